/* Apart from files that use gl_api.h: osmesa.h brings GL/gl.h, which declares other prototypes. */
#include <GL/osmesa.h>
#include <stdio.h>

#include "context.h"

#define OSMESA_FUNCTIONS(X)                                                                        \
  X(OSMesaCreateContextAttribs)                                                                    \
  X(OSMesaMakeCurrent)                                                                             \
  X(OSMesaDestroyContext)                                                                          \
  X(OSMesaGetProcAddress)

static union {
  struct {
#define MEMBER(name) __typeof__(name) *name;
    OSMESA_FUNCTIONS(MEMBER)
#undef MEMBER
  } call;
  void *functions[8];
} osmesa;

static OSMesaContext osmesa_context;

typedef void (*gl_function)(void);
slf_result gl_api_load(gl_function (*get_address)(const char *name), slf_error *error);

static gl_function get_address(const char *name) {
  return (gl_function)osmesa.call.OSMesaGetProcAddress(name);
}

slf_result context_open_osmesa(slf_error *error) {
  static const char *const names[] = {"libOSMesa.so.8", "libOSMesa.so", NULL};
  static const char *const symbols[] = {
#define SYMBOL(name) #name,
      OSMESA_FUNCTIONS(SYMBOL)
#undef SYMBOL
          NULL};
  slf_result result = load_library(names, symbols, osmesa.functions, error);
  if (result != SLF_OK) return result;
  static const int attributes[] = {OSMESA_FORMAT,
                                   OSMESA_RGBA,
                                   OSMESA_PROFILE,
                                   OSMESA_CORE_PROFILE,
                                   OSMESA_CONTEXT_MAJOR_VERSION,
                                   3,
                                   OSMESA_CONTEXT_MINOR_VERSION,
                                   3,
                                   OSMESA_DEPTH_BITS,
                                   24,
                                   0};
  /* It wants a default buffer; nothing is drawn to it. */
  static unsigned char buffer[4];
  osmesa_context = osmesa.call.OSMesaCreateContextAttribs(attributes, NULL);
  if (!osmesa_context ||
      !osmesa.call.OSMesaMakeCurrent(osmesa_context, buffer, GL_UNSIGNED_BYTE, 1, 1)) {
    snprintf(error->message, sizeof error->message, "OSMesa: no context for OpenGL 3.3 core");
    return SLF_ERROR_IO;
  }
  return gl_api_load(get_address, error);
}

void context_close_osmesa(void) {
  if (osmesa_context) osmesa.call.OSMesaDestroyContext(osmesa_context);
  osmesa_context = NULL;
}
