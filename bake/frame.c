#include "frame.h"

#include <stdlib.h>
#include <string.h>

#include "fail.h"
#include "image.h"
#include "sample.h"

texel_grid grid_of_all(const surface *self) {
  return (texel_grid){0, 1, self->u_count, 0, 1, self->v_count};
}

void view_of_slice(uint32_t s_count, uint32_t t_count, slice at, uint32_t rays, double (*stn)[3]) {
  double st[SAMPLE_MAX_RAYS][2];
  sample_cell_offsets(rays, at.s, at.t, st);
  for (uint32_t m = 0; m < rays; m++) {
    if (s_count == 1 && t_count == 1)
      memcpy(stn[m], (double[3]){0, 0, 1}, sizeof stn[m]);
    else
      slf_direction((at.s + st[m][0]) / s_count, (at.t + st[m][1]) / t_count, SLF_BAKED_N_MIN,
                    stn[m]);
  }
}

bool chunk_is_smooth(const char *what, uint32_t *chunk_index) {
  static const char prefix[] = "smooth-";
  const bool smooth = !strncmp(what, prefix, strlen(prefix));
  *chunk_index = (uint32_t)atoi(what + (smooth ? strlen(prefix) : 0));
  return smooth;
}

view_list views_of_chunk(const surface *self, uint32_t asked_rays, uint32_t rays,
                         uint32_t chunk_index) {
  uint32_t slice_count;
  chunk_range range = surface_chunk(self, asked_rays, chunk_index);
  slice *slices = surface_slices(self, &slice_count);
  view_list views = {range.count, rays,
                     allocate((size_t)range.count * rays, sizeof *views.stn, self->name)};
  for (uint32_t i = 0; i < range.count; i++) {
    slice at = slices[range.first + i];
    view_of_slice(self->s_count, self->t_count, at, rays, views.stn + (size_t)i * rays);
    /* Rays that spread over a cell's directions hit no one height. */
    for (uint32_t m = 0; m < rays && surface_has_layers(self); m++)
      slf_direction((at.s + 0.5) / self->s_count, (at.t + 0.5) / self->t_count, SLF_BAKED_N_MIN,
                    views.stn[(size_t)i * rays + m]);
  }
  free(slices);
  return views;
}

view_list views_of_cover(uint32_t rays) {
  view_list views = {1, rays, allocate(rays, sizeof *views.stn, "cover")};
  view_of_slice(1, 1, (slice){0, 0}, rays, views.stn);
  return views;
}

/* POV-Ray sorts a type 3 camera's triangles into tenths of the frame's width and height, and goes
 * through all of those that a pixel's tenths share. */
static const uint32_t tile_columns = 10;

void frame_size(bool planar, texel_grid grid, const view_list *views, bool apart, uint32_t *width,
                uint32_t *height) {
  uint32_t image_count = views->view_count * (apart || planar ? views->rays : 1);
  uint32_t columns = planar ? tile_columns : 1;
  if (columns > image_count) columns = image_count;
  *width = grid.u_count * columns + planar;
  *height = grid.v_count * ((image_count + columns - 1) / columns) + 1;
}

void frame_tile(bool planar, texel_grid grid, uint32_t rays, uint32_t view, uint32_t m,
                uint32_t *column, uint32_t *row) {
  uint32_t tile = view * rays + m, columns = planar ? tile_columns : 1;
  *column = tile % columns * grid.u_count;
  *row = tile / columns * grid.v_count;
}

/* The mean over a sample's rays, or over those that stand in for rays that miss the surface. */
static void mean_of_tiles(const float *pixels, uint32_t width, bool planar, texel_grid grid,
                          uint32_t view, uint32_t rays, const uint32_t *sources,
                          const double *weights, float *rgb) {
  const float *tiles[SAMPLE_MAX_RAYS];
  for (uint32_t m = 0; m < rays; m++) {
    uint32_t column, row;
    frame_tile(planar, grid, rays, view, m, &column, &row);
    tiles[m] = pixels + ((size_t)row * width + column) * 3;
  }
  for (uint32_t texel = 0; texel < grid.u_count * grid.v_count; texel++) {
    double sum[3] = {0, 0, 0};
    for (uint32_t m = 0; m < rays; m++) {
      uint32_t source = sources ? sources[(size_t)texel * rays + m] : texel * rays + m;
      uint32_t i = source / rays % grid.u_count, j = source / rays / grid.u_count;
      const float *from = tiles[source % rays] + ((size_t)j * width + i) * 3;
      for (int channel = 0; channel < 3; channel++) sum[channel] += weights[m] * from[channel];
    }
    for (int channel = 0; channel < 3; channel++)
      rgb[(size_t)texel * 3 + channel] = (float)sum[channel];
  }
}

/* For the caller to free; the first row is left out. */
static float *read_pixels(const char *path, uint32_t width, uint32_t height) {
  image *frame = image_open(path);
  if (image_width(frame) != width || image_height(frame) != height)
    fail("%s: %u x %u pixels, expected %u x %u", path, image_width(frame), image_height(frame),
         width, height);
  float *pixels = allocate((size_t)(height - 1) * width * 3, sizeof *pixels, path);
  image_read_rows(frame, "RGB", 1, height - 1, pixels);
  image_close(frame);
  return pixels;
}

static float *read_means(const char *path, bool planar, texel_grid grid, const view_list *views,
                         const uint32_t *sources, const double *weights) {
  uint32_t width, height;
  frame_size(planar, grid, views, true, &width, &height);
  float *pixels = read_pixels(path, width, height);
  size_t view_size = (size_t)grid.u_count * grid.v_count * 3;
  float *means = allocate(view_size * views->view_count, sizeof *means, path);
  for (uint32_t view = 0; view < views->view_count; view++)
    mean_of_tiles(pixels, width, planar, grid, view, views->rays, sources, weights,
                  means + view * view_size);
  free(pixels);
  return means;
}

float *frame_read_means(const char *path, bool planar, texel_grid grid, const view_list *views,
                        const uint32_t *sources) {
  if (planar) {
    double weights[SAMPLE_MAX_RAYS];
    for (uint32_t m = 0; m < views->rays; m++) weights[m] = 1.0 / views->rays;
    return read_means(path, true, grid, views, sources, weights);
  }
  /* A curved surface's images are means already, one below the other. */
  uint32_t width, height;
  frame_size(false, grid, views, false, &width, &height);
  return read_pixels(path, width, height);
}

float *frame_read_smooth_means(const char *path, bool planar, texel_grid grid,
                               const view_list *views, const uint32_t *sources) {
  double weights[SAMPLE_MAX_RAYS];
  sample_texel_weights(views->rays, weights);
  return read_means(path, planar, grid, views, planar ? sources : NULL, weights);
}
