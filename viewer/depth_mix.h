/* depth_mix.h - the mix that knows how high above a surface the things are that it reflects:
 * it reads each slice where that sees the same point, so that mirrors stay mirrors.
 *
 * A ray leaves texel p with slopes q = (s, t) / n, in texels a unit of height, and what it reflects
 * lies at height h: over p - h q. Slice i sees that point at
 *     p_i = p + h (q_i - q),
 * if nothing in between hides it, and then its own height there is h. What the slices around (S,T)
 * say of h is weighed against each other: a slice that sees something lower is merely hidden and
 * has no say; one that looks further, through the point, proves that the point is not there. At an
 * outline texels of slices do the one and the other, or in part, where the file knows their
 * coverage, and their shares say how much of the texel the thing covers.
 *
 * Behind a slab (slf.h) h begins at its far side, and what rays pass in between counts as their
 * way through it: p_i = p + h (q_i - q) + w_i - w, w = thickness (s, t) / sqrt(ior^2 - s^2 - t^2).
 *
 * A mixer belongs to one thread at a time, but for depth_mix_block_shared. */
#ifndef DEPTH_MIX_H
#define DEPTH_MIX_H

#include "depth_pages.h"
#include "resample.h"

typedef struct depth_mixer depth_mixer;

/* Texels along u and v per scene unit along tangent_u and tangent_v, {u_tu, u_tv, v_tu, v_tv}, of a
 * surface that is flat and whose P(U,V) is affine; false for any other. */
bool flat_texel_scale(const slf_mesh *mesh, uint32_t u_count, uint32_t v_count, float scale[4]);

/* The sources must outlive it, and must always give the same. Layers and surface need not. It mixes
 * u_count x v_count texels: more than the layer has are worth it, because neighbours read it
 * further apart than its texels are, 1 + h / e times for an eye e above the surface. NULL if memory
 * ran out. */
depth_mixer *depth_mixer_create(const depth_sources *sources, const slf_surface *surface,
                                uint32_t u_count, uint32_t v_count);
void depth_mixer_free(depth_mixer *m); /* accepts NULL */

/* Before each frame: what is not read for many of them makes room for other things, and what a
 * block found is what its neighbours know of it from then on. */
void depth_mixer_begin_frame(depth_mixer *m);

/* Mixes 8x8 texels at once; directions and out as for resample_block. */
void depth_mix_block(depth_mixer *m, uint32_t block_u, uint32_t block_v,
                     const block_directions *directions, uint16_t *out, size_t row_nbytes);

/* The same, from any number of threads at once, no two of them in the same row of blocks. The
 * sources are not asked: where something must be decompressed first, nothing is done, and it
 * returns false; depth_mix_block is to be called for that block when the others have finished. What
 * comes out depends on earlier frames of the block and of its neighbours, and on nothing of this
 * frame, so that it makes no difference which thread mixes it and when. */
bool depth_mix_block_shared(depth_mixer *m, uint32_t block_u, uint32_t block_v,
                            const block_directions *directions, uint16_t *out, size_t row_nbytes);

/* The plain C and the vector kernels give the same bytes; tests hold them against each other. */
void depth_mixer_use_kernel(depth_mixer *m, resample_kernel kernel);

/* Counts since creation. */
typedef struct {
  uint64_t texel_count;
  uint64_t foretold_count; /* of them near a height of the last frame, their own or a neighbour's */
  uint64_t wide_count;     /* of them mixed from up to 16 slices: the four disagree */
  uint64_t four_tap_count; /* of them mixed the paper's way: no slice sees what the ray meets */
} depth_mix_counts;
depth_mix_counts depth_mixer_counts(const depth_mixer *m);

#endif
