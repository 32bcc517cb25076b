/* draw.h - a .slf file on the graphics hardware: textures made for the camera, meshes drawn with
 * them. Needs a current context (context.h, window.h). */
#ifndef DRAW_H
#define DRAW_H

#include "block_cache.h"
#include "camera.h"
#include "texture.h"
#include "water.h"

typedef struct drawing drawing;

/* How light fields that have depth are mixed; those without are always mixed from four taps. */
typedef enum { MIX_DEPTH, MIX_FOUR_TAP } drawing_mix;

typedef struct {
  size_t cache_blocks; /* N of the block cache */
  uint32_t dice_px;
  uint32_t water_cells; /* as in water_create */
  /* Where to get blocks instead of the cache, for measuring; NULL for the cache. */
  block_source (*source)(void *context, uint32_t surface_index, uint32_t layer_index);
  void *source_context;
} drawing_options;

/* How radiance becomes a picture. */
typedef struct {
  float exposure_ev; /* radiance is multiplied by 2^exposure_ev */
  bool tone_map;     /* x / (1 + x), so that what is brighter than white stays distinct */
  bool anisotropic;  /* texture filter; trilinear if not. Software GL takes twice the time for it */
  uint32_t detail;   /* angular level of detail, 0 .. ANGULAR_MAX_LEVEL (angular_level.h) */
  drawing_mix mix;   /* MIX_DEPTH holds at level 0: a mean over directions has no one depth */
} drawing_look;

/* What the latest frame cost, on this thread. */
typedef struct {
  double resample_s,
      upload_s;           /* (S,T), decompression, mix and mip levels; textures to the driver */
  size_t texel_count;     /* mixed, 0 if nothing had to be: the same view as before */
  depth_mix_counts depth; /* of them, those mixed by depth */
} drawing_cost;

/* Uploads meshes and matte textures. *out is NULL on failure. The file must outlive it. */
slf_result drawing_create(const slf_file *file, drawing_options options, drawing **out,
                          slf_error *error);
void drawing_free(drawing *d); /* accepts NULL */

/* From the next frame on; at first 0 EV, no tone mapping, anisotropic, level 0, by depth. */
void drawing_set_look(drawing *d, const drawing_look *look);
drawing_look drawing_get_look(const drawing *d);

/* Draws the view into an own framebuffer of width_px x height_px. `mask_surface` >= 0 paints that
 * surface white and all else black. The framebuffer stays bound, for overlay.h. */
slf_result drawing_render(drawing *d, const slf_view *view, int width_px, int height_px,
                          int mask_surface, slf_error *error);

/* The picture rendered last: height_px rows of width_px R G B A from the top, display code. */
void drawing_read(drawing *d, uint8_t *rgba);
/* Waits until it is drawn. */
void drawing_finish(drawing *d);
/* Shows it in the window's framebuffer of that size. */
void drawing_show(drawing *d, int width_px, int height_px);

/* The caller's until the next drawing_finish or drawing_show: from there to the next frame another
 * thread may use it, to decompress ahead. */
block_cache *drawing_cache(drawing *d);
const slf_file *drawing_file(const drawing *d);
drawing_cost drawing_get_cost(const drawing *d);
/* Whether some layer of the file has heights to mix by. */
bool drawing_has_depth(const drawing *d);
/* Whether the driver draws on the processor. */
bool drawing_is_software(const drawing *d);

/* The water of a surface, moved and disturbed through water.h; NULL where the file marks none. */
water *drawing_water(drawing *d, uint32_t surface_index);

#endif
