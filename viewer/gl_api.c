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
