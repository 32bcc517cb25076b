#include "depth_mix.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cpu.h"
#include "depth_kernel.h"
#include "half.h"

struct depth_mixer {
  depth_geometry geometry;
  float u_end, v_end; /* half a texel beyond the light's last */
  float unit;
  depth_frame *frames; /* of a curved surface; NULL for a flat one */
  float (*slopes)[2];  /* q of each slice, NAN of those that do not exist */
  depth_pages pages;
  const depth_kernel *kernel;
  uint32_t block_u_count; /* of what is mixed */
  depth_memory *last;     /* of each block */
  uint8_t *visits;        /* of each block */
  depth_mix_counts counts;
};

bool flat_texel_scale(const slf_mesh *mesh, uint32_t u_count, uint32_t v_count, float scale[4]) {
  const slf_vertex *v0 = &mesh->vertices[mesh->triangles[0]];
  const slf_vertex *v1 = &mesh->vertices[mesh->triangles[1]];
  const slf_vertex *v2 = &mesh->vertices[mesh->triangles[2]];
  float u1 = v1->u - v0->u, w1 = v1->v - v0->v, u2 = v2->u - v0->u, w2 = v2->v - v0->v;
  float det = u1 * w2 - u2 * w1, pu[3], pv[3], a = 0, b = 0, c = 0, d = 0, largest = 0;
  if (det == 0) return false;
  for (int k = 0; k < 3; k++) {
    float d1 = v1->position[k] - v0->position[k], d2 = v2->position[k] - v0->position[k];
    pu[k] = (d1 * w2 - d2 * w1) / det;
    pv[k] = (d2 * u1 - d1 * u2) / det;
    a += pu[k] * v0->tangent_u[k];
    b += pv[k] * v0->tangent_u[k];
    c += pu[k] * v0->tangent_v[k];
    d += pv[k] * v0->tangent_v[k];
    largest = fmaxf(largest, fabsf(pu[k]) + fabsf(pv[k]));
  }
  for (uint32_t i = 0; i < mesh->vertex_count; i++) {
    const slf_vertex *v = &mesh->vertices[i];
    for (int k = 0; k < 3; k++) {
      float p = v0->position[k] + pu[k] * (v->u - v0->u) + pv[k] * (v->v - v0->v);
      if (!(fabsf(p - v->position[k]) < 1e-4f * largest)) return false;
      if (!(fabsf(v->tangent_u[k] - v0->tangent_u[k]) < 1e-4f)) return false;
      if (!(fabsf(v->normal[k] - v0->normal[k]) < 1e-4f)) return false;
    }
  }
  float inverse = 1 / (a * d - b * c);
  scale[0] = d * inverse * (float)u_count;
  scale[1] = -b * inverse * (float)u_count;
  scale[2] = -c * inverse * (float)v_count;
  scale[3] = a * inverse * (float)v_count;
  return true;
}

/* ---- What a slice sees --------------------------------------------------------------------------
 */

/* A slice near a ray's direction: its weight, and (q_i - q). */
typedef struct {
  const depth_slice *slice;
  float weight, dx, dy;
} neighbour;

/* A place in a slice: the page and the texel there that it is right of and below, and how far. */
typedef struct {
  const uint8_t *page;
  int x, y;
  float fx, fy;
} place;

static inline float confine(float x, float last) {
  return x < 0 ? 0 : x > last ? last : x;
}

static inline place find_place(depth_mixer *m, const neighbour *n, float x, float y) {
  depth_pages *p = &m->pages;
  x = confine(x - 0.5f, m->u_end - 1.5f);
  y = confine(y - 0.5f, m->v_end - 1.5f);
  int i = (int)x, j = (int)y;
  uint32_t block = (uint32_t)(j >> 3) * p->block_u_count + (uint32_t)(i >> 3);
  if (!(n->slice->there[block / 32] >> block % 32 & 1)) depth_pages_load(p, n->slice, block);
  const uint8_t *page = n->slice->bytes + (size_t)block * PAGE_NBYTES;
  return (place){page, i & 7, j & 7, x - (float)i, y - (float)j};
}

/* The code of the height that the slice sees at texel (x, y) of the light; -1 beyond the surface.
 */
static float code_at(depth_mixer *m, const neighbour *n, float x, float y) {
  if (!(x >= -0.5f && y >= -0.5f && x <= m->u_end && y <= m->v_end)) return -1;
  place at = find_place(m, n, x, y);
  const uint8_t *t = at.page + at.y * PAGE_ROW_NBYTES + at.x * 4 + 3;
  int a = t[0], b = t[4], c = t[PAGE_ROW_NBYTES], d = t[PAGE_ROW_NBYTES + 4];
  int low = a < b ? a : b, high = a < b ? b : a, low_2 = c < d ? c : d, high_2 = c < d ? d : c;
  if (low_2 < low) low = low_2;
  if (high_2 > high) high = high_2;
  /* Between a thing and what is behind it there is nothing. */
  if (high - low > EDGE_CODES)
    return at.fy > 0.5f ? (float)(at.fx > 0.5f ? d : c) : (float)(at.fx > 0.5f ? b : a);
  float top = (float)a + at.fx * (float)(b - a), bottom = (float)c + at.fx * (float)(d - c);
  return top + at.fy * (bottom - top);
}

static float height_of(const depth_mixer *m, float code) {
  return m->unit * code / (256 - code);
}

static void add_light(depth_mixer *m, const neighbour *n, float x, float y, float weight,
                      float rgb[3]) {
  place at = find_place(m, n, x, y);
  for (int k = 0; k < 4; k++) {
    float w = weight * (k & 1 ? at.fx : 1 - at.fx) * (k & 2 ? at.fy : 1 - at.fy) / PAGE_WHITE;
    const uint8_t *texel = at.page + (at.y + k / 2) * PAGE_ROW_NBYTES + (at.x + k % 2) * 4;
    for (int channel = 0; channel < 3; channel++)
      rgb[channel] += w * (float)(texel[channel] * texel[channel]);
  }
}

/* ---- One texel ----------------------------------------------------------------------------------
 */

typedef struct {
  float x, y;         /* texel */
  float qx, qy;       /* slopes, texels a unit of height */
  float i, j;         /* place among the slices, S and T */
  neighbour near[16]; /* that of most weight first */
  int near_count;
} ray;

/* The slices within `reach` of the ray's direction that it does not have yet, weighed by a tent of
 * that width; a slice on the tent's rim keeps a hundredth, as its word on visibility counts. */
static void add_neighbours(depth_mixer *m, ray *r, int reach) {
  int i0 = (int)r->i, j0 = (int)r->j;
  if (m->geometry.s_count > 1 && i0 > (int)m->geometry.s_count - 2)
    i0 = (int)m->geometry.s_count - 2;
  if (m->geometry.t_count > 1 && j0 > (int)m->geometry.t_count - 2)
    j0 = (int)m->geometry.t_count - 2;
  for (int j = j0 + 1 - reach; j <= j0 + reach; j++)
    for (int i = i0 + 1 - reach; i <= i0 + reach; i++) {
      if (reach == 2 && i >= i0 && i <= i0 + 1 && j >= j0 && j <= j0 + 1) continue;
      if (i < 0 || j < 0 || i >= (int)m->geometry.s_count || j >= (int)m->geometry.t_count)
        continue;
      const float *q = m->slopes[(uint32_t)i * m->geometry.t_count + (uint32_t)j];
      if (isnan(q[0])) continue;
      float wide = 1.0f / (float)reach;
      float weight = fmaxf(1 - wide * fabsf((float)i - r->i), 0) *
                     fmaxf(1 - wide * fabsf((float)j - r->j), 0) * wide;
      neighbour n = {.slice = depth_pages_slice(&m->pages, (uint32_t)i, (uint32_t)j),
                     .weight = weight + LEAST_WEIGHT,
                     .dx = q[0] - r->qx,
                     .dy = q[1] - r->qy};
      r->near[r->near_count] = n;
      if (n.weight > r->near[0].weight) r->near[r->near_count] = r->near[0], r->near[0] = n;
      r->near_count++;
    }
}

/* As see_from in depth_kernel.c: where a slice sees what the ray meets at height h; *there becomes
 * its height over the surface there. */
static void see_from(const depth_mixer *m, const ray *r, const neighbour *n, float h, float *x,
                     float *y, float *there) {
  float right_u = h * n->dx, right_v = h * n->dy;
  *x = r->x + right_u, *y = r->y + right_v, *there = h;
  if (!m->frames) return;
  const depth_frame *f = &m->frames[(size_t)r->y * m->pages.u_count + (size_t)r->x];
  const float *p = f->across, *b = f->bend, *w = f->turn, q_u = r->qx + n->dx, q_v = r->qy + n->dy;
  float rise_u = q_u * b[0] + q_v * b[2], rise_v = q_u * b[1] + q_v * b[3];
  float uu = p[0] + h * (b[0] + q_v * w[0] + q_u * rise_u);
  float uv = p[1] + h * (b[1] + q_v * w[1] + q_u * rise_v);
  float vu = p[2] + h * (b[2] - q_u * w[0] + q_v * rise_u);
  float vv = p[3] + h * (b[3] - q_u * w[1] + q_v * rise_v);
  float scale = 1 / (uu * vv - uv * vu);
  float e_u = (right_u * vv - right_v * uv) * scale, e_v = (uu * right_v - vu * right_u) * scale;
  float drop = (b[0] * e_u + b[1] * e_v) * (p[0] * e_u + p[1] * e_v) +
               (b[2] * e_u + b[3] * e_v) * (p[2] * e_u + p[3] * e_v);
  *x = r->x + e_u, *y = r->y + e_v;
  *there = (h + 0.5f * drop) / (1 + rise_u * e_u + rise_v * e_v);
  if (m->pages.wrap_u) *x -= (float)m->pages.u_count * floorf(*x / (float)m->pages.u_count);
}

/* By how much what a slice sees where it should see height h is higher than it should; *inside is
 * whether there is any surface. */
static float look_from(depth_mixer *m, const ray *r, const neighbour *n, float h, bool *inside) {
  float x, y, there;
  see_from(m, r, n, h, &x, &y, &there);
  float code = code_at(m, n, x, y);
  *inside = code >= 0;
  return *inside ? height_of(m, code) - there : 0;
}

/* How far apart two heights may be and still be one: codes, slopes and edges are not exact. */
static float tolerance(const depth_mixer *m, float h) {
  return TOLERANCE_UNITS * m->unit + TOLERANCE_SHARE * h;
}

/* 1 for the same height, 0 beyond twice the tolerance. */
static float agreement(float off) {
  float a = 1 - 0.25f * off * off;
  return a > 0 ? a * a : 0;
}

/* On a curved surface slices see the same thing close to each other: from what the slice sees at
 * the texel itself. */
static float meet_curved(depth_mixer *m, const ray *r, const neighbour *n) {
  bool inside;
  float h = look_from(m, r, n, 0, &inside), off = h;
  for (int i = 0; i < CURVED_STEPS && inside && h >= 0; i++) {
    off = look_from(m, r, n, h, &inside);
    if (inside && fabsf(off) < 0.3f * tolerance(m, h)) return h;
    h += off;
  }
  return -1;
}

/* Where the ray meets what the slice sees: along the ray the point at height h is seen at p + h d.
 * As long as the slice sees something higher there, the point is in the open; where it sees
 * something lower, the point is behind that. From the open to behind in a step without an edge is a
 * hit. */
static float meet(depth_mixer *m, const ray *r, const neighbour *n) {
  if (m->frames) return meet_curved(m, r, n);
  float d = fmaxf(fabsf(n->dx), fabsf(n->dy)), step = STEP_TEXELS / fmaxf(d, 1e-3f), h = 0;
  if (MAX_STEPS * step < LEAST_REACH * m->unit || n->weight < LEAST_WITNESS) return -1;
  float code = code_at(m, n, r->x, r->y), last_code = code, last_open = 1;
  for (int k = 0; k < MAX_STEPS && code >= 0; k++) {
    float seen = height_of(m, code), open = seen - h;
    if (open <= 0 && last_open > 0 && fabsf(code - last_code) <= EDGE_CODES)
      return k == 0 ? seen : h - step * open / (open - last_open);
    last_open = open, last_code = code;
    /* Slices that look almost along the ray see what it meets at once. */
    if (d * fabsf(open) < 0.5f) return seen;
    h += step;
    code = code_at(m, n, r->x + h * n->dx, r->y + h * n->dy);
  }
  return -1;
}

/* What the slices say of height h, in weight: that they see a thing there, less that they look
 * through it. */
static float judge(depth_mixer *m, const ray *r, float h) {
  float sum = 0, scale = 1 / tolerance(m, h);
  for (int k = 0; k < r->near_count; k++) {
    const neighbour *n = &r->near[k];
    bool inside;
    float off = look_from(m, r, n, h, &inside) * scale;
    if (inside) sum += off > 2 ? -n->weight : n->weight * agreement(off);
  }
  return sum;
}

/* The lowest height that the slices see a thing at, by a share of what the best is judged, *score.
 * What is behind a thing may be in sight of all slices around, past it on every side. */
static float find_height(depth_mixer *m, const ray *r, float *score) {
  float heights[16], scores[16], best = -INFINITY, lowest = INFINITY;
  int count = 0;
  for (int k = 0; k < r->near_count; k++) {
    float h = meet(m, r, &r->near[k]);
    bool known = h < 0;
    for (int i = 0; i < count && !known; i++)
      known = fabsf(heights[i] - h) < 0.3f * tolerance(m, h);
    if (known) continue;
    heights[count] = h;
    scores[count] = judge(m, r, h);
    best = fmaxf(best, scores[count++]);
  }
  for (int i = 0; i < count; i++)
    if (scores[i] >= LOWER_SHARE * best && heights[i] < lowest) lowest = heights[i];
  *score = best;
  return lowest;
}

/* The slices' mean where they see height h, each as far as it does. Returns the weight. */
static float mix_at(depth_mixer *m, const ray *r, float h, float rgb[3]) {
  float sum = 0, scale = 1 / tolerance(m, h);
  rgb[0] = rgb[1] = rgb[2] = 0;
  for (int k = 0; k < r->near_count; k++) {
    const neighbour *n = &r->near[k];
    float x, y, there;
    see_from(m, r, n, h, &x, &y, &there);
    float code = code_at(m, n, x, y);
    if (code < 0) continue;
    float weight = n->weight * agreement((height_of(m, code) - there) * scale);
    if (weight < 1e-5f) continue;
    add_light(m, n, x, y, weight, rgb);
    sum += weight;
  }
  for (int k = 0; k < 3 && sum > 0; k++) rgb[k] /= sum;
  return sum;
}

/* The paper's mix, where no slice sees what the ray meets. */
static void mix_four_tap(depth_mixer *m, ray *r, float rgb[3]) {
  float sum = 0;
  rgb[0] = rgb[1] = rgb[2] = 0;
  r->near_count = 0;
  add_neighbours(m, r, 1);
  for (int k = 0; k < r->near_count; k++) {
    add_light(m, &r->near[k], r->x, r->y, r->near[k].weight, rgb);
    sum += r->near[k].weight;
  }
  for (int k = 0; k < 3; k++) rgb[k] /= sum;
}

/* ---- Blocks of texels --------------------------------------------------------------------------
 */

/* What was found for a texel last time is where it is looked for next. Texels with some slices that
 * disagree forget every 64th frame, so that nothing wrong stays, and each tells its neighbours what
 * it finds: eight of a block in every eighth, one in each row and column, as eight are followed at
 * the cost of one. Blocks take turns. */
enum { REFRESH = 8, TURN = 3 /* odd: neighbours' turns differ */ };

static depth_memory *recall(depth_mixer *m, size_t block) {
  depth_memory *last = &m->last[block];
  const uint32_t turn = m->visits[block]++ + TURN * (uint32_t)block;
  for (uint32_t row = 0; row < 8 && turn % REFRESH == 0; row++) {
    uint32_t k = 8 * row + (turn / REFRESH + 3 * row) % 8;
    if (last->score[k] < (int)(100 * ALL_AGREE)) last->kind[k] = SEEN_UNKNOWN;
  }
  return last;
}

/* A little less than last time. What was wanted stays wanted until the next search: scores do not
 * wear off frame by frame. */
static float wanted_score(const depth_memory *last, uint32_t k) {
  float least = last->kind[k] == SEEN_WIDE ? LEAST_WIDE : LEAST_NEAR;
  float wanted = fmaxf(0.01f * (float)last->score[k] - SCORE_SLACK, least);
  return wanted < ALL_AGREE ? wanted : ALL_AGREE;
}

/* The slices at a cell's corners. */
static depth_cell find_cell(depth_mixer *m, uint32_t i0, uint32_t j0) {
  depth_cell cell = {.pages = &m->pages, .frames = m->frames, .unit = m->unit, .i0 = i0, .j0 = j0};
  const depth_geometry *g = &m->geometry;
  uint32_t any = 0;
  for (uint32_t k = 0; k < 4; k++) {
    uint32_t i = i0 + (k & 1), j = j0 + (k >> 1);
    bool exists = i < g->s_count && j < g->t_count && !isnan(m->slopes[i * g->t_count + j][0]);
    cell.exists[k] = exists;
    if (exists) any = k;
  }
  for (uint32_t k = 0; k < 4; k++) {
    uint32_t from = cell.exists[k] > 0 ? k : any, i = i0 + (from & 1), j = j0 + (from >> 1);
    const float *q = m->slopes[i * g->t_count + j];
    cell.qx[k] = q[0], cell.qy[k] = q[1];
    cell.slices[k] = depth_pages_slice(&m->pages, i, j);
  }
  return cell;
}

static ray find_ray(depth_mixer *m, const depth_rays *rays, uint32_t k) {
  ray r = {rays->x[k], rays->y[k], rays->qx[k], rays->qy[k], rays->i[k], rays->j[k], {{0}}, 0};
  add_neighbours(m, &r, 1);
  return r;
}

/* As last time, where the four slices around did not do. */
static bool mix_again(depth_mixer *m, depth_rays *rays, uint32_t k, const depth_memory *last) {
  ray r = find_ray(m, rays, k);
  rays->rgba[k][3] = 1;
  if (last->kind[k] == SEEN_NOT) {
    rays->score[k] = 0;
    mix_four_tap(m, &r, rays->rgba[k]);
    return true;
  }
  float code = (float)last->code[k] / 256, h = height_of(m, code);
  add_neighbours(m, &r, 2);
  rays->code[k] = code;
  rays->score[k] = judge(m, &r, h);
  return rays->score[k] > wanted_score(last, k) && mix_at(m, &r, h, rays->rgba[k]) > 0;
}

/* From 16 slices, each followed along the ray. Returns how. */
static uint8_t mix_alone(depth_mixer *m, depth_rays *rays, uint32_t k) {
  ray r = find_ray(m, rays, k);
  rays->rgba[k][3] = 1;
  add_neighbours(m, &r, 2);
  float h = find_height(m, &r, &rays->score[k]);
  if (rays->score[k] >= LEAST_WIDE && mix_at(m, &r, h, rays->rgba[k]) > 0) {
    rays->code[k] = 256 * h / (m->unit + h);
    return SEEN_WIDE;
  }
  mix_four_tap(m, &r, rays->rgba[k]);
  return SEEN_NOT;
}

/* Where a guess comes from: the texel itself or its neighbours, last time. What moves, moves over a
 * texel from there. */
typedef enum {
  GUESS_LOWER, /* from the lowest neighbour, if that is another thing, which may hide the texel's */
  GUESS_AGAIN,
  GUESS_RIGHT,
  GUESS_LEFT,
  GUESS_BELOW,
  GUESS_ABOVE,
  GUESS_COUNT
} guess_origin;

static const int8_t columns[GUESS_COUNT] = {0, 0, 1, -1, 0, 0},
                    rows[GUESS_COUNT] = {0, 0, 0, 0, 1, -1};

/* The place of a texel's neighbour in the block; -1 beyond it. */
static int find_neighbour(uint32_t k, guess_origin origin) {
  int column = (int)k % 8 + columns[origin], row = (int)k / 8 + rows[origin];
  return column < 0 || row < 0 || column > 7 || row > 7 ? -1 : 8 * row + column;
}

static bool guess_lower(const depth_memory *last, uint32_t k, float *code, float *wanted) {
  int lowest = last->code[k] - 256 * EDGE_CODES;
  bool found = false;
  for (int origin = GUESS_RIGHT; origin < GUESS_COUNT; origin++) {
    int from = find_neighbour(k, (guess_origin)origin);
    if (from < 0 || last->kind[from] != SEEN_NEAR || last->code[from] >= lowest) continue;
    lowest = last->code[from], found = true;
  }
  *code = (float)lowest / 256;
  *wanted = fmaxf(0.01f * LOWER_SHARE * (float)last->score[k], LEAST_NEAR);
  return found;
}

static bool guess(const depth_memory *last, uint32_t k, guess_origin origin, float *code,
                  float *wanted) {
  if (origin != GUESS_AGAIN && last->kind[k] == SEEN_UNKNOWN) return false;
  if (origin == GUESS_LOWER) return guess_lower(last, k, code, wanted);
  int from = find_neighbour(k, origin);
  if (from < 0 || last->kind[from] != SEEN_NEAR) return false;
  *code = (float)last->code[from] / 256;
  *wanted = wanted_score(last, (uint32_t)from);
  return true;
}

/* Takes up to eight texels out of the mask. */
static int take_eight(uint64_t *texels, uint8_t out[LANES]) {
  int count = 0;
  for (; *texels && count < LANES; *texels &= *texels - 1)
    out[count++] = (uint8_t)__builtin_ctzll(*texels);
  return count;
}

/* Takes texels out of the mask until there are eight for which `origin` has a guess. */
static void pick(const depth_memory *last, guess_origin origin, uint64_t *texels, depth_guess *g) {
  int count = 0;
  for (; *texels && count < LANES; *texels &= *texels - 1) {
    uint32_t k = (uint32_t)__builtin_ctzll(*texels);
    if (guess(last, k, origin, &g->codes[count], &g->wanted[count]))
      g->texels[count++] = (uint8_t)k;
  }
  g->count = count;
  if (count == 0) return;
  for (int l = count; l < LANES; l++)
    g->texels[l] = g->texels[0], g->codes[l] = g->codes[0], g->wanted[l] = g->wanted[0];
}

static uint64_t find_mixed(const depth_guess *g, unsigned lanes) {
  uint64_t mixed = 0;
  for (; lanes; lanes &= lanes - 1) mixed |= 1ull << g->texels[__builtin_ctz(lanes)];
  return mixed;
}

/* Mixes what it can of the texels from what is guessed; returns those. */
static uint64_t mix_guessed(depth_mixer *m, const depth_cell *cell, depth_rays *rays,
                            uint64_t texels, const depth_memory *last, guess_origin origin) {
  uint64_t mixed = 0;
  while (texels) {
    depth_guess g;
    pick(last, origin, &texels, &g);
    if (g.count > 0) mixed |= find_mixed(&g, m->kernel->mix(cell, rays, &g));
  }
  return mixed;
}

/* The same without guesses. */
static uint64_t mix_sought(depth_mixer *m, const depth_cell *cell, depth_rays *rays,
                           uint64_t texels) {
  uint64_t mixed = 0;
  while (texels) {
    depth_guess g = {.count = 0};
    for (int l = 0; l < LANES; l++) g.wanted[l] = LEAST_NEAR;
    g.count = take_eight(&texels, g.texels);
    mixed |= find_mixed(&g, m->kernel->seek(cell, rays, &g));
  }
  return mixed;
}

/* The texels that the four slices around did not serve last time. */
static uint64_t find_poor(const depth_memory *last) {
  uint64_t poor = 0;
  for (int k = 0; k < 64; k++)
    poor |= (uint64_t)(last->kind[k] == SEEN_WIDE || last->kind[k] == SEEN_NOT) << k;
  return poor;
}

/* Mixes texels of a cell that are not steady; returns those that were foretold. */
static uint64_t mix_rest(depth_mixer *m, const depth_cell *cell, depth_rays *rays, uint64_t left,
                         const depth_memory *last, uint8_t kinds[64]) {
  uint64_t foretold = 0;
  for (int origin = 0; origin < GUESS_COUNT && left; origin++) {
    uint64_t found = mix_guessed(m, cell, rays, left, last, (guess_origin)origin);
    foretold |= found, left &= ~found;
  }
  for (uint64_t poor = left & find_poor(last); poor; poor &= poor - 1) {
    uint32_t k = (uint32_t)__builtin_ctzll(poor);
    if (mix_again(m, rays, k, last)) kinds[k] = last->kind[k], left &= ~(1ull << k);
  }
  left &= ~mix_sought(m, cell, rays, left);
  for (; left; left &= left - 1) {
    uint32_t k = (uint32_t)__builtin_ctzll(left);
    kinds[k] = mix_alone(m, rays, k);
  }
  return foretold;
}

static void count_texels(depth_mix_counts *counts, uint64_t mask, uint64_t foretold,
                         const uint8_t kinds[64]) {
  counts->texel_count += (uint64_t)__builtin_popcountll(mask);
  counts->foretold_count += (uint64_t)__builtin_popcountll(foretold);
  for (uint64_t left = mask & ~foretold; left; left &= left - 1) {
    uint8_t kind = kinds[__builtin_ctzll(left)];
    counts->wide_count += kind == SEEN_WIDE;
    counts->four_tap_count += kind == SEEN_NOT;
  }
}

void depth_mix_block(depth_mixer *m, uint32_t block_u, uint32_t block_v,
                     const block_directions *directions, uint16_t *out, size_t row_nbytes) {
  depth_rays rays;
  depth_cell cells[64];
  uint64_t texels[64]; /* of each cell */
  depth_aim aims[64];
  uint8_t kinds[64];
  int cell_count = 0, aim_count = 0;
  depth_pages_make_room(&m->pages);
  depth_memory *now = recall(m, (size_t)block_v * m->block_u_count + block_u);
  const depth_memory last = *now;
  const uint64_t steady = m->kernel->find_steady(&last);
  uint64_t foretold = 0;
  memset(kinds, SEEN_NEAR, sizeof kinds);
  m->kernel->place(&m->geometry, block_u, block_v, directions, &rays);
  if (~directions->mask) memset(rays.rgba, 0, sizeof rays.rgba);
  for (uint64_t left = directions->mask; left; left &= ~texels[cell_count++]) {
    int32_t at = rays.cell[__builtin_ctzll(left)];
    cells[cell_count] =
        find_cell(m, (uint32_t)at / m->geometry.t_count, (uint32_t)at % m->geometry.t_count);
    texels[cell_count] = m->kernel->find_cell(&rays, at) & left;
    for (uint64_t k = texels[cell_count] & steady; k;) {
      uint8_t eight[LANES] = {0};
      int count = take_eight(&k, eight);
      m->kernel->aim(&cells[cell_count], &rays, &last, eight, count, &aims[aim_count++]);
    }
  }
  for (int i = 0; i < aim_count; i++)
    foretold |= find_mixed(&aims[i].guess, m->kernel->mix_aimed(&rays, &aims[i]));
  for (int i = 0; i < cell_count; i++)
    foretold |= mix_rest(m, &cells[i], &rays, texels[i] & ~foretold, &last, kinds);
  count_texels(&m->counts, directions->mask, foretold, kinds);
  m->kernel->remember(&rays, kinds, directions->mask, now);
  m->kernel->put(&rays, out, row_nbytes);
}

void depth_mixer_use_kernel(depth_mixer *m, resample_kernel kernel) {
  m->kernel = &depth_kernel_plain;
#if defined(__x86_64__)
  if (kernel == RESAMPLE_BEST && cpu_has_avx2_f16c()) m->kernel = &depth_kernel_avx2;
#endif
}

depth_mixer *depth_mixer_create(const slf_layer *reflected, block_source light,
                                const slf_layer *height, block_source heights,
                                const slf_surface *surface, uint32_t u_count, uint32_t v_count) {
  depth_mixer *m = calloc(1, sizeof *m);
  if (!m) return NULL;
  m->geometry.s_count = reflected->s_count, m->geometry.t_count = reflected->t_count;
  m->u_end = (float)reflected->u_count + 0.5f, m->v_end = (float)reflected->v_count + 0.5f;
  m->geometry.texel_u = (float)reflected->u_count / (float)u_count;
  m->geometry.texel_v = (float)reflected->v_count / (float)v_count;
  float *scale = m->geometry.scale;
  bool wrap_u = surface->flags & SLF_SURFACE_WRAP_U;
  bool flat = flat_texel_scale(&surface->mesh, reflected->u_count, reflected->v_count, scale);
  if (!flat) {
    memcpy(scale, (float[4]){1, 0, 0, 1}, 4 * sizeof *scale);
    m->frames = depth_frames_create(&surface->mesh, reflected->u_count, reflected->v_count, wrap_u);
  }
  m->unit = height->height_unit;
  m->slopes = calloc((size_t)m->geometry.s_count * m->geometry.t_count, sizeof *m->slopes);
  depth_mixer_use_kernel(m, RESAMPLE_BEST);
  m->block_u_count = (u_count + 7) / 8;
  size_t block_count = (size_t)m->block_u_count * ((v_count + 7) / 8);
  m->last = calloc(block_count, sizeof *m->last);
  m->visits = calloc(block_count, 1);
  if (!depth_pages_create(&m->pages, reflected, light, height, heights) || !m->slopes || !m->last ||
      !m->visits || (!flat && !m->frames)) {
    depth_mixer_free(m);
    return NULL;
  }
  m->pages.wrap_u = wrap_u && !flat;
  for (uint32_t i = 0; i < m->geometry.s_count; i++)
    for (uint32_t j = 0; j < m->geometry.t_count; j++) {
      double d[3];
      float *q = m->slopes[i * m->geometry.t_count + j];
      q[0] = NAN;
      if (!slf_slice_exists(m->geometry.s_count, m->geometry.t_count, i, j)) continue;
      slf_direction((i + 0.5) / m->geometry.s_count, (j + 0.5) / m->geometry.t_count,
                    SLF_BAKED_N_MIN, d);
      q[0] = (scale[0] * (float)d[0] + scale[1] * (float)d[1]) / (float)d[2];
      q[1] = (scale[2] * (float)d[0] + scale[3] * (float)d[1]) / (float)d[2];
    }
  return m;
}

const depth_mix_counts *depth_mixer_counts(const depth_mixer *m) {
  return &m->counts;
}

void depth_mixer_free(depth_mixer *m) {
  if (!m) return;
  free(m->slopes);
  free(m->frames);
  free(m->last);
  free(m->visits);
  depth_pages_free(&m->pages);
  free(m);
}
