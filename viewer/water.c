#include "viewer/water.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "viewer/half.h"

const char *const water_display_names[WATER_DISPLAY_COUNT] = {"rippled", "split", "normals"};

static float dot(const float a[3], const float b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* ---- The rectangle -----------------------------------------------------------------------------
 */

/* The vertex whose a u + b v is largest. */
static const slf_vertex *extreme_vertex(const slf_mesh *mesh, float a, float b) {
  const slf_vertex *found = &mesh->vertices[0];
  for (uint32_t i = 1; i < mesh->vertex_count; i++) {
    const slf_vertex *x = &mesh->vertices[i];
    if (a * x->u + b * x->v > a * found->u + b * found->v) found = x;
  }
  return found;
}

/* P(u,v) = corner + u u_length along_u + v v_length along_v, if that holds at every vertex within
 * 1e-3 of the rectangle's size, which moves no reflection by a texel. */
static bool find_rectangle(const slf_mesh *mesh, water_rectangle *r) {
  if (mesh->vertex_count < 3) return false;
  const slf_vertex *p = extreme_vertex(mesh, -1, -1), *right = extreme_vertex(mesh, 1, -1),
                   *down = extreme_vertex(mesh, -1, 1);
  const float right_u = right->u - p->u, down_v = down->v - p->v;
  if (!(right_u > 0.5f) || !(down_v > 0.5f)) return false;
  for (int k = 0; k < 3; k++) {
    r->along_u[k] = (right->position[k] - p->position[k]) / right_u;
    r->along_v[k] = (down->position[k] - p->position[k]) / down_v;
    r->normal[k] = p->normal[k];
    r->corner[k] = p->position[k] - p->u * r->along_u[k] - p->v * r->along_v[k];
  }
  r->u_length = sqrtf(dot(r->along_u, r->along_u));
  r->v_length = sqrtf(dot(r->along_v, r->along_v));
  if (!(r->u_length > 0) || !(r->v_length > 0)) return false;
  for (int k = 0; k < 3; k++) {
    r->along_u[k] /= r->u_length;
    r->along_v[k] /= r->v_length;
  }
  const float tolerance = 1e-3f;
  if (!(fabsf(dot(r->along_u, r->along_v)) < tolerance)) return false;
  for (uint32_t i = 0; i < mesh->vertex_count; i++) {
    const slf_vertex *x = &mesh->vertices[i];
    for (int k = 0; k < 3; k++) {
      const float expected =
          r->corner[k] + x->u * r->u_length * r->along_u[k] + x->v * r->v_length * r->along_v[k];
      if (!(fabsf(x->position[k] - expected) < tolerance * fmaxf(r->u_length, r->v_length)))
        return false;
    }
    if (!(dot(x->tangent_u, r->along_u) > 1 - tolerance) ||
        !(dot(x->tangent_v, r->along_v) > 1 - tolerance) ||
        !(dot(x->normal, r->normal) > 1 - tolerance))
      return false;
  }
  return true;
}

/* ---- What stands in the water ------------------------------------------------------------------
 */

/* A point's (u, v), and its height over the water. */
static void place(const water_rectangle *r, const float point[3], float at[3]) {
  float d[3];
  for (int k = 0; k < 3; k++) d[k] = point[k] - r->corner[k];
  at[0] = dot(d, r->along_u) / r->u_length;
  at[1] = dot(d, r->along_v) / r->v_length;
  at[2] = dot(d, r->normal);
}

/* Where the segment in which a triangle meets the water ends, as (u, v); false if it does not. The
 * cut is made 1/1000 of the pond above it, so that a column that stands on the floor is found. */
static bool waterline(const water_rectangle *r, const slf_mesh *mesh, const uint32_t *triangle,
                      float ends[2][2]) {
  float at[3][3];
  int count = 0;
  for (int k = 0; k < 3; k++) {
    place(r, mesh->vertices[triangle[k]].position, at[k]);
    at[k][2] -= 1e-3f * fmaxf(r->u_length, r->v_length);
  }
  for (int k = 0; k < 3; k++) {
    const float *a = at[k], *b = at[(k + 1) % 3];
    if ((a[2] < 0) == (b[2] < 0)) continue;
    const float t = a[2] / (a[2] - b[2]);
    ends[count][0] = a[0] + t * (b[0] - a[0]);
    ends[count][1] = a[1] + t * (b[1] - a[1]);
    count++;
  }
  return count == 2;
}

/* Fills a surface's cross-section by parity along each row of cells: `flips` counts the waterlines
 * passed at each cell. A row with an odd number belongs to a surface that is not closed, such as
 * a wall, and stays water. */
static void close_cross_section(const water_rectangle *r, const slf_mesh *mesh, uint32_t u_count,
                                uint32_t v_count, uint16_t *flips, uint8_t *closed) {
  memset(flips, 0, (size_t)v_count * (u_count + 1) * sizeof *flips);
  for (uint32_t i = 0; i < mesh->triangle_count; i++) {
    float ends[2][2];
    if (!waterline(r, mesh, mesh->triangles + 3 * (size_t)i, ends)) continue;
    const int low = ends[0][1] < ends[1][1] ? 0 : 1;
    const float *top = ends[low], *bottom = ends[1 - low];
    for (uint32_t j = 0; j < v_count; j++) {
      const float v = ((float)j + 0.5f) / (float)v_count;
      if (v < top[1] || v >= bottom[1]) continue;
      const float u = top[0] + (v - top[1]) / (bottom[1] - top[1]) * (bottom[0] - top[0]);
      const float cell = fminf(fmaxf(ceilf(u * (float)u_count - 0.5f), 0), (float)u_count);
      flips[(size_t)j * (u_count + 1) + (size_t)cell]++;
    }
  }
  for (uint32_t j = 0; j < v_count; j++) {
    const uint16_t *row = flips + (size_t)j * (u_count + 1);
    unsigned all = 0, passed = 0;
    for (uint32_t i = 0; i <= u_count; i++) all += row[i];
    if (all & 1) continue;
    for (uint32_t i = 0; i < u_count; i++) {
      passed += row[i];
      if (passed & 1) closed[(size_t)j * u_count + i] = 1;
    }
  }
}

static bool add_obstacles(const slf_file *file, uint32_t water_index, const water_rectangle *r,
                          ripple *pond) {
  const uint32_t u_count = ripple_get_options(pond)->u_count;
  const uint32_t v_count = ripple_get_options(pond)->v_count;
  const size_t cell_count = (size_t)u_count * v_count;
  uint16_t *flips = malloc((size_t)v_count * (u_count + 1) * sizeof *flips);
  uint8_t *closed = malloc(cell_count);
  const bool allocated = flips && closed;
  for (uint32_t i = 0; allocated && i < slf_surface_count(file); i++) {
    if (i == water_index) continue;
    memset(closed, 0, cell_count);
    close_cross_section(r, &slf_get_surface(file, i)->mesh, u_count, v_count, flips, closed);
    size_t closed_count = 0;
    for (size_t k = 0; k < cell_count; k++) closed_count += closed[k];
    /* A surface around the pond, such as a room in one piece, is no obstacle in it. */
    if (closed_count > 0 && closed_count <= cell_count / 2) ripple_add_obstacle(pond, closed);
  }
  free(flips);
  free(closed);
  return allocated;
}

/* ---- Creation ----------------------------------------------------------------------------------
 */

/* A wave crosses the pond's longer side in 5 s and has then lost two thirds of its energy; waves of
 * a few hundredths of the pond, which a grid carries badly, are gone within a second. All of it is
 * told by the pond's size, not by the grid, so that a finer one shows the same water. */
static ripple_options pond_options(const water_rectangle *r, uint32_t cells) {
  const float longer = fmaxf(r->u_length, r->v_length), spacing = longer / (float)cells;
  const float u_cells = fmaxf(roundf(r->u_length / spacing), RIPPLE_MIN_CELLS);
  const float v_cells = fmaxf(roundf(r->v_length / spacing), RIPPLE_MIN_CELLS);
  return (ripple_options){.u_count = (uint32_t)u_cells,
                          .v_count = (uint32_t)v_cells,
                          .u_length = r->u_length,
                          .v_length = r->v_length,
                          .step_s = 1.0f / 120,
                          .wave_speed = longer / 5,
                          .damping_per_s = 0.2f,
                          .viscosity = longer * longer / 8192,
                          .height_limit = longer / 20,
                          .border = RIPPLE_REFLECTING};
}

static size_t block_count_of(const water *w) {
  return w->stride / 8 * ((w->v_count + 7) / 8);
}

static bool allocate(water *w) {
  const size_t rows = (w->v_count + 7) / 8 * (size_t)8;
  w->stride = (w->u_count + 7) / 8 * (size_t)8;
  w->slope_u = calloc(w->stride * rows, sizeof *w->slope_u);
  w->slope_v = calloc(w->stride * rows, sizeof *w->slope_v);
  w->facing = calloc(w->stride * rows, sizeof *w->facing);
  w->counts = calloc(block_count_of(w), sizeof *w->counts);
  return w->slope_u && w->slope_v && w->facing && w->counts;
}

slf_result water_create(const slf_file *file, uint32_t surface_index, uint32_t u_count,
                        uint32_t v_count, uint32_t cells, water **out, slf_error *error) {
  *out = NULL;
  const slf_surface *surface = slf_get_surface(file, surface_index);
  water_rectangle r;
  if (!find_rectangle(&surface->mesh, &r)) {
    snprintf(error->message, sizeof error->message,
             "surface '%s' is marked as water, but is not a flat rectangle", surface->name);
    return SLF_ERROR_ARGUMENT;
  }
  if (cells == 0) {
    cells = u_count > v_count ? u_count : v_count;
    cells = cells < 64 ? 64 : cells > 256 ? 256 : cells;
  }
  water *w = calloc(1, sizeof *w);
  slf_result result = SLF_ERROR_MEMORY;
  if (!w) goto out_of_memory;
  w->rectangle = r;
  w->u_count = u_count;
  w->v_count = v_count;
  w->bottom[0] = 0.05f;
  w->bottom[1] = 0.20f;
  w->bottom[2] = 0.22f;
  for (int i = 0; i < 256; i++)
    w->half_of_code[i] = half_from_float(slf_linear_from_srgb((uint8_t)i));
  if (!allocate(w)) goto out_of_memory;
  const ripple_options options = pond_options(&r, cells);
  result = ripple_create(&options, &w->pond, error);
  if (result != SLF_OK) goto failed;
  result = SLF_ERROR_MEMORY;
  if (!add_obstacles(file, surface_index, &r, w->pond)) goto out_of_memory;
  *out = w;
  return SLF_OK;

out_of_memory:
  snprintf(error->message, sizeof error->message, "out of memory for the water of '%s'",
           surface->name);
failed:
  water_free(w);
  return result;
}

void water_free(water *w) {
  if (!w) return;
  ripple_destroy(w->pond);
  free(w->slope_u);
  free(w->slope_v);
  free(w->facing);
  free(w->counts);
  free(w);
}

/* ---- Time --------------------------------------------------------------------------------------
 */

double water_time_s(const water *w) {
  return (double)w->step_index * ripple_get_options(w->pond)->step_s;
}

slf_result water_step(water *w, slf_error *error) {
  const double step_s = ripple_get_options(w->pond)->step_s;
  const double begin_s = (double)w->step_index * step_s,
               end_s = (double)(w->step_index + 1) * step_s;
  if (w->script) {
    if (ripple_script_stops(w->script) && begin_s >= ripple_script_end_s(w->script)) return SLF_OK;
    const slf_result result = ripple_script_apply(w->script, w->pond, begin_s, end_s, error);
    if (result != SLF_OK) return result;
  }
  ripple_step(w->pond);
  w->step_index++;
  return SLF_OK;
}

slf_result water_advance(water *w, double elapsed_s, slf_error *error) {
  if (w->paused) return SLF_OK;
  const uint32_t count = ripple_due(w->pond, elapsed_s);
  slf_result result = SLF_OK;
  for (uint32_t i = 0; i < count && result == SLF_OK; i++) result = water_step(w, error);
  return result;
}

void water_reset(water *w) {
  ripple_reset(w->pond);
  w->step_index = 0;
}

/* ---- A frame -----------------------------------------------------------------------------------
 */

static void bend_block(void *context, uint32_t block_u, uint32_t block_v, block_directions *d) {
  water *w = context;
  const size_t first = (size_t)block_v * 8 * w->stride + (size_t)block_u * 8;
  /* Numbers of one width in the loop: four go at once. */
  float cosine[64];
  int32_t below[64];
  for (size_t row = 0; row < 8; row++) {
    const float *restrict slope_u = w->slope_u + first + row * w->stride;
    const float *restrict slope_v = w->slope_v + first + row * w->stride;
    uint16_t *restrict facing = w->facing + first + row * w->stride;
    float *restrict S = d->s + 8 * row, *restrict T = d->t + 8 * row;
    for (size_t i = 0; i < 8; i++) {
      float s = 2 * S[i] - 1, t = 2 * T[i] - 1;
      const float radius2 = s * s + t * t;
      /* Past the horizon (texture.h) the flat direction is held at the rim. */
      const float shrink = radius2 > 1 ? 1 / sqrtf(radius2) : 1;
      s *= shrink;
      t *= shrink;
      const float n2 = 1 - s * s - t * t, n = sqrtf(n2 > 0 ? n2 : 0);
      /* m = (-slope_u, -slope_v, 1) / length; r = 2 (m.d) m - d; d' = (-r_u, -r_v, |r_n|). */
      const float length2 = 1 + slope_u[i] * slope_u[i] + slope_v[i] * slope_v[i];
      const float along = n - slope_u[i] * s - slope_v[i] * t;
      const float twice = 2 * along / length2;
      S[i] = 0.5f * (s + twice * slope_u[i] + 1);
      T[i] = 0.5f * (t + twice * slope_v[i] + 1);
      below[8 * row + i] = twice < n;
      const float c = (along > 0 ? along : 0) / sqrtf(length2);
      cosine[8 * row + i] = (c < 1 ? c : 1) * (WATER_FACINGS - 1) + 0.5f;
    }
    for (size_t i = 0; i < 8; i++) facing[i] = (uint16_t)(int)cosine[8 * row + i];
  }
  uint64_t below_mask = 0;
  for (int k = 0; k < 64; k++) below_mask |= (uint64_t)below[k] << k;
  uint8_t *counts = w->counts[block_v * (w->stride / 8) + block_u];
  counts[0] = (uint8_t)__builtin_popcountll(d->mask);
  counts[1] = (uint8_t)__builtin_popcountll(d->mask & below_mask);
}

direction_bend water_begin_frame(water *w) {
  memset(w->counts, 0, block_count_of(w) * sizeof *w->counts);
  w->finished_count = 0;
  w->bending = !ripple_is_calm(w->pond) || w->fresnel || w->display == WATER_NORMALS;
  if (!w->bending) return (direction_bend){NULL, NULL};
  ripple_slopes(w->pond, w->u_count, w->v_count, w->slope_u, w->slope_v, w->stride);
  if (w->display == WATER_SPLIT)
    for (size_t j = 0; j < w->v_count; j++) {
      memset(w->slope_u + j * w->stride, 0, w->u_count / 2 * sizeof(float));
      memset(w->slope_v + j * w->stride, 0, w->u_count / 2 * sizeof(float));
    }
  return (direction_bend){bend_block, w};
}

/* Fresnel's reflectance, and the bottom's light through the surface, for each cosine. */
typedef struct {
  float reflected, bottom[3];
} fresnel;

static fresnel fresnel_at(float cosine, const float bottom[3]) {
  const float index = 1.333f; /* water, 20 degrees Celsius, visible light */
  const float refracted = sqrtf(1 - (1 - cosine * cosine) / (index * index));
  const float across = (cosine - index * refracted) / (cosine + index * refracted);
  const float within = (index * cosine - refracted) / (index * cosine + refracted);
  fresnel f = {.reflected = 0.5f * (across * across + within * within)};
  for (int k = 0; k < 3; k++)
    f.bottom[k] = (1 - f.reflected) * powf(fmaxf(bottom[k], 0), 1 / refracted);
  return f;
}

static void tint(const water *w, const float bottom[3], uint16_t *texels, size_t row_nbytes) {
  fresnel table[WATER_FACINGS];
  for (int i = 0; i < WATER_FACINGS; i++)
    table[i] = fresnel_at((float)i / (WATER_FACINGS - 1), bottom);
  for (size_t j = 0; j < w->v_count; j++) {
    uint16_t *texel = texels + j * (row_nbytes / sizeof *texels);
    const uint16_t *facing = w->facing + j * w->stride;
    for (size_t i = 0; i < w->u_count; i++, texel += 4) {
      if (texel[3] == 0) continue;
      const fresnel *f = &table[facing[i]];
      for (int k = 0; k < 3; k++)
        texel[k] = half_from_float(f->reflected * float_from_half(texel[k]) + f->bottom[k]);
    }
  }
}

static uint8_t slope_code(float slope) {
  return (uint8_t)(255 * fminf(fmaxf(0.5f + slope, 0), 1) + 0.5f);
}

static void clear(const water *w, uint16_t *texels, size_t row_nbytes) {
  for (size_t j = 0; j < w->v_count; j++)
    for (size_t i = 0; i < w->u_count; i++)
      memset(texels + j * (row_nbytes / sizeof *texels) + 4 * i, 0, 3 * sizeof *texels);
}

static void paint_normals(const water *w, uint16_t *texels, size_t row_nbytes) {
  for (size_t j = 0; j < w->v_count; j++) {
    uint16_t *texel = texels + j * (row_nbytes / sizeof *texels);
    for (size_t i = 0; i < w->u_count; i++, texel += 4) {
      if (texel[3] == 0) continue;
      texel[0] = w->half_of_code[slope_code(w->slope_u[j * w->stride + i])];
      texel[1] = w->half_of_code[slope_code(w->slope_v[j * w->stride + i])];
      texel[2] = HALF_ONE;
    }
  }
}

void water_finish_frame(water *w, uint16_t *texels, size_t row_nbytes) {
  if (!w->bending) return;
  const bool first = w->finished_count++ == 0;
  const float nothing[3] = {0, 0, 0};
  if (w->display == WATER_NORMALS && first)
    paint_normals(w, texels, row_nbytes);
  else if (w->display == WATER_NORMALS)
    clear(w, texels, row_nbytes);
  else if (w->fresnel)
    tint(w, first ? w->bottom : nothing, texels, row_nbytes);
}

water_counts water_get_counts(const water *w) {
  water_counts sum = {0};
  for (size_t block = 0; block < block_count_of(w); block++)
    sum.ray_count += w->counts[block][0], sum.below_count += w->counts[block][1];
  return sum;
}
