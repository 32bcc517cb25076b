#include "codec/scratch.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

slf_result scratch_open(const char *path, scratch_file *scratch, slf_error *error) {
  char *name;
  *scratch = (scratch_file){.descriptor = -1};
  if (asprintf(&name, "%s.%ld.scratch", path, (long)getpid()) < 0)
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", path);
  scratch->descriptor = open(name, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  slf_result result = SLF_OK;
  if (scratch->descriptor < 0)
    result = slf_fail(error, SLF_ERROR_IO, "%s: %s", name, strerror(errno));
  else
    unlink(name);
  free(name);
  return result;
}

void scratch_close(scratch_file *scratch) {
  if (scratch->descriptor >= 0) close(scratch->descriptor);
  scratch->descriptor = -1;
}

bool write_at(int descriptor, uint64_t offset, const void *bytes, uint64_t nbytes) {
  const uint8_t *p = bytes;
  while (nbytes) {
    ssize_t written = pwrite(descriptor, p, nbytes < 1 << 30 ? nbytes : 1 << 30, (off_t)offset);
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return false;
    p += written;
    offset += (uint64_t)written;
    nbytes -= (uint64_t)written;
  }
  return true;
}

void scratch_write(scratch_file *scratch, uint64_t offset, const void *bytes, uint64_t nbytes) {
  if (offset + nbytes > scratch->nbytes) scratch->nbytes = offset + nbytes;
  if (scratch->error_number == 0 && !write_at(scratch->descriptor, offset, bytes, nbytes))
    scratch->error_number = errno;
}

void scratch_truncate(scratch_file *scratch, uint64_t nbytes) {
  scratch->nbytes = nbytes;
  if (ftruncate(scratch->descriptor, (off_t)nbytes) != 0) scratch->error_number = errno;
}

slf_result scratch_map_part(const scratch_file *scratch, uint64_t offset, uint64_t nbytes,
                            const char *name, scratch_map *map, slf_error *error) {
  uint64_t page = (uint64_t)sysconf(_SC_PAGESIZE), before = offset % page;
  *map = (scratch_map){.pages_nbytes = (size_t)(before + nbytes)};
  map->pages = mmap(NULL, map->pages_nbytes, PROT_READ, MAP_SHARED, scratch->descriptor,
                    (off_t)(offset - before));
  if (map->pages == MAP_FAILED) {
    map->pages = NULL;
    return slf_fail(error, SLF_ERROR_IO, "%s: %s", name, strerror(errno));
  }
  map->bytes = (const uint8_t *)map->pages + before;
  return SLF_OK;
}

void scratch_unmap(scratch_map *map) {
  if (map->pages) munmap(map->pages, map->pages_nbytes);
  *map = (scratch_map){0};
}
