/* context.h - a GL 3.3 core context: a window (GLFW), or none (EGL surfaceless, OSMesa).
 *
 * Each library is loaded when it is asked for (dlopen), so that one binary runs where only one of
 * them is installed. A context is current on the thread that opened it. */
#ifndef CONTEXT_H
#define CONTEXT_H

#include "slf.h"

typedef enum { BACKEND_GLFW, BACKEND_EGL, BACKEND_OSMESA, BACKEND_COUNT } backend;

extern const char *const backend_names[BACKEND_COUNT]; /* "glfw", "egl", "osmesa" */

/* Opens a context and fills `gl`. For GLFW see window.h. */
slf_result context_open_egl(slf_error *error);
slf_result context_open_osmesa(slf_error *error);
/* Frees what context_open_... made; harmless otherwise. */
void context_close_egl(void);
void context_close_osmesa(void);

/* Opens a shared library by the first of `names` (NULL ends the list) that loads and looks up the
 * functions `symbols` (NULL ends it) into `functions`. The library stays loaded. */
slf_result load_library(const char *const *names, const char *const *symbols, void **functions,
                        slf_error *error);

#endif
