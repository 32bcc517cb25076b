/* Each allocation fails once: the library says so, leaks nothing and leaves no file behind. */
#include "codec/slf.h"

#include <dlfcn.h>
#include <glob.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#if defined(__SANITIZE_ADDRESS__)
#define SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define SANITIZED 1
#endif
#endif

#ifdef SANITIZED
/* The sanitizer's allocator cannot be stood in for; the plain program runs the same test. */
int main(void) {
  printf("1..0 # SKIP the sanitizer allocates\n");
  return 0;
}
#else

static long until_failure = -1; /* allocations that still succeed; -1: all */
static long live_count;         /* blocks that were not freed yet, while counting */
static bool counting;

static bool fails(void) {
  if (until_failure < 0) return false;
  if (until_failure == 0) return true;
  until_failure--;
  return false;
}

/* glibc's own names for its allocator: these functions take its place in this program. */
extern void *__libc_malloc(size_t nbytes);
extern void *__libc_calloc(size_t count, size_t nbytes);
extern void *__libc_realloc(void *old, size_t nbytes);
extern void __libc_free(void *block);

#define SEEN __attribute__((visibility("default"))) /* by libc, which allocates for strdup */

SEEN void *malloc(size_t nbytes) {
  void *block = counting && fails() ? NULL : __libc_malloc(nbytes);
  live_count += counting && block;
  return block;
}
SEEN void *calloc(size_t count, size_t nbytes) {
  void *block = counting && fails() ? NULL : __libc_calloc(count, nbytes);
  live_count += counting && block;
  return block;
}
SEEN void *realloc(void *old, size_t nbytes) {
  void *block = counting && fails() ? NULL : __libc_realloc(old, nbytes);
  live_count += counting && block && !old;
  return block;
}
SEEN void free(void *block) {
  live_count -= counting && block;
  __libc_free(block);
}

static slf_result read_slice(void *context, uint32_t s, uint32_t t, float *rgb, slf_error *error) {
  (void)context;
  (void)error;
  for (int i = 0; i < 12 * 12 * 3; i++)
    rgb[i] = (float)((i * 7 + (int)s * 13 + (int)t * 29) % 64) / 64;
  return SLF_OK;
}

static char path[64];

static slf_result write_file(slf_angular angular, slf_error *error) {
  static const slf_vertex vertices[3];
  static const uint32_t triangles[3] = {0, 1, 2};
  slf_writer *writer;
  slf_view view = {"v", {0, 0, 0}, {0, 0, 1}, 50};
  slf_surface surface = {.name = "s", .mesh = {vertices, triangles, 3, 1}};
  slf_layer_options options = {.angular = angular,
                               .u_count = 12,
                               .v_count = 12,
                               .s_count = 5,
                               .t_count = 5,
                               .quality = 70,
                               .thread_count = 1};
  slf_source source = {read_slice, NULL, NULL};
  slf_result result = slf_writer_create(path, &writer, error);
  if (result != SLF_OK) return result;
  if ((result = slf_writer_add_view(writer, &view, error)) == SLF_OK &&
      (result = slf_writer_add_surface(writer, &surface, error)) == SLF_OK &&
      (result = slf_writer_add_layer(writer, &options, &source, error)) == SLF_OK)
    return slf_writer_finish(writer, error);
  slf_writer_abort(writer);
  return result;
}

static slf_result open_and_verify(slf_error *error) {
  slf_file *file;
  slf_result result = slf_open(path, &file, error);
  if (result == SLF_OK) result = slf_verify(file, error);
  slf_close(file);
  return result;
}

static size_t files_beside(void) {
  char pattern[80];
  glob_t found;
  snprintf(pattern, sizeof pattern, "%s*", path);
  glob(pattern, 0, NULL, &found);
  size_t count = found.gl_pathc;
  globfree(&found);
  return count;
}

static const slf_angular schemes[] = {SLF_ANGULAR_NONE, SLF_ANGULAR_IDENTICAL, SLF_ANGULAR_MOTION,
                                      SLF_ANGULAR_LAYERED};

static void writing_survives(void **state) {
  (void)state;
  for (int scheme = 0; scheme < 4; scheme++) {
    long failures = 0;
    slf_result result = SLF_ERROR_MEMORY;
    for (; result != SLF_OK; failures++) {
      slf_error error = {""};
      unlink(path);
      counting = true;
      live_count = 0;
      until_failure = failures;
      result = write_file(schemes[scheme], &error);
      counting = false;
      if (result == SLF_OK) break;
      assert_int_equal(result, SLF_ERROR_MEMORY);
      assert_true(error.message[0]);
      assert_int_equal(live_count, 0);
      assert_int_equal(files_beside(), 0);
    }
    print_message("  scheme %d: %ld allocations\n", scheme, failures);
    assert_true(failures > 10);
    assert_int_equal(live_count, 0);
  }
}

static void opening_survives(void **state) {
  (void)state;
  for (int scheme = 0; scheme < 4; scheme++) {
    slf_error error;
    until_failure = -1;
    assert_int_equal(write_file(schemes[scheme], &error), SLF_OK);
    slf_result result = SLF_ERROR_MEMORY;
    for (long failures = 0; result != SLF_OK; failures++) {
      counting = true;
      live_count = 0;
      until_failure = failures;
      result = open_and_verify(&error);
      counting = false;
      if (result != SLF_OK) assert_int_equal(result, SLF_ERROR_MEMORY);
      assert_int_equal(live_count, 0);
    }
  }
}

static int make_path(void **state) {
  (void)state;
  snprintf(path, sizeof path, "/tmp/slf_codec_memory.%ld.slf", (long)getpid());
  return 0;
}

static int remove_path(void **state) {
  (void)state;
  return unlink(path);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(writing_survives),
                                     cmocka_unit_test(opening_survives)};
  return cmocka_run_group_tests_name("codec_memory", tests, make_path, remove_path);
}
#endif
