/* gather - means of the rays of each sample, from a frame that POV-Ray rendered for a chunk. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "fail.h"
#include "image.h"
#include "surface.h"

/* Numbers that the renderer cannot have meant end the bake, with the place where they are. */
static void check_finite(const surface *self, slice at, uint32_t row, const float *rgb,
                         const char *path) {
  for (uint32_t i = 0; i < self->u_count; i++)
    for (int channel = 0; channel < 3; channel++)
      if (!isfinite(rgb[i * 3 + channel]))
        fail("%s: surface '%s', slice %u,%u, texel %u,%u: radiance is %f", path, self->name, at.s,
             at.t, i, row, rgb[i * 3 + channel]);
}

/* A row of a planar surface's frame holds `rays` tiles side by side. */
static void mean_of_tiles(const float *frame_row, uint32_t u_count, uint32_t rays, float *rgb) {
  for (uint32_t i = 0; i < u_count * 3; i++) {
    double sum = 0;
    for (uint32_t m = 0; m < rays; m++) sum += frame_row[m * u_count * 3 + i];
    rgb[i] = (float)(sum / rays);
  }
}

int main(int argc, char **argv) {
  if (argc != 6) {
    fputs("usage: gather SURFACE.txt RAYS CHUNK FRAME.exr OUT.exr\n", stderr);
    return 2;
  }
  const char *path = argv[4];
  scene *whole = scene_read(argv[1]);
  const surface *self = &whole->surfaces[0];
  uint32_t rays = (uint32_t)atoi(argv[2]), slice_count;
  chunk_range range = surface_chunk(self, rays, (uint32_t)atoi(argv[3]));
  slice *slices = surface_slices(self, &slice_count);

  /* POV-Ray's type 0 camera has taken the mean itself; see camera.c for the row and column more. */
  uint32_t tiles = self->planar ? rays : 1;
  uint32_t width = self->u_count * tiles + self->planar, height = self->v_count * range.count + 1;
  image *frame = image_open(path);
  if (image_width(frame) != width || image_height(frame) != height)
    fail("%s: %u x %u pixels, expected %u x %u", path, image_width(frame), image_height(frame),
         width, height);
  float *row = allocate((size_t)width * 3, sizeof *row, path);
  float *means = allocate((size_t)(height - 1) * self->u_count * 3, sizeof *means, path);
  for (uint32_t y = 0; y + 1 < height; y++) {
    float *rgb = means + (size_t)y * self->u_count * 3;
    image_read_rows(frame, y + 1, 1, row);
    mean_of_tiles(row, self->u_count, tiles, rgb);
    check_finite(self, slices[range.first + y / self->v_count], y % self->v_count, rgb, path);
  }
  image_close(frame);
  image_write(argv[5], self->u_count, height - 1, means);
  free(means);
  free(row);
  free(slices);
  scene_free(whole);
  return 0;
}
