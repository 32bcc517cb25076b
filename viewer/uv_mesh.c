#include "uv_mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- Dicing -----------------------------------------------------------------------------------
 */

/* Midpoints by edge. Whether an edge is split depends on the edge alone, so the two triangles that
 * share it agree, and no T-junction arises. */
typedef struct {
  uint64_t edge; /* smaller index in the high half; 0 marks a free entry */
  uint32_t middle;
} midpoint;

typedef struct {
  uv_mesh *mesh;
  float limit_px;
  uint32_t vertex_capacity;
  uv_triangle *next;
  uint32_t next_count, next_capacity;
  midpoint *midpoints; /* open addressing, capacity a power of two */
  size_t midpoint_capacity, midpoint_count;
  bool out_of_memory;
} dicer;

static bool grow(void **items, uint32_t *capacity, uint32_t count, size_t item_nbytes) {
  if (count < *capacity) return true;
  if (*capacity > UINT32_MAX / 2) return false;
  uint32_t larger = *capacity ? 2 * *capacity : 1024;
  void *moved = realloc(*items, larger * item_nbytes);
  if (!moved) return false;
  *items = moved;
  *capacity = larger;
  return true;
}

static void normalise(float v[3]) {
  float length = sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  if (length > 0)
    for (int k = 0; k < 3; k++) v[k] /= length;
}

static float dot(const float a[3], const float b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void make_orthogonal(float v[3], const float unit[3]) {
  float along = dot(v, unit);
  for (int k = 0; k < 3; k++) v[k] -= along * unit[k];
  normalise(v);
}

/* The frame is interpolated and made orthonormal again; where two frames cancel, the first stays.
 */
static slf_vertex middle_of(const slf_vertex *a, const slf_vertex *b) {
  slf_vertex m = *a;
  m.u = 0.5f * (a->u + b->u);
  m.v = 0.5f * (a->v + b->v);
  for (int k = 0; k < 3; k++) m.position[k] = 0.5f * (a->position[k] + b->position[k]);
  if (dot(a->normal, b->normal) <= -0.9f || dot(a->tangent_u, b->tangent_u) <= -0.9f) return m;
  for (int k = 0; k < 3; k++) {
    m.normal[k] = a->normal[k] + b->normal[k];
    m.tangent_u[k] = a->tangent_u[k] + b->tangent_u[k];
    m.tangent_v[k] = a->tangent_v[k] + b->tangent_v[k];
  }
  normalise(m.normal);
  make_orthogonal(m.tangent_u, m.normal);
  make_orthogonal(m.tangent_v, m.normal);
  make_orthogonal(m.tangent_v, m.tangent_u);
  return m;
}

static size_t find_midpoint(const dicer *d, uint64_t edge) {
  size_t i = (edge * 0x9e3779b97f4a7c15u >> 17) & (d->midpoint_capacity - 1);
  while (d->midpoints[i].edge && d->midpoints[i].edge != edge)
    i = (i + 1) & (d->midpoint_capacity - 1);
  return i;
}

static bool grow_midpoints(dicer *d) {
  if (2 * d->midpoint_count < d->midpoint_capacity) return true;
  dicer larger = *d;
  larger.midpoint_capacity = d->midpoint_capacity ? 2 * d->midpoint_capacity : 4096;
  larger.midpoints = calloc(larger.midpoint_capacity, sizeof *larger.midpoints);
  if (!larger.midpoints) return false;
  for (size_t i = 0; i < d->midpoint_capacity; i++)
    if (d->midpoints[i].edge)
      larger.midpoints[find_midpoint(&larger, d->midpoints[i].edge)] = d->midpoints[i];
  free(d->midpoints);
  *d = larger;
  return true;
}

/* The vertex in the middle of edge (a, b), or UINT32_MAX if the edge is short enough. */
static uint32_t split_edge(dicer *d, uint32_t a, uint32_t b) {
  uv_mesh *mesh = d->mesh;
  const slf_vertex *va = &mesh->vertices[a], *vb = &mesh->vertices[b];
  float length_px = fmaxf(fabsf(va->u - vb->u) * (float)mesh->u_count,
                          fabsf(va->v - vb->v) * (float)mesh->v_count);
  /* A side that is the limit but for rounding stays whole. */
  if (!(length_px > d->limit_px * 1.0001f)) return UINT32_MAX;
  if (a > b) {
    uint32_t swap = a;
    a = b;
    b = swap;
  }
  if (!grow_midpoints(d) || !grow((void **)&mesh->vertices, &d->vertex_capacity, mesh->vertex_count,
                                  sizeof *mesh->vertices)) {
    d->out_of_memory = true;
    return UINT32_MAX;
  }
  uint64_t edge = (uint64_t)a << 32 | b;
  midpoint *found = &d->midpoints[find_midpoint(d, edge)];
  if (!found->edge) {
    found->edge = edge;
    found->middle = mesh->vertex_count++;
    mesh->vertices[found->middle] = middle_of(&mesh->vertices[a], &mesh->vertices[b]);
    d->midpoint_count++;
  }
  return found->middle;
}

static void emit(dicer *d, uint32_t parent, uint32_t a, uint32_t b, uint32_t c) {
  if (!grow((void **)&d->next, &d->next_capacity, d->next_count, sizeof *d->next)) {
    d->out_of_memory = true;
    return;
  }
  d->next[d->next_count++] = (uv_triangle){.vertex = {a, b, c}, .parent = parent};
}

static void dice_triangle(dicer *d, const uv_triangle *triangle) {
  const uint32_t none = UINT32_MAX;
  uint32_t v[3], middle[3], split_count = 0, parent = triangle->parent;
  memcpy(v, triangle->vertex, sizeof v);
  for (int k = 0; k < 3; k++) {
    middle[k] = split_edge(d, v[k], v[(k + 1) % 3]);
    split_count += middle[k] != none;
  }
  /* Turn the triangle so that one split lies on edge 0, two lie on edges 0 and 1. */
  int turn = 0;
  while ((split_count == 1 && middle[turn] == none) ||
         (split_count == 2 && middle[(turn + 2) % 3] != none))
    turn++;
  uint32_t a = v[turn % 3], b = v[(turn + 1) % 3], c = v[(turn + 2) % 3];
  uint32_t ab = middle[turn % 3], bc = middle[(turn + 1) % 3], ca = middle[(turn + 2) % 3];
  if (split_count == 0) {
    emit(d, parent, a, b, c);
  } else if (split_count == 1) {
    emit(d, parent, a, ab, c);
    emit(d, parent, ab, b, c);
  } else if (split_count == 2) {
    emit(d, parent, ab, b, bc);
    emit(d, parent, a, ab, bc);
    emit(d, parent, a, bc, c);
  } else {
    emit(d, parent, a, ab, ca);
    emit(d, parent, ab, b, bc);
    emit(d, parent, ca, bc, c);
    emit(d, parent, ab, bc, ca);
  }
}

static float clamp01(float x) {
  return x > 0 ? (x < 1 ? x : 1) : 0; /* NaN gives 0 */
}

static bool dice(uv_mesh *diced, const slf_mesh *mesh, uint32_t dice_px) {
  dicer d = {.mesh = diced, .limit_px = (float)(dice_px > 1 ? dice_px : 1)};
  diced->vertex_count = mesh->vertex_count;
  diced->triangle_count = mesh->triangle_count;
  d.vertex_capacity = mesh->vertex_count + 1;
  diced->vertices = malloc(d.vertex_capacity * sizeof *diced->vertices);
  diced->triangles = malloc((mesh->triangle_count + (size_t)1) * sizeof *diced->triangles);
  if (!diced->vertices || !diced->triangles) return false;
  for (uint32_t i = 0; i < mesh->vertex_count; i++) {
    diced->vertices[i] = mesh->vertices[i];
    diced->vertices[i].u = clamp01(mesh->vertices[i].u);
    diced->vertices[i].v = clamp01(mesh->vertices[i].v);
  }
  for (uint32_t i = 0; i < mesh->triangle_count; i++) {
    diced->triangles[i] = (uv_triangle){.parent = i};
    memcpy(diced->triangles[i].vertex, mesh->triangles + 3 * (size_t)i, 3 * sizeof(uint32_t));
  }
  /* Each round halves the longest edge, so it ends after log2(SLF_MAX_TEXELS) rounds. */
  uint32_t before;
  do {
    before = diced->triangle_count;
    d.next = NULL;
    d.next_count = d.next_capacity = 0;
    for (uint32_t i = 0; i < before && !d.out_of_memory; i++)
      dice_triangle(&d, &diced->triangles[i]);
    free(diced->triangles);
    diced->triangles = d.next;
    diced->triangle_count = d.next_count;
  } while (diced->triangle_count != before && !d.out_of_memory);
  free(d.midpoints);
  return !d.out_of_memory;
}

/* ---- Scan conversion --------------------------------------------------------------------------
 */

typedef struct {
  int64_t x[3], y[3]; /* snapped, in 1/UV_SNAP texel, counter-clockwise */
  int64_t area;       /* twice the area; 0 covers nothing */
} snapped_triangle;

static snapped_triangle snap(const uv_mesh *mesh, const uv_triangle *triangle) {
  snapped_triangle t;
  for (int k = 0; k < 3; k++) {
    const slf_vertex *v = &mesh->vertices[triangle->vertex[k]];
    t.x[k] = llrintf(v->u * (float)mesh->u_count * UV_SNAP);
    t.y[k] = llrintf(v->v * (float)mesh->v_count * UV_SNAP);
  }
  t.area = (t.x[1] - t.x[0]) * (t.y[2] - t.y[0]) - (t.x[2] - t.x[0]) * (t.y[1] - t.y[0]);
  return t;
}

/* Twice the area of (a, b, centre), less one on the edges that leave their points to the neighbour;
 * the rule takes an edge and its reverse oppositely. */
static int64_t edge_value(const snapped_triangle *t, int a, int b, int64_t x, int64_t y) {
  int64_t dx = t->x[b] - t->x[a], dy = t->y[b] - t->y[a];
  bool owns = dy > 0 || (dy == 0 && dx < 0);
  return dx * (y - t->y[a]) - dy * (x - t->x[a]) - (owns ? 0 : 1);
}

static uint64_t cover_mask(const uv_mesh *mesh, const snapped_triangle *t, uint32_t block_u,
                           uint32_t block_v) {
  uint64_t mask = 0;
  if (t->area == 0) return 0;
  int b = t->area > 0 ? 1 : 2, c = 3 - b;
  for (uint32_t row = 0; row < 8 && block_v * 8 + row < mesh->v_count; row++)
    for (uint32_t column = 0; column < 8 && block_u * 8 + column < mesh->u_count; column++) {
      int64_t x = (int64_t)(block_u * 8 + column) * UV_SNAP + UV_SNAP / 2;
      int64_t y = (int64_t)(block_v * 8 + row) * UV_SNAP + UV_SNAP / 2;
      if (edge_value(t, 0, b, x, y) >= 0 && edge_value(t, b, c, x, y) >= 0 &&
          edge_value(t, c, 0, x, y) >= 0)
        mask |= (uint64_t)1 << (8 * row + column);
    }
  return mask;
}

static void set_interpolation(uv_triangle *triangle, const snapped_triangle *t) {
  triangle->x0 = (float)t->x[0] / UV_SNAP;
  triangle->y0 = (float)t->y[0] / UV_SNAP;
  double scale = t->area ? (double)UV_SNAP / (double)t->area : 0;
  triangle->m[0] = (float)((double)(t->y[2] - t->y[0]) * scale);
  triangle->m[1] = (float)(-(double)(t->x[2] - t->x[0]) * scale);
  triangle->m[2] = (float)(-(double)(t->y[1] - t->y[0]) * scale);
  triangle->m[3] = (float)((double)(t->x[1] - t->x[0]) * scale);
}

static int64_t min3(const int64_t v[3]) {
  int64_t m = v[0] < v[1] ? v[0] : v[1];
  return m < v[2] ? m : v[2];
}

static int64_t max3(const int64_t v[3]) {
  int64_t m = v[0] > v[1] ? v[0] : v[1];
  return m > v[2] ? m : v[2];
}

/* The blocks first..last along an axis that [low, high] (1/UV_SNAP texel) touches. */
static void block_range(int64_t low, int64_t high, uint32_t block_count, uint32_t *first,
                        uint32_t *last) {
  int64_t side = 8 * UV_SNAP;
  int64_t f = low / side, l = high > low ? (high - 1) / side : high / side;
  *first = (uint32_t)(f < block_count ? f : block_count - 1);
  *last = (uint32_t)(l < block_count ? l : block_count - 1);
}

/* Two passes: the first counts the covers of each block, the second stores them. */
static bool scan_convert(uv_mesh *mesh) {
  size_t block_count = (size_t)mesh->block_u_count * mesh->block_v_count;
  mesh->cover_start = calloc(block_count + 2, sizeof *mesh->cover_start);
  if (!mesh->cover_start) return false;
  uint32_t *fill = mesh->cover_start + 1; /* in the end fill[b] is where block b + 1 starts */
  for (int pass = 0; pass < 2; pass++) {
    for (uint32_t i = 0; i < mesh->triangle_count; i++) {
      snapped_triangle t = snap(mesh, &mesh->triangles[i]);
      set_interpolation(&mesh->triangles[i], &t);
      uint32_t u0, u1, v0, v1;
      block_range(min3(t.x), max3(t.x), mesh->block_u_count, &u0, &u1);
      block_range(min3(t.y), max3(t.y), mesh->block_v_count, &v0, &v1);
      for (uint32_t bv = v0; bv <= v1; bv++)
        for (uint32_t bu = u0; bu <= u1; bu++) {
          size_t block = (size_t)bv * mesh->block_u_count + bu;
          if (pass == 0)
            fill[block + 1]++;
          else
            mesh->covers[fill[block]++] =
                (uv_cover){.mask = cover_mask(mesh, &t, bu, bv), .triangle = i};
        }
    }
    if (pass == 0) {
      for (size_t b = 0; b < block_count; b++) fill[b + 1] += fill[b];
      mesh->covers = malloc((fill[block_count] + (size_t)1) * sizeof *mesh->covers);
      if (!mesh->covers) return false;
    }
  }
  return true;
}

bool uv_mesh_create(uv_mesh *diced, const slf_mesh *mesh, uint32_t u_count, uint32_t v_count,
                    uint32_t dice_px) {
  memset(diced, 0, sizeof *diced);
  diced->u_count = u_count;
  diced->v_count = v_count;
  diced->block_u_count = (u_count + 7) / 8;
  diced->block_v_count = (v_count + 7) / 8;
  if (dice(diced, mesh, dice_px) && scan_convert(diced)) return true;
  uv_mesh_free(diced);
  return false;
}

void uv_mesh_free(uv_mesh *diced) {
  free(diced->vertices);
  free(diced->triangles);
  free(diced->covers);
  free(diced->cover_start);
  memset(diced, 0, sizeof *diced);
}
