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
  drawing_mix mix;
  uint32_t dice_px;
} drawing_options;

/* Uploads meshes and matte textures. *out is NULL on failure. The file must outlive it. */
slf_result drawing_create(const slf_file *file, drawing_options options, drawing **out,
                          slf_error *error);
void drawing_free(drawing *d); /* accepts NULL */

/* Draws the view into an own framebuffer of width_px x height_px. `mask_surface` >= 0 paints that
 * surface white and all else black. */
slf_result drawing_render(drawing *d, const slf_view *view, int width_px, int height_px,
                          int mask_surface, slf_error *error);

/* The picture rendered last: height_px rows of width_px R G B A from the top, display code. */
void drawing_read(drawing *d, uint8_t *rgba);
/* Shows it in the window's framebuffer of that size. */
void drawing_show(drawing *d, int width_px, int height_px);

block_cache *drawing_cache(drawing *d);
const slf_file *drawing_file(const drawing *d);

/* The water of a surface, moved and disturbed through water.h; NULL where the file marks none. */
water *drawing_water(drawing *d, uint32_t surface_index);

#endif
