#include "maps.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void maps_clear(maps *m) {
  free(m->rgba);
  *m = (maps){0};
}

static bool reserve(maps *m, size_t pixel_count) {
  m->file = NULL;
  if (4 * pixel_count <= m->capacity) return true;
  free(m->rgba);
  m->rgba = malloc(4 * pixel_count);
  m->capacity = m->rgba ? 4 * pixel_count : 0;
  return m->rgba != NULL;
}

static const char *const role_names[] = {[SLF_ROLE_FULL] = "",
                                         [SLF_ROLE_OWN] = ", own light",
                                         [SLF_ROLE_REFLECTED] = ", reflected light",
                                         [SLF_ROLE_HEIGHT] = ", heights",
                                         [SLF_ROLE_COVERAGE] = ", coverage"};

typedef struct {
  uint8_t *rgba;
  int width, box_u, box_v;
  size_t cached, fresh;
} cache_picture;

static void paint(uint8_t *pixel, uint8_t r, uint8_t g, uint8_t b) {
  pixel[0] = r;
  pixel[1] = g;
  pixel[2] = b;
  pixel[3] = 255;
}

static uint8_t *pixel_of(const cache_picture *p, slf_block_address a) {
  int x = a.s * p->box_u + a.block_u, y = a.t * p->box_v + a.block_v;
  return p->rgba + 4 * ((size_t)y * (size_t)p->width + (size_t)x);
}

static void paint_block(void *context, slf_block_address address, bool fresh) {
  cache_picture *p = context;
  paint(pixel_of(p, address), fresh ? 255 : 40, fresh ? 40 : 220, 60);
  p->cached++;
  p->fresh += fresh;
}

const uint8_t *maps_cache(maps *m, const slf_file *file, const block_cache *cache,
                          uint32_t surface_index, uint32_t layer_index, char *text,
                          size_t text_nbytes, int *width, int *height) {
  const slf_surface *surface = slf_get_surface(file, surface_index);
  const slf_layer *layer = &surface->layers[layer_index];
  /* A dark line between the boxes. */
  cache_picture p = {.box_u = (int)layer->block_u_count + 1,
                     .box_v = (int)layer->block_v_count + 1};
  *width = p.width = (int)layer->s_count * p.box_u;
  *height = (int)layer->t_count * p.box_v;
  size_t pixel_count = (size_t)*width * (size_t)*height;
  if (!reserve(m, pixel_count)) return NULL;
  p.rgba = m->rgba;
  for (size_t i = 0; i < pixel_count; i++) paint(m->rgba + 4 * i, 0, 0, 0);
  for (uint32_t s = 0; s < layer->s_count; s++)
    for (uint32_t t = 0; t < layer->t_count; t++) {
      if (!slf_slice_exists(layer->s_count, layer->t_count, s, t)) continue;
      for (uint32_t v = 0; v < layer->block_v_count; v++)
        for (uint32_t u = 0; u < layer->block_u_count; u++)
          paint(
              pixel_of(&p, (slf_block_address){(uint16_t)s, (uint16_t)t, (uint16_t)u, (uint16_t)v}),
              48, 48, 56);
    }
  block_cache_visit(cache, surface_index, layer_index, paint_block, &p);
  snprintf(text, text_nbytes, "cache map of %s%s: %zu blocks, %zu decompressed in this frame",
           surface->name, role_names[layer->role], p.cached, p.fresh);
  return m->rgba;
}

const uint8_t *maps_slice(maps *m, const slf_file *file, uint32_t surface_index,
                          uint32_t layer_index, uint32_t s_index, uint32_t t_index, char *text,
                          size_t text_nbytes, int *width, int *height) {
  const slf_surface *surface = slf_get_surface(file, surface_index);
  const slf_layer *layer = &surface->layers[layer_index];
  *width = (int)layer->u_count;
  *height = (int)layer->v_count;
  snprintf(text, text_nbytes, "slice S %u, T %u of %s%s", s_index, t_index, surface->name,
           role_names[layer->role]);
  if (m->file == file && m->surface == surface_index && m->layer == layer_index &&
      m->s == s_index && m->t == t_index)
    return m->rgba;
  size_t pixel_count = (size_t)*width * (size_t)*height;
  slf_error error;
  float *rgb = malloc(pixel_count * 3 * sizeof *rgb);
  if (!rgb || !reserve(m, pixel_count) ||
      slf_decode_slice(file, surface_index, layer_index, s_index, t_index, rgb, &error) != SLF_OK) {
    free(rgb);
    return NULL;
  }
  for (size_t i = 0; i < pixel_count; i++)
    paint(m->rgba + 4 * i, slf_srgb_from_linear(rgb[3 * i]), slf_srgb_from_linear(rgb[3 * i + 1]),
          slf_srgb_from_linear(rgb[3 * i + 2]));
  free(rgb);
  m->file = file;
  m->surface = surface_index;
  m->layer = layer_index;
  m->s = s_index;
  m->t = t_index;
  return m->rgba;
}

const uint8_t *maps_difference(maps *m, const uint8_t *a, const uint8_t *b, size_t pixel_count) {
  if (!reserve(m, pixel_count)) return NULL;
  for (size_t i = 0; i < 4 * pixel_count; i++) {
    int difference = 8 * abs(a[i] - b[i]);
    m->rgba[i] = i % 4 == 3 ? 255 : difference < 255 ? (uint8_t)difference : 255;
  }
  return m->rgba;
}
