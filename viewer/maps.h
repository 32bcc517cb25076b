/* maps.h - pictures about a light field: the cache map (the paper's figure 8), a slice (figures 2a
 * and 3a), a difference. They are made into memory that lives until the next call or maps_clear. */
#ifndef MAPS_H
#define MAPS_H

#include "block_cache.h"

typedef struct {
  uint8_t *rgba;
  size_t capacity;
  /* Which slice is in it, so that it is decoded once. */
  const slf_file *file;
  uint32_t surface, layer, s, t;
} maps;

void maps_clear(maps *m);

/* One box for each (S,T) that has a slice, S to the right and T down; one pixel for each block of
 * 8x8 texels: green where it is cached, red where it was decompressed in this frame. Fills a line
 * of text about it. The layer must exist; NULL if memory ran out. */
const uint8_t *maps_cache(maps *m, const slf_file *file, const block_cache *cache,
                          uint32_t surface_index, uint32_t layer_index, char *text,
                          size_t text_nbytes, int *width, int *height);

/* One slice in display code. */
const uint8_t *maps_slice(maps *m, const slf_file *file, uint32_t surface_index,
                          uint32_t layer_index, uint32_t s_index, uint32_t t_index, char *text,
                          size_t text_nbytes, int *width, int *height);

/* Eight times the absolute difference of two pictures, R G B A. */
const uint8_t *maps_difference(maps *m, const uint8_t *a, const uint8_t *b, size_t pixel_count);

#endif
