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
/* Of the tolerance: a guess this near is not looked at again. */
#define MOVED_SHARE 0.5f
#define INLINE static inline __attribute__((always_inline))

typedef float f8 __attribute__((vector_size(32)));
typedef int32_t i8 __attribute__((vector_size(32))); /* numbers, or masks of -1 and 0 */
typedef uint16_t u16 __attribute__((vector_size(16)));
typedef int8_t c8 __attribute__((vector_size(8)));

/* ---- Eight numbers -----------------------------------------------------------------------------
 */

INLINE f8 all(float x) {
  return (f8){x, x, x, x, x, x, x, x};
}

INLINE i8 all_int(int32_t x) {
  return (i8){x, x, x, x, x, x, x, x};
}

INLINE f8 load(const float *x) {
  f8 v;
  memcpy(&v, x, sizeof v);
  return v;
}

INLINE void store(float *x, f8 v) {
  memcpy(x, &v, sizeof v);
}

INLINE i8 load_u16(const uint16_t *x) {
  u16 v;
  memcpy(&v, x, sizeof v);
  return __builtin_convertvector(v, i8);
}

INLINE i8 load_c8(const void *x) {
  c8 v;
  memcpy(&v, x, sizeof v);
  return __builtin_convertvector(v, i8);
}

INLINE void store_u16(uint16_t *x, i8 v) {
  u16 narrow = __builtin_convertvector(v, u16);
  memcpy(x, &narrow, sizeof narrow);
}

INLINE void store_c8(void *x, i8 v) {
  c8 narrow = __builtin_convertvector(v, c8);
  memcpy(x, &narrow, sizeof narrow);
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
  i8 texel; /* where the four texels around begin, in the slice's bytes */
  f8 fx, fy;
  f8 seen; /* code of the height */
  i8 inside;
} reading;

static __attribute__((noinline)) void load_pages(const depth_cell *cell, int k, i8 block) {
  for (int l = 0; l < LANES; l++) {
    const uint32_t at = (uint32_t)block[l];
    /* The lane before may have brought it. */
    if (!(cell->slices[k]->there[at / 32] >> at % 32 & 1))
      depth_pages_load(cell->pages, cell->slices[k], at);
  }
}

/* Where slice k shows texel (x, y) of the light. */
INLINE reading find(const depth_cell *cell, int k, f8 x, f8 y) {
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
  i8 block = (j >> 3) * (int32_t)p->block_u_count + (i >> 3);
  i8 there = gather(cell->slices[k]->there, (block >> 5) << 2) << (31 - (block & 31));
  if (__builtin_expect(mask_bits(there >= 0) != 0, 0)) load_pages(cell, k, block);
  r.texel = block * PAGE_NBYTES + (j & 7) * PAGE_ROW_NBYTES + ((i & 7) << 2);
  return r;
}

/* Slice k at texel (x, y) of the light. */
INLINE reading look(const depth_cell *cell, int k, f8 x, f8 y) {
  reading r = find(cell, k, x, y);
  i8 a, b, c, d;
  const uint8_t *bytes = cell->slices[k]->bytes;
  gather_codes(bytes, r.texel, &a, &b);
  gather_codes(bytes + PAGE_ROW_NBYTES, r.texel, &c, &d);
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
    store(rays->code + row, all(-1)), store(rays->score + row, all(0));
  }
}

static uint64_t find_cell(const depth_rays *rays, int32_t cell) {
  uint64_t found = 0;
  for (int row = 0; row < 64; row += LANES) {
    i8 cells;
    memcpy(&cells, rays->cell + row, sizeof cells);
    found |= (uint64_t)mask_bits(cells == cell) << row;
  }
  return found;
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
INLINE void mix_lane(const depth_cell *cell, const int32_t *texel, const int32_t *upper,
                     const int32_t *lower_two, float rgba[4]) {
  __m256i sum = _mm256_setzero_si256();
  for (int k = 0; k < 4; k++)
    sum = _mm256_add_epi32(sum, weigh(cell->slices[k]->bytes + texel[LANES * k], upper[LANES * k],
                                      lower_two[LANES * k]));
  __m128i rows = _mm_add_epi32(_mm256_castsi256_si128(sum), _mm256_extracti128_si256(sum, 1));
  __m128 light = _mm_mul_ps(_mm_cvtepi32_ps(rows), _mm_set1_ps(2.0f / PAGE_WHITE / WHOLE));
  _mm_storeu_ps(rgba, _mm_blend_ps(light, _mm_set1_ps(1), 8));
}
#else
INLINE void mix_lane(const depth_cell *cell, const int32_t *texel, const int32_t *upper,
                     const int32_t *lower_two, float rgba[4]) {
  int32_t sum[3] = {0, 0, 0};
  for (int k = 0; k < 4 * LANES; k += LANES)
    for (int row = 0; row < 2; row++) {
      const uint8_t *left = cell->slices[k / LANES]->bytes + texel[k] + row * PAGE_ROW_NBYTES,
                    *right = left + 4;
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
      mix_lane(cell, texel[0] + l, upper[0] + l, lower_two[0] + l, rays->rgba[of[l]]);
}

/* Mixes the lanes of the mask; returns which. */
static unsigned write(const depth_cell *cell, depth_rays *rays, const depth_guess *guess,
                      const verdict *v, unsigned mask) {
  float codes[LANES], scores[LANES];
  store(codes, v->code), store(scores, v->score);
  mask &= (1u << guess->count) - 1;
  for (int l = 0; l < guess->count; l++)
    if (mask >> l & 1)
      rays->code[guess->texels[l]] = codes[l], rays->score[guess->texels[l]] = scores[l];
  if (mask) mix(cell, v, guess->texels, mask, rays);
  return mask;
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

static unsigned mix_bundle(const depth_cell *cell, depth_rays *rays, const depth_guess *guess_of) {
  const f8 guess = load(guess_of->codes), wanted = load(guess_of->wanted);
  bundle b;
  verdict v;
  make_bundle(cell, rays, guess_of->texels, guess_of->count, &b);
  /* The heaviest slice looks most nearly along the ray. */
  int first = 0;
  for (int k = 1; k < 4; k++)
    if (b.weight[k][0] + b.weight[k][7] > b.weight[first][0] + b.weight[first][7]) first = k;
  f8 code = meet(cell, &b, first, guess);
  /* It may see something else than the ray does. */
  code = choose(magnitude(code - guess) < 4.0f * tolerance(guess), code, guess);
  judge(cell, &b, &code, &v);
  i8 good = v.score > wanted;
  if (mask_bits(~good & (code != guess))) {
    verdict unmoved;
    judge(cell, &b, &guess, &unmoved);
    i8 better = ~good & (unmoved.score > v.score);
    take(&v, &unmoved, &better);
    good = v.score > wanted;
  }
  v.score = larger(v.score, wanted + SCORE_SLACK);
  return write(cell, rays, guess_of, &v, mask_bits(good));
}

/* ---- Without a guess ---------------------------------------------------------------------------
 */

/* Where the ray and what slice k sees meet: along the ray the point at height h is seen at p + h d.
 * As long as the slice sees something higher there, the point is in the open; where it sees
 * something lower, the point is behind that. From the open to behind in a step without an edge is a
 * hit. Codes, below 0 for none. */
static f8 follow(const depth_cell *cell, const bundle *b, int k) {
  f8 d = larger(larger(magnitude(b->dx[k]), magnitude(b->dy[k])), all(1e-3f));
  f8 step = (float)STEP_TEXELS / d, h = all(0), met = all(-1), last_open = all(1),
     last_code = all(0);
  i8 going =
      ((float)MAX_STEPS * step >= LEAST_REACH * cell->unit) & (b->weight[k] >= LEAST_WITNESS);
  for (int i = 0; i < MAX_STEPS && mask_bits(going); i++) {
    reading r = look(cell, k, b->x + h * b->dx[k], b->y + h * b->dy[k]);
    f8 seen = height_of(cell, r.seen), open = seen - h;
    i8 hit = (open <= all(0)) & (last_open > all(0)) &
             (magnitude(r.seen - last_code) <= all(EDGE_CODES));
    f8 at = h - step * open / (open - last_open);
    if (i == 0) hit = open <= all(0), at = seen;
    /* Slices that look almost along the ray see what it meets at once. */
    i8 close = ~hit & (d * magnitude(open) < all(0.5f));
    going &= r.inside;
    met = choose(going & (hit | close), choose(hit, at, seen), met);
    going &= ~(hit | close);
    last_open = open, last_code = r.seen, h += step;
  }
  return choose(met < all(0), all(-1), 256.0f * met / (cell->unit + met));
}

/* On a curved surface slices see the same thing close to each other: from what the slice sees at
 * the texel itself. */
static f8 follow_curved(const depth_cell *cell, const bundle *b, int k) {
  f8 code = all(0), met = all(-1), expected;
  i8 going = b->weight[k] > all(0);
  for (int i = 0; i <= CURVED_STEPS && mask_bits(going); i++) {
    reading r = look_from(cell, b, k, code, &expected);
    f8 off = r.seen - expected;
    going &= r.inside;
    i8 there = going & (magnitude(off) < 0.3f * tolerance(code));
    if (i > 0) met = choose(there, code, met), going &= ~there;
    going &= code + off >= all(0);
    code = smaller(larger(code + off, all(0)), all(255));
  }
  return met;
}

/* The lowest height that the slices see a thing at, by a share of what the best is judged, which is
 * the score. What is behind a thing may be in sight of all slices around, past it on every side. */
static unsigned seek(const depth_cell *cell, depth_rays *rays, const depth_guess *guess) {
  bundle b;
  verdict v[4], lowest;
  f8 best = all(0);
  make_bundle(cell, rays, guess->texels, guess->count, &b);
  for (int k = 0; k < 4; k++) {
    f8 code = cell->frames ? follow_curved(cell, &b, k) : follow(cell, &b, k);
    i8 none = code < all(0);
    code = larger(code, all(0));
    judge(cell, &b, &code, &v[k]);
    v[k].score = choose(none, all(-1), v[k].score);
    best = larger(best, v[k].score);
  }
  lowest = v[0];
  lowest.code = all(256);
  for (int k = 0; k < 4; k++) {
    i8 lower = (v[k].score >= LOWER_SHARE * best) & (v[k].code < lowest.code);
    take(&lowest, &v[k], &lower);
  }
  lowest.score = best;
  i8 good = (best >= load(guess->wanted)) & (lowest.agreed > all(1e-5f));
  return write(cell, rays, guess, &lowest, mask_bits(good));
}

/* ---- Where heights go on as they were ----------------------------------------------------------
 */

#if defined(__AVX2__)
/* As weigh, and the height's code as it is, times 64. */
INLINE __m256i weigh_all(const uint8_t *texels, int32_t upper, int32_t lower_two) {
  const __m128i pairs = _mm_setr_epi8(0, 4, 1, 5, 2, 6, 3, 7, 8, 12, 9, 13, 10, 14, 11, 15);
  __m128 top = _mm_castsi128_ps(_mm_loadl_epi64((const __m128i *)(const void *)texels));
  __m128i quad =
      _mm_castps_si128(_mm_loadh_pi(top, (const __m64 *)(const void *)(texels + PAGE_ROW_NBYTES)));
  __m256i both = _mm256_cvtepu8_epi16(_mm_shuffle_epi8(quad, pairs));
  __m256i weights =
      _mm256_blend_epi32(_mm256_set1_epi32(upper), _mm256_set1_epi32(lower_two), 0xf0);
  __m256i factors = _mm256_blend_epi16(both, _mm256_set1_epi16(128), 0xc0);
  return _mm256_madd_epi16(_mm256_srli_epi16(_mm256_mullo_epi16(both, factors), 1), weights);
}

/* Sums over the four texels of each lane, R G B H. */
INLINE void weigh_lanes(const uint8_t *bytes, const int32_t *texel, const int32_t *upper,
                        const int32_t *lower_two, i8 sums[4]) {
  __m256i of[4];
  for (int l = 0; l < 4; l++) {
    __m256i a = weigh_all(bytes + texel[l], upper[l], lower_two[l]);
    __m256i b = weigh_all(bytes + texel[l + 4], upper[l + 4], lower_two[l + 4]);
    of[l] = _mm256_add_epi32(_mm256_permute2x128_si256(a, b, 0x20),
                             _mm256_permute2x128_si256(a, b, 0x31));
  }
  __m256i rg_01 = _mm256_unpacklo_epi32(of[0], of[1]), rg_23 = _mm256_unpacklo_epi32(of[2], of[3]);
  __m256i bh_01 = _mm256_unpackhi_epi32(of[0], of[1]), bh_23 = _mm256_unpackhi_epi32(of[2], of[3]);
  sums[0] = (i8)_mm256_unpacklo_epi64(rg_01, rg_23),
  sums[1] = (i8)_mm256_unpackhi_epi64(rg_01, rg_23);
  sums[2] = (i8)_mm256_unpacklo_epi64(bh_01, bh_23),
  sums[3] = (i8)_mm256_unpackhi_epi64(bh_01, bh_23);
}

/* R G B and 1 side by side, of each lane. */
INLINE void spread(f8 r, f8 g, f8 b, float rgba[LANES][4]) {
  __m256 rb_low = _mm256_unpacklo_ps(r, b), rb_high = _mm256_unpackhi_ps(r, b);
  __m256 ga_low = _mm256_unpacklo_ps(g, all(1)), ga_high = _mm256_unpackhi_ps(g, all(1));
  __m256 lanes[4] = {_mm256_unpacklo_ps(rb_low, ga_low), _mm256_unpackhi_ps(rb_low, ga_low),
                     _mm256_unpacklo_ps(rb_high, ga_high), _mm256_unpackhi_ps(rb_high, ga_high)};
  for (int l = 0; l < 4; l++) {
    _mm_storeu_ps(rgba[l], _mm256_castps256_ps128(lanes[l]));
    _mm_storeu_ps(rgba[l + 4], _mm256_extractf128_ps(lanes[l], 1));
  }
}
#else
INLINE void weigh_lanes(const uint8_t *bytes, const int32_t *texel, const int32_t *upper,
                        const int32_t *lower_two, i8 sums[4]) {
  for (int l = 0; l < LANES; l++)
    for (int c = 0; c < 4; c++) {
      sums[c][l] = 0;
      for (int row = 0; row < 2; row++) {
        const uint8_t *left = bytes + texel[l] + row * PAGE_ROW_NBYTES + c, *right = left + 4;
        int32_t weights = row ? lower_two[l] : upper[l];
        int32_t a = c < 3 ? left[0] * left[0] >> 1 : left[0] * 64;
        int32_t b = c < 3 ? right[0] * right[0] >> 1 : right[0] * 64;
        sums[c][l] += a * (weights & 0xffff) + b * (weights >> 16);
      }
    }
}

INLINE void spread(f8 r, f8 g, f8 b, float rgba[LANES][4]) {
  for (int l = 0; l < LANES; l++)
    rgba[l][0] = r[l], rgba[l][1] = g[l], rgba[l][2] = b[l], rgba[l][3] = 1;
}
#endif

static void aim_at(const depth_cell *cell, const bundle *b, const f8 *code, depth_aim *a) {
  f8 height = height_of(cell, *code);
  for (int k = 0; k < 4; k++) {
    f8 x, y, there = see_from(cell, b, k, height, &x, &y);
    f8 expected = *code;
    if (cell->frames) expected = 256.0f * there / (cell->unit + there);
    reading r = find(cell, k, x, y);
    f8 bottom = (float)WHOLE * r.fy, top = (float)WHOLE - bottom;
    f8 bottom_right = bottom * r.fx, top_right = top * r.fx;
    i8 above = to_int(top - top_right + 0.5f) | to_int(top_right + 0.5f) << 16;
    i8 below = to_int(bottom - bottom_right + 0.5f) | to_int(bottom_right + 0.5f) << 16;
    memcpy(a->upper[k], &above, sizeof above);
    memcpy(a->lower_two[k], &below, sizeof below);
    memcpy(a->texel[k], &r.texel, sizeof r.texel);
    store(a->weight[k], choose(r.inside, b->weight[k], all(0)));
    store(a->expected[k], expected);
    const uint8_t *bytes = cell->slices[k]->bytes;
    for (int l = 0; l < LANES; l++) {
      __builtin_prefetch(bytes + a->texel[k][l]);
      __builtin_prefetch(bytes + a->texel[k][l] + PAGE_ROW_NBYTES + 7);
    }
  }
}

static void aim(const depth_cell *cell, const depth_rays *rays, const depth_memory *last,
                const uint8_t *texels, int count, depth_aim *a) {
  bundle b;
  f8 code, score;
  if (count == LANES && texels[7] == texels[0] + 7 && texels[0] % 8 == 0) {
    code = to_float(load_u16(last->code + texels[0]));
    score = to_float(load_c8(last->score + texels[0]));
  } else {
    for (int l = 0; l < LANES; l++) {
      uint8_t k = texels[l < count ? l : 0];
      code[l] = last->code[k], score[l] = last->score[k];
    }
  }
  code *= 1.0f / 256;
  memcpy(a->guess.texels, texels, LANES);
  a->guess.count = count;
  store(a->guess.codes, code);
  store(a->guess.wanted,
        smaller(larger(0.01f * score - SCORE_SLACK, all(LEAST_NEAR)), all(ALL_AGREE)));
  make_bundle(cell, rays, a->guess.texels, a->guess.count, &b);
  a->cell = cell;
  aim_at(cell, &b, &code, a);
}

/* What the four slices show where they should see a height. */
typedef struct {
  f8 rgb[4][3]; /* linear, times PAGE_WHITE * WHOLE / 2 */
  f8 off[4];    /* code seen less the one expected */
  f8 weight[4];
  f8 moved; /* mean of off: the slices' directions lie around the ray's, so that it leads to what
               they see, right to first order wherever along the ray they look */
} view;

static void read_aimed(const depth_aim *a, const f8 *code, view *v) {
  f8 sum = all(1e-6f), limit = 4.0f * tolerance(*code);
  v->moved = all(0);
  for (int k = 0; k < 4; k++) {
    i8 sums[4];
    weigh_lanes(a->cell->slices[k]->bytes, a->texel[k], a->upper[k], a->lower_two[k], sums);
    for (int c = 0; c < 3; c++) v->rgb[k][c] = to_float(sums[c]);
    v->weight[k] = load(a->weight[k]);
    v->off[k] = to_float(sums[3]) * (1.0f / 64 / WHOLE) - load(a->expected[k]);
    f8 weight = choose(magnitude(v->off[k]) < limit, v->weight[k], all(0));
    v->moved += weight * v->off[k], sum += weight;
  }
  v->moved /= sum;
}

static unsigned mix_aimed(depth_rays *rays, depth_aim *a) {
  enum { PASSES = 3 };
  const uint8_t *texels = a->guess.texels;
  const int count = a->guess.count;
  view v;
  f8 code = load(a->guess.codes);
  read_aimed(a, &code, &v);
  for (int pass = 1; pass < PASSES; pass++) {
    bundle b;
    if (!mask_bits(magnitude(v.moved) > MOVED_SHARE * tolerance(code))) break;
    code = smaller(larger(code + v.moved, all(0)), all(255));
    make_bundle(a->cell, rays, texels, count, &b);
    aim_at(a->cell, &b, &code, a);
    read_aimed(a, &code, &v);
  }
  f8 scale = 1.0f / tolerance(code), score = all(0), agreed = all(1e-6f);
  f8 rgb[3] = {all(0), all(0), all(0)};
  for (int k = 0; k < 4; k++) {
    f8 off = v.off[k] * scale, agreement = larger(1.0f - 0.25f * off * off, all(0));
    f8 agreeing = v.weight[k] * (agreement * agreement);
    for (int c = 0; c < 3; c++) rgb[c] += agreeing * v.rgb[k][c];
    agreed += agreeing;
    score += choose(off > 2.0f, -v.weight[k], agreeing);
  }
  f8 wanted = load(a->guess.wanted), light = 2.0f / PAGE_WHITE / WHOLE / agreed;
  unsigned mask = mask_bits(score > wanted) & ((1u << count) - 1);
  float rgba[LANES][4], codes[LANES], scores[LANES];
  spread(rgb[0] * light, rgb[1] * light, rgb[2] * light, rgba);
  store(codes, smaller(larger(code + v.moved, all(0)), all(255)));
  store(scores, larger(score, wanted + SCORE_SLACK));
  for (int l = 0; l < count; l++) {
    if (!(mask >> l & 1)) continue;
    uint8_t k = texels[l];
    rays->code[k] = codes[l], rays->score[k] = scores[l];
    memcpy(rays->rgba[k], rgba[l], sizeof rgba[l]);
  }
  return mask;
}

/* ---- From frame to frame ------------------------------------------------------------------------
 */

static uint64_t find_steady(const depth_memory *last) {
  const i8 none = all_int(UINT16_MAX);
  i8 codes[10];
  uint64_t steady = 0, certain = 0;
  codes[0] = codes[9] = none;
  for (int row = 0; row < 8; row++) {
    i8 near = load_c8(last->kind + 8 * row) == SEEN_NEAR;
    certain |= (uint64_t)mask_bits(load_c8(last->score + 8 * row) >= (int)(100 * MOST_AGREE))
               << 8 * row;
    codes[row + 1] = (load_u16(last->code + 8 * row) & near) | (none & ~near);
  }
  for (int row = 1; row <= 8; row++) {
    i8 left = __builtin_shufflevector(codes[row], none, 8, 0, 1, 2, 3, 4, 5, 6);
    i8 right = __builtin_shufflevector(codes[row], none, 1, 2, 3, 4, 5, 6, 7, 8);
    i8 lowest = lower(lower(left, right), lower(codes[row - 1], codes[row + 1]));
    i8 fits = (codes[row] != none) & (lowest >= codes[row] - 256 * EDGE_CODES);
    steady |= (uint64_t)mask_bits(fits) << (8 * row - 8);
  }
  return steady & certain;
}

static void remember(const depth_rays *rays, const uint8_t kinds[64], uint64_t mask,
                     depth_memory *now) {
  const i8 lanes = {1, 2, 4, 8, 16, 32, 64, 128};
  for (int row = 0; row < 64; row += LANES) {
    i8 made = (all_int((int32_t)(mask >> row & 0xff)) & lanes) == lanes;
    i8 code = to_int(256.0f * larger(load(rays->code + row), all(0)));
    i8 score = to_int(100.0f * load(rays->score + row)), kind = load_c8(kinds + row);
    store_u16(now->code + row, (code & made) | (load_u16(now->code + row) & ~made));
    store_c8(now->score + row, (score & made) | (load_c8(now->score + row) & ~made));
    store_c8(now->kind + row, (kind & made) | (load_c8(now->kind + row) & ~made));
  }
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

const depth_kernel KERNEL = {place, find_cell, find_steady, mix_bundle, seek,
                             aim,   mix_aimed, remember,    put};
