#include "resample.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cpu.h"
#include "half.h"
#include "slf.h"

#if defined(__x86_64__)
#include <immintrin.h>
#define HAVE_AVX2 1
#define TARGET_AVX2 __attribute__((target("avx2,f16c")))
#endif
#define INLINE static inline __attribute__((always_inline))

/* A block on its way: where its taps are and how they weigh. Texels that follow each other in the
 * block and read the same cell are a run; `starts` has a bit for the first texel of each. */
typedef struct {
  float f[64], g[64]; /* the place inside the cell, along s and along t */
  uint16_t cell[64];  /* i * t_count + j */
  uint64_t starts;
  uint8_t cell_of_run[64];    /* which of taps */
  const uint8_t *taps[64][4]; /* U-Blocks of (i,j) (i+1,j) (i,j+1) (i+1,j+1) */
  uint64_t mask;
  uint16_t *out;
  size_t row_nbytes;
} pending_block;

/* Of a source that makes blocks at once rather than one by one as many are taken in before they are
 * mixed; else one, which the next one's U-Blocks come into the processor's cache behind. */
enum { MOST_PENDING = 32 };

typedef struct {
  uint32_t stamp; /* the block that noted it last */
  uint32_t number;
} note;

struct resampler {
  uint32_t s_count, t_count, most_s_count, most_t_count;
  block_source source;
  u_block_format format;
  resample_kernel kernel;
  void (*place)(const resampler *, const block_directions *, pending_block *);
  void (*mix)(const pending_block *);
  pending_block pending[MOST_PENDING];
  uint32_t first_pending, pending_count; /* a ring, of blocks taken in and not yet mixed */
  size_t pending_slices;
  uint32_t stamp;
  note *cells, *slices; /* of each slice: what the block taken in has asked for so far */
};

/* ---- Display code to linear light, linear light to half ----------------------------------------
 */

/* The sRGB curve of IEC 61966-2-1 from the 8-bit code: its line up to code 10, exactly, and from
 * there a cubic (minimax fit), within 0.3 of a code. A table would need a gather for each tap; this
 * is nine operations for eight. What it costs in accuracy, and what mixing in display code would
 * cost, is in viewer/README.md. */
#define LINE_END 10.5f
#define LINE_1 (1 / (255.0f * 12.92f))
#define CURVE_3 (0.33142574f / 255.0f / 255.0f / 255.0f)
#define CURVE_2 (0.65515540f / 255.0f / 255.0f)
#define CURVE_1 (0.014552665f / 255.0f)
#define CURVE_0 0.0015218680f

INLINE float linear_from_code(float c) {
  return c < LINE_END ? c * LINE_1 : ((c * CURVE_3 + CURVE_2) * c + CURVE_1) * c + CURVE_0;
}

/* ---- Where the taps are -----------------------------------------------------------------------
 */

/* A hair inside the circle, so that rounding never asks for a slice that is not stored; the angle
 * is off by at most 0.8 degrees there, 1/300 of a cell of 32. */
static const float rim = 0.9999f;

/* Compiled twice, for plain and for vector code; no contraction, so both round alike. */
INLINE void place_texels(const resampler *r, const block_directions *d, pending_block *p) {
  float s_last = (float)(r->s_count - 1), t_last = (float)(r->t_count - 1);
  float s_scale = 0.5f * (float)r->s_count, t_scale = 0.5f * (float)r->t_count;
  int i_last = r->s_count > 1 ? (int)r->s_count - 2 : 0;
  int j_last = r->t_count > 1 ? (int)r->t_count - 2 : 0, t_count = (int)r->t_count;
  /* Half of s and t of eq. 1, so that no finite S or T overflows. */
  float s[64], t[64], farthest_2 = 0;
  for (int k = 0; k < 64; k++) {
    s[k] = d->s[k] - 0.5f;
    t[k] = d->t[k] - 0.5f;
    s[k] = fabsf(s[k]) <= FLT_MAX ? s[k] : 0; /* NaN gives 0, too */
    t[k] = fabsf(t[k]) <= FLT_MAX ? t[k] : 0;
  }
  for (int k = 0; k < 64; k++) {
    float radius_2 = s[k] * s[k] + t[k] * t[k];
    farthest_2 = radius_2 > farthest_2 ? radius_2 : farthest_2;
  }
  if (farthest_2 > 0.25f * rim * rim)
    for (int k = 0; k < 64; k++) {
      float s_size = fabsf(s[k]), t_size = fabsf(t[k]), size = s_size > t_size ? s_size : t_size;
      float shrink = size > 1e9f ? 1e9f / size : 1; /* the square must stay finite */
      s[k] *= shrink;
      t[k] *= shrink;
      float radius_2 = s[k] * s[k] + t[k] * t[k];
      float pull = radius_2 > 0.25f * rim * rim ? 0.5f * rim / sqrtf(radius_2) : 1;
      s[k] *= pull;
      t[k] *= pull;
    }
  for (int k = 0; k < 64; k++) {
    float x = (2 * s[k] + 1) * s_scale - 0.5f, y = (2 * t[k] + 1) * t_scale - 0.5f;
    x = x > 0 ? x : 0;
    y = y > 0 ? y : 0;
    x = x < s_last ? x : s_last;
    y = y < t_last ? y : t_last;
    int i = (int)x, j = (int)y;
    i = i < i_last ? i : i_last;
    j = j < j_last ? j : j_last;
    p->f[k] = x - (float)i;
    p->g[k] = y - (float)j;
    p->cell[k] = (uint16_t)(i * t_count + j);
  }
}

static void place_plain(const resampler *r, const block_directions *d, pending_block *p) {
  place_texels(r, d, p);
}

/* Texels that are not wanted read what their neighbour reads: no block is fetched for them. */
static void skip_unwanted(pending_block *p) {
  uint16_t cell = p->cell[__builtin_ctzll(p->mask)];
  for (int k = 0; k < 64; k++) {
    if (p->mask >> k & 1) cell = p->cell[k];
    p->cell[k] = cell;
  }
}

static uint64_t find_starts(const uint16_t cell[64]) {
  uint8_t differs[64];
  uint64_t starts = 0;
  differs[0] = 1;
  for (int k = 1; k < 64; k++) differs[k] = cell[k] != cell[k - 1];
  for (int row = 0; row < 8; row++) {
    uint64_t bytes = 0;
    for (int k = 0; k < 8; k++) bytes |= (uint64_t)differs[8 * row + k] << 8 * k;
    starts |= bytes * 0x0102040810204080u >> 56 << 8 * row; /* bit 0 of each byte, side by side */
  }
  return starts;
}

/* Numbers the slice within the block taken in, adding it to slices if it is new. */
INLINE uint8_t number_slice(resampler *r, slice_index *slices, size_t *count, uint32_t i,
                            uint32_t j) {
  note *n = &r->slices[i * r->t_count + j];
  if (n->stamp != r->stamp) {
    *n = (note){.stamp = r->stamp, .number = (uint32_t)*count};
    slices[(*count)++] = (slice_index)(i << 8 | j);
  }
  return (uint8_t)n->number;
}

/* What the texels of a block read: slices, and which of them each cell mixes. */
typedef struct {
  slice_index slices[BLOCK_MAX_SLICES];
  size_t slice_count;
  uint8_t tap_slices[64][4];
  uint32_t cell_count;
} block_slices;

/* p->mask is not empty. */
static void find_slices(resampler *r, pending_block *p, block_slices *b) {
  b->slice_count = b->cell_count = 0;
  /* A light field of one direction along an axis has its second tap in the first. */
  uint32_t next_i = r->s_count > 1, next_j = r->t_count > 1;

  if (~p->mask) skip_unwanted(p);
  if (++r->stamp == 0) { /* once in 2^32 blocks */
    memset(r->cells, 0, (size_t)r->most_s_count * r->most_t_count * sizeof *r->cells);
    memset(r->slices, 0, (size_t)r->most_s_count * r->most_t_count * sizeof *r->slices);
    r->stamp = 1;
  }
  p->starts = find_starts(p->cell);
  uint8_t *cell_of_run = p->cell_of_run;
  for (uint64_t starts = p->starts; starts; starts &= starts - 1) {
    uint32_t cell = p->cell[__builtin_ctzll(starts)];
    note *n = &r->cells[cell];
    if (n->stamp != r->stamp) {
      *n = (note){.stamp = r->stamp, .number = b->cell_count};
      uint32_t i = cell / r->t_count, j = cell % r->t_count;
      uint8_t *tap = b->tap_slices[b->cell_count++];
      tap[0] = number_slice(r, b->slices, &b->slice_count, i, j);
      tap[1] = number_slice(r, b->slices, &b->slice_count, i + next_i, j);
      tap[2] = number_slice(r, b->slices, &b->slice_count, i, j + next_j);
      tap[3] = number_slice(r, b->slices, &b->slice_count, i + next_i, j + next_j);
    }
    *cell_of_run++ = (uint8_t)n->number;
  }
}

/* Where the block's slices are, or will be when the source has finished. */
static void find_taps(resampler *r, uint32_t block_u, uint32_t block_v, pending_block *p) {
  const uint8_t *u_blocks[BLOCK_MAX_SLICES];
  block_slices b;
  if (p->mask == 0) return;
  find_slices(r, p, &b);
  if (r->source.fetch_later) {
    if (r->pending_slices + b.slice_count > BLOCK_MAX_SLICES) resample_flush(r);
    r->pending_slices += b.slice_count;
    r->source.fetch_later(r->source.context, block_u, block_v, b.slices, b.slice_count, u_blocks);
  } else {
    r->source.fetch(r->source.context, block_u, block_v, b.slices, b.slice_count, u_blocks);
  }
  const int u_block_nbytes = r->format == U_BLOCK_HALF ? U_BLOCK_HALF_NBYTES : SLF_BLOCK_NBYTES;
  for (size_t i = 0; i < b.slice_count; i++)
    for (int line = 0; line < u_block_nbytes; line += 64) __builtin_prefetch(u_blocks[i] + line);
  for (uint32_t c = 0; c < b.cell_count; c++)
    for (int tap = 0; tap < 4; tap++) p->taps[c][tap] = u_blocks[b.tap_slices[c][tap]];
}

/* ---- The mix ----------------------------------------------------------------------------------
 */

static uint16_t *texel_out(const pending_block *p, int k) {
  return (uint16_t *)((uint8_t *)p->out + (size_t)(k / 8) * p->row_nbytes) + k % 8 * 4;
}

static float half_at(const uint8_t *u_block, int i) {
  uint16_t half;
  memcpy(&half, u_block + 2 * i, sizeof half);
  return float_from_half(half);
}

INLINE void mix_plain(const pending_block *p, u_block_format format) {
  const uint8_t *cell_of_run = p->cell_of_run - 1;
  for (int k = 0; k < 64; k++) {
    cell_of_run += p->starts >> k & 1;
    const uint8_t *const *taps = p->taps[*cell_of_run];
    uint16_t *out = texel_out(p, k);
    for (int channel = 0; channel < 3; channel++) {
      float y[4];
      for (int tap = 0; tap < 4; tap++)
        y[tap] = format == U_BLOCK_HALF ? half_at(taps[tap], 4 * k + channel)
                                        : linear_from_code(taps[tap][4 * k + channel]);
      float y0 = y[0] + p->f[k] * (y[1] - y[0]), y1 = y[2] + p->f[k] * (y[3] - y[2]);
      out[channel] = half_from_float(y0 + p->g[k] * (y1 - y0));
    }
    out[3] = HALF_ONE;
  }
}

static void mix_codes_plain(const pending_block *p) {
  mix_plain(p, U_BLOCK_CODES);
}

static void mix_half_plain(const pending_block *p) {
  mix_plain(p, U_BLOCK_HALF);
}

#if HAVE_AVX2
TARGET_AVX2 static void place_avx2(const resampler *r, const block_directions *d,
                                   pending_block *p) {
  place_texels(r, d, p);
}

/* Two texels, four channels each: texels k and k + 1 of one tap, from here on. */
TARGET_AVX2 INLINE __m256 load_half_pair(const uint8_t *a, const uint8_t *b) {
  __m128i both = _mm_loadl_epi64((const __m128i *)(const void *)a);
  both =
      _mm_castps_si128(_mm_loadh_pi(_mm_castsi128_ps(both), (const __m64 *)(const void *)(b + 8)));
  return _mm256_cvtph_ps(both);
}

TARGET_AVX2 INLINE __m256 load_code_pair(const uint8_t *a, const uint8_t *b, bool same_block) {
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
  y = _mm256_add_ps(_mm256_mul_ps(y, c), _mm256_set1_ps(CURVE_1));
  y = _mm256_add_ps(_mm256_mul_ps(y, c), _mm256_set1_ps(CURVE_0));
  return _mm256_blendv_ps(y, _mm256_mul_ps(c, _mm256_set1_ps(LINE_1)),
                          _mm256_cmp_ps(c, _mm256_set1_ps(LINE_END), _CMP_LT_OQ));
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

TARGET_AVX2 INLINE __m256 load_pair(const uint8_t *a, const uint8_t *b, int k, bool same_block,
                                    u_block_format format) {
  return format == U_BLOCK_HALF ? load_half_pair(a + 8 * k, b + 8 * k)
                                : load_code_pair(a + 4 * k, b + 4 * k, same_block);
}

TARGET_AVX2 INLINE void mix_avx2(const pending_block *p, u_block_format format) {
  const __m256 one = _mm256_set1_ps(1);
  const uint8_t *cell_of_run = p->cell_of_run - 1;
  uint64_t starts = p->starts;
  for (int k = 0; k < 64; k += 2, starts >>= 2) {
    cell_of_run += starts & 1;
    const uint8_t *const *a = p->taps[*cell_of_run];
    bool same = !(starts & 2);
    cell_of_run += !same;
    const uint8_t *const *b = p->taps[*cell_of_run];
    __m256 y00 = load_pair(a[0], b[0], k, same, format);
    __m256 y10 = load_pair(a[1], b[1], k, same, format);
    __m256 y01 = load_pair(a[2], b[2], k, same, format);
    __m256 y11 = load_pair(a[3], b[3], k, same, format);
    __m256 f = load_weights(p->f + k), g = load_weights(p->g + k);
    __m256 y = _mm256_blend_ps(lerp(lerp(y00, y10, f), lerp(y01, y11, f), g), one, 0x88);
    _mm_storeu_si128((__m128i *)(void *)texel_out(p, k),
                     _mm256_cvtps_ph(y, _MM_FROUND_TO_NEAREST_INT));
  }
}

TARGET_AVX2 static void mix_codes_avx2(const pending_block *p) {
  mix_avx2(p, U_BLOCK_CODES);
}

TARGET_AVX2 static void mix_half_avx2(const pending_block *p) {
  mix_avx2(p, U_BLOCK_HALF);
}
#endif

static void mix(const resampler *r, const pending_block *p) {
  if (p->mask) r->mix(p);
  if (~p->mask)
    for (int k = 0; k < 64; k++)
      if (!(p->mask >> k & 1)) memset(texel_out(p, k), 0, 8);
}

/* ---- The stream -------------------------------------------------------------------------------
 */

void resampler_use_format(resampler *r, u_block_format format) {
  r->format = format;
  resampler_use_kernel(r, r->kernel);
}

void resampler_use_kernel(resampler *r, resample_kernel kernel) {
  r->kernel = kernel;
  r->place = place_plain;
  bool half = r->format == U_BLOCK_HALF;
  r->mix = half ? mix_half_plain : mix_codes_plain;
#if HAVE_AVX2
  if (kernel == RESAMPLE_BEST && cpu_has_avx2_f16c()) {
    r->place = place_avx2;
    r->mix = half ? mix_half_avx2 : mix_codes_avx2;
  }
#endif
}

resampler *resampler_create(uint32_t s_count, uint32_t t_count, block_source source) {
  assert(s_count >= 1 && s_count <= SLF_MAX_DIRECTIONS);
  assert(t_count >= 1 && t_count <= SLF_MAX_DIRECTIONS);
  resampler *r = calloc(1, sizeof *r);
  if (!r) return NULL;
  r->most_s_count = s_count;
  r->most_t_count = t_count;
  r->cells = calloc((size_t)s_count * t_count, sizeof *r->cells);
  r->slices = calloc((size_t)s_count * t_count, sizeof *r->slices);
  if (!r->cells || !r->slices) {
    resampler_free(r);
    return NULL;
  }
  resampler_use_kernel(r, RESAMPLE_BEST);
  resampler_use_slices(r, s_count, t_count, source);
  return r;
}

void resampler_use_slices(resampler *r, uint32_t s_count, uint32_t t_count, block_source source) {
  assert(s_count >= 1 && s_count <= r->most_s_count);
  assert(t_count >= 1 && t_count <= r->most_t_count);
  r->s_count = s_count;
  r->t_count = t_count;
  r->source = source;
}

void resampler_free(resampler *r) {
  if (!r) return;
  free(r->cells);
  free(r->slices);
  free(r);
}

/* The place that the next block is taken in at; there is always one. */
static pending_block *free_pending(resampler *r) {
  return &r->pending[(r->first_pending + r->pending_count) % MOST_PENDING];
}

void resample_flush(resampler *r) {
  if (r->pending_slices > 0) r->source.finish(r->source.context);
  r->pending_slices = 0;
  for (; r->pending_count > 0; r->pending_count--) {
    mix(r, &r->pending[r->first_pending]);
    r->first_pending = (r->first_pending + 1) % MOST_PENDING;
  }
}

void resample_block(resampler *r, uint32_t block_u, uint32_t block_v,
                    const block_directions *directions, uint16_t *out, size_t row_nbytes) {
  pending_block *p = free_pending(r);
  p->mask = directions->mask;
  p->out = out;
  p->row_nbytes = row_nbytes;
  r->place(r, directions, p);
  find_taps(r, block_u, block_v, p);
  if (!r->source.fetch_later) resample_flush(r);
  r->pending_count++;
  if (r->pending_count == MOST_PENDING) resample_flush(r);
}

void resample_ask(resampler *r, uint32_t block_u, uint32_t block_v,
                  const block_directions *directions,
                  void (*ask)(void *context, uint32_t block_u, uint32_t block_v,
                              const slice_index *slices, size_t count),
                  void *context) {
  pending_block *p = free_pending(r);
  block_slices b;
  p->mask = directions->mask;
  if (p->mask == 0) return;
  r->place(r, directions, p);
  find_slices(r, p, &b);
  ask(context, block_u, block_v, b.slices, b.slice_count);
}
