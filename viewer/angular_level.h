/* angular_level.h - a light field with fewer directions.
 *
 * Level l has ceil(N / 2^l) slices along an axis of N. Its slices share the axis evenly: slice i of
 * n is the mean, in linear light, of the slices [i N / n, (i + 1) N / n) of level 0, ends rounded
 * to whole slices. So the four-tap mix of a coarser level is a smooth one over all directions, with
 * no double images, and the coarsest level, one slice, is matte. Of more than four slices along an
 * axis four stand for all, evenly spread, so that a block costs at most 16 C-Blocks at any level.
 */
#ifndef ANGULAR_LEVEL_H
#define ANGULAR_LEVEL_H

#include "block_source.h"
#include "slf.h"

enum { ANGULAR_MAX_LEVEL = 8, ANGULAR_MAX_SAMPLES = 16 };

/* Slices along an axis of `count` (1 .. SLF_MAX_DIRECTIONS) at a level, 0 .. ANGULAR_MAX_LEVEL. */
uint32_t angular_count(uint32_t count, uint32_t level);

/* The slices of level 0, all stored ones, whose mean is a slice of this level; returns how many.
 * Where none of the slice's own is stored it is the stored one next to them, towards the middle. */
size_t angular_samples(uint32_t s_count, uint32_t t_count, uint32_t level, slice_index slice,
                       slice_index samples[ANGULAR_MAX_SAMPLES]);

#endif
