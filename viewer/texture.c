#include "texture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static float dot(const float a[3], const float b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

void view_direction(const slf_vertex *vertex, const float eye[3], float *s, float *t) {
  float d[3], s_axis, t_axis;
  for (int k = 0; k < 3; k++) d[k] = eye[k] - vertex->position[k];
  float length = sqrtf(dot(d, d));
  *s = *t = 0.5f;
  if (!(length > 1e-12f) || !isfinite(length)) return;
  s_axis = dot(d, vertex->tangent_u) / length;
  t_axis = dot(d, vertex->tangent_v) / length;
  if (dot(d, vertex->normal) < 0) {
    /* r continues as 2 - r: with n the sine of the elevation, r = 1 - n^2/2 above the horizon and
     * 1 + n^2/2 below, smooth across it. */
    float r = sqrtf(s_axis * s_axis + t_axis * t_axis);
    float stretch = r > 1e-6f ? (2 - r) / r : 0;
    s_axis = r > 1e-6f ? s_axis * stretch : 2;
    t_axis *= stretch;
  }
  *s = 0.5f * (s_axis + 1);
  *t = 0.5f * (t_axis + 1);
}

/* A triangle shows if its plane faces the eye, the side being that of its vertices' normals, and no
 * plane of the view's pyramid has all of it outside. */
static void find_visible(texture *x, const camera *c) {
  const slf_mesh *mesh = &x->surface_mesh;
  for (uint32_t i = 0; i < mesh->vertex_count; i++)
    x->outside[i] = camera_outside(c, mesh->vertices[i].position);
  for (uint32_t i = 0; i < mesh->triangle_count; i++) {
    const uint32_t *v = mesh->triangles + 3 * (size_t)i;
    const slf_vertex *a = &mesh->vertices[v[0]], *b = &mesh->vertices[v[1]],
                     *d = &mesh->vertices[v[2]];
    float ab[3], ad[3], plane[3], eye[3], side[3];
    for (int k = 0; k < 3; k++) {
      ab[k] = b->position[k] - a->position[k];
      ad[k] = d->position[k] - a->position[k];
      eye[k] = c->location[k] - a->position[k];
      side[k] = a->normal[k] + b->normal[k] + d->normal[k];
    }
    for (int k = 0; k < 3; k++)
      plane[k] = ab[(k + 1) % 3] * ad[(k + 2) % 3] - ab[(k + 2) % 3] * ad[(k + 1) % 3];
    /* On the plane itself (0) counts as facing: such a triangle may still be drawn by rounding. */
    bool faces = dot(plane, eye) * (dot(plane, side) < 0 ? -1.0f : 1.0f) >= 0;
    x->visible[i] = faces && !(x->outside[v[0]] & x->outside[v[1]] & x->outside[v[2]]);
  }
}

/* Interpolates (S,T) over the texels of a block from the triangles that cover them. False if none
 * of the triangles that touch it shows. */
static bool block_view_directions(const texture *x, size_t block, block_directions *d) {
  const uv_mesh *mesh = &x->mesh;
  float left = (float)(block % mesh->block_u_count * 8) + 0.5f;
  float top = (float)(block / mesh->block_u_count * 8) + 0.5f;
  bool shows = false;
  d->mask = 0;
  for (uint32_t i = mesh->cover_start[block]; i < mesh->cover_start[block + 1]; i++)
    shows |= x->visible[mesh->triangles[mesh->covers[i].triangle].parent];
  if (!shows) return false;
  for (uint32_t i = mesh->cover_start[block]; i < mesh->cover_start[block + 1]; i++) {
    const uv_cover *cover = &mesh->covers[i];
    if (cover->mask == 0) continue;
    const uv_triangle *t = &mesh->triangles[cover->triangle];
    const uint32_t *v = t->vertex;
    float s0 = x->s[v[0]], s1 = x->s[v[1]] - s0, s2 = x->s[v[2]] - s0;
    float t0 = x->t[v[0]], t1 = x->t[v[1]] - t0, t2 = x->t[v[2]] - t0;
    float s_u = s1 * t->m[0] + s2 * t->m[2], s_v = s1 * t->m[1] + s2 * t->m[3];
    float t_u = t1 * t->m[0] + t2 * t->m[2], t_v = t1 * t->m[1] + t2 * t->m[3];
    s0 += s_u * (left - t->x0) + s_v * (top - t->y0);
    t0 += t_u * (left - t->x0) + t_v * (top - t->y0);
    for (int row = 0; row < 8; row++) {
      uint32_t covered = cover->mask >> (8 * row) & 0xff;
      if (covered == 0) continue;
      for (uint32_t column = 0; column < 8; column++) {
        float s = s0 + s_u * (float)column + s_v * (float)row;
        float tt = t0 + t_u * (float)column + t_v * (float)row;
        bool here = covered & 1u << column;
        d->s[8 * row + column] = here ? s : d->s[8 * row + column];
        d->t[8 * row + column] = here ? tt : d->t[8 * row + column];
      }
    }
    d->mask |= cover->mask;
  }
  return true;
}

static uint16_t *block_texels(const texture *x, uint32_t block_u, uint32_t block_v) {
  const mipmap_level *level = &x->levels[0];
  return (uint16_t *)((uint8_t *)level->texels + 8 * block_v * level->row_nbytes) + 32 * block_u;
}

static void clear_block(const texture *x, uint32_t block_u, uint32_t block_v) {
  uint8_t *texels = (uint8_t *)block_texels(x, block_u, block_v);
  for (size_t row = 0; row < 8; row++) memset(texels + row * x->levels[0].row_nbytes, 0, 64);
}

static void add_block(mipmap_area *area, const mipmap_level *level, uint32_t block_u,
                      uint32_t block_v) {
  uint32_t x1 = 8 * block_u + 8, y1 = 8 * block_v + 8;
  if (x1 > level->width) x1 = level->width;
  if (y1 > level->height) y1 = level->height;
  if (area->x1 == 0) *area = (mipmap_area){8 * block_u, 8 * block_v, x1, y1};
  if (8 * block_u < area->x0) area->x0 = 8 * block_u;
  if (8 * block_v < area->y0) area->y0 = 8 * block_v;
  if (x1 > area->x1) area->x1 = x1;
  if (y1 > area->y1) area->y1 = y1;
}

void texture_update(texture *x, const camera *c, direction_bend bend) {
  uv_mesh *mesh = &x->mesh;
  block_directions d;
  memset(&d, 0, sizeof d);
  find_visible(x, c);
  for (uint32_t i = 0; i < mesh->vertex_count; i++)
    view_direction(&mesh->vertices[i], c->location, &x->s[i], &x->t[i]);
  x->made_count = 0;
  mipmap_area changed = {0, 0, 0, 0};
  for (uint32_t block_v = 0; block_v < mesh->block_v_count; block_v++)
    for (uint32_t block_u = 0; block_u < mesh->block_u_count; block_u++) {
      size_t block = (size_t)block_v * mesh->block_u_count + block_u;
      bool shows = block_view_directions(x, block, &d);
      if (shows) {
        if (bend.bend) bend.bend(bend.context, block_u, block_v, &d);
        uint16_t *texels = block_texels(x, block_u, block_v);
        if (x->depth)
          depth_mix_block(x->depth, block_u, block_v, &d, texels, x->levels[0].row_nbytes);
        else
          resample_block(x->resampler, block_u, block_v, &d, texels, x->levels[0].row_nbytes);
        x->made_count++;
      } else if (x->made[block]) {
        clear_block(x, block_u, block_v);
      }
      if (shows || x->made[block]) add_block(&changed, &x->levels[0], block_u, block_v);
      x->made[block] = shows;
    }
  resample_flush(x->resampler);
  x->changed[0] = changed;
}

void texture_make_levels(texture *x) {
  for (uint32_t level = 1; level < x->level_count; level++) {
    x->changed[level] = x->changed[level - 1].x1
                            ? mipmap_reached(&x->levels[level - 1], x->changed[level - 1])
                            : (mipmap_area){0, 0, 0, 0};
    mipmap_reduce(&x->levels[level - 1], &x->levels[level], x->changed[level]);
  }
}

static bool create_levels(texture *x) {
  uint32_t width = x->mesh.u_count, height = x->mesh.v_count;
  size_t row_nbytes = (size_t)x->mesh.block_u_count * 64, row_count = x->mesh.block_v_count * 8;
  for (;;) {
    x->levels[x->level_count] =
        (mipmap_level){width, height, row_nbytes, calloc(row_count, row_nbytes)};
    if (!x->levels[x->level_count++].texels) return false;
    if (width == 1 && height == 1) return true;
    width = width > 1 ? width / 2 : 1;
    height = height > 1 ? height / 2 : 1;
    row_nbytes = (size_t)width * 8;
    row_count = height;
  }
}

bool texture_create(texture *x, const slf_mesh *mesh, const slf_layer *layer, block_source source,
                    uint32_t dice_px) {
  memset(x, 0, sizeof *x);
  if (!uv_mesh_create(&x->mesh, mesh, layer->u_count, layer->v_count, dice_px)) return false;
  size_t block_count = (size_t)x->mesh.block_u_count * x->mesh.block_v_count;
  x->surface_mesh = *mesh;
  x->resampler = resampler_create(layer->s_count, layer->t_count, source);
  x->made = calloc(block_count, 1);
  x->s = malloc((x->mesh.vertex_count + (size_t)1) * sizeof *x->s);
  x->t = malloc((x->mesh.vertex_count + (size_t)1) * sizeof *x->t);
  x->outside = malloc(mesh->vertex_count + (size_t)1);
  x->visible = malloc(mesh->triangle_count + (size_t)1);
  if (x->resampler && x->made && x->s && x->t && x->outside && x->visible && create_levels(x))
    return true;
  texture_free(x);
  return false;
}

void texture_free(texture *x) {
  uv_mesh_free(&x->mesh);
  resampler_free(x->resampler);
  depth_mixer_free(x->depth);
  for (uint32_t i = 0; i < x->level_count; i++) free(x->levels[i].texels);
  free(x->made);
  free(x->s);
  free(x->t);
  free(x->outside);
  free(x->visible);
  memset(x, 0, sizeof *x);
}
