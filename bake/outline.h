/* outline.h - the texels of a chunk of layers at which one thing that is reflected ends and another
 * begins. One ray tells which of them a texel shows; all rays of a sample, seen through a far fog
 * alone (fog.h), tell how much of it.
 *
 * The camera sends the rays of one texel after the other, behind one from the surface's middle
 * straight up, as POV-Ray takes the objects around the first ray's origin to be around all. */
#ifndef BAKE_OUTLINE_H
#define BAKE_OUTLINE_H

#include <stdint.h>
#include <stdio.h>

#include "surface.h"

typedef struct {
  uint32_t slice; /* of the chunk */
  uint32_t texel;
} outline_texel;

typedef struct {
  uint32_t count;
  outline_texel *texels;
} outline_list;

/* Of slice_count images of heights (u_count x v_count x 3, scene units, the first channel counts),
 * `stride` numbers apart: texels whose height is of another thing than that of one of the eight
 * around. The caller frees texels. */
outline_list outlines_find(const surface *, const float *heights, size_t stride,
                           uint32_t slice_count);

/* The caller frees texels. */
outline_list outlines_read(const char *path, const surface *, uint32_t slice_count);
void outlines_write(const outline_list *, FILE *to, const char *name);

/* Size of the frame that shows `rays` rays of each: ray m of texel i is pixel 1 + i rays + m of
 * what follows the first row. */
enum { OUTLINE_FRAME_WIDTH = 1024 };
uint32_t outline_frame_height(const outline_list *, uint32_t rays);

#endif
