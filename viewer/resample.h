/* resample.h - the four-tap mix: radiance of 8x8 texels in given directions, out of a light field.
 *
 * For every texel of a block of 8x8 there is a direction (S,T). The four slices around it are mixed
 * bilinearly, in linear light, at that very texel (paper, section 2.1: bilinear, not quadrilinear).
 * (S,T) may come from the viewing direction (texture.h) or from anything else, such as rays
 * reflected by ripples: it may differ from texel to texel.
 *
 * Blocks stream through: resample_block finds the slices of its block, asks the source for them,
 * and, while they come into the processor's cache, mixes a block given before it; of a source that
 * decompresses, several blocks, whose missing slices are then decompressed together. One look-up
 * serves all texels of a block that read a slice; a C-Block is asked for once a call. So call
 * resample_block once for each block of texels and resample_flush after the last:
 *
 *     for each block (block_u, block_v) of the texture:
 *       fill directions.s, .t (and .mask)
 *       resample_block(r, block_u, block_v, &directions, texture + ..., row_nbytes);
 *     resample_flush(r);
 *
 * A resampler belongs to one thread at a time. */
#ifndef RESAMPLE_H
#define RESAMPLE_H

#include <stdbool.h>

#include "block_source.h"

/* The directions of 8x8 texels; texel 8 * row + column. (S,T) as in eq. 1, any values: outside the
 * hemisphere they are pulled back along the radius to the rim, however far they are; NaN and
 * infinity read as 1/2. Texels whose bit in mask is clear come out as zeros. */
typedef struct {
  float s[64], t[64];
  uint64_t mask;
} block_directions;

typedef struct resampler resampler;

/* For a light field of s_count x t_count directions (1 .. SLF_MAX_DIRECTIONS). The source must
 * outlive it. NULL if memory ran out. */
resampler *resampler_create(uint32_t s_count, uint32_t t_count, block_source source);
void resampler_free(resampler *r); /* accepts NULL */

/* What the source's U-Blocks hold; U_BLOCK_CODES at first. */
void resampler_use_format(resampler *r, u_block_format format);

/* From the next block on, another light field of the same texels: a level of detail with fewer
 * directions (angular_level.h). At most as many as at creation. */
void resampler_use_slices(resampler *r, uint32_t s_count, uint32_t t_count, block_source source);

/* Takes in a block of texels, copying *directions, and writes ones taken in before. `out` is 8 rows
 * of 8 texels R G B A, rows row_nbytes apart, linear radiance as IEEE half floats, A = 1; it is
 * written by a later call or by the flush, and must stay valid until then. Whatever else takes
 * blocks from the source's cache waits for the flush. (Half floats: what
 * is mixed in linear light is filtered in linear light, so going back to display code in between
 * would cost a root and a division a texel, and precision.) */
void resample_block(resampler *r, uint32_t block_u, uint32_t block_v,
                    const block_directions *directions, uint16_t *out, size_t row_nbytes);
void resample_flush(resampler *r);

/* Calls `ask` with the slices that resample_block will ask the source for, mixing nothing. */
void resample_ask(resampler *r, uint32_t block_u, uint32_t block_v,
                  const block_directions *directions,
                  void (*ask)(void *context, uint32_t block_u, uint32_t block_v,
                              const slice_index *slices, size_t count),
                  void *context);

/* The plain C and the vector kernels give the same bytes; tests hold them against each other. */
typedef enum { RESAMPLE_BEST, RESAMPLE_PLAIN_C } resample_kernel;
void resampler_use_kernel(resampler *r, resample_kernel kernel);

#endif
