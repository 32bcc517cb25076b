#include "resample.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "slf.h"

#if defined(__x86_64__)
#include <immintrin.h>
#define HAVE_AVX2 1
#define TARGET_AVX2 __attribute__((target("avx2")))
#endif
#define INLINE static inline __attribute__((always_inline))

/* A block on its way: where its taps are and how they weigh. */
typedef struct {
  float f[64], g[64];         /* the place inside the cell, along s and along t */
  uint16_t cell_of[64];       /* i << 8 | j, then the number of the cell in taps */
  const uint8_t *taps[64][4]; /* U-Blocks of (i,j) (i+1,j) (i,j+1) (i+1,j+1) */
  uint64_t mask;
  uint8_t *out;
  size_t row_nbytes;
} pending_block;

typedef struct {
  uint32_t stamp; /* the block that noted it last */
  uint32_t number;
} note;

struct resampler {
  uint32_t s_count, t_count;
  block_source source;
  void (*place)(const resampler *, const block_directions *, pending_block *);
  void (*mix)(const pending_block *);
  pending_block pending[2];
  int latest;
  bool has_pending;
  uint32_t stamp;
  note *cells, *slices; /* s_count << 8 of each: what the block taken in has asked for so far */
};

/* ---- Display code <-> linear light ------------------------------------------------------------
 */

/* The sRGB curve as a cubic of the 8-bit code, within 0.0017 of IEC 61966-2-1: a table would need a
 * gather for each tap, the cubic is five operations for eight. The inverse is a quadratic in the
 * square root and one Newton step, within 0.19 of a code value of the cubic's inverse; so equal
 * taps give back their own code, all 256 of them. What the approximation costs against exact
 * tables, and what mixing in display code would cost, is in viewer/README.md. */
#define CURVE_3 (0.305306011f / 255.0f / 255.0f / 255.0f)
#define CURVE_2 (0.682171111f / 255.0f / 255.0f)
#define CURVE_1 (0.012522878f / 255.0f)
#define GUESS_1 (1.1437804f * 255.0f)
#define GUESS_2 (-0.1449953f * 255.0f)

INLINE float linear_from_code(float c) {
  return c * (c * (c * CURVE_3 + CURVE_2) + CURVE_1);
}

INLINE float code_from_linear(float y) {
  float r = sqrtf(y);
  float c = r * (r * GUESS_2 + GUESS_1);
  float value = c * (c * (c * CURVE_3 + CURVE_2) + CURVE_1);
  float slope = c * (c * (3 * CURVE_3) + 2 * CURVE_2) + CURVE_1;
  return c - (value - y) / slope;
}

/* ---- Where the taps are -----------------------------------------------------------------------
 */

/* A hair inside the circle, so that rounding never asks for a slice that is not stored; the angle
 * is off by at most 0.8 degrees there, 1/300 of a cell of 32. */
static const float rim = 0.9999f;

/* Compiled twice, for plain and for vector code; no contraction, so both round alike. */
INLINE void place_texels(const resampler *r, const block_directions *d, pending_block *p) {
  float s_scale = 0.5f * (float)r->s_count, t_scale = 0.5f * (float)r->t_count;
  float s_last = (float)(r->s_count - 1), t_last = (float)(r->t_count - 1);
  int i_last = r->s_count > 1 ? (int)r->s_count - 2 : 0;
  int j_last = r->t_count > 1 ? (int)r->t_count - 2 : 0;
  for (int k = 0; k < 64; k++) {
    float s = 2 * d->s[k] - 1, t = 2 * d->t[k] - 1;
    s = fabsf(s) < 1e9f ? s : 0; /* NaN too */
    t = fabsf(t) < 1e9f ? t : 0;
    float radius_2 = s * s + t * t;
    float pull = radius_2 > rim * rim ? rim / sqrtf(radius_2) : 1;
    float x = (s * pull + 1) * s_scale - 0.5f, y = (t * pull + 1) * t_scale - 0.5f;
    x = x > 0 ? x : 0;
    y = y > 0 ? y : 0;
    x = x < s_last ? x : s_last;
    y = y < t_last ? y : t_last;
    int i = (int)x, j = (int)y;
    i = i < i_last ? i : i_last;
    j = j < j_last ? j : j_last;
    p->f[k] = x - (float)i;
    p->g[k] = y - (float)j;
    p->cell_of[k] = (uint16_t)(i << 8 | j);
  }
}

static void place_plain(const resampler *r, const block_directions *d, pending_block *p) {
  place_texels(r, d, p);
}

/* Numbers the slice within the block taken in, adding it to slices if it is new. */
INLINE uint8_t number_slice(resampler *r, slice_index *slices, size_t *count, uint32_t slice) {
  note *n = &r->slices[slice];
  if (n->stamp != r->stamp) {
    *n = (note){.stamp = r->stamp, .number = (uint32_t)*count};
    slices[(*count)++] = (slice_index)slice;
  }
  return (uint8_t)n->number;
}

static void find_taps(resampler *r, uint32_t block_u, uint32_t block_v, pending_block *p) {
  slice_index slices[BLOCK_MAX_SLICES];
  const uint8_t *u_blocks[BLOCK_MAX_SLICES];
  uint8_t tap_slices[64][4];
  size_t slice_count = 0;
  uint32_t cell_count = 0, last_cell = UINT32_MAX, last_number = 0;
  /* A light field of one direction along an axis has its second tap in the first. */
  uint32_t next_s = r->s_count > 1 ? 1 << 8 : 0, next_t = r->t_count > 1 ? 1 : 0;

  if (++r->stamp == 0) { /* once in 2^32 blocks */
    memset(r->cells, 0, ((size_t)r->s_count << 8) * sizeof *r->cells);
    memset(r->slices, 0, ((size_t)r->s_count << 8) * sizeof *r->slices);
    r->stamp = 1;
  }
  for (int k = 0; k < 64; k++) {
    uint32_t cell = p->cell_of[k];
    if (!(p->mask >> k & 1)) {
      p->cell_of[k] = 0;
      continue;
    }
    if (cell != last_cell) {
      note *n = &r->cells[cell];
      if (n->stamp != r->stamp) {
        *n = (note){.stamp = r->stamp, .number = cell_count};
        uint8_t *tap = tap_slices[cell_count++];
        tap[0] = number_slice(r, slices, &slice_count, cell);
        tap[1] = number_slice(r, slices, &slice_count, cell + next_s);
        tap[2] = number_slice(r, slices, &slice_count, cell + next_t);
        tap[3] = number_slice(r, slices, &slice_count, cell + next_s + next_t);
      }
      last_cell = cell;
      last_number = n->number;
    }
    p->cell_of[k] = (uint16_t)last_number;
  }
  if (slice_count == 0) return;
  r->source.fetch(r->source.context, block_u, block_v, slices, slice_count, u_blocks);
  for (size_t i = 0; i < slice_count; i++)
    for (int line = 0; line < SLF_BLOCK_NBYTES; line += 64) __builtin_prefetch(u_blocks[i] + line);
  for (uint32_t c = 0; c < cell_count; c++)
    for (int tap = 0; tap < 4; tap++) p->taps[c][tap] = u_blocks[tap_slices[c][tap]];
}

/* ---- The mix ----------------------------------------------------------------------------------
 */

static void mix_plain(const pending_block *p) {
  for (int k = 0; k < 64; k++) {
    uint8_t *out = p->out + (size_t)(k / 8) * p->row_nbytes + (size_t)(k % 8) * 4;
    if (!(p->mask >> k & 1)) {
      memset(out, 0, 4);
      continue;
    }
    const uint8_t *const *taps = p->taps[p->cell_of[k]];
    for (int channel = 0; channel < 3; channel++) {
      float y[4];
      for (int tap = 0; tap < 4; tap++) y[tap] = linear_from_code(taps[tap][4 * k + channel]);
      float y0 = y[0] + p->f[k] * (y[1] - y[0]), y1 = y[2] + p->f[k] * (y[3] - y[2]);
      out[channel] = (uint8_t)lrintf(code_from_linear(y0 + p->g[k] * (y1 - y0)));
    }
    out[3] = 255;
  }
}

#if HAVE_AVX2
TARGET_AVX2 static void place_avx2(const resampler *r, const block_directions *d,
                                   pending_block *p) {
  place_texels(r, d, p);
}

/* Two texels, four channels each: texels k and k + 1 of one tap. */
TARGET_AVX2 INLINE __m256 load_pair(const uint8_t *a, const uint8_t *b, bool same_block) {
  __m128i bytes;
  if (same_block) {
    bytes = _mm_loadl_epi64((const __m128i *)(const void *)a);
  } else {
    int first, second;
    memcpy(&first, a, 4);
    memcpy(&second, b + 4, 4);
    bytes = _mm_insert_epi32(_mm_cvtsi32_si128(first), second, 1);
  }
  __m256 c = _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(bytes));
  __m256 y = _mm256_add_ps(_mm256_mul_ps(c, _mm256_set1_ps(CURVE_3)), _mm256_set1_ps(CURVE_2));
  y = _mm256_add_ps(_mm256_mul_ps(c, y), _mm256_set1_ps(CURVE_1));
  return _mm256_mul_ps(c, y);
}

TARGET_AVX2 INLINE __m256 lerp(__m256 a, __m256 b, __m256 x) {
  return _mm256_add_ps(a, _mm256_mul_ps(x, _mm256_sub_ps(b, a)));
}

/* The weights of texels k and k + 1, each over its four channels. */
TARGET_AVX2 INLINE __m256 load_weights(const float *w) {
  const __m256i spread = _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1);
  double both;
  memcpy(&both, w, sizeof both);
  return _mm256_permutevar_ps(_mm256_castpd_ps(_mm256_set1_pd(both)), spread);
}

TARGET_AVX2 INLINE __m256i codes(__m256 y) {
  __m256 r = _mm256_sqrt_ps(y);
  __m256 c = _mm256_add_ps(_mm256_mul_ps(r, _mm256_set1_ps(GUESS_2)), _mm256_set1_ps(GUESS_1));
  c = _mm256_mul_ps(r, c);
  __m256 value = _mm256_add_ps(_mm256_mul_ps(c, _mm256_set1_ps(CURVE_3)), _mm256_set1_ps(CURVE_2));
  value = _mm256_add_ps(_mm256_mul_ps(c, value), _mm256_set1_ps(CURVE_1));
  value = _mm256_mul_ps(c, value);
  __m256 slope =
      _mm256_add_ps(_mm256_mul_ps(c, _mm256_set1_ps(3 * CURVE_3)), _mm256_set1_ps(2 * CURVE_2));
  slope = _mm256_add_ps(_mm256_mul_ps(c, slope), _mm256_set1_ps(CURVE_1));
  c = _mm256_sub_ps(c, _mm256_div_ps(_mm256_sub_ps(value, y), slope));
  return _mm256_cvtps_epi32(c);
}

TARGET_AVX2 static void mix_avx2(const pending_block *p) {
  const __m256i gather_bytes =
      _mm256_setr_epi8(0, 4, 8, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, 0, 4, 8, -1, -1,
                       -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1);
  for (int k = 0; k < 64; k += 2) {
    uint8_t *out = p->out + (size_t)(k / 8) * p->row_nbytes + (size_t)(k % 8) * 4;
    uint32_t pair = p->mask >> k & 3;
    if (pair == 0) {
      memset(out, 0, 8);
      continue;
    }
    /* Where one of the two is not wanted it reads what the other reads. */
    uint32_t cell_a = p->cell_of[pair & 1 ? k : k + 1], cell_b = p->cell_of[pair & 2 ? k + 1 : k];
    const uint8_t *const *a = p->taps[cell_a], *const *b = p->taps[cell_b];
    bool same = cell_a == cell_b;
    __m256 y00 = load_pair(a[0] + 4 * k, b[0] + 4 * k, same);
    __m256 y10 = load_pair(a[1] + 4 * k, b[1] + 4 * k, same);
    __m256 y01 = load_pair(a[2] + 4 * k, b[2] + 4 * k, same);
    __m256 y11 = load_pair(a[3] + 4 * k, b[3] + 4 * k, same);
    __m256 f = load_weights(p->f + k), g = load_weights(p->g + k);
    __m256i c = codes(lerp(lerp(y00, y10, f), lerp(y01, y11, f), g));
    c = _mm256_shuffle_epi8(c, gather_bytes);
    uint32_t texels[2] = {
        (uint32_t)_mm256_extract_epi32(c, 0) | 0xff000000u,
        (uint32_t)_mm256_extract_epi32(c, 4) | 0xff000000u,
    };
    if (!(pair & 1)) texels[0] = 0;
    if (!(pair & 2)) texels[1] = 0;
    memcpy(out, texels, 8);
  }
}
#endif

/* ---- The stream -------------------------------------------------------------------------------
 */

void resampler_use_kernel(resampler *r, resample_kernel kernel) {
  r->place = place_plain;
  r->mix = mix_plain;
#if HAVE_AVX2
  if (kernel == RESAMPLE_BEST && __builtin_cpu_supports("avx2")) {
    r->place = place_avx2;
    r->mix = mix_avx2;
  }
#else
  (void)kernel;
#endif
}

resampler *resampler_create(uint32_t s_count, uint32_t t_count, block_source source) {
  assert(s_count >= 1 && s_count <= SLF_MAX_DIRECTIONS);
  assert(t_count >= 1 && t_count <= SLF_MAX_DIRECTIONS);
  resampler *r = calloc(1, sizeof *r);
  if (!r) return NULL;
  r->s_count = s_count;
  r->t_count = t_count;
  r->source = source;
  r->cells = calloc((size_t)s_count << 8, sizeof *r->cells);
  r->slices = calloc((size_t)s_count << 8, sizeof *r->slices);
  if (!r->cells || !r->slices) {
    resampler_free(r);
    return NULL;
  }
  resampler_use_kernel(r, RESAMPLE_BEST);
  return r;
}

void resampler_free(resampler *r) {
  if (!r) return;
  free(r->cells);
  free(r->slices);
  free(r);
}

void resample_flush(resampler *r) {
  if (r->has_pending) r->mix(&r->pending[r->latest]);
  r->has_pending = false;
}

void resample_block(resampler *r, uint32_t block_u, uint32_t block_v,
                    const block_directions *directions, uint8_t *out, size_t row_nbytes) {
  pending_block *p = &r->pending[1 - r->latest];
  p->mask = directions->mask;
  p->out = out;
  p->row_nbytes = row_nbytes;
  r->place(r, directions, p);
  find_taps(r, block_u, block_v, p);
  resample_flush(r);
  r->latest = 1 - r->latest;
  r->has_pending = true;
}
