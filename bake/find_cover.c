/* find_cover - from the frame that POV-Ray rendered of a surface along its normals, with short
 * rays: which rays of which texels find the surface (cover.h). */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fail.h"
#include "frame.h"
#include "image.h"

int main(int argc, char **argv) {
  if (argc != 5) {
    fputs("usage: find_cover FOLDER SURFACE RAYS FRAME.exr > COVER\n", stderr);
    return 2;
  }
  surface *self = surface_read(argv[1], argv[2]);
  uint32_t rays = (uint32_t)atoi(argv[3]), width, height;
  view_list views = views_of_cover(rays);
  frame_size(self->planar, grid_of_all(self), &views, true, &width, &height);
  image *frame = image_open(argv[4]);
  if (image_width(frame) != width || image_height(frame) != height)
    fail("%s: %u x %u pixels, expected %u x %u", argv[4], image_width(frame), image_height(frame),
         width, height);
  size_t texel_count = (size_t)self->u_count * self->v_count;
  float *alpha = allocate((size_t)(height - 1) * width, sizeof *alpha, self->name);
  uint8_t *cover = allocate(texel_count, rays, self->name);
  image_read_rows(frame, "A", 1, height - 1, alpha);
  for (uint32_t m = 0; m < rays; m++) {
    uint32_t column, row;
    frame_tile(self->planar, grid_of_all(self), rays, 0, m, &column, &row);
    for (size_t texel = 0; texel < texel_count; texel++) {
      size_t i = column + texel % self->u_count, j = row + texel / self->u_count;
      cover[texel * rays + m] = alpha[j * width + i] > 0.5f;
    }
  }
  if (!memchr(cover, 1, texel_count * rays))
    fail("surface '%s': no object of the scene lies where it is said to be", self->name);
  if (fwrite(cover, rays, texel_count, stdout) != texel_count || fflush(stdout))
    fail("surface '%s': its cover cannot be written", self->name);
  image_close(frame);
  free(cover);
  free(alpha);
  free(views.stn);
  surface_free(self);
  return 0;
}
