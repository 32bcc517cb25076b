/* fail.h - the bake's programs are short-lived: what the world does wrong ends them. */
#ifndef BAKE_FAIL_H
#define BAKE_FAIL_H

#include <stddef.h>

/* Prints "slf: ", the message and a newline on stderr; exits 1. */
_Noreturn void fail(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* `count` zeroed items of `nbytes`, for the thing named `what`; fails if there is no memory. */
void *allocate(size_t count, size_t nbytes, const char *what);

/* A path or other text, to be freed by the caller. */
char *format_text(const char *format, ...) __attribute__((format(printf, 1, 2)));

#endif
