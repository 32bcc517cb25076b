#include "fail.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

void fail(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  fputs("slf: ", stderr);
  vfprintf(stderr, format, arguments);
  fputc('\n', stderr);
  va_end(arguments);
  exit(1);
}

void *allocate(size_t count, size_t nbytes, const char *what) {
  void *memory = calloc(count ? count : 1, nbytes);
  if (!memory) fail("%s: no memory for %zu x %zu bytes", what, count, nbytes);
  return memory;
}

char *format_text(const char *format, ...) {
  va_list arguments;
  char *text;
  va_start(arguments, format);
  if (vasprintf(&text, format, arguments) < 0) fail("no memory for a path");
  va_end(arguments);
  return text;
}
