/* overlay.h - text, boxes and pictures over the scene, in pixels from the top left. Needs a current
 * context. Everything is collected and drawn in the order given, by overlay_finish. */
#ifndef OVERLAY_H
#define OVERLAY_H

#include "slf.h"

typedef struct overlay overlay;

/* Display code, R G B A. */
typedef struct {
  uint8_t r, g, b, a;
} overlay_colour;

/* *out is NULL on failure. */
slf_result overlay_create(overlay **out, slf_error *error);
void overlay_free(overlay *o); /* accepts NULL */

/* Begins an overlay on a picture of width_px x height_px; a pixel of text is scale pixels. */
void overlay_begin(overlay *o, int width_px, int height_px, float scale);

/* Sizes of text as overlay_text draws it, in pixels. */
float overlay_text_width(const overlay *o, const char *text);
float overlay_line_height(const overlay *o);

void overlay_box(overlay *o, float x, float y, float width, float height, overlay_colour colour);
/* Lines are separated by \n. */
void overlay_text(overlay *o, float x, float y, overlay_colour colour, const char *text);
/* Text on a dark box; returns the height taken. */
float overlay_panel(overlay *o, float x, float y, const char *text);
/* A picture, image_width x image_height texels R G B A in display code, copied; drawn at x, y with
 * that size, its part from left_fraction to right_fraction only. */
void overlay_image(overlay *o, float x, float y, float width, float height, const uint8_t *rgba,
                   int image_width, int image_height, float left_fraction, float right_fraction);

/* Draws it into the framebuffer that is bound. */
void overlay_finish(overlay *o);

#endif
