/* scratch.h - a file without a name, where an encoder puts what is done until all is known. */
#ifndef SLF_SCRATCH_H
#define SLF_SCRATCH_H

#include "codec/format.h"

typedef struct {
  int descriptor; /* -1: not open */
  uint64_t nbytes;
  int error_number; /* errno of the first write that failed; asked once, at the end */
} scratch_file;

/* Begins one in the folder of `path`, where there is room for what is to be written there. It goes
 * when it is closed, or the program ends. */
slf_result scratch_open(const char *path, scratch_file *scratch, slf_error *error);
void scratch_close(scratch_file *scratch);

/* Writes at an offset, beyond the end too. */
void scratch_write(scratch_file *scratch, uint64_t offset, const void *bytes, uint64_t nbytes);

/* Forgets what lies beyond. */
void scratch_truncate(scratch_file *scratch, uint64_t nbytes);

/* A part of it, to read. */
typedef struct {
  const uint8_t *bytes; /* NULL: not mapped */
  void *pages;
  size_t pages_nbytes;
} scratch_map;

slf_result scratch_map_part(const scratch_file *scratch, uint64_t offset, uint64_t nbytes,
                            const char *name, scratch_map *map, slf_error *error);
void scratch_unmap(scratch_map *map);

/* Writes all of `nbytes` bytes to a descriptor at an offset; false with errno. */
bool write_at(int descriptor, uint64_t offset, const void *bytes, uint64_t nbytes);

#endif
