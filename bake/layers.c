/* layers - splits what a surface sends out into its own radiance and what it reflects, and finds
 * how high above the surface the thing reflected is, by what fogs do to them.
 *
 * A fog of distance d and grey C turns the radiance L of a path of length h into T L + (1 - T) C
 * with T = exp(-h / d). From the surface to the ray's start, a distance e, T_e is known. A surface
 * of own radiance O and reflectance r is seen through it as I(C) = T_e (O + r (T L + (1 - T) C)) +
 * (1 - T_e) C. A near fog lets nothing through from what is reflected (T = 0): I(0) = T_e O and
 * I(1) - I(0) = T_e r + 1 - T_e. A far fog then gives 1 - T = ((I(1) - I(0) - 1 + T_e) / T_e) / r,
 * so h; its height over the surface is h n. Nothing of this asks what the scene is made of. Where r
 * varies along the path, as with reflections of reflections, the fogs weigh its segments: h is a
 * weighted mean. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fail.h"
#include "image.h"
#include "surface.h"

/* The near fog's distance, in distances from the surface to the ray's start: what is reflected from
 * five of these away or less counts in part as the surface's own. */
static const double near_starts = 10;

/* Less than this is no reflection: a display shows nothing of it. */
static const float least_reflectance = 1.0f / 512;

typedef struct {
  double distance;
  float grey;
} fog;

enum { NEAR_BLACK, NEAR_WHITE, FAR_BLACK, FAR_WHITE, FOG_COUNT };

static void make_fogs(const surface *self, fog fogs[FOG_COUNT]) {
  double near = near_starts * surface_ray_start(self), far = self->layers;
  fogs[NEAR_BLACK] = (fog){near, 0}, fogs[NEAR_WHITE] = (fog){near, 1};
  fogs[FAR_BLACK] = (fog){far, 0}, fogs[FAR_WHITE] = (fog){far, 1};
}

/* What a fog adds to paths beyond the ray's start, summed over the channels. */
static float fogged(const float black[3], const float white[3], float t_start) {
  float sum = 0;
  for (int k = 0; k < 3; k++) sum += (white[k] - black[k] - 1 + t_start) / t_start;
  return sum;
}

typedef struct {
  float own_gain; /* 1 / T_e of the near fog */
  float t_near_start, t_far_start;
  float far, n;
} splitting;

/* One sample: its radiance, and the same through each fog, become three pixels. */
static void split(const splitting *by, const float *full, float *const through[FOG_COUNT],
                  float own[3], float reflected[3], float height[3]) {
  float r = fogged(through[NEAR_BLACK], through[NEAR_WHITE], by->t_near_start);
  bool reflects = r > 3 * least_reflectance;
  for (int k = 0; k < 3; k++) {
    own[k] = reflects ? fminf(through[NEAR_BLACK][k] * by->own_gain, full[k]) : full[k];
    reflected[k] = full[k] - own[k];
  }
  float opaque = reflects ? fogged(through[FAR_BLACK], through[FAR_WHITE], by->t_far_start) / r : 1;
  float distance = -by->far * logf(fminf(fmaxf(1 - opaque, 1e-6f), 1));
  height[0] = height[1] = height[2] = distance * by->n;
}

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

/* A white fog brightens the way to the ray's start, whatever is seen. Where it does not, POV-Ray
 * takes the rays to start inside an object, and there is nothing to learn. */
static void check_fog(const surface *self, float *const through[FOG_COUNT], size_t count,
                      float t_start) {
  size_t without = 0;
  for (size_t i = 0; i < count; i++)
    without += through[NEAR_WHITE][i] - through[NEAR_BLACK][i] < 0.5f * (1 - t_start);
  if (without > count / 2)
    fail("surface '%s' cannot be baked as layers: no fog is seen from it: is its middle inside a "
         "thing?",
         self->name);
}

static void split_chunk(const surface *self, uint32_t rays, uint32_t chunk_index,
                        const char *full_path, const char *fog_path, const char *out) {
  chunk_range range = surface_chunk(self, rays, chunk_index);
  uint32_t slice_count, row_count = range.count * self->v_count;
  slice *slices = surface_slices(self, &slice_count);
  float *full = read_means(full_path, self, row_count), *through[FOG_COUNT];
  fog fogs[FOG_COUNT];
  make_fogs(self, fogs);
  for (int i = 0; i < FOG_COUNT; i++) {
    char *path = format_text("%s.%d", fog_path, i);
    through[i] = read_means(path, self, row_count);
    free(path);
  }
  double start = surface_ray_start(self);
  splitting by = {.t_near_start = (float)exp(-start / fogs[NEAR_BLACK].distance),
                  .t_far_start = (float)exp(-start / fogs[FAR_BLACK].distance),
                  .far = (float)fogs[FAR_BLACK].distance};
  by.own_gain = 1 / by.t_near_start;
  size_t texel_count = (size_t)self->u_count * self->v_count;
  check_fog(self, through, 3 * texel_count * range.count, by.t_near_start);
  float *split_rgb = allocate(3 * texel_count * range.count * 3, sizeof *split_rgb, out);
  for (uint32_t k = 0; k < range.count; k++) {
    slice at = slices[range.first + k];
    double direction[3];
    slf_direction((at.s + 0.5) / self->s_count, (at.t + 0.5) / self->t_count, SLF_BAKED_N_MIN,
                  direction);
    by.n = (float)direction[2];
    float *own = split_rgb + 3 * k * texel_count * 3;
    for (size_t i = 0; i < texel_count; i++) {
      size_t from = (k * texel_count + i) * 3;
      float *seen[FOG_COUNT];
      for (int f = 0; f < FOG_COUNT; f++) seen[f] = through[f] + from;
      split(&by, full + from, seen, own + 3 * i, own + 3 * (texel_count + i),
            own + 3 * (2 * texel_count + i));
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
  fog fogs[FOG_COUNT];
  make_fogs(self, fogs);
  if (!lists)
    split_chunk(self, surface_rays(self, (uint32_t)atoi(argv[4])), (uint32_t)atoi(argv[5]), argv[6],
                argv[7], argv[8]);
  for (int i = 0; i < FOG_COUNT && lists && surface_has_layers(self); i++)
    printf("%d %.10g %g\n", i, fogs[i].distance, fogs[i].grey);
  surface_free(self);
  return 0;
}
