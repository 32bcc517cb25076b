/* gl_api.h - the functions of OpenGL 3.3 core that the viewer calls, loaded at run time.
 *
 * Kept by hand: one list serves GLFW, EGL and OSMesa (each brings its own loader), and only what is
 * common to GL 3.3 core, GLES 3.0 and WebGL 2 is on it. */
#ifndef GL_API_H
#define GL_API_H

#include <GL/glcorearb.h>

#include "slf.h"

#define GL_FUNCTIONS(X)                                                                            \
  X(PFNGLACTIVETEXTUREPROC, ActiveTexture)                                                         \
  X(PFNGLATTACHSHADERPROC, AttachShader)                                                           \
  X(PFNGLBINDBUFFERPROC, BindBuffer)                                                               \
  X(PFNGLBINDFRAMEBUFFERPROC, BindFramebuffer)                                                     \
  X(PFNGLBINDRENDERBUFFERPROC, BindRenderbuffer)                                                   \
  X(PFNGLBINDTEXTUREPROC, BindTexture)                                                             \
  X(PFNGLBINDVERTEXARRAYPROC, BindVertexArray)                                                     \
  X(PFNGLBLENDFUNCPROC, BlendFunc)                                                                 \
  X(PFNGLBLITFRAMEBUFFERPROC, BlitFramebuffer)                                                     \
  X(PFNGLBUFFERDATAPROC, BufferData)                                                               \
  X(PFNGLCHECKFRAMEBUFFERSTATUSPROC, CheckFramebufferStatus)                                       \
  X(PFNGLCLEARPROC, Clear)                                                                         \
  X(PFNGLCLEARCOLORPROC, ClearColor)                                                               \
  X(PFNGLCOMPILESHADERPROC, CompileShader)                                                         \
  X(PFNGLCREATEPROGRAMPROC, CreateProgram)                                                         \
  X(PFNGLCREATESHADERPROC, CreateShader)                                                           \
  X(PFNGLCULLFACEPROC, CullFace)                                                                   \
  X(PFNGLDELETEBUFFERSPROC, DeleteBuffers)                                                         \
  X(PFNGLDELETEFRAMEBUFFERSPROC, DeleteFramebuffers)                                               \
  X(PFNGLDELETEPROGRAMPROC, DeleteProgram)                                                         \
  X(PFNGLDELETERENDERBUFFERSPROC, DeleteRenderbuffers)                                             \
  X(PFNGLDELETESHADERPROC, DeleteShader)                                                           \
  X(PFNGLDELETETEXTURESPROC, DeleteTextures)                                                       \
  X(PFNGLDELETEVERTEXARRAYSPROC, DeleteVertexArrays)                                               \
  X(PFNGLDEPTHFUNCPROC, DepthFunc)                                                                 \
  X(PFNGLDISABLEPROC, Disable)                                                                     \
  X(PFNGLDRAWARRAYSPROC, DrawArrays)                                                               \
  X(PFNGLDRAWELEMENTSPROC, DrawElements)                                                           \
  X(PFNGLENABLEPROC, Enable)                                                                       \
  X(PFNGLENABLEVERTEXATTRIBARRAYPROC, EnableVertexAttribArray)                                     \
  X(PFNGLFINISHPROC, Finish)                                                                       \
  X(PFNGLFLUSHPROC, Flush)                                                                         \
  X(PFNGLFRAMEBUFFERRENDERBUFFERPROC, FramebufferRenderbuffer)                                     \
  X(PFNGLGENBUFFERSPROC, GenBuffers)                                                               \
  X(PFNGLGENERATEMIPMAPPROC, GenerateMipmap)                                                       \
  X(PFNGLGENFRAMEBUFFERSPROC, GenFramebuffers)                                                     \
  X(PFNGLGENRENDERBUFFERSPROC, GenRenderbuffers)                                                   \
  X(PFNGLGENTEXTURESPROC, GenTextures)                                                             \
  X(PFNGLGENVERTEXARRAYSPROC, GenVertexArrays)                                                     \
  X(PFNGLGETERRORPROC, GetError)                                                                   \
  X(PFNGLGETINTEGERVPROC, GetIntegerv)                                                             \
  X(PFNGLGETPROGRAMIVPROC, GetProgramiv)                                                           \
  X(PFNGLGETPROGRAMINFOLOGPROC, GetProgramInfoLog)                                                 \
  X(PFNGLGETSHADERIVPROC, GetShaderiv)                                                             \
  X(PFNGLGETSHADERINFOLOGPROC, GetShaderInfoLog)                                                   \
  X(PFNGLGETSTRINGPROC, GetString)                                                                 \
  X(PFNGLGETSTRINGIPROC, GetStringi)                                                               \
  X(PFNGLGETUNIFORMLOCATIONPROC, GetUniformLocation)                                               \
  X(PFNGLLINKPROGRAMPROC, LinkProgram)                                                             \
  X(PFNGLPIXELSTOREIPROC, PixelStorei)                                                             \
  X(PFNGLREADPIXELSPROC, ReadPixels)                                                               \
  X(PFNGLRENDERBUFFERSTORAGEPROC, RenderbufferStorage)                                             \
  X(PFNGLSHADERSOURCEPROC, ShaderSource)                                                           \
  X(PFNGLTEXIMAGE2DPROC, TexImage2D)                                                               \
  X(PFNGLTEXPARAMETERFPROC, TexParameterf)                                                         \
  X(PFNGLTEXPARAMETERIPROC, TexParameteri)                                                         \
  X(PFNGLTEXSUBIMAGE2DPROC, TexSubImage2D)                                                         \
  X(PFNGLUNIFORM1FPROC, Uniform1f)                                                                 \
  X(PFNGLUNIFORM4FPROC, Uniform4f)                                                                 \
  X(PFNGLUNIFORM1IPROC, Uniform1i)                                                                 \
  X(PFNGLUNIFORMMATRIX4FVPROC, UniformMatrix4fv)                                                   \
  X(PFNGLUSEPROGRAMPROC, UseProgram)                                                               \
  X(PFNGLVERTEXATTRIBPOINTERPROC, VertexAttribPointer)                                             \
  X(PFNGLVIEWPORTPROC, Viewport)

typedef struct {
#define MEMBER(type, name) type name;
  GL_FUNCTIONS(MEMBER)
#undef MEMBER
} gl_api;

/* The functions of the context that is current. Loaded once; there is one context a program. */
extern gl_api gl;

typedef void (*gl_function)(void);

/* Fills `gl` from a context's loader. Fails, naming the function, if one is missing. */
slf_result gl_api_load(gl_function (*get_address)(const char *name), slf_error *error);

/* Compiles and links a program. */
slf_result gl_link_program(const char *vertex_source, const char *fragment_source, GLuint *program,
                           slf_error *error);

#endif
