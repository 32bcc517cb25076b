/* pick.h - what the mouse points at. */
#ifndef SLF_PICK_H
#define SLF_PICK_H

#include "viewer/camera.h"

typedef struct {
  uint32_t surface_index;
  float u, v;
} pick_hit;

/* The nearest triangle, its front towards the eye as it is drawn, that is seen at pixel (x_px,
 * y_px) of a picture of width_px x height_px; x to the right and y down, the first pixel's centre
 * at (0.5, 0.5). False if there is none. Tries all triangles: microseconds for a scene's thousands.
 */
bool pick_surface(const slf_file *file, const camera *c, double x_px, double y_px, int width_px,
                  int height_px, pick_hit *hit);

#endif
