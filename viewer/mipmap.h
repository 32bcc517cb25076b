/* mipmap.h - the coarser levels of a texture that changes every frame.
 *
 * Texels are R G B A in linear half floats, colour premultiplied by A, so that the plain mean of
 * texels is the mean weighted by coverage. Each level is floor(half) of the one before, at least 1;
 * along an odd side a texel covers 2 + 1/floor(n/2) of the finer ones and three are mixed, so that
 * no level is shifted against another. */
#ifndef MIPMAP_H
#define MIPMAP_H

#include <stddef.h>
#include <stdint.h>

enum { MIPMAP_MAX_LEVELS = 15 }; /* log2(SLF_MAX_TEXELS) + 1 */

typedef struct {
  uint32_t width, height; /* texels */
  size_t row_nbytes;
  uint16_t *texels;
} mipmap_level;

/* Texels x0 <= x < x1, y0 <= y < y1. */
typedef struct {
  uint32_t x0, y0, x1, y1;
} mipmap_area;

/* Adds the colours of another light's level to those of the same texels; both have the same size,
 * and coverage is the same. */
void mipmap_add(const mipmap_level *light, const mipmap_level *sum, mipmap_area area);
/* The same in plain C, the same bytes. */
void mipmap_add_plain(const mipmap_level *light, const mipmap_level *sum, mipmap_area area);

/* The texels of the next level that `area` of this one reaches. */
mipmap_area mipmap_reached(const mipmap_level *fine, mipmap_area area);

/* Makes `area` of a level out of the finer one. */
void mipmap_reduce(const mipmap_level *fine, const mipmap_level *coarse, mipmap_area area);
/* The same in plain C, the same bytes. */
void mipmap_reduce_plain(const mipmap_level *fine, const mipmap_level *coarse, mipmap_area area);

#endif
