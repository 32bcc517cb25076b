#include "depth_mix.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "half.h"

enum {
  MEMO_COUNT =
      1024,        /* U-Blocks at hand, a power of two: 256 KiB, what a row of blocks reads again */
  EDGE_CODES = 12, /* heights further apart are of two things */
  STEP_TEXELS = 2, /* that a ray is followed through a slice by, */
  MAX_STEPS = 48   /* so many times */
};

/* The weight of slices that must agree for no more to be asked: less lets a thing's outline slip
 * where the slices that see it weigh little. */
static const float all_agree = 0.93f;

/* A hair inside the circle, as in resample.c, but n must stay well above 0 for slopes. */
static const float rim = 0.9997f;

typedef struct {
  uint64_t key;
  uint8_t texels[SLF_BLOCK_NBYTES];
} memo_entry;

/* The blocks read lately, in front of a source whose blocks do not stay. */
typedef struct {
  block_source source;
  uint32_t u_count, v_count; /* texels of its layer */
  memo_entry *entries;       /* MEMO_COUNT of them */
} block_memo;

struct depth_mixer {
  uint32_t s_count, t_count;
  float u_end, v_end;                 /* half a texel beyond the light's last */
  float heights_per_u, heights_per_v; /* texels of heights per texel of light */
  float texel_u, texel_v;             /* texels of light per texel mixed */
  float scale[4];                     /* see flat_texel_scale */
  float unit;
  float (*slopes)[2]; /* q of each slice, NAN of those that do not exist */
  float linear[256];  /* of a code */
  block_memo light, heights;
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

/* ---- Blocks ------------------------------------------------------------------------------------
 */

static bool memo_create(block_memo *memo, const slf_layer *layer, block_source source) {
  *memo = (block_memo){.source = source, .u_count = layer->u_count, .v_count = layer->v_count};
  memo->entries = malloc(MEMO_COUNT * sizeof *memo->entries);
  for (int i = 0; i < MEMO_COUNT && memo->entries; i++) memo->entries[i].key = UINT64_MAX;
  return memo->entries;
}

static const memo_entry *memo_find(block_memo *memo, uint32_t slice, uint32_t block_u,
                                   uint32_t block_v) {
  uint64_t key = (uint64_t)block_v << 32 | (uint64_t)block_u << 16 | slice;
  memo_entry *entry = &memo->entries[(key * 0x9e3779b97f4a7c15u) >> 48 & (MEMO_COUNT - 1)];
  if (entry->key != key) {
    slice_index index = (slice_index)slice;
    const uint8_t *u_block;
    memo->source.fetch(memo->source.context, block_u, block_v, &index, 1, &u_block);
    memcpy(entry->texels, u_block, SLF_BLOCK_NBYTES);
    entry->key = key;
  }
  return entry;
}

/* ---- What a slice sees --------------------------------------------------------------------------
 */

static int clamp_index(int x, uint32_t count) {
  return x < 0 ? 0 : x >= (int)count ? (int)count - 1 : x;
}

/* The four texels around (x, y), and how far it is from the first. */
static void find_texels(block_memo *memo, uint32_t slice, float x, float y,
                        const uint8_t *texels[4], float *fx, float *fy) {
  float left = floorf(x - 0.5f), top = floorf(y - 0.5f);
  int x0 = (int)left, y0 = (int)top;
  *fx = x - 0.5f - left, *fy = y - 0.5f - top;
  if (x0 >= 0 && y0 >= 0 && (x0 & 7) < 7 && (y0 & 7) < 7 && x0 + 1 < (int)memo->u_count &&
      y0 + 1 < (int)memo->v_count) {
    const uint8_t *first = memo_find(memo, slice, (uint32_t)x0 / 8, (uint32_t)y0 / 8)->texels +
                           ((y0 & 7) * 8 + (x0 & 7)) * 4;
    texels[0] = first, texels[1] = first + 4, texels[2] = first + 32, texels[3] = first + 36;
    return;
  }
  for (int k = 0; k < 4; k++) {
    uint32_t i = (uint32_t)clamp_index(x0 + (k & 1), memo->u_count);
    uint32_t j = (uint32_t)clamp_index(y0 + (k >> 1), memo->v_count);
    texels[k] = memo_find(memo, slice, i / 8, j / 8)->texels + (j % 8 * 8 + i % 8) * 4;
  }
}

/* The code of the height that the slice sees at texel (x, y) of the light; -1 beyond the surface.
 */
static float code_at(depth_mixer *m, uint32_t slice, float x, float y) {
  if (!(x >= -0.5f && y >= -0.5f && x <= m->u_end && y <= m->v_end)) return -1;
  const uint8_t *t[4];
  float fx, fy;
  find_texels(&m->heights, slice, x * m->heights_per_u, y * m->heights_per_v, t, &fx, &fy);
  int a = t[0][1], b = t[1][1], c = t[2][1], d = t[3][1];
  int low = a < b ? a : b, high = a < b ? b : a, low_2 = c < d ? c : d, high_2 = c < d ? d : c;
  if (low_2 < low) low = low_2;
  if (high_2 > high) high = high_2;
  /* Between a thing and what is behind it there is nothing. */
  if (high - low > EDGE_CODES) return t[(fx > 0.5f) + 2 * (fy > 0.5f)][1];
  float top = (float)a + fx * (float)(b - a), bottom = (float)c + fx * (float)(d - c);
  return top + fy * (bottom - top);
}

static float height_of(const depth_mixer *m, float code) {
  return m->unit * code / (256 - code);
}

static void add_light(depth_mixer *m, uint32_t slice, float x, float y, float weight,
                      float rgb[3]) {
  const uint8_t *t[4];
  float fx, fy;
  find_texels(&m->light, slice, x, y, t, &fx, &fy);
  float w[4] = {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
  for (int channel = 0; channel < 3; channel++)
    for (int k = 0; k < 4; k++) rgb[channel] += weight * w[k] * m->linear[t[k][channel]];
}

/* ---- One texel ----------------------------------------------------------------------------------
 */

/* A slice near the ray's direction: its weight, and (q_i - q). */
typedef struct {
  uint32_t slice;
  float weight, dx, dy;
} neighbour;

typedef struct {
  float x, y;         /* texel */
  float qx, qy;       /* slopes, texels a unit of height */
  float i, j;         /* place among the slices, S and T */
  neighbour near[16]; /* that of most weight first */
  int near_count;
} ray;

static ray make_ray(const depth_mixer *m, float x, float y, float S, float T) {
  float s = 2 * S - 1, t = 2 * T - 1;
  s = fabsf(s) < 1e9f ? s : 0; /* NaN too */
  t = fabsf(t) < 1e9f ? t : 0;
  float radius_2 = s * s + t * t, pull = radius_2 > rim * rim ? rim / sqrtf(radius_2) : 1;
  s *= pull, t *= pull;
  float n = sqrtf(1 - s * s - t * t);
  ray r = {.x = x, .y = y};
  r.qx = (m->scale[0] * s + m->scale[1] * t) / n;
  r.qy = (m->scale[2] * s + m->scale[3] * t) / n;
  r.i = fminf(fmaxf(0.5f * (s + 1) * (float)m->s_count - 0.5f, 0), (float)(m->s_count - 1));
  r.j = fminf(fmaxf(0.5f * (t + 1) * (float)m->t_count - 0.5f, 0), (float)(m->t_count - 1));
  return r;
}

/* The slices within `reach` of the ray's direction that it does not have yet, weighed by a tent of
 * that width; a slice on the tent's rim keeps a hundredth, as its word on visibility counts. */
static void add_neighbours(const depth_mixer *m, ray *r, int reach) {
  int i0 = (int)r->i, j0 = (int)r->j;
  if (m->s_count > 1 && i0 > (int)m->s_count - 2) i0 = (int)m->s_count - 2;
  if (m->t_count > 1 && j0 > (int)m->t_count - 2) j0 = (int)m->t_count - 2;
  for (int j = j0 + 1 - reach; j <= j0 + reach; j++)
    for (int i = i0 + 1 - reach; i <= i0 + reach; i++) {
      if (reach == 2 && i >= i0 && i <= i0 + 1 && j >= j0 && j <= j0 + 1) continue;
      if (i < 0 || j < 0 || i >= (int)m->s_count || j >= (int)m->t_count) continue;
      const float *q = m->slopes[(uint32_t)i * m->t_count + (uint32_t)j];
      if (isnan(q[0])) continue;
      float wide = 1.0f / (float)reach;
      float weight = fmaxf(1 - wide * fabsf((float)i - r->i), 0) *
                     fmaxf(1 - wide * fabsf((float)j - r->j), 0) * wide;
      neighbour n = {(uint32_t)i << 8 | (uint32_t)j, weight + 0.01f, q[0] - r->qx, q[1] - r->qy};
      r->near[r->near_count] = n;
      if (n.weight > r->near[0].weight) r->near[r->near_count] = r->near[0], r->near[0] = n;
      r->near_count++;
    }
}

/* How far apart two heights may be and still be one: codes, slopes and edges are not exact. */
static float tolerance(const depth_mixer *m, float h) {
  return 0.005f * m->unit + 0.03f * h;
}

/* 1 for the same height, 0 beyond twice the tolerance. */
static float agreement(float off) {
  float a = 1 - 0.25f * off * off;
  return a > 0 ? a * a : 0;
}

/* Where the ray meets what the slice sees: along the ray the point at height h is seen at p + h d.
 * As long as the slice sees something higher there, the point is in the open; where it sees
 * something lower, the point is behind that. From the open to behind in a step without an edge is a
 * hit. */
static float meet(depth_mixer *m, const ray *r, const neighbour *n) {
  float d = fmaxf(fabsf(n->dx), fabsf(n->dy)), step = STEP_TEXELS / fmaxf(d, 1e-3f), h = 0;
  float code = code_at(m, n->slice, r->x, r->y), last_code = code, last_open = 1;
  for (int k = 0; k < MAX_STEPS && code >= 0; k++) {
    float seen = height_of(m, code), open = seen - h;
    if (open <= 0 && last_open > 0 && fabsf(code - last_code) <= EDGE_CODES)
      return k == 0 ? seen : h - step * open / (open - last_open);
    last_open = open, last_code = code;
    /* Slices that look almost along the ray see what it meets at once. */
    if (d * fabsf(open) < 0.5f) return seen;
    h += step;
    code = code_at(m, n->slice, r->x + h * n->dx, r->y + h * n->dy);
  }
  return -1;
}

/* What the slices say of height h, in weight: that they see a thing there, less that they look
 * through it. */
static float judge(depth_mixer *m, const ray *r, float h) {
  float sum = 0, scale = 1 / tolerance(m, h);
  for (int k = 0; k < r->near_count; k++) {
    const neighbour *n = &r->near[k];
    float code = code_at(m, n->slice, r->x + h * n->dx, r->y + h * n->dy);
    if (code < 0) continue;
    float off = (height_of(m, code) - h) * scale;
    sum += off > 2 ? -n->weight : n->weight * agreement(off);
  }
  return sum;
}

/* The lowest height that is judged about as well as the best; *score is the best's. */
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
    if (scores[count] > best) best = scores[count];
    if (scores[count++] > all_agree) break;
  }
  for (int i = 0; i < count; i++)
    if (scores[i] >= 0.5f * best && heights[i] < lowest) lowest = heights[i];
  *score = best;
  return lowest;
}

/* The slices' mean where they see height h, each as far as it does. Returns the weight. */
static float mix_at(depth_mixer *m, const ray *r, float h, float rgb[3]) {
  float sum = 0, scale = 1 / tolerance(m, h);
  rgb[0] = rgb[1] = rgb[2] = 0;
  for (int k = 0; k < r->near_count; k++) {
    const neighbour *n = &r->near[k];
    float x = r->x + h * n->dx, y = r->y + h * n->dy, code = code_at(m, n->slice, x, y);
    if (code < 0) continue;
    float weight = n->weight * agreement((height_of(m, code) - h) * scale);
    if (weight < 1e-5f) continue;
    add_light(m, n->slice, x, y, weight, rgb);
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
    add_light(m, r->near[k].slice, r->x, r->y, r->near[k].weight, rgb);
    sum += r->near[k].weight;
  }
  for (int k = 0; k < 3; k++) rgb[k] /= sum;
}

/* Returns the height that was found, -1 for none. */
static float mix_texel(depth_mixer *m, ray *r, float rgb[3]) {
  for (int reach = 1; reach <= 2; reach++) {
    float score;
    if (reach == 2) add_neighbours(m, r, reach);
    float h = find_height(m, r, &score);
    if (score < (reach == 1 ? 0.15f : 0.01f)) continue;
    m->counts.wide_count += reach == 2;
    if (mix_at(m, r, h, rgb) > 0) return h;
  }
  m->counts.four_tap_count++;
  mix_four_tap(m, r, rgb);
  return -1;
}

/* ---- Blocks of texels --------------------------------------------------------------------------
 */

static ray ray_of_texel(const depth_mixer *m, uint32_t block_u, uint32_t block_v,
                        const block_directions *directions, uint32_t k) {
  float x = ((float)(8 * block_u + k % 8) + 0.5f) * m->texel_u;
  float y = ((float)(8 * block_v + k / 8) + 0.5f) * m->texel_v;
  ray r = make_ray(m, x, y, directions->s[k], directions->t[k]);
  add_neighbours(m, &r, 1);
  return r;
}

static void put_texel(uint16_t *out, size_t row_nbytes, uint32_t k, const float rgb[3]) {
  uint16_t *texel = (uint16_t *)((uint8_t *)out + k / 8 * row_nbytes) + k % 8 * 4;
  for (int a = 0; a < 3; a++) texel[a] = half_from_float(rgb[a]);
  texel[3] = HALF_ONE;
}

/* A height near *guess that all slices around agree on gives the texel, and becomes *guess; false
 * if there is none. */
static bool mix_near(depth_mixer *m, const ray *r, float *guess, float rgb[3]) {
  const neighbour *n = &r->near[0];
  float h = *guess;
  for (int i = 0; i < 2; i++) {
    float code = code_at(m, n->slice, r->x + h * n->dx, r->y + h * n->dy);
    if (code < 0) return false;
    h = height_of(m, code);
  }
  bool near = fabsf(h - *guess) < 4 * tolerance(m, h);
  *guess = h;
  return near && mix_at(m, r, h, rgb) > all_agree;
}

/* Heights change slowly but at edges: the texel to the left foretells a texel's, or the one above.
 * Where a thing ends, slices on either side of the ray see past it or do not, so not all agree. */
void depth_mix_block(depth_mixer *m, uint32_t block_u, uint32_t block_v,
                     const block_directions *directions, uint16_t *out, size_t row_nbytes) {
  float heights[64];
  for (uint32_t k = 0; k < 64; k++) {
    float rgb[3], guess = k % 8 > 0 ? heights[k - 1] : k > 7 ? heights[k - 8] : -1;
    heights[k] = -1;
    if (!(directions->mask >> k & 1)) {
      memset((uint8_t *)out + k / 8 * row_nbytes + k % 8 * 8, 0, 8);
      continue;
    }
    ray r = ray_of_texel(m, block_u, block_v, directions, k);
    m->counts.texel_count++;
    if (guess >= 0 && mix_near(m, &r, &guess, rgb))
      m->counts.foretold_count++, heights[k] = guess;
    else
      heights[k] = mix_texel(m, &r, rgb);
    put_texel(out, row_nbytes, k, rgb);
  }
}

depth_mixer *depth_mixer_create(const slf_layer *reflected, block_source light,
                                const slf_layer *height, block_source heights, const float scale[4],
                                uint32_t u_count, uint32_t v_count) {
  depth_mixer *m = calloc(1, sizeof *m);
  if (!m) return NULL;
  m->s_count = reflected->s_count, m->t_count = reflected->t_count;
  m->u_end = (float)reflected->u_count + 0.5f, m->v_end = (float)reflected->v_count + 0.5f;
  m->heights_per_u = (float)height->u_count / (float)reflected->u_count;
  m->heights_per_v = (float)height->v_count / (float)reflected->v_count;
  m->texel_u = (float)reflected->u_count / (float)u_count;
  m->texel_v = (float)reflected->v_count / (float)v_count;
  memcpy(m->scale, scale, sizeof m->scale);
  m->unit = height->height_unit;
  m->slopes = calloc((size_t)m->s_count * m->t_count, sizeof *m->slopes);
  bool made = memo_create(&m->light, reflected, light) && m->slopes;
  if (!memo_create(&m->heights, height, heights) || !made) {
    depth_mixer_free(m);
    return NULL;
  }
  for (uint32_t i = 0; i < m->s_count; i++)
    for (uint32_t j = 0; j < m->t_count; j++) {
      double d[3];
      float *q = m->slopes[i * m->t_count + j];
      q[0] = NAN;
      if (!slf_slice_exists(m->s_count, m->t_count, i, j)) continue;
      slf_direction((i + 0.5) / m->s_count, (j + 0.5) / m->t_count, SLF_BAKED_N_MIN, d);
      q[0] = (scale[0] * (float)d[0] + scale[1] * (float)d[1]) / (float)d[2];
      q[1] = (scale[2] * (float)d[0] + scale[3] * (float)d[1]) / (float)d[2];
    }
  for (int code = 0; code < 256; code++) m->linear[code] = slf_linear_from_srgb((uint8_t)code);
  return m;
}

const depth_mix_counts *depth_mixer_counts(const depth_mixer *m) {
  return &m->counts;
}

void depth_mixer_free(depth_mixer *m) {
  if (!m) return;
  free(m->slopes);
  free(m->light.entries);
  free(m->heights.entries);
  free(m);
}
