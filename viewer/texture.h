/* texture.h - the texture of one layer of one surface as the camera sees it (paper, section 2.1).
 *
 * Each update computes (S,T) at the vertices of the diced mesh, interpolates it to the texels, and
 * mixes the light field there, block after block of 8x8 texels, so that a C-Block is decompressed
 * at most once an update, however small the cache. Only blocks are made that a piece of a triangle
 * touches which faces the camera and is not outside its pyramid; all others are transparent zeros.
 * Within a block that is made, every texel is: past the silhouette, where the surface turns away,
 * the direction is held at the rim. So a texel's alpha says whether it holds radiance, and a filter
 * that divides colour by alpha never shows one that does not (see draw.c). */
#ifndef TEXTURE_H
#define TEXTURE_H

#include <stdatomic.h>

#include "block_cache.h"
#include "camera.h"
#include "depth_mix.h"
#include "mipmap.h"
#include "resample.h"
#include "uv_mesh.h"

/* (S,T) over a block's texels, linear in column and row. */
typedef struct {
  float s, s_u, s_v, t, t_u, t_v;
} direction_plane;

/* Changes the directions of a block of texels before they are mixed: ripples on water. Directions
 * come in as the camera sees the texels. May be NULL. Called from several threads at once, and
 * perhaps twice for a block, with texture_mix_together. */
typedef struct {
  void (*bend)(void *context, uint32_t block_u, uint32_t block_v, block_directions *directions);
  void *context;
} direction_bend;

typedef struct {
  uv_mesh mesh;
  slf_mesh surface_mesh; /* the caller's, not diced */
  resampler *resampler;
  block_source source;
  block_cache *ahead; /* see texture_decode_ahead */
  uint32_t thread_count;
  size_t least_count;
  uint32_t mix_thread_count; /* see texture_mix_together */
  uint32_t least_made_count;
  depth_mixer *depth; /* mixes instead of the resampler, if not NULL; freed with the texture */
  /* R G B A in half floats, linear. Level 0 has rows and columns for whole blocks, 64 bytes a block
   * and row. */
  mipmap_level levels[MIPMAP_MAX_LEVELS];
  uint32_t level_count;
  mipmap_area changed[MIPMAP_MAX_LEVELS]; /* what the latest update wrote, of each level */
  uint8_t *made;                          /* of each block, row by row: whether it holds radiance */
  uint8_t *updated;                       /* of each block: what the latest update did */
  uint32_t made_count;
  float *s, *t;     /* of each diced vertex; not confined to the circle, see view_direction */
  uint8_t *outside; /* of each vertex of surface_mesh; if clipped, of each diced vertex */
  bool clipped;     /* some vertex of surface_mesh lies outside the view */
  uint8_t *visible; /* of each triangle of surface_mesh */
  /* Sets the texels of mask to the plane. */
  void (*fill)(const direction_plane *plane, uint64_t mask, block_directions *directions);
} texture;

/* dice_px: UV_DICE_PX, or another limit. The mesh and the source must outlive the texture. False if
 * memory ran out. */
bool texture_create(texture *x, const slf_mesh *mesh, const slf_layer *layer, block_source source,
                    uint32_t dice_px);
void texture_free(texture *x);

/* Plain C or vector code, the same bytes. */
void texture_use_kernel(texture *x, resample_kernel kernel);

/* Another light field of the same texels, see resampler_use_slices. */
void texture_use_slices(texture *x, uint32_t s_count, uint32_t t_count, block_source source);
/* The source is of this cache: where half of what an update needs is missing, and at least
 * least_count blocks are, they are decompressed first, on several threads. What comes out is the
 * same. Not done for ripples and for the mix by depth. */
void texture_decode_ahead(texture *x, block_cache *cache, uint32_t thread_count,
                          size_t least_count);
/* Between updates: decompresses what one for camera `c` would have to, on the caller's thread, a
 * row of blocks after the other until *stop is set. Nobody else uses the texture or the cache
 * meanwhile. Not done for the mix by depth nor without texture_decode_ahead. */
void texture_look_ahead(texture *x, const camera *c, const atomic_bool *stop);
/* The mix by depth goes on that many threads, in updates after one that made at least
 * least_made_count blocks: less is not worth waiting for a thread. What comes out is the same. */
void texture_mix_together(texture *x, uint32_t thread_count, uint32_t least_made_count);
/* Makes the texels that camera `c` sees, of level 0. */
void texture_update(texture *x, const camera *c, direction_bend bend);
/* Makes what changed of the coarser levels. */
void texture_make_levels(texture *x);

/* (S,T) of the direction from a vertex to the eye. Below the horizon (n < 0) the radius goes on
 * from 1 to 2, so that interpolation crosses the horizon where the surface does; an eye on the
 * vertex itself is taken to be above it. */
void view_direction(const slf_vertex *vertex, const float eye[3], float *s, float *t);

#endif
