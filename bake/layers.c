/* layers - splits what a surface sends out, seen through fogs (fog.h), into its own radiance and
 * what it reflects, with the height of the thing reflected above the surface, and, from more rays,
 * light without steps, and where things end (outline.h) how much of a texel shows lower or higher
 * ones. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fail.h"
#include "fog.h"
#include "image.h"
#include "outline.h"

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

/* A chunk, and what was made of it. */
typedef struct {
  surface *self;
  uint32_t rays; /* that were asked for */
  chunk_range range;
  slice *slices;
  fog_set fogs;
  size_t texel_count, image_size; /* of a slice: texels, numbers */
} chunk;

/* Parts of a slice that is split, before coverage joins them. And what a surface's own radiance may
 * vary by, in display codes, where one ray tells it, all rays the light. */
enum { SPLIT_PARTS = PART_COVERAGE, SMOOTH_CODES = 4 };

static chunk open_chunk(surface *self, uint32_t rays, uint32_t chunk_index) {
  uint32_t slice_count;
  size_t texel_count = (size_t)self->u_count * self->v_count;
  return (chunk){.self = self,
                 .rays = rays,
                 .range = surface_chunk(self, rays, chunk_index),
                 .slices = surface_slices(self, &slice_count),
                 .fogs = fogs_of(self, self->layers),
                 .texel_count = texel_count,
                 .image_size = 3 * texel_count};
}

/* For the caller to free. */
static float *read_through(const chunk *c, const char *fog_path, int number) {
  char *path = format_text("%s.%d", fog_path, number);
  float *rgb = read_means(path, c->self, c->range.count * c->self->v_count);
  free(path);
  return rgb;
}

/* n of the k-th slice's direction. */
static float slice_n(const chunk *c, uint32_t k) {
  const slice at = c->slices[c->range.first + k];
  double direction[3];
  slf_direction((at.s + 0.5) / c->self->s_count, (at.t + 0.5) / c->self->t_count, SLF_BAKED_N_MIN,
                direction);
  return (float)direction[2];
}

static void put_gray(float *rgb, size_t texel, float value) {
  for (int k = 0; k < 3; k++) rgb[3 * texel + k] = value;
}

static void split(const chunk *c, const char *full_path, const char *fog_path, const char *out) {
  const uint32_t row_count = c->range.count * c->self->v_count;
  float *full = read_means(full_path, c->self, row_count), *through[FOG_COUNT];
  for (int i = 0; i < FOG_COUNT; i++) through[i] = read_through(c, fog_path, i);
  if (!fog_is_seen(&c->fogs, through, c->image_size * c->range.count))
    fail("surface '%s' cannot be baked as layers: no fog is seen from it: is its middle inside a "
         "thing?",
         c->self->name);
  float *parts = allocate(SPLIT_PARTS * c->image_size * c->range.count, sizeof *parts, out);
  for (uint32_t k = 0; k < c->range.count; k++) {
    float *own = parts + SPLIT_PARTS * k * c->image_size;
    float *reflected = own + c->image_size, *height = reflected + c->image_size;
    for (size_t i = 0; i < c->texel_count; i++) {
      size_t from = (k * c->texel_count + i) * 3;
      float distance;
      fog_split(&c->fogs, full + from, through, from, own + 3 * i, reflected + 3 * i, &distance);
      put_gray(height, i, distance * slice_n(c, k));
    }
  }
  image_write(out, c->self->u_count, SPLIT_PARTS * row_count, parts);
  free(parts);
  for (int i = 0; i < FOG_COUNT; i++) free(through[i]);
  free(full);
}

static float *read_parts(const chunk *c, const char *path) {
  return read_means(path, c->self, SPLIT_PARTS * c->range.count * c->self->v_count);
}

/* Whether what the texel sends out itself is what its neighbours do, within SMOOTH_CODES. */
static bool own_is_even(const surface *self, const float *own, uint32_t texel) {
  const int64_t i = texel % self->u_count, j = texel / self->u_count;
  for (int k = 0; k < 9; k++) {
    const int64_t beside = surface_texel(self, i + k % 3 - 1, j + k / 3 - 1);
    for (int channel = 0; channel < 3 && beside >= 0; channel++)
      if (abs(slf_srgb_from_linear(own[3 * beside + channel]) -
              slf_srgb_from_linear(own[3 * (size_t)texel + channel])) > SMOOTH_CODES)
        return false;
  }
  return true;
}

/* Where all rays of a texel see one thing, on which colours may have borders, its light is what
 * they see in the mean, less what the texel sends out itself. */
static void smooth(const chunk *c, const char *split_path, const char *outlines_path,
                   const char *means_path, const char *out) {
  outline_list outlines = outlines_read(outlines_path, c->self, c->range.count);
  float *parts = read_parts(c, split_path);
  float *means = read_means(means_path, c->self, c->range.count * c->self->v_count);
  bool *ends = allocate(c->texel_count * c->range.count, sizeof *ends, out);
  memset(ends, 0, c->texel_count * c->range.count * sizeof *ends);
  for (uint32_t i = 0; i < outlines.count; i++)
    ends[outlines.texels[i].slice * c->texel_count + outlines.texels[i].texel] = true;
  for (uint32_t k = 0; k < c->range.count; k++) {
    float *own = parts + SPLIT_PARTS * k * c->image_size, *reflected = own + c->image_size;
    const float *mean = means + k * c->image_size;
    for (uint32_t i = 0; i < c->texel_count; i++)
      if (!ends[k * c->texel_count + i] && own_is_even(c->self, own, i))
        for (uint32_t at = 3 * i; at < 3 * i + 3; at++)
          reflected[at] = fmaxf(mean[at] - own[at], 0);
  }
  image_write(out, c->self->u_count, SPLIT_PARTS * c->range.count * c->self->v_count, parts);
  free(ends);
  free(outlines.texels);
  free(means);
  free(parts);
}

static void print_outlines(const chunk *c, const char *split_path) {
  float *parts = read_parts(c, split_path);
  outline_list found = outlines_find(c->self, parts + PART_HEIGHT * c->image_size,
                                     SPLIT_PARTS * c->image_size, c->range.count);
  outlines_write(&found, stdout, c->self->name);
  free(found.texels);
  free(parts);
}

/* Of the rays of a texel that meet something lower than its middle one does, less those that meet
 * something higher: the share. Own and reflected radiance of the middle one do for all beside the
 * far fog's. */
static float coverage_of(const chunk *c, uint32_t k, const float *own, float reflectance,
                         const float *seen) {
  const float unit = (float)c->self->layers, *reflected = own + c->image_size;
  const int middle = slf_code_from_height(own[PART_HEIGHT * c->image_size], unit);
  int covered = 0;
  for (uint32_t m = 0; m < c->rays; m++) {
    const float distance = fog_distance(&c->fogs, reflectance, own, reflected, seen + 3 * m);
    const int code = slf_code_from_height(distance * slice_n(c, k), unit);
    covered += (code < middle - SLF_THING_CODES / 2) - (code > middle + SLF_THING_CODES / 2);
  }
  return (float)covered / (float)c->rays;
}

/* What the camera saw of outlines: width x rows after the first. */
static float *read_outline_frame(const chunk *c, const outline_list *outlines, const char *path) {
  const uint32_t height = outline_frame_height(outlines, c->rays);
  image *from = image_open(path);
  if (image_width(from) != OUTLINE_FRAME_WIDTH || image_height(from) != height)
    fail("%s: %u x %u pixels, expected %u x %u", path, image_width(from), image_height(from),
         OUTLINE_FRAME_WIDTH, height);
  float *rgb = allocate((size_t)OUTLINE_FRAME_WIDTH * (height - 1) * 3, sizeof *rgb, path);
  image_read_rows(from, "RGB", 1, height - 1, rgb);
  image_close(from);
  return rgb;
}

static void add_coverage(const chunk *c, const char *split_path, const char *fog_path,
                         const char *outlines_path, const char *frame_path, const char *out) {
  const size_t part_size = SPLIT_PARTS * c->image_size, size = part_size + c->image_size;
  outline_list outlines = outlines_read(outlines_path, c->self, c->range.count);
  float *parts = read_parts(c, split_path);
  float *black = read_through(c, fog_path, NEAR_BLACK),
        *white = read_through(c, fog_path, NEAR_WHITE);
  float *all = allocate(size * c->range.count, sizeof *all, out);
  for (uint32_t k = 0; k < c->range.count; k++) {
    memcpy(all + k * size, parts + k * part_size, part_size * sizeof *all);
    memset(all + k * size + part_size, 0, c->image_size * sizeof *all);
  }
  float *frame = outlines.count ? read_outline_frame(c, &outlines, frame_path) : NULL;
  for (uint32_t i = 0; i < outlines.count; i++) {
    const uint32_t k = outlines.texels[i].slice, texel = outlines.texels[i].texel;
    const size_t from = k * c->image_size + 3 * (size_t)texel;
    const float reflectance = fog_reflectance(&c->fogs, black + from, white + from);
    const float *own = parts + k * part_size + 3 * (size_t)texel;
    const float *seen = frame + 3 * (1 + (size_t)i * c->rays);
    if (reflectance > 0)
      put_gray(all + k * size + part_size, texel, coverage_of(c, k, own, reflectance, seen));
  }
  image_write(out, c->self->u_count, (SPLIT_PARTS + 1) * c->range.count * c->self->v_count, all);
  free(frame);
  free(all);
  free(white);
  free(black);
  free(parts);
  free(outlines.texels);
}

static void print_fogs(const surface *self) {
  const fog_set fogs = fogs_of(self, self->layers);
  for (int i = 0; i < FOG_COUNT && surface_has_layers(self); i++)
    printf("%d %.10g %g\n", i, fogs.fogs[i].distance, fogs.fogs[i].grey);
}

int main(int argc, char **argv) {
  const char *what = argc > 1 ? argv[1] : "";
  const bool fogs = argc == 4 && !strcmp(what, "fogs"),
             splits = argc == 9 && !strcmp(what, "split");
  const bool outlines = argc == 7 && !strcmp(what, "outlines");
  const bool smooths = argc == 10 && !strcmp(what, "smooth");
  if (!fogs && !splits && !outlines && !smooths && !(argc == 11 && !strcmp(what, "coverage"))) {
    fputs("usage: layers fogs FOLDER SURFACE > FOGS\n"
          "       layers split FOLDER SURFACE RAYS CHUNK FULL.exr FOG SPLIT.exr\n"
          "       layers outlines FOLDER SURFACE RAYS CHUNK SPLIT.exr > OUTLINES\n"
          "       layers smooth FOLDER SURFACE RAYS CHUNK SPLIT.exr OUTLINES MEANS.exr OUT.exr\n"
          "       layers coverage FOLDER SURFACE RAYS CHUNK SPLIT.exr FOG OUTLINES FRAME.exr "
          "OUT.exr\n"
          "MEANS: of all rays, without a fog; OUT of smooth is a SPLIT. FOGS: number, distance and "
          "grey a line, the far one last, none if it has no layers; "
          "FOG.number is seen\nthrough it, and FRAME, of OUTLINES, through the far one\n",
          stderr);
    return 2;
  }
  surface *self = surface_read(argv[2], argv[3]);
  if (fogs) {
    print_fogs(self);
  } else {
    chunk c = open_chunk(self, (uint32_t)atoi(argv[4]), (uint32_t)atoi(argv[5]));
    if (splits)
      split(&c, argv[6], argv[7], argv[8]);
    else if (smooths)
      smooth(&c, argv[6], argv[7], argv[8], argv[9]);
    else if (outlines)
      print_outlines(&c, argv[6]);
    else
      add_coverage(&c, argv[6], argv[7], argv[8], argv[9], argv[10]);
    free(c.slices);
  }
  surface_free(self);
  return 0;
}
