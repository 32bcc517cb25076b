/* gather - means of the rays of each sample, from a frame that POV-Ray rendered for a chunk. Smooth
 * ones are of all rays that are asked for, of a surface whose own pictures take one. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "cover.h"
#include "fail.h"
#include "frame.h"
#include "image.h"

/* Numbers that the renderer cannot have meant end the bake, with the place where they are. */
static void check_finite(const surface *self, slice at, const float *rgb, const char *path) {
  for (size_t i = 0; i < (size_t)self->u_count * self->v_count * 3; i++)
    if (!isfinite(rgb[i]))
      fail("%s: surface '%s', slice %u,%u, texel %zu,%zu: radiance is %f", path, self->name, at.s,
           at.t, i / 3 % self->u_count, i / 3 / self->u_count, rgb[i]);
}

int main(int argc, char **argv) {
  if (argc != 7) {
    fputs("usage: gather FOLDER SURFACE RAYS CHUNK|smooth-CHUNK FRAME.exr OUT.exr\n", stderr);
    return 2;
  }
  surface *self = surface_read(argv[1], argv[2]);
  uint32_t chunk, slice_count, hole_count;
  const bool smooth = chunk_is_smooth(argv[4], &chunk);
  uint32_t asked_rays = (uint32_t)atoi(argv[3]);
  uint32_t rays = smooth ? asked_rays : surface_rays(self, asked_rays);
  slice *slices = surface_slices(self, &slice_count);
  uint32_t first = surface_chunk(self, asked_rays, chunk).first;
  view_list views = views_of_chunk(self, asked_rays, rays, chunk);
  uint32_t *sources = cover_sources(argv[1], self, asked_rays, rays, &hole_count);
  float *means = (smooth ? frame_read_smooth_means : frame_read_means)(
      argv[5], self->planar, grid_of_all(self), &views, sources);
  for (uint32_t i = 0; i < views.view_count; i++)
    check_finite(self, slices[first + i], means + (size_t)i * self->u_count * self->v_count * 3,
                 argv[5]);
  image_write(argv[6], self->u_count, self->v_count * views.view_count, means);
  free(means);
  free(sources);
  free(views.stn);
  free(slices);
  surface_free(self);
  return 0;
}
