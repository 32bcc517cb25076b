#define EGL_NO_X11
#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <stdio.h>

#include "context.h"
#include "gl_api.h"

#define EGL_FUNCTIONS(X)                                                                           \
  X(eglGetProcAddress)                                                                             \
  X(eglInitialize)                                                                                 \
  X(eglBindAPI)                                                                                    \
  X(eglCreateContext)                                                                              \
  X(eglMakeCurrent)                                                                                \
  X(eglDestroyContext)                                                                             \
  X(eglTerminate)                                                                                  \
  X(eglGetError)

static union {
  struct {
#define MEMBER(name) __typeof__(name) *name;
    EGL_FUNCTIONS(MEMBER)
#undef MEMBER
  } call;
  void *functions[16];
} egl;

static EGLDisplay display;
static EGLContext egl_context;

static gl_function get_address(const char *name) {
  return (gl_function)egl.call.eglGetProcAddress(name);
}

static slf_result refuse(const char *what, slf_error *error) {
  snprintf(error->message, sizeof error->message, "EGL: %s failed (0x%x)", what,
           (unsigned)egl.call.eglGetError());
  return SLF_ERROR_IO;
}

slf_result context_open_egl(slf_error *error) {
  static const char *const names[] = {"libEGL.so.1", "libEGL.so", NULL};
  static const char *const symbols[] = {
#define SYMBOL(name) #name,
      EGL_FUNCTIONS(SYMBOL)
#undef SYMBOL
          NULL};
  slf_result result = load_library(names, symbols, egl.functions, error);
  if (result != SLF_OK) return result;
  PFNEGLGETPLATFORMDISPLAYEXTPROC get_display =
      (PFNEGLGETPLATFORMDISPLAYEXTPROC)get_address("eglGetPlatformDisplayEXT");
  if (!get_display) return refuse("eglGetPlatformDisplayEXT", error);
  display = get_display(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL);
  if (!display || !egl.call.eglInitialize(display, NULL, NULL))
    return refuse("the surfaceless display", error);
  if (!egl.call.eglBindAPI(EGL_OPENGL_API)) return refuse("eglBindAPI(OpenGL)", error);
  static const EGLint attributes[] = {EGL_CONTEXT_MAJOR_VERSION,
                                      3,
                                      EGL_CONTEXT_MINOR_VERSION,
                                      3,
                                      EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                      EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                      EGL_NONE};
  /* No surface and so no config: all drawing goes to framebuffer objects. */
  egl_context = egl.call.eglCreateContext(display, (EGLConfig)0, EGL_NO_CONTEXT, attributes);
  if (egl_context == EGL_NO_CONTEXT) return refuse("eglCreateContext(3.3 core)", error);
  if (!egl.call.eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, egl_context))
    return refuse("eglMakeCurrent", error);
  return gl_api_load(get_address, error);
}

void context_close_egl(void) {
  if (!display) return;
  egl.call.eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  if (egl_context) egl.call.eglDestroyContext(display, egl_context);
  egl.call.eglTerminate(display);
  egl_context = NULL;
  display = NULL;
}
