#include "gl_api.h"

#include <stdio.h>

gl_api gl;

slf_result gl_api_load(gl_function (*get_address)(const char *name), slf_error *error) {
#define LOAD(type, name)                                                                           \
  gl.name = (type)get_address("gl" #name);                                                         \
  if (!gl.name) {                                                                                  \
    snprintf(error->message, sizeof error->message, "OpenGL: no gl" #name " (3.3 core needed)");   \
    return SLF_ERROR_IO;                                                                           \
  }
  GL_FUNCTIONS(LOAD)
#undef LOAD
  return SLF_OK;
}

static GLuint compile(GLenum kind, const char *source, slf_error *error) {
  GLuint shader = gl.CreateShader(kind);
  GLint ok = 0;
  gl.ShaderSource(shader, 1, &source, NULL);
  gl.CompileShader(shader);
  gl.GetShaderiv(shader, GL_COMPILE_STATUS, &ok);
  if (ok) return shader;
  gl.GetShaderInfoLog(shader, sizeof error->message, NULL, error->message);
  gl.DeleteShader(shader);
  return 0;
}

slf_result gl_link_program(const char *vertex_source, const char *fragment_source, GLuint *program,
                           slf_error *error) {
  GLuint vertex = compile(GL_VERTEX_SHADER, vertex_source, error);
  GLuint fragment = compile(GL_FRAGMENT_SHADER, fragment_source, error);
  GLint ok = 0;
  *program = 0;
  if (vertex && fragment) {
    *program = gl.CreateProgram();
    gl.AttachShader(*program, vertex);
    gl.AttachShader(*program, fragment);
    gl.LinkProgram(*program);
    gl.GetProgramiv(*program, GL_LINK_STATUS, &ok);
    if (!ok) {
      gl.GetProgramInfoLog(*program, sizeof error->message, NULL, error->message);
      gl.DeleteProgram(*program);
      *program = 0;
    }
  }
  gl.DeleteShader(vertex);
  gl.DeleteShader(fragment);
  return ok ? SLF_OK : SLF_ERROR_IO;
}
