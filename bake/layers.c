/* layers - splits what a surface sends out, seen through fogs (fog.h), into its own radiance and
 * what it reflects, with the height of the thing reflected above the surface. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fail.h"
#include "fog.h"
#include "image.h"

static float *read_means(const char *path, const surface *self, uint32_t row_count) {
  image *from = image_open(path);
  if (image_width(from) != self->u_count || image_height(from) != row_count)
    fail("%s: %u x %u texels, expected %u x %u", path, image_width(from), image_height(from),
         self->u_count, row_count);
  float *rgb = allocate((size_t)self->u_count * row_count * 3, sizeof *rgb, path);
  image_read_rows(from, "RGB", 0, row_count, rgb);
  image_close(from);
  return rgb;
}

static void split_chunk(const surface *self, uint32_t rays, uint32_t chunk_index,
                        const char *full_path, const char *fog_path, const char *out) {
  chunk_range range = surface_chunk(self, rays, chunk_index);
  uint32_t slice_count, row_count = range.count * self->v_count;
  slice *slices = surface_slices(self, &slice_count);
  float *full = read_means(full_path, self, row_count), *through[FOG_COUNT];
  fog_set fogs = fogs_of(self, self->layers);
  for (int i = 0; i < FOG_COUNT; i++) {
    char *path = format_text("%s.%d", fog_path, i);
    through[i] = read_means(path, self, row_count);
    free(path);
  }
  size_t texel_count = (size_t)self->u_count * self->v_count;
  if (!fog_is_seen(&fogs, through, 3 * texel_count * range.count))
    fail("surface '%s' cannot be baked as layers: no fog is seen from it: is its middle inside a "
         "thing?",
         self->name);
  float *split_rgb = allocate(3 * texel_count * range.count * 3, sizeof *split_rgb, out);
  for (uint32_t k = 0; k < range.count; k++) {
    slice at = slices[range.first + k];
    double direction[3];
    slf_direction((at.s + 0.5) / self->s_count, (at.t + 0.5) / self->t_count, SLF_BAKED_N_MIN,
                  direction);
    float *own = split_rgb + 3 * k * texel_count * 3;
    for (size_t i = 0; i < texel_count; i++) {
      size_t from = (k * texel_count + i) * 3;
      float *reflected = own + 3 * (texel_count + i), *height = own + 3 * (2 * texel_count + i);
      float distance;
      fog_split(&fogs, full + from, through, from, own + 3 * i, reflected, &distance);
      height[0] = height[1] = height[2] = distance * (float)direction[2];
    }
  }
  image_write(out, self->u_count, 3 * row_count, split_rgb);
  free(split_rgb);
  for (int i = 0; i < FOG_COUNT; i++) free(through[i]);
  free(full);
  free(slices);
}

int main(int argc, char **argv) {
  bool lists = argc == 4 && !strcmp(argv[1], "fogs");
  if (!lists && !(argc == 9 && !strcmp(argv[1], "split"))) {
    fputs("usage: layers fogs FOLDER SURFACE > FOGS\n"
          "       layers split FOLDER SURFACE RAYS CHUNK FULL.exr FOG OUT.exr\n"
          "FOGS: number, distance and grey a line, none if it has no layers; FOG.number is seen "
          "through it\n",
          stderr);
    return 2;
  }
  surface *self = surface_read(argv[2], argv[3]);
  if (!lists)
    split_chunk(self, surface_rays(self, (uint32_t)atoi(argv[4])), (uint32_t)atoi(argv[5]), argv[6],
                argv[7], argv[8]);
  fog_set fogs = fogs_of(self, self->layers);
  for (int i = 0; i < FOG_COUNT && lists && surface_has_layers(self); i++)
    printf("%d %.10g %g\n", i, fogs.fogs[i].distance, fogs.fogs[i].grey);
  surface_free(self);
  return 0;
}
