/* frame.h - what POV-Ray renders for a surface: a list of views, and where their rays lie in it.
 *
 * A view is the surface's texels seen by all rays of a sample, each ray of it from one direction
 * (of eq. 1's s, t, n, in each texel's own frame). Of a planar surface each (view, ray) is a tile
 * of the frame: view after view, ray after ray, ten tiles in a row, as POV-Ray looks for the tile
 * of a pixel among those of a tenth of the frame. Of a curved one each view is one image, the views
 * below each other, and POV-Ray takes the mean over the rays itself. Above both lies one row that
 * counts for nothing, and to the right of tiles one column (see camera.c). */
#ifndef BAKE_FRAME_H
#define BAKE_FRAME_H

#include <stdint.h>

#include "surface.h"

/* Some of a surface's texels: the u_first-th and every u_step-th after it, rows alike. */
typedef struct {
  uint32_t u_first, u_step, u_count;
  uint32_t v_first, v_step, v_count;
} texel_grid;
texel_grid grid_of_all(const surface *);

typedef struct {
  uint32_t view_count, rays;
  double (*stn)[3]; /* view_count x rays directions */
} view_list;

/* What is rendered: one chunk of slices; or views along the normal that tell where the surface is
 * (cover.h); or views of a few texels that tell how many directions it needs (choose.c). The caller
 * frees stn. */
view_list views_of_chunk(const surface *, uint32_t asked_rays, uint32_t rays, uint32_t chunk_index);
view_list views_of_cover(uint32_t rays);

/* The number in CHUNK or smooth-CHUNK; whether it is smooth: seen by all rays that are asked for,
 * whatever surface_rays says, so that there are none of the steps that one ray leaves. */
bool chunk_is_smooth(const char *what, uint32_t *chunk_index);

/* The slice of a surface of s_count x t_count directions, with its cell's offsets, into stn: one
 * view. A matte surface is seen along its normal. */
void view_of_slice(uint32_t s_count, uint32_t t_count, slice at, uint32_t rays, double (*stn)[3]);

/* Size of the frame, of tiles if it is planar; `apart`: each ray of a curved surface has an image
 * of its own. */
void frame_size(bool planar, texel_grid, const view_list *, bool apart, uint32_t *width,
                uint32_t *height);

/* Column and row (from the first that counts) of the tile or image of ray m of a view. */
void frame_tile(bool planar, texel_grid, uint32_t rays, uint32_t view, uint32_t m, uint32_t *column,
                uint32_t *row);

/* The mean radiance of every texel of every view: view_count x v_count x u_count x 3, for the
 * caller to free. sources (cover.h) may be NULL; a curved surface's camera has heeded them already.
 * A frame of another size ends the program. */
float *frame_read_means(const char *path, bool planar, texel_grid, const view_list *,
                        const uint32_t *sources);
/* The same by the weights of sample_texel_weights, of a curved surface whose rays are apart. */
float *frame_read_smooth_means(const char *path, bool planar, texel_grid, const view_list *,
                               const uint32_t *sources);

#endif
