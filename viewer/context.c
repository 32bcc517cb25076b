#include "context.h"

#include <dlfcn.h>
#include <stdio.h>

const char *const backend_names[BACKEND_COUNT] = {"glfw", "egl", "osmesa"};

slf_result load_library(const char *const *names, const char *const *symbols, void **functions,
                        slf_error *error) {
  void *library = NULL;
  for (size_t i = 0; names[i] && !library; i++) library = dlopen(names[i], RTLD_NOW | RTLD_LOCAL);
  if (!library) {
    snprintf(error->message, sizeof error->message, "%s: cannot be loaded: %s", names[0],
             dlerror());
    return SLF_ERROR_IO;
  }
  for (size_t i = 0; symbols[i]; i++) {
    functions[i] = dlsym(library, symbols[i]);
    if (!functions[i]) {
      snprintf(error->message, sizeof error->message, "%s: has no %s", names[0], symbols[i]);
      return SLF_ERROR_IO;
    }
  }
  return SLF_OK;
}
