/* Compiled twice: for any processor, and, with -mavx2 -mf16c, for those that have that. The vectors
 * are the compiler's own, so that both do the same operations in the same order. */
#include "depth_kernel.h"

#include <math.h>
#include <string.h>

#include "half.h"

#if defined(__AVX2__)
#include <immintrin.h>
#define KERNEL depth_kernel_avx2
#else
#define KERNEL depth_kernel_plain
#endif
/* Weights are parts of this. */
enum { WHOLE = 32767 };
#define INLINE static inline __attribute__((always_inline))

typedef float f8 __attribute__((vector_size(32)));
typedef int32_t i8 __attribute__((vector_size(32))); /* numbers, or masks of -1 and 0 */

/* ---- Eight numbers -----------------------------------------------------------------------------
 */

INLINE f8 all(float x) {
  return (f8){x, x, x, x, x, x, x, x};
}

INLINE f8 load(const float *x) {
  f8 v;
  memcpy(&v, x, sizeof v);
  return v;
}

INLINE void store(float *x, f8 v) {
  memcpy(x, &v, sizeof v);
}

INLINE f8 to_float(i8 v) {
  return __builtin_convertvector(v, f8);
}

INLINE i8 to_int(f8 v) {
  return __builtin_convertvector(v, i8);
}

#if defined(__AVX2__)
INLINE f8 choose(i8 mask, f8 a, f8 b) {
  return _mm256_blendv_ps(b, a, (f8)mask);
}

INLINE f8 smaller(f8 a, f8 b) {
  return _mm256_min_ps(a, b);
}

INLINE f8 larger(f8 a, f8 b) {
  return _mm256_max_ps(a, b);
}

INLINE i8 lower(i8 a, i8 b) {
  return (i8)_mm256_min_epi32((__m256i)a, (__m256i)b);
}

INLINE i8 higher(i8 a, i8 b) {
  return (i8)_mm256_max_epi32((__m256i)a, (__m256i)b);
}

INLINE unsigned mask_bits(i8 mask) {
  return (unsigned)_mm256_movemask_ps((f8)mask);
}

INLINE i8 gather(const void *base, i8 offset_nbytes) {
  return (i8)_mm256_i32gather_epi32(base, (__m256i)offset_nbytes, 1);
}

/* The heights' codes of a texel and its right neighbour. */
INLINE void gather_codes(const uint8_t *texels, i8 offset_nbytes, i8 *left, i8 *right) {
  __m128i low = _mm256_castsi256_si128((__m256i)offset_nbytes);
  __m128i high = _mm256_extracti128_si256((__m256i)offset_nbytes, 1);
  const long long *base = (const long long *)(const void *)texels;
  __m256 a = _mm256_castsi256_ps(_mm256_i32gather_epi64(base, low, 1));
  __m256 b = _mm256_castsi256_ps(_mm256_i32gather_epi64(base, high, 1));
  __m256i even = _mm256_castps_si256(_mm256_shuffle_ps(a, b, 0x88));
  __m256i odd = _mm256_castps_si256(_mm256_shuffle_ps(a, b, 0xdd));
  *left = (i8)_mm256_permute4x64_epi64(_mm256_srli_epi32(even, 24), 0xd8);
  *right = (i8)_mm256_permute4x64_epi64(_mm256_srli_epi32(odd, 24), 0xd8);
}
#else
INLINE f8 choose(i8 mask, f8 a, f8 b) {
  return (f8)(((i8)a & mask) | ((i8)b & ~mask));
}

INLINE f8 smaller(f8 a, f8 b) {
  return choose(a < b, a, b);
}

INLINE f8 larger(f8 a, f8 b) {
  return choose(a > b, a, b);
}

INLINE i8 lower(i8 a, i8 b) {
  i8 mask = a < b;
  return (a & mask) | (b & ~mask);
}

INLINE i8 higher(i8 a, i8 b) {
  i8 mask = a > b;
  return (a & mask) | (b & ~mask);
}

INLINE unsigned mask_bits(i8 mask) {
  unsigned bits = 0;
  for (int l = 0; l < LANES; l++) bits |= (unsigned)(mask[l] & 1) << l;
  return bits;
}

INLINE i8 gather(const void *base, i8 offset_nbytes) {
  i8 v;
  for (int l = 0; l < LANES; l++) {
    int32_t x;
    memcpy(&x, (const uint8_t *)base + offset_nbytes[l], sizeof x);
    v[l] = x;
  }
  return v;
}

INLINE void gather_codes(const uint8_t *texels, i8 offset_nbytes, i8 *left, i8 *right) {
  for (int l = 0; l < LANES; l++) {
    (*left)[l] = texels[offset_nbytes[l] + 3];
    (*right)[l] = texels[offset_nbytes[l] + 7];
  }
}
#endif

INLINE f8 root(f8 x) {
#if defined(__AVX2__)
  return _mm256_sqrt_ps(x);
#else
  for (int l = 0; l < LANES; l++) x[l] = sqrtf(x[l]);
  return x;
#endif
}

INLINE f8 magnitude(f8 x) {
  return (f8)((i8)x & 0x7fffffff);
}

/* ---- What a slice sees --------------------------------------------------------------------------
 */

/* What a slice shows at a place. */
typedef struct {
  i8 texel; /* where the four texels around begin, in the pages' bytes */
  f8 fx, fy;
  f8 seen; /* code of the height */
  i8 inside;
} reading;

static __attribute__((noinline)) i8 load_pages(const depth_cell *cell, int k, i8 place, i8 page) {
  const uint32_t columns = cell->pages->block_u_count;
  for (int l = 0; l < LANES; l++)
    if (page[l] < 0) {
      uint32_t block = (uint32_t)place[l];
      /* The lane before may have brought it. */
      page[l] = cell->tables[k][block];
      if (page[l] < 0)
        page[l] =
            depth_pages_load(cell->pages, cell->s[k], cell->t[k], block % columns, block / columns);
    }
  return page;
}

/* Slice k at texel (x, y) of the light. */
INLINE reading look(const depth_cell *cell, int k, f8 x, f8 y) {
  const depth_pages *p = cell->pages;
  reading r;
  if (p->wrap_u) {
    f8 round = all((float)p->u_count);
    x = choose(x < all(0), x + round, choose(x >= round, x - round, x));
  }
  f8 free_x = x - 0.5f, free_y = y - 0.5f;
  x = smaller(larger(free_x, all(0)), all((float)(p->u_count - 1)));
  y = smaller(larger(free_y, all(0)), all((float)(p->v_count - 1)));
  r.inside = larger(magnitude(x - free_x), magnitude(y - free_y)) <= all(1);
  i8 i = to_int(x), j = to_int(y);
  r.fx = x - to_float(i), r.fy = y - to_float(j);
  i8 place = (j >> 3) * (int32_t)p->block_u_count + (i >> 3);
  i8 page = gather(cell->tables[k], place << 2);
  if (__builtin_expect(mask_bits(page < 0) != 0, 0)) page = load_pages(cell, k, place, page);
  r.texel = page + (j & 7) * PAGE_ROW_NBYTES + ((i & 7) << 2);
  i8 a, b, c, d;
  gather_codes(p->bytes, r.texel, &a, &b);
  gather_codes(p->bytes + PAGE_ROW_NBYTES, r.texel, &c, &d);
  i8 range = higher(higher(a, b), higher(c, d)) - lower(lower(a, b), lower(c, d));
  f8 fa = to_float(a), fb = to_float(b), fc = to_float(c), fd = to_float(d);
  f8 top = fa + r.fx * (fb - fa), bottom = fc + r.fx * (fd - fc),
     code = top + r.fy * (bottom - top);
  i8 right = r.fx > all(0.5f), below = r.fy > all(0.5f);
  /* Between a thing and what is behind it there is nothing. */
  f8 nearest = choose(below, choose(right, fd, fc), choose(right, fb, fa));
  r.seen = choose(range > EDGE_CODES, nearest, code);
  return r;
}

/* ---- Eight rays --------------------------------------------------------------------------------
 */

/* A hair inside the circle, as in resample.c, but n must stay well above 0 for slopes. */
#define RIM 0.9997f

static void place(const depth_geometry *geometry, uint32_t block_u, uint32_t block_v,
                  const block_directions *directions, depth_rays *rays) {
  const depth_geometry g = *geometry;
  const i8 columns = {0, 1, 2, 3, 4, 5, 6, 7};
  const float s_last = (float)(g.s_count - 1), t_last = (float)(g.t_count - 1);
  const f8 i_last = all(g.s_count > 1 ? s_last - 1 : 0),
           j_last = all(g.t_count > 1 ? t_last - 1 : 0);
  for (int row = 0; row < 64; row += LANES) {
    f8 s = 2.0f * load(directions->s + row) - 1.0f, t = 2.0f * load(directions->t + row) - 1.0f;
    s = choose(magnitude(s) < all(1e9f), s, all(0)); /* NaN too */
    t = choose(magnitude(t) < all(1e9f), t, all(0));
    f8 radius_2 = s * s + t * t, pull = choose(radius_2 > RIM * RIM, RIM / root(radius_2), all(1));
    s *= pull, t *= pull;
    f8 n = root(1.0f - s * s - t * t);
    store(rays->x + row, (to_float(columns + (int32_t)(8 * block_u)) + 0.5f) * g.texel_u);
    store(rays->y + row, all(((float)(8 * block_v + (uint32_t)row / 8) + 0.5f) * g.texel_v));
    store(rays->qx + row, (g.scale[0] * s + g.scale[1] * t) / n);
    store(rays->qy + row, (g.scale[2] * s + g.scale[3] * t) / n);
    f8 i = 0.5f * (s + 1.0f) * (float)g.s_count - 0.5f;
    f8 j = 0.5f * (t + 1.0f) * (float)g.t_count - 0.5f;
    i = smaller(larger(i, all(0)), all(s_last)), j = smaller(larger(j, all(0)), all(t_last));
    store(rays->i + row, i), store(rays->j + row, j);
    i8 cell = to_int(smaller(i, i_last)) * (int32_t)g.t_count + to_int(smaller(j, j_last));
    memcpy(rays->cell + row, &cell, sizeof cell);
    store(rays->code + row, all(-1));
  }
}

/* Eight rays of a cell. */
typedef struct {
  f8 x, y;
  f8 dx[4], dy[4]; /* q_k - q */
  f8 weight[4];
  f8 across[4], bend[4], turn[2]; /* of a curved surface: depth_frames.h */
} bundle;

/* What the slices say of a height in each lane. */
typedef struct {
  f8 code;
  f8 score;  /* weight of those that see a thing there, less that of those that look through it */
  f8 agreed; /* weight of the former */
  f8 weight[4];
  reading at[4];
} verdict;

INLINE f8 pick(const float *of_texel, const uint8_t *texels, int count) {
  float v[LANES];
  for (int l = 0; l < LANES; l++) v[l] = of_texel[texels[l < count ? l : 0]];
  return load(v);
}

static void pick_frames(const depth_cell *cell, bundle *b) {
  enum { COUNT = sizeof(depth_frame) / sizeof(float) };
  const depth_pages *p = cell->pages;
  float numbers[COUNT][LANES];
  for (int l = 0; l < LANES; l++) {
    float of_one[COUNT];
    memcpy(of_one, &cell->frames[(size_t)b->y[l] * p->u_count + (size_t)b->x[l]], sizeof of_one);
    for (int i = 0; i < COUNT; i++) numbers[i][l] = of_one[i];
  }
  for (int i = 0; i < 4; i++) b->across[i] = load(numbers[i]), b->bend[i] = load(numbers[4 + i]);
  for (int i = 0; i < 2; i++) b->turn[i] = load(numbers[8 + i]);
}

INLINE void make_bundle(const depth_cell *cell, const depth_rays *rays, const uint8_t *texels,
                        int count, bundle *b) {
  f8 qx, qy, f, g;
  if (count == LANES && texels[0] % 8 == 0 && texels[7] == texels[0] + 7) { /* a row */
    int row = texels[0];
    b->x = load(rays->x + row), b->y = load(rays->y + row);
    qx = load(rays->qx + row), qy = load(rays->qy + row);
    f = load(rays->i + row), g = load(rays->j + row);
  } else {
    b->x = pick(rays->x, texels, count), b->y = pick(rays->y, texels, count);
    qx = pick(rays->qx, texels, count), qy = pick(rays->qy, texels, count);
    f = pick(rays->i, texels, count), g = pick(rays->j, texels, count);
  }
  if (cell->frames) pick_frames(cell, b);
  f -= (float)cell->i0, g -= (float)cell->j0;
  for (int k = 0; k < 4; k++) {
    f8 along_s = k & 1 ? f : 1.0f - f, along_t = k & 2 ? g : 1.0f - g;
    b->weight[k] = cell->exists[k] * (along_s * along_t + LEAST_WEIGHT);
    b->dx[k] = cell->qx[k] - qx;
    b->dy[k] = cell->qy[k] - qy;
  }
}

/* In codes, of the tolerance in heights (depth_kernel.h). */
INLINE f8 tolerance(f8 code) {
  f8 left = 1.0f - code * (1.0f / 256);
  return left * (256 * TOLERANCE_UNITS * left + TOLERANCE_SHARE * code);
}

INLINE f8 height_of(const depth_cell *cell, f8 code) {
  return cell->unit * code / (256.0f - code);
}

/* Where slice k sees what the ray meets at a height, and how high that is over the surface there.
 * Curved, by depth_frames.h: at texel e away the slice's ray leaves along -q + turn . e (q_v, -q_u)
 * + bend e in the tangent plane and rises by 1 + q . bend e; to first order in e it meets the point
 * if (across + h (bend + (q_v, -q_u) turn + q (q . bend))) e = h (q_k - q). */
INLINE f8 see_from(const depth_cell *cell, const bundle *b, int k, f8 h, f8 *x, f8 *y) {
  f8 right_u = h * b->dx[k], right_v = h * b->dy[k];
  if (!cell->frames) {
    *x = b->x + right_u, *y = b->y + right_v;
    return h;
  }
  const f8 *p = b->across, *n = b->bend, *w = b->turn;
  float q_u = cell->qx[k], q_v = cell->qy[k];
  f8 rise_u = q_u * n[0] + q_v * n[2], rise_v = q_u * n[1] + q_v * n[3];
  f8 uu = p[0] + h * (n[0] + q_v * w[0] + q_u * rise_u),
     uv = p[1] + h * (n[1] + q_v * w[1] + q_u * rise_v);
  f8 vu = p[2] + h * (n[2] - q_u * w[0] + q_v * rise_u),
     vv = p[3] + h * (n[3] - q_u * w[1] + q_v * rise_v);
  f8 scale = 1.0f / (uu * vv - uv * vu);
  f8 e_u = (right_u * vv - right_v * uv) * scale, e_v = (uu * right_v - vu * right_u) * scale;
  f8 drop = (n[0] * e_u + n[1] * e_v) * (p[0] * e_u + p[1] * e_v) +
            (n[2] * e_u + n[3] * e_v) * (p[2] * e_u + p[3] * e_v);
  *x = b->x + e_u, *y = b->y + e_v;
  return (h + 0.5f * drop) / (1.0f + rise_u * e_u + rise_v * e_v);
}

/* What slice k sees there, and the code that it should. */
INLINE reading look_from(const depth_cell *cell, const bundle *b, int k, f8 code, f8 *expected) {
  f8 x, y, height = height_of(cell, code);
  f8 there = see_from(cell, b, k, height, &x, &y);
  *expected = code;
  if (cell->frames) *expected = 256.0f * there / (cell->unit + there);
  return look(cell, k, x, y);
}

static void judge(const depth_cell *cell, const bundle *b, const f8 *code, verdict *v) {
  f8 scale = 1.0f / tolerance(*code), expected;
  f8 score = all(0), agreed = all(0);
  v->code = *code;
  for (int k = 0; k < 4; k++) {
    v->at[k] = look_from(cell, b, k, *code, &expected);
    f8 off = (v->at[k].seen - expected) * scale,
       agreement = larger(1.0f - 0.25f * off * off, all(0));
    f8 weight = choose(v->at[k].inside, b->weight[k], all(0));
    f8 agreeing = weight * (agreement * agreement);
    v->weight[k] = agreeing;
    agreed += agreeing;
    score += choose(off > 2.0f, -weight, agreeing);
  }
  v->score = score, v->agreed = agreed;
}

/* Takes b's lanes of the mask over into a. */
static void take(verdict *a, const verdict *b, const i8 *mask) {
  a->code = choose(*mask, b->code, a->code);
  a->agreed = choose(*mask, b->agreed, a->agreed);
  a->score = choose(*mask, b->score, a->score);
  for (int k = 0; k < 4; k++) {
    a->weight[k] = choose(*mask, b->weight[k], a->weight[k]);
    a->at[k].fx = choose(*mask, b->at[k].fx, a->at[k].fx);
    a->at[k].fy = choose(*mask, b->at[k].fy, a->at[k].fy);
    a->at[k].texel = (i8)choose(*mask, (f8)b->at[k].texel, (f8)a->at[k].texel);
  }
}

/* ---- Mixing ------------------------------------------------------------------------------------
 */

#if defined(__AVX2__)
/* Channels of neighbouring texels side by side, the upper row's before the lower's, squared, times
 * their weights. */
INLINE __m256i weigh(const uint8_t *texels, int32_t upper, int32_t lower_two) {
  const __m256i pairs = _mm256_broadcastsi128_si256(
      _mm_setr_epi8(0, -1, 4, -1, 1, -1, 5, -1, 2, -1, 6, -1, 3, -1, 7, -1));
  __m128i top = _mm_loadl_epi64((const __m128i *)(const void *)texels);
  __m128i bottom = _mm_loadl_epi64((const __m128i *)(const void *)(texels + PAGE_ROW_NBYTES));
  __m256i both = _mm256_shuffle_epi8(_mm256_set_m128i(bottom, top), pairs);
  __m256i weights =
      _mm256_blend_epi32(_mm256_set1_epi32(upper), _mm256_set1_epi32(lower_two), 0xf0);
  both = _mm256_srli_epi16(_mm256_mullo_epi16(both, both), 1);
  return _mm256_madd_epi16(both, weights);
}

/* One lane of mix's arrays, LANES numbers a slice. */
INLINE void mix_lane(const uint8_t *bytes, const int32_t *texel, const int32_t *upper,
                     const int32_t *lower_two, float rgba[4]) {
  __m256i sum = _mm256_setzero_si256();
  for (int k = 0; k < 4 * LANES; k += LANES)
    sum = _mm256_add_epi32(sum, weigh(bytes + texel[k], upper[k], lower_two[k]));
  __m128i rows = _mm_add_epi32(_mm256_castsi256_si128(sum), _mm256_extracti128_si256(sum, 1));
  __m128 light = _mm_mul_ps(_mm_cvtepi32_ps(rows), _mm_set1_ps(2.0f / PAGE_WHITE / WHOLE));
  _mm_storeu_ps(rgba, _mm_blend_ps(light, _mm_set1_ps(1), 8));
}
#else
INLINE void mix_lane(const uint8_t *bytes, const int32_t *texel, const int32_t *upper,
                     const int32_t *lower_two, float rgba[4]) {
  int32_t sum[3] = {0, 0, 0};
  for (int k = 0; k < 4 * LANES; k += LANES)
    for (int row = 0; row < 2; row++) {
      const uint8_t *left = bytes + texel[k] + row * PAGE_ROW_NBYTES, *right = left + 4;
      int32_t weights = row ? lower_two[k] : upper[k];
      int32_t w_left = weights & 0xffff, w_right = weights >> 16;
      for (int c = 0; c < 3; c++)
        sum[c] += (left[c] * left[c] >> 1) * w_left + (right[c] * right[c] >> 1) * w_right;
    }
  for (int c = 0; c < 3; c++) rgba[c] = (float)sum[c] * (2.0f / PAGE_WHITE / WHOLE);
  rgba[3] = 1;
}
#endif

/* The slices' mean where they see the verdict's height, of the lanes in the mask. */
INLINE void mix(const depth_cell *cell, const verdict *v, const uint8_t *of, unsigned mask,
                depth_rays *rays) {
  /* For each slice: where each lane's texels are, and the weights of the upper two and of the lower
   * two. */
  int32_t texel[4][LANES], upper[4][LANES], lower_two[4][LANES];
  f8 white = (float)WHOLE / larger(v->agreed, all(1e-6f));
  for (int k = 0; k < 4; k++) {
    f8 w = v->weight[k] * white, w_bottom = w * v->at[k].fy, w_top = w - w_bottom;
    f8 bottom_right = w_bottom * v->at[k].fx, top_right = w_top * v->at[k].fx;
    i8 a = to_int(w_top - top_right + 0.5f), b = to_int(top_right + 0.5f);
    i8 c = to_int(w_bottom - bottom_right + 0.5f), d = to_int(bottom_right + 0.5f);
    i8 above = a | b << 16, below = c | d << 16;
    memcpy(upper[k], &above, sizeof above);
    memcpy(lower_two[k], &below, sizeof below);
    memcpy(texel[k], &v->at[k].texel, sizeof v->at[k].texel);
  }
  for (int l = 0; l < LANES; l++)
    if (mask >> l & 1)
      mix_lane(cell->pages->bytes, texel[0] + l, upper[0] + l, lower_two[0] + l, rays->rgba[of[l]]);
}

/* ---- Finding heights ---------------------------------------------------------------------------
 */

/* From a guess to the height on which the ray and what slice k sees meet, by a secant; what is seen
 * there where there is an edge. Settled lanes are there already. */
static f8 meet(const depth_cell *cell, const bundle *b, int k, f8 guess) {
  f8 expected, seen = look_from(cell, b, k, guess, &expected).seen, off = seen - expected;
  i8 settled = magnitude(off) < 0.2f * tolerance(guess);
  if (!mask_bits(~settled)) return guess;
  f8 next = smaller(larger(guess + off, all(0)), all(255)), step = next - guess;
  seen = look_from(cell, b, k, next, &expected).seen;
  f8 next_off = seen - expected, fall = off - next_off;
  i8 steady = (magnitude(fall) > 0.25f * magnitude(step)) & (magnitude(next_off) < all(EDGE_CODES));
  f8 code = choose(steady, guess + off * step / choose(steady, fall, all(1)), next + next_off);
  code = smaller(larger(code, all(0)), all(255));
  return choose(settled, guess, code);
}

static unsigned mix_bundle(const depth_cell *cell, depth_rays *rays, const uint8_t *texels,
                           int count, const float *guesses, const float *wanted) {
  bundle b;
  verdict v;
  make_bundle(cell, rays, texels, count, &b);
  /* The heaviest slice looks most nearly along the ray. */
  int first = 0;
  for (int k = 1; k < 4; k++)
    if (b.weight[k][0] + b.weight[k][7] > b.weight[first][0] + b.weight[first][7]) first = k;
  f8 guess = load(guesses), code = meet(cell, &b, first, guess);
  /* It may see something else than the ray does. */
  code = choose(magnitude(code - guess) < 4.0f * tolerance(guess), code, guess);
  judge(cell, &b, &code, &v);
  i8 good = v.score > load(wanted);
  if (mask_bits(~good & (code != guess))) {
    verdict unmoved;
    judge(cell, &b, &guess, &unmoved);
    i8 better = ~good & (unmoved.score > v.score);
    take(&v, &unmoved, &better);
    good = v.score > load(wanted);
  }
  unsigned mask = mask_bits(good) & ((1u << count) - 1);
  for (int l = 0; l < count; l++)
    if (mask >> l & 1) rays->code[texels[l]] = v.code[l], rays->score[texels[l]] = v.score[l];
  if (mask) mix(cell, &v, texels, mask, rays);
  return mask;
}

static void put(const depth_rays *rays, uint16_t *out, size_t row_nbytes) {
  for (int row = 0; row < 8; row++, out += row_nbytes / sizeof *out) {
    const float *from = rays->rgba[8 * row];
    for (int k = 0; k < 32; k += LANES) {
#if defined(__AVX2__)
      __m128i half = _mm256_cvtps_ph(_mm256_loadu_ps(from + k), _MM_FROUND_TO_NEAREST_INT);
      _mm_storeu_si128((__m128i *)(void *)(out + k), half);
#else
      for (int l = 0; l < LANES; l++) out[k + l] = half_from_float(from[k + l]);
#endif
    }
  }
}

const depth_kernel KERNEL = {place, mix_bundle, put};
