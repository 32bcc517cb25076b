/* transform.c - levels to texels. Compiled for each kernel: see kernel.h.
 *
 * Eight lanes are eight columns or rows. A compiler without 256-bit registers splits them; the sums
 * and products stay the same ones. */
#include "codec/kernel.h"

#ifdef __AVX2__
#include <immintrin.h>
#endif

typedef float lanes __attribute__((vector_size(32)));
typedef int32_t int_lanes __attribute__((vector_size(32)));
typedef int16_t short_lanes __attribute__((vector_size(16)));

static inline __attribute__((always_inline)) lanes splat(float x) {
  return (lanes){x, x, x, x, x, x, x, x};
}

/* The same where they stand in memory. A copy by memcpy would go through 16-byte registers, and the
 * wide loads that follow would wait for it. */
typedef lanes lanes_at __attribute__((aligned(4), may_alias));
typedef uint16_t words_at __attribute__((vector_size(16), aligned(2), may_alias));

static inline __attribute__((always_inline)) void load(const float *from, lanes b[8]) {
#pragma GCC unroll 8
  for (int i = 0; i < 8; i++) b[i] = *(const lanes_at *)(from + 8 * i);
}

static inline __attribute__((always_inline)) void store(const lanes b[8], float *to) {
#pragma GCC unroll 8
  for (int i = 0; i < 8; i++) *(lanes_at *)(to + 8 * i) = b[i];
}

static inline __attribute__((always_inline)) lanes to_lanes(short_lanes x) {
#ifdef __AVX2__ /* what GCC 12 makes of the general form takes four instructions */
  return (lanes)_mm256_cvtepi32_ps(_mm256_cvtepi16_epi32((__m128i)x));
#else
  return __builtin_convertvector(__builtin_convertvector(x, int_lanes), lanes);
#endif
}

#define LANES lanes
#define INVERSE_PASS inverse_pass
#include "codec/inverse_pass.h"

static inline __attribute__((always_inline)) void transpose(lanes b[8]) {
  lanes p[8], q[8];
  for (int i = 0; i < 8; i += 2) {
    p[i] = __builtin_shufflevector(b[i], b[i + 1], 0, 8, 1, 9, 4, 12, 5, 13);
    p[i + 1] = __builtin_shufflevector(b[i], b[i + 1], 2, 10, 3, 11, 6, 14, 7, 15);
  }
  for (int i = 0; i < 8; i += 4)
    for (int k = 0; k < 2; k++) {
      q[i + 2 * k] = __builtin_shufflevector(p[i + k], p[i + k + 2], 0, 1, 8, 9, 4, 5, 12, 13);
      q[i + 2 * k + 1] =
          __builtin_shufflevector(p[i + k], p[i + k + 2], 2, 3, 10, 11, 6, 7, 14, 15);
    }
  for (int i = 0; i < 4; i++) {
    b[i] = __builtin_shufflevector(q[i], q[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
    b[i + 4] = __builtin_shufflevector(q[i], q[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
  }
}

/* Of lanes whose upper four are zeros; four come out, and the others would be zeros. */
static inline __attribute__((always_inline)) void transpose_low(lanes b[8]) {
  lanes p[4], q[4];
  for (int i = 0; i < 4; i++)
    p[i] = __builtin_shufflevector(b[i], b[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
  for (int i = 0; i < 4; i += 2) {
    q[i] = __builtin_shufflevector(p[i], p[i + 1], 0, 8, 1, 9, 4, 12, 5, 13);
    q[i + 1] = __builtin_shufflevector(p[i], p[i + 1], 2, 10, 3, 11, 6, 14, 7, 15);
  }
  for (int k = 0; k < 2; k++) {
    b[2 * k] = __builtin_shufflevector(q[k], q[k + 2], 0, 1, 8, 9, 4, 5, 12, 13);
    b[2 * k + 1] = __builtin_shufflevector(q[k], q[k + 2], 2, 3, 10, 11, 6, 7, 14, 15);
  }
}

static inline __attribute__((always_inline)) void inverse(lanes b[8], bool low) {
  inverse_pass(b, low);
  if (low)
    transpose_low(b);
  else
    transpose(b);
  inverse_pass(b, low);
}

void inverse_dct(float block[COEFFICIENTS]) {
  lanes b[8];
  load(block, b);
  inverse(b, false);
  store(b, block);
}

void plain_inverse_dct(float block[COEFFICIENTS]) {
  for (int i = 0; i < COEFFICIENTS; i++) block[i] *= (float)(slf_aan[i / 8] * slf_aan[i % 8] / 8);
  inverse_dct(block);
}

/* Half the cosines of (2x + 1) k pi / 16; row 0 times sqrt(1/2). */
static const float cosines[8][8] = {{0.35355339f, 0.35355339f, 0.35355339f, 0.35355339f,
                                     0.35355339f, 0.35355339f, 0.35355339f, 0.35355339f},
                                    {0.49039264f, 0.41573481f, 0.27778512f, 0.09754516f,
                                     -0.09754516f, -0.27778512f, -0.41573481f, -0.49039264f},
                                    {0.46193977f, 0.19134172f, -0.19134172f, -0.46193977f,
                                     -0.46193977f, -0.19134172f, 0.19134172f, 0.46193977f},
                                    {0.41573481f, -0.09754516f, -0.49039264f, -0.27778512f,
                                     0.27778512f, 0.49039264f, 0.09754516f, -0.41573481f},
                                    {0.35355339f, -0.35355339f, -0.35355339f, 0.35355339f,
                                     0.35355339f, -0.35355339f, -0.35355339f, 0.35355339f},
                                    {0.27778512f, -0.49039264f, 0.09754516f, 0.41573481f,
                                     -0.41573481f, -0.09754516f, 0.49039264f, -0.27778512f},
                                    {0.19134172f, -0.46193977f, 0.46193977f, -0.19134172f,
                                     -0.19134172f, 0.46193977f, -0.46193977f, 0.19134172f},
                                    {0.09754516f, -0.27778512f, 0.41573481f, -0.49039264f,
                                     0.49039264f, -0.41573481f, 0.27778512f, -0.09754516f}};

static inline __attribute__((always_inline)) void forward_pass(const lanes from[8], lanes to[8]) {
  for (int k = 0; k < 8; k++) {
    to[k] = splat(cosines[k][0]) * from[0];
    for (int x = 1; x < 8; x++) to[k] += splat(cosines[k][x]) * from[x];
  }
}

void forward_dct(const float texels[COEFFICIENTS], float coefficients[COEFFICIENTS]) {
  lanes rows[8], once[8];
  load(texels, rows);
  forward_pass(rows, once); /* down the columns: [vertical][x] */
  transpose(once);          /* [x][vertical] */
  forward_pass(once, rows); /* [horizontal][vertical] */
  store(rows, coefficients);
}

/* ---- Levels -------------------------------------------------------------------------------- */

/* Int16 arithmetic wraps: a damaged file may ask for anything. */
typedef uint16_t word_lanes __attribute__((vector_size(16)));

static inline __attribute__((always_inline)) void channel_texels(const int16_t *prediction,
                                                                 const int16_t *levels,
                                                                 uint16_t gain, const float *scales,
                                                                 bool low, lanes b[8]) {
#pragma GCC unroll 8
  for (int i = 0; i < 8; i++) {
    if (low && i >= 4) break;
    word_lanes level = *(const words_at *)(levels + 8 * i) * gain;
    if (prediction) level += *(const words_at *)(prediction + 8 * i);
    b[i] = *(const lanes_at *)(scales + 8 * i) * to_lanes((short_lanes)level);
  }
  inverse(b, low);
}

/* Up to here the zigzag scan stays in the lowest 4x4 frequencies. */
enum { LOW_LAST_K = 9 };

static inline __attribute__((always_inline)) void
own_texels(const block_levels *block, int c, uint16_t gain, const float *scales, lanes b[8]) {
  if (block->last_k[c] <= LOW_LAST_K)
    channel_texels(NULL, block->levels[c], gain, scales, true, b);
  else
    channel_texels(NULL, block->levels[c], gain, scales, false, b);
}

/* Without AC all texels are the DC: the transform adds zeros to it. */
static inline __attribute__((always_inline)) void flat_texels(int16_t level, uint16_t gain,
                                                              const float *scales, lanes b[8]) {
  lanes dc = splat((float)(int16_t)(uint16_t)((uint16_t)level * (uint32_t)gain) * scales[0]);
  for (int i = 0; i < 8; i++) b[i] = dc;
}

static inline __attribute__((always_inline)) void
channel_texels_of(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
                  const block_levels *block, int c, uint32_t gain, lanes b[8]) {
  if (prediction)
    channel_texels(prediction[c], block->levels[c], (uint16_t)gain, layer->scales[c], false, b);
  else if (block->ac_flags >> c & 1)
    own_texels(block, c, (uint16_t)gain, layer->scales[c], b);
  else
    flat_texels(block->levels[c][0], (uint16_t)gain, layer->scales[c], b);
}

static inline __attribute__((always_inline)) void
add_shifted(const layer_state *layer, const shift_window *shifted, int c, lanes b[8]) {
  const int16_t *more = shifted->channels + c * WINDOW_CHANNEL + shifted->begin;
#pragma GCC unroll 8
  for (int y = 0; y < 8; y++)
    b[y] += to_lanes((short_lanes) * (const words_at *)(more + y * WINDOW_ROW)) *
            splat(1 / layer->difference_one);
}

static inline __attribute__((always_inline)) lanes choose(int_lanes mask, lanes yes, lanes no) {
  return (lanes)((mask & (int_lanes)yes) | (~mask & (int_lanes)no));
}

/* Rounded half up, within 16 bits: 32768 more, and what is left is to cut off. */
static inline __attribute__((always_inline)) void put_difference(lanes x, int16_t *to) {
  lanes low = splat(0.5f), high = splat(65535);
  x += splat(32768.5f);
  x = choose(x > low, x, low);
  x = choose(x < high, x, high);
  int_lanes steps = __builtin_convertvector(x, int_lanes) - 32768;
  *(words_at *)to = (words_at) __builtin_convertvector(steps, short_lanes);
}

void levels_to_difference(const layer_state *layer, const int16_t fine[3][COEFFICIENTS],
                          int16_t difference[3][COEFFICIENTS]) {
  for (int c = 0; c < 3; c++) {
    lanes b[8];
    channel_texels(NULL, fine[c], 1, layer->scales[c], false, b);
    for (int y = 0; y < 8; y++)
      put_difference(b[y] * splat(layer->difference_one), difference[c] + 8 * y);
  }
}

/* Codes of 8 texels, rounded down and clamped: the rounding half is in them already. */
static inline __attribute__((always_inline)) void pack_codes(lanes red, lanes green, lanes blue,
                                                             uint8_t *to) {
#ifdef __AVX2__
  __m256i r = _mm256_cvttps_epi32((__m256)red), g = _mm256_cvttps_epi32((__m256)green);
  __m256i b = _mm256_cvttps_epi32((__m256)blue), x = _mm256_set1_epi32(255);
  __m256i bytes = _mm256_packus_epi16(_mm256_packs_epi32(r, g), _mm256_packs_epi32(b, x));
  const __m256i order = _mm256_setr_epi8(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15, 0, 4,
                                         8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
  _mm256_storeu_si256((__m256i *)to, _mm256_shuffle_epi8(bytes, order));
#else
  int_lanes codes[3] = {__builtin_convertvector(red, int_lanes),
                        __builtin_convertvector(green, int_lanes),
                        __builtin_convertvector(blue, int_lanes)};
  for (int i = 0; i < 8; i++) {
    for (int c = 0; c < 3; c++) {
      int32_t code = codes[c][i];
      to[4 * i + c] = (uint8_t)(code < 0 ? 0 : code > 255 ? 255 : code);
    }
    to[4 * i + 3] = 255;
  }
#endif
}

/* The layer's colours, and the level shift of 128; of JFIF's colours without their ones and zeros.
 */
static inline __attribute__((always_inline)) void put_codes(const layer_state *layer, lanes b[3][8],
                                                            uint8_t *u_block) {
  const float(*m)[3] = layer->to_rgb;
  if (layer->own_colours) {
#pragma GCC unroll 8
    for (int y = 0; y < 8; y++) {
      lanes rgb[3];
#pragma GCC unroll 3
      for (int k = 0; k < 3; k++)
        rgb[k] = splat(m[k][0]) * b[0][y] + splat(m[k][1]) * b[1][y] + splat(m[k][2]) * b[2][y] +
                 splat(128.5f);
      pack_codes(rgb[0], rgb[1], rgb[2], u_block + 32 * y);
    }
    return;
  }
#pragma GCC unroll 8
  for (int y = 0; y < 8; y++) {
    lanes luma = b[0][y] + splat(128.5f), cb = b[1][y], cr = b[2][y];
    pack_codes(luma + splat(m[0][2]) * cr, luma + splat(m[1][1]) * cb + splat(m[1][2]) * cr,
               luma + splat(m[2][1]) * cb, u_block + 32 * y);
  }
}

void levels_to_channels(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
                        const block_levels *block, uint32_t gain, const shift_window *shifted,
                        float channels[3][COEFFICIENTS]) {
  for (int c = 0; c < 3; c++) {
    lanes b[8];
    channel_texels_of(layer, prediction, block, c, gain, b);
    if (shifted) add_shifted(layer, shifted, c, b);
    store(b, channels[c]);
  }
}

void channels_to_codes(const layer_state *layer, float channels[3][COEFFICIENTS],
                       uint8_t *u_block) {
  lanes b[3][8];
  for (int c = 0; c < 3; c++) load(channels[c], b[c]);
  put_codes(layer, b, u_block);
}

/* Most blocks of low rate: chroma without AC, of JFIF's colours. What chroma and the level shift
 * add to luma is three numbers. */
static inline __attribute__((always_inline)) void put_flat_chroma(const layer_state *layer,
                                                                  const block_levels *block,
                                                                  uint32_t gain, uint8_t *u_block) {
  const float(*m)[3] = layer->to_rgb;
  lanes b[8], cb[8], cr[8];
  own_texels(block, 0, (uint16_t)gain, layer->scales[0], b);
  flat_texels(block->levels[1][0], (uint16_t)gain, layer->scales[1], cb);
  flat_texels(block->levels[2][0], (uint16_t)gain, layer->scales[2], cr);
  lanes half = splat(128.5f), red = half + splat(m[0][2]) * cr[0];
  lanes green = half + splat(m[1][1]) * cb[0] + splat(m[1][2]) * cr[0];
  lanes blue = half + splat(m[2][1]) * cb[0];
#pragma GCC unroll 8
  for (int y = 0; y < 8; y++) pack_codes(b[y] + red, b[y] + green, b[y] + blue, u_block + 32 * y);
}

/* ---- Two channels at once ------------------------------------------------------------------ */

/* With 512 bits chroma's channels are transformed side by side, and colours made of two rows. */
#ifdef __AVX512F__
typedef float pairs __attribute__((vector_size(64)));
typedef pairs pairs_at __attribute__((aligned(4), may_alias));
#define LANES pairs
#define INVERSE_PASS inverse_pass_of_pairs
#include "codec/inverse_pass.h"

static inline __attribute__((always_inline)) void transpose_pairs(pairs b[8]) {
  pairs p[8], q[8];
  for (int i = 0; i < 8; i += 2) {
    p[i] = (pairs)_mm512_unpacklo_ps((__m512)b[i], (__m512)b[i + 1]);
    p[i + 1] = (pairs)_mm512_unpackhi_ps((__m512)b[i], (__m512)b[i + 1]);
  }
  for (int i = 0; i < 8; i += 4)
    for (int k = 0; k < 2; k++) {
      q[i + 2 * k] = (pairs)_mm512_unpacklo_pd((__m512d)p[i + k], (__m512d)p[i + k + 2]);
      q[i + 2 * k + 1] = (pairs)_mm512_unpackhi_pd((__m512d)p[i + k], (__m512d)p[i + k + 2]);
    }
  const __m512i low = _mm512_setr_epi64(0, 1, 8, 9, 4, 5, 12, 13);
  const __m512i high = _mm512_setr_epi64(2, 3, 10, 11, 6, 7, 14, 15);
  for (int i = 0; i < 4; i++) {
    __m512d even = (__m512d)q[i], odd = (__m512d)q[i + 4];
    b[i] = (pairs)_mm512_permutex2var_pd(even, low, odd);
    b[i + 4] = (pairs)_mm512_permutex2var_pd(even, high, odd);
  }
}

static inline __attribute__((always_inline)) __m256i pair_words(const int16_t *a,
                                                                const int16_t *b) {
  __m128i low = _mm_loadu_si128((const __m128i *)a), high = _mm_loadu_si128((const __m128i *)b);
  return _mm256_inserti128_si256(_mm256_castsi128_si256(low), high, 1);
}

static inline __attribute__((always_inline)) pairs pair(lanes a, lanes b) {
  return (pairs)_mm512_insertf32x8(_mm512_castps256_ps512((__m256)a), (__m256)b, 1);
}

static inline __attribute__((always_inline)) pairs to_pairs(__m256i words) {
  return (pairs)_mm512_cvtepi32_ps(_mm512_cvtepi16_epi32(words));
}

/* The scaled coefficients of a channel, two rows in each. */
static inline __attribute__((always_inline)) void
scaled_rows(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
            const block_levels *block, int c, uint32_t gain, pairs rows[4]) {
#pragma GCC unroll 2
  for (int half = 0; half < 2; half++) {
    const int at = COEFFICIENTS / 2 * half;
    __m512i level = _mm512_loadu_si512(block->levels[c] + at);
    level = _mm512_mullo_epi16(level, _mm512_set1_epi16((short)gain));
    if (prediction) level = _mm512_add_epi16(level, _mm512_loadu_si512(prediction[c] + at));
    const float *scales = layer->scales[c] + at;
    rows[2 * half] = to_pairs(_mm512_castsi512_si256(level)) * *(const pairs_at *)scales;
    rows[2 * half + 1] =
        to_pairs(_mm512_extracti64x4_epi64(level, 1)) * *(const pairs_at *)(scales + 16);
  }
}

static inline __attribute__((always_inline)) void
luma_texels(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
            const block_levels *block, uint32_t gain, lanes b[8]) {
  pairs rows[4];
  scaled_rows(layer, prediction, block, 0, gain, rows);
#pragma GCC unroll 4
  for (int i = 0; i < 4; i++) {
    b[2 * i] = (lanes)_mm512_castps512_ps256((__m512)rows[i]);
    b[2 * i + 1] = (lanes)_mm512_extractf32x8_ps((__m512)rows[i], 1);
  }
  inverse(b, false);
}

/* channel_texels of both chroma channels. */
static inline __attribute__((always_inline)) void
chroma_texels(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
              const block_levels *block, uint32_t gain, pairs b[8]) {
  pairs blue[4], red[4];
  scaled_rows(layer, prediction, block, 1, gain, blue);
  scaled_rows(layer, prediction, block, 2, gain, red);
#pragma GCC unroll 4
  for (int i = 0; i < 4; i++) {
    b[2 * i] = (pairs)_mm512_shuffle_f32x4((__m512)blue[i], (__m512)red[i], 0x44);
    b[2 * i + 1] = (pairs)_mm512_shuffle_f32x4((__m512)blue[i], (__m512)red[i], 0xee);
  }
  inverse_pass_of_pairs(b, false);
  transpose_pairs(b);
  inverse_pass_of_pairs(b, false);
}

/* What a window shows of a channel in two rows. */
static inline __attribute__((always_inline)) pairs
shifted_rows(const layer_state *layer, const shift_window *shifted, int c, int y) {
  const int16_t *from = shifted->channels + c * WINDOW_CHANNEL + shifted->begin + y * WINDOW_ROW;
  return to_pairs(pair_words(from, from + WINDOW_ROW)) * (1 / layer->difference_one);
}

static inline __attribute__((always_inline)) void pack_pairs(const pairs rgb[3], uint8_t *to) {
  __m512i r = _mm512_cvttps_epi32((__m512)rgb[0]), g = _mm512_cvttps_epi32((__m512)rgb[1]);
  __m512i b = _mm512_cvttps_epi32((__m512)rgb[2]), x = _mm512_set1_epi32(255);
  __m512i bytes = _mm512_packus_epi16(_mm512_packs_epi32(r, g), _mm512_packs_epi32(b, x));
  const __m512i order = _mm512_set4_epi32(0x0f0b0703, 0x0e0a0602, 0x0d090501, 0x0c080400);
  _mm512_storeu_si512(to, _mm512_shuffle_epi8(bytes, order));
}

/* As put_codes does. */
static inline __attribute__((always_inline)) void put_pairs(const layer_state *layer,
                                                            const pairs b[3], uint8_t *to) {
  const float(*m)[3] = layer->to_rgb;
  pairs rgb[3], luma = b[0] + 128.5f;
  if (layer->own_colours) {
#pragma GCC unroll 3
    for (int k = 0; k < 3; k++) rgb[k] = m[k][0] * b[0] + m[k][1] * b[1] + m[k][2] * b[2] + 128.5f;
  } else {
    rgb[0] = luma + m[0][2] * b[2];
    rgb[1] = luma + m[1][1] * b[1] + m[1][2] * b[2];
    rgb[2] = luma + m[2][1] * b[1];
  }
  pack_pairs(rgb, to);
}

/* Both chroma channels where they have few frequencies. */
static inline __attribute__((always_inline)) void
low_chroma_texels(const layer_state *layer, const block_levels *block, uint32_t gain, pairs b[8]) {
  lanes blue[8], red[8];
  channel_texels_of(layer, NULL, block, 1, gain, blue);
  channel_texels_of(layer, NULL, block, 2, gain, red);
#pragma GCC unroll 8
  for (int y = 0; y < 8; y++) b[y] = pair(blue[y], red[y]);
}

static void make_luma(texels_maker *m) {
  lanes b[8];
  if (m->prediction || m->block->last_k[0] > LOW_LAST_K)
    luma_texels(m->layer, m->prediction, m->block, m->gain, b);
  else
    channel_texels_of(m->layer, NULL, m->block, 0, m->gain, b);
  store(b, m->luma);
}

static void make_chroma(texels_maker *m) {
  pairs b[8];
  if (m->prediction || m->block->last_k[1] > LOW_LAST_K || m->block->last_k[2] > LOW_LAST_K)
    chroma_texels(m->layer, m->prediction, m->block, m->gain, b);
  else
    low_chroma_texels(m->layer, m->block, m->gain, b);
#pragma GCC unroll 8
  for (int y = 0; y < 8; y++) *(pairs_at *)m->chroma[y] = b[y];
}

static void make_codes(texels_maker *m) {
#pragma GCC unroll 4
  for (int y = 0; y < 8; y += 2) {
    __m512 above = (__m512) * (const pairs_at *)m->chroma[y];
    __m512 below = (__m512) * (const pairs_at *)m->chroma[y + 1];
    pairs b[3] = {*(const pairs_at *)(m->luma + 8 * y),
                  (pairs)_mm512_shuffle_f32x4(above, below, 0x44),
                  (pairs)_mm512_shuffle_f32x4(above, below, 0xee)};
    if (m->shifted)
#pragma GCC unroll 3
      for (int c = 0; c < 3; c++) b[c] += shifted_rows(m->layer, m->shifted, c, y);
    put_pairs(m->layer, b, m->u_block + 32 * y);
  }
}
#else
static void make_luma(texels_maker *m) {
  lanes b[8];
  channel_texels_of(m->layer, m->prediction, m->block, 0, m->gain, b);
  store(b, m->luma);
}

static void make_chroma(texels_maker *m) {
  for (int c = 1; c < 3; c++) {
    lanes b[8];
    channel_texels_of(m->layer, m->prediction, m->block, c, m->gain, b);
    for (int y = 0; y < 8; y++) *(lanes_at *)m->chroma[y][c - 1] = b[y];
  }
}

static void make_codes(texels_maker *m) {
  lanes b[3][8];
  load(m->luma, b[0]);
  for (int c = 1; c < 3; c++)
    for (int y = 0; y < 8; y++) b[c][y] = *(const lanes_at *)m->chroma[y][c - 1];
  for (int c = 0; c < 3 && m->shifted; c++) add_shifted(m->layer, m->shifted, c, b[c]);
  put_codes(m->layer, b, m->u_block);
}
#endif

void texels_step(texels_maker *m) {
  switch (m->step) {
  case TEXELS_LUMA:
    if (!m->prediction && !m->shifted && m->block->ac_flags <= 1 && !m->layer->own_colours) {
      put_flat_chroma(m->layer, m->block, m->gain, m->u_block);
      m->step = TEXELS_MADE;
      return;
    }
    make_luma(m);
    break;
  case TEXELS_CHROMA:
    make_chroma(m);
    break;
  default:
    make_codes(m);
  }
  m->step++;
}

void levels_to_codes(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
                     const block_levels *block, uint32_t gain, const shift_window *shifted,
                     uint8_t *u_block) {
  texels_maker maker;
  texels_begin(&maker, layer, prediction, block, gain, shifted, u_block);
  texels_finish(&maker);
}
