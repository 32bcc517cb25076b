#include "checked_file.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

struct checked_file {
  slf_file *file;
  char *path;
  pthread_t thread;
  bool joinable;
  atomic_bool done; /* result and error are written before */
  slf_result result;
  slf_error error;
};

static void *verify(void *context) {
  checked_file *c = context;
  c->result = slf_verify(c->file, &c->error);
  atomic_store(&c->done, true);
  return NULL;
}

slf_result checked_file_open(const char *path, bool coming, checked_file **out, slf_error *error) {
  *out = NULL;
  checked_file *c = calloc(1, sizeof *c);
  char *copy = strdup(path);
  if (!c || !copy) {
    strcpy(error->message, "out of memory");
    free(c);
    free(copy);
    return SLF_ERROR_MEMORY;
  }
  c->path = copy;
  slf_result result =
      coming ? slf_open_prefix(path, &c->file, error) : slf_open(path, &c->file, error);
  if (result != SLF_OK) {
    checked_file_close(c);
    return result;
  }
  c->joinable = pthread_create(&c->thread, NULL, verify, c) == 0;
  if (!c->joinable) verify(c);
  *out = c;
  return SLF_OK;
}

slf_result checked_file_wait(checked_file *c, slf_error *error) {
  if (c->joinable) pthread_join(c->thread, NULL);
  c->joinable = false;
  if (c->result != SLF_OK) *error = c->error;
  return c->result;
}

bool checked_file_done(const checked_file *c, slf_result *result, slf_error *error) {
  if (!atomic_load(&c->done)) return false;
  *result = c->result;
  if (c->result != SLF_OK) *error = c->error;
  return true;
}

void checked_file_close(checked_file *c) {
  if (!c) return;
  if (c->joinable) pthread_join(c->thread, NULL);
  slf_close(c->file);
  free(c->path);
  free(c);
}

const slf_file *checked_file_get(const checked_file *c) {
  return c->file;
}

const char *checked_file_path(const checked_file *c) {
  return c->path;
}
