/* texel_frame.h - where the rays of a texel start, and the frame that their directions are in. */
#ifndef BAKE_TEXEL_FRAME_H
#define BAKE_TEXEL_FRAME_H

#include <stddef.h>

#include "surface.h"

typedef struct {
  double position[3], normal[3], tangent_u[3], tangent_v[3];
} texel_frame;

/* The places of a curved surface's rays, FOLDER/NAME/rays: texel by texel, its rays together, 12
 * floats each, for the caller to free. NULL for a planar one, which needs none. */
float *texel_frames_read(const char *folder, const surface *, uint32_t table_rays);

/* Ray `ray` of such a table, or of a planar surface. */
texel_frame texel_frame_of_ray(const surface *, const float *table, uint32_t table_rays,
                               size_t ray);
/* The middle one of a texel, from its centre. */
texel_frame texel_frame_of_centre(const surface *, const float *table, uint32_t table_rays,
                                  size_t texel);

/* The direction of a frame for eq. 1's (s, t, n), in scene coordinates. */
void texel_frame_to_scene(const texel_frame *, const double stn[3], double direction[3]);

#endif
