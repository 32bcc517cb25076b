#include "texture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "codec/parallel.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

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
  uint8_t any = 0;
  /* The diced mesh has the surface's own vertices first. */
  for (uint32_t i = 0; i < mesh->vertex_count; i++)
    any |= x->outside[i] = camera_outside(c, mesh->vertices[i].position);
  x->clipped = any != 0;
  for (uint32_t i = mesh->vertex_count; i < x->mesh.vertex_count && x->clipped; i++)
    x->outside[i] = camera_outside(c, x->mesh.vertices[i].position);
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

static direction_plane plane_of(const texture *x, const uv_triangle *triangle, float left,
                                float top) {
  const uint32_t *v = triangle->vertex;
  const float *m = triangle->m, s0 = x->s[v[0]], t0 = x->t[v[0]];
  float s1 = x->s[v[1]] - s0, s2 = x->s[v[2]] - s0, t1 = x->t[v[1]] - t0, t2 = x->t[v[2]] - t0;
  direction_plane p = {.s_u = s1 * m[0] + s2 * m[2],
                       .s_v = s1 * m[1] + s2 * m[3],
                       .t_u = t1 * m[0] + t2 * m[2],
                       .t_v = t1 * m[1] + t2 * m[3]};
  p.s = s0 + p.s_u * (left - triangle->x0) + p.s_v * (top - triangle->y0);
  p.t = t0 + p.t_u * (left - triangle->x0) + p.t_v * (top - triangle->y0);
  return p;
}

static void fill_plain(const direction_plane *p, uint64_t mask, block_directions *d) {
  for (int k = 0; k < 64; k++) {
    float column = (float)(k % 8), row = (float)(k / 8);
    if (!(mask >> k & 1)) continue;
    d->s[k] = p->s + p->s_v * row + p->s_u * column;
    d->t[k] = p->t + p->t_v * row + p->t_u * column;
  }
}

#if defined(__x86_64__)
__attribute__((target("avx2"))) static void fill_avx2(const direction_plane *p, uint64_t mask,
                                                      block_directions *d) {
  const __m256i bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
  const __m256 columns = _mm256_setr_ps(0, 1, 2, 3, 4, 5, 6, 7);
  __m256 s_u = _mm256_mul_ps(_mm256_set1_ps(p->s_u), columns);
  __m256 t_u = _mm256_mul_ps(_mm256_set1_ps(p->t_u), columns);
  for (int row = 0; row < 8; row++, mask >>= 8) {
    if ((mask & 0xff) == 0) continue;
    float *s = d->s + 8 * row, *t = d->t + 8 * row;
    __m256 s_row = _mm256_add_ps(_mm256_set1_ps(p->s + p->s_v * (float)row), s_u);
    __m256 t_row = _mm256_add_ps(_mm256_set1_ps(p->t + p->t_v * (float)row), t_u);
    __m256i covered = _mm256_and_si256(_mm256_set1_epi32((int)(mask & 0xff)), bits);
    __m256 here = _mm256_castsi256_ps(_mm256_cmpeq_epi32(covered, bits));
    _mm256_storeu_ps(s, _mm256_blendv_ps(_mm256_loadu_ps(s), s_row, here));
    _mm256_storeu_ps(t, _mm256_blendv_ps(_mm256_loadu_ps(t), t_row, here));
  }
}
#endif

/* Whether a piece of a triangle shows. */
static bool shows(const texture *x, const uv_triangle *piece) {
  const uint32_t *v = piece->vertex;
  if (!x->visible[piece->parent]) return false;
  return !x->clipped || !(x->outside[v[0]] & x->outside[v[1]] & x->outside[v[2]]);
}

/* Interpolates (S,T) over the texels of a block from the triangles that cover them. False if none
 * of the triangles that touch it shows. */
static bool block_view_directions(const texture *x, uint32_t block_u, uint32_t block_v,
                                  block_directions *d) {
  const uv_mesh *mesh = &x->mesh;
  size_t block = (size_t)block_v * mesh->block_u_count + block_u;
  const uv_cover *cover = mesh->covers + mesh->cover_start[block];
  const uv_cover *end = mesh->covers + mesh->cover_start[block + 1];
  bool any = false;
  d->mask = 0;
  for (const uv_cover *i = cover; i < end && !any; i++)
    any = shows(x, &mesh->triangles[i->triangle]);
  if (!any) return false;
  for (; cover < end; cover++) {
    if (cover->mask == 0) continue;
    direction_plane p = plane_of(x, &mesh->triangles[cover->triangle], (float)(8 * block_u) + 0.5f,
                                 (float)(8 * block_v) + 0.5f);
    x->fill(&p, cover->mask, d);
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

/* Sets what block_view_directions asks for. */
static void look_from(texture *x, const camera *c) {
  find_visible(x, c);
  for (uint32_t i = 0; i < x->mesh.vertex_count; i++)
    view_direction(&x->mesh.vertices[i], c->location, &x->s[i], &x->t[i]);
}

/* Every step-th block of `first` to `end`. */
static void announce(texture *x, uint32_t first, uint32_t end, uint32_t step) {
  block_directions d;
  memset(&d, 0, sizeof d);
  for (uint32_t block = first; block < end; block += step) {
    uint32_t block_u = block % x->mesh.block_u_count, block_v = block / x->mesh.block_u_count;
    if (block_view_directions(x, block_u, block_v, &d))
      resample_ask(x->resampler, block_u, block_v, &d, block_cache_announce, x->source.context);
  }
}

/* Finding the directions and slices of all blocks twice costs about half of an update that finds
 * everything decompressed, so a few blocks tell first whether that is worth it. */
static void decode_ahead(texture *x) {
  enum { STEP = 13 }; /* mostly no divisor of a row's blocks */
  const uint32_t block_count = x->mesh.block_u_count * x->mesh.block_v_count;
  size_t announced_count, missing_count;
  announce(x, 0, block_count, STEP);
  block_cache_forget_announced(x->ahead, &announced_count, &missing_count);
  if (2 * missing_count < announced_count || STEP * missing_count < x->least_count) return;
  announce(x, 0, block_count, 1);
  block_cache_decompress_announced(x->ahead, x->thread_count, true);
}

void texture_look_ahead(texture *x, const camera *c, const atomic_bool *stop) {
  if (!x->ahead || x->depth) return;
  const uint32_t row = x->mesh.block_u_count, block_count = row * x->mesh.block_v_count;
  look_from(x, c);
  for (uint32_t block = 0; block < block_count && !atomic_load(stop); block += row) {
    announce(x, block, block + row, 1);
    block_cache_decompress_announced(x->ahead, 1, false);
  }
}

/* What an update did with a block. */
enum {
  BLOCK_EMPTY,   /* nothing, nor was anything there */
  BLOCK_CHANGED, /* it was made, or cleared as it shows no longer */
  BLOCK_WAITS    /* nothing: its mix must not go on beside others */
};

typedef struct {
  texture *x;
  direction_bend bend;
  bool together;
} update;

static uint8_t update_block(const update *u, uint32_t block_u, uint32_t block_v,
                            block_directions *d) {
  texture *x = u->x;
  const size_t row_nbytes = x->levels[0].row_nbytes;
  uint8_t *made = &x->made[(size_t)block_v * x->mesh.block_u_count + block_u];
  const bool was_made = *made, makes = block_view_directions(x, block_u, block_v, d);
  uint16_t *texels = block_texels(x, block_u, block_v);
  if (makes) {
    if (u->bend.bend) u->bend.bend(u->bend.context, block_u, block_v, d);
    if (!x->depth)
      resample_block(x->resampler, block_u, block_v, d, texels, row_nbytes);
    else if (!u->together)
      depth_mix_block(x->depth, block_u, block_v, d, texels, row_nbytes);
    else if (!depth_mix_block_shared(x->depth, block_u, block_v, d, texels, row_nbytes))
      return BLOCK_WAITS;
  } else if (was_made) {
    clear_block(x, block_u, block_v);
  }
  *made = makes;
  return makes || was_made ? BLOCK_CHANGED : BLOCK_EMPTY;
}

static void update_row(void *context, uint64_t block_v) {
  const update *u = context;
  const uint32_t count = u->x->mesh.block_u_count;
  uint8_t *updated = u->x->updated + block_v * count;
  block_directions d;
  memset(&d, 0, sizeof d);
  for (uint32_t i = 0; i < count; i++)
    if (u->together || updated[i] == BLOCK_WAITS)
      updated[i] = update_block(u, i, (uint32_t)block_v, &d);
}

/* Of a mix by depth that begins: outlines are made from what was found the time before, a texel
 * further each time, and the view may stay as it is. */
enum { FIRST_UPDATES = 5 };

static void update_blocks(texture *x, direction_bend bend) {
  const uint32_t block_v_count = x->mesh.block_v_count;
  update u = {x, bend, x->mix_thread_count > 1 && x->made_count >= x->least_made_count};
  if (x->depth) depth_mixer_begin_frame(x->depth);
  memset(x->updated, BLOCK_WAITS, (size_t)x->mesh.block_u_count * block_v_count);
  if (u.together) parallel_for(x->mix_thread_count, block_v_count, update_row, &u);
  u.together = false;
  for (uint32_t block_v = 0; block_v < block_v_count; block_v++) update_row(&u, block_v);
  resample_flush(x->resampler);
}

void texture_update(texture *x, const camera *c, direction_bend bend) {
  const uint32_t block_u_count = x->mesh.block_u_count;
  const size_t block_count = (size_t)block_u_count * x->mesh.block_v_count;
  look_from(x, c);
  if (x->thread_count > 1 && !bend.bend && !x->depth) decode_ahead(x);
  update_blocks(x, bend);
  for (int i = 1; x->depth && x->made_count == 0 && i < FIRST_UPDATES; i++) update_blocks(x, bend);
  x->made_count = 0;
  x->changed[0] = (mipmap_area){0, 0, 0, 0};
  for (size_t block = 0; block < block_count; block++) {
    x->made_count += x->made[block];
    if (x->updated[block] == BLOCK_CHANGED)
      add_block(&x->changed[0], &x->levels[0], (uint32_t)(block % block_u_count),
                (uint32_t)(block / block_u_count));
  }
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

void texture_use_slices(texture *x, uint32_t s_count, uint32_t t_count, block_source source) {
  x->source = source;
  resampler_use_slices(x->resampler, s_count, t_count, source);
}

void texture_decode_ahead(texture *x, block_cache *cache, uint32_t thread_count,
                          size_t least_count) {
  x->ahead = cache;
  x->least_count = least_count;
  x->thread_count = thread_count;
}

void texture_mix_together(texture *x, uint32_t thread_count, uint32_t least_made_count) {
  x->mix_thread_count = thread_count;
  x->least_made_count = least_made_count;
}

void texture_use_kernel(texture *x, resample_kernel kernel) {
  resampler_use_kernel(x->resampler, kernel);
  x->fill = fill_plain;
#if defined(__x86_64__)
  if (kernel == RESAMPLE_BEST && __builtin_cpu_supports("avx2")) x->fill = fill_avx2;
#endif
}

bool texture_create(texture *x, const slf_mesh *mesh, const slf_layer *layer, block_source source,
                    uint32_t dice_px) {
  memset(x, 0, sizeof *x);
  if (!uv_mesh_create(&x->mesh, mesh, layer->u_count, layer->v_count, dice_px)) return false;
  size_t block_count = (size_t)x->mesh.block_u_count * x->mesh.block_v_count;
  x->surface_mesh = *mesh;
  x->resampler = resampler_create(layer->s_count, layer->t_count, source);
  x->source = source;
  x->made = calloc(block_count, 1);
  x->updated = malloc(block_count);
  x->s = malloc((x->mesh.vertex_count + (size_t)1) * sizeof *x->s);
  x->t = malloc((x->mesh.vertex_count + (size_t)1) * sizeof *x->t);
  x->outside = malloc(x->mesh.vertex_count + (size_t)1);
  x->visible = malloc(mesh->triangle_count + (size_t)1);
  if (x->resampler && x->made && x->updated && x->s && x->t && x->outside && x->visible &&
      create_levels(x)) {
    if (layer->curve == SLF_CURVE_DWA) resampler_use_format(x->resampler, U_BLOCK_HALF);
    texture_use_kernel(x, RESAMPLE_BEST);
    return true;
  }
  texture_free(x);
  return false;
}

void texture_free(texture *x) {
  uv_mesh_free(&x->mesh);
  resampler_free(x->resampler);
  depth_mixer_free(x->depth);
  for (uint32_t i = 0; i < x->level_count; i++) free(x->levels[i].texels);
  free(x->made);
  free(x->updated);
  free(x->s);
  free(x->t);
  free(x->outside);
  free(x->visible);
  memset(x, 0, sizeof *x);
}
