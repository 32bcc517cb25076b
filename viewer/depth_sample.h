/* depth_sample.h - what lies between four texels of a slice, of eight lanes: heights' codes, and
 * light. With AVX2, and the same without.
 *
 * Part of depth_kernel.c, which alone includes it: once in each of its compilations. */
#ifndef DEPTH_SAMPLE_H
#define DEPTH_SAMPLE_H

#include "depth_lanes.h"
#include "half.h"

/* Places are in 1/128 texel; a texel's and its right neighbour's weights add up to what a signed
 * byte holds; what is read is in parts of that, and shares of slices in parts of a whole. */
enum { SPLIT = 128, ACROSS = SPLIT - 1, WHOLE = UINT16_MAX };

/* ---- Codes of heights --------------------------------------------------------------------------
 */

#if defined(__AVX2__)
/* Four codes of heights, of a texel, its right neighbour and the two below, in a number. */
INLINE i8 load_codes(const uint8_t *bytes, const int32_t texel[LANES]) {
  const __m256i upper = _mm256_broadcastsi128_si256(
      _mm_setr_epi8(3, 7, -1, -1, 11, 15, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1));
  __m256i a, b, c, d;
  load_pairs(bytes, texel, &a, &b);
  load_pairs(bytes + 4 * PAGE_ROW_TEXELS, texel, &c, &d);
  a = _mm256_unpacklo_epi64(_mm256_shuffle_epi8(a, upper), _mm256_shuffle_epi8(b, upper));
  c = _mm256_unpacklo_epi64(_mm256_shuffle_epi8(c, upper), _mm256_shuffle_epi8(d, upper));
  return (i8)_mm256_or_si256(a, _mm256_slli_epi32(c, 16));
}

/* Between them, in parts of ACROSS * SPLIT. */
INLINE i8 code_between(i8 codes, i8 fx, i8 fy) {
  i8 across = fx * 255 + ACROSS, down = fy * UINT16_MAX + SPLIT;
  __m256i rows = _mm256_maddubs_epi16((__m256i)codes, (__m256i)(across | across << 16));
  return (i8)_mm256_madd_epi16(rows, (__m256i)down);
}

/* How far apart the highest and the lowest are. */
INLINE i8 range_of(i8 codes) {
  __m256i v = (__m256i)codes, w = _mm256_srli_epi32(v, 16);
  __m256i highest = _mm256_max_epu8(v, w), lowest = _mm256_min_epu8(v, w);
  highest = _mm256_max_epu8(highest, _mm256_srli_epi32(highest, 8));
  lowest = _mm256_min_epu8(lowest, _mm256_srli_epi32(lowest, 8));
  return (i8)_mm256_sub_epi8(highest, lowest) & 0xff;
}

/* The sum of four bytes, each times a weight; the weights' sum is at most ACROSS. */
INLINE i8 weigh(i8 bytes, i8 weights) {
  const __m256i pairs = _mm256_maddubs_epi16((__m256i)bytes, (__m256i)weights);
  return (i8)_mm256_madd_epi16(pairs, _mm256_set1_epi16(1));
}

/* The bytes that are at least a limit, of 0 to 255, as masks. */
INLINE i8 bytes_from(i8 bytes, i8 limit) {
  const __m256i least =
      _mm256_shuffle_epi8((__m256i)limit, _mm256_broadcastsi128_si256(_mm_setr_epi8(
                                              0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12, 12, 12, 12)));
  return (i8)_mm256_cmpeq_epi8(_mm256_max_epu8((__m256i)bytes, least), (__m256i)bytes);
}

/* One of them, counted from the first. */
INLINE i8 pick_code(i8 codes, i8 number) {
  return (i8)_mm256_srlv_epi32((__m256i)codes, (__m256i)(number * 8)) & 0xff;
}
#else
INLINE i8 load_codes(const uint8_t *bytes, const int32_t texel[LANES]) {
  i8 codes;
  for (int l = 0; l < LANES; l++) {
    const uint8_t *upper = bytes + 4 * (size_t)texel[l] + 3;
    const uint8_t *lower_two = upper + 4 * PAGE_ROW_TEXELS;
    const uint32_t four = upper[0] | (uint32_t)upper[4] << 8 | (uint32_t)lower_two[0] << 16 |
                          (uint32_t)lower_two[4] << 24;
    codes[l] = (int32_t)four;
  }
  return codes;
}

INLINE i8 pick_code(i8 codes, i8 number) {
  return codes >> number * 8 & 0xff;
}

INLINE i8 weigh(i8 bytes, i8 weights) {
  i8 sum = all_int(0);
  for (int k = 0; k < 32; k += 8) sum += (bytes >> k & 0xff) * (weights >> k & 0xff);
  return sum;
}

INLINE i8 bytes_from(i8 bytes, i8 limit) {
  i8 mask = all_int(0);
  for (int k = 0; k < 32; k += 8)
    mask |= ((bytes >> k & 0xff) >= limit) & all_int((int32_t)(0xffu << k));
  return mask;
}

INLINE i8 code_between(i8 codes, i8 fx, i8 fy) {
  i8 a = codes & 0xff, b = codes >> 8 & 0xff, c = codes >> 16 & 0xff, d = codes >> 24 & 0xff;
  return (a * (ACROSS - fx) + b * fx) * (SPLIT - fy) + (c * (ACROSS - fx) + d * fx) * fy;
}

INLINE i8 range_of(i8 codes) {
  i8 a = codes & 0xff, b = codes >> 8 & 0xff, c = codes >> 16 & 0xff, d = codes >> 24 & 0xff;
  return higher(higher(a, b), higher(c, d)) - lower(lower(a, b), lower(c, d));
}
#endif

/* ---- Light -------------------------------------------------------------------------------------
 */

/* What is read of eight lanes: R G B and H of each, side by side; of lanes 0 1 4 5 and of lanes
 * 2 3 6 7. Colours are roots until slices are mixed: what lies between two texels is nearer to what
 * is seen there so (README.md). */
typedef struct {
  w16 half[2];
} sample;
#define CODE_UNIT (1.0f / ACROSS)
/* Where roots are added before they are squared their sum must fit, of however few weights: their
 * factors are of 16 at most. */
enum { TWICE_SHIFT = 4, MOST_TIMES = 1 << TWICE_SHIFT, ONCE = (UINT16_MAX + 1) / MOST_TIMES };
/* Linear light is the square of twice a root, less its lower 16 bits. */
#define WHITE (2.0f * 255 * ACROSS * 2 * 255 * ACROSS / 65536)
#define LIGHT_UNIT (1.0f / WHITE)

#if defined(__AVX2__)
/* Between the four texels of each lane. */
INLINE sample read(const uint8_t *bytes, const int32_t texel[LANES], i8 weights) {
  const __m256i side_by_side = _mm256_broadcastsi128_si256(
      _mm_setr_epi8(0, 4, 1, 5, 2, 6, 3, 7, 8, 12, 9, 13, 10, 14, 11, 15));
  const __m256i across =
      _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 1, 0, 1, 0, 1, 0, 1, 4, 5, 4, 5, 4, 5, 4, 5));
  const __m256i down = _mm256_broadcastsi128_si256(
      _mm_setr_epi8(-1, 2, -1, 2, -1, 2, -1, 2, -1, 6, -1, 6, -1, 6, -1, 6));
  sample r;
  __m256i upper[2], lower_two[2];
  load_pairs(bytes, texel, &upper[0], &upper[1]);
  load_pairs(bytes + 4 * PAGE_ROW_TEXELS, texel, &lower_two[0], &lower_two[1]);
  for (int k = 0; k < 2; k++) {
    __m256i w = k ? _mm256_srli_si256((__m256i)weights, 8) : (__m256i)weights;
    __m256i along = _mm256_shuffle_epi8(w, across);
    __m256i a = _mm256_maddubs_epi16(_mm256_shuffle_epi8(upper[k], side_by_side), along);
    __m256i b = _mm256_maddubs_epi16(_mm256_shuffle_epi8(lower_two[k], side_by_side), along);
    __m256i fall = _mm256_mulhrs_epi16(_mm256_sub_epi16(b, a), _mm256_shuffle_epi8(w, down));
    r.half[k] = (w16)_mm256_add_epi16(a, fall);
  }
  return r;
}

INLINE i8 heights_of(const sample *r) {
  return (i8)_mm256_srli_epi32((__m256i)odd((__m256i)r->half[0], (__m256i)r->half[1]), 16);
}

/* The lower 16 bits of numbers, of the lanes of a half. */
INLINE __m256i spread(i8 numbers, int half) {
  const __m256i first =
      _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 1, 0, 1, 0, 1, 0, 1, 4, 5, 4, 5, 4, 5, 4, 5));
  const __m256i last = _mm256_broadcastsi128_si256(
      _mm_setr_epi8(8, 9, 8, 9, 8, 9, 8, 9, 12, 13, 12, 13, 12, 13, 12, 13));
  return _mm256_shuffle_epi8((__m256i)numbers, half ? last : first);
}

/* Adds a share, of WHOLE, of what was read as linear light. */
INLINE void add(sample *sum, const sample *r, i8 share) {
  for (int k = 0; k < 2; k++) {
    __m256i twice = (__m256i)(r->half[k] + r->half[k]);
    sum->half[k] += (w16)_mm256_mulhi_epu16(_mm256_mulhi_epu16(twice, twice), spread(share, k));
  }
}

/* Adds roots: the four texels of each lane by weights of their own, and that times a factor. */
INLINE void add_roots(sample *sum, const uint8_t *bytes, const int32_t texel[LANES], i8 weights,
                      i8 factor) {
  const __m256i side_by_side = _mm256_broadcastsi128_si256(
      _mm_setr_epi8(0, 4, 1, 5, 2, 6, 3, 7, 8, 12, 9, 13, 10, 14, 11, 15));
  __m256i upper[2], lower_two[2];
  load_pairs(bytes, texel, &upper[0], &upper[1]);
  load_pairs(bytes + 4 * PAGE_ROW_TEXELS, texel, &lower_two[0], &lower_two[1]);
  for (int k = 0; k < 2; k++) {
    const __m256i above = spread(weights, k), below = spread(weights >> 16, k);
    __m256i a = _mm256_maddubs_epi16(_mm256_shuffle_epi8(upper[k], side_by_side), above);
    __m256i b = _mm256_maddubs_epi16(_mm256_shuffle_epi8(lower_two[k], side_by_side), below);
    __m256i twice = _mm256_slli_epi16(_mm256_add_epi16(a, b), 1);
    sum->half[k] += (w16)_mm256_mulhi_epu16(twice, spread(factor, k));
  }
}

/* A share, of WHOLE, of the linear light whose roots were added. */
INLINE void square(sample *roots, i8 share) {
  for (int k = 0; k < 2; k++) {
    __m256i twice = (__m256i)(roots->half[k] << TWICE_SHIFT);
    roots->half[k] = (w16)_mm256_mulhi_epu16(_mm256_mulhi_epu16(twice, twice), spread(share, k));
  }
}

/* Half floats of two lanes, and 1. */
INLINE void put_pair(__m128i light, uint16_t out[2][4]) {
  __m128i with_1 = _mm_blend_epi16(light, _mm_set1_epi16((int16_t)(uint16_t)WHITE), 0x88);
  __m256 linear = _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(with_1)) * LIGHT_UNIT;
  _mm_storeu_si128((__m128i *)(void *)out, _mm256_cvtps_ph(linear, _MM_FROUND_TO_NEAREST_INT));
}

INLINE void put(const sample *sum, uint16_t out[LANES][4]) {
  for (int k = 0; k < 2; k++) {
    put_pair(_mm256_castsi256_si128((__m256i)sum->half[k]), out + 2 * k);
    put_pair(_mm256_extracti128_si256((__m256i)sum->half[k], 1), out + 4 + 2 * k);
  }
}
#else
/* Where lane l's R is. */
INLINE uint16_t *of_lane(sample *r, int l) {
  return (uint16_t *)&r->half[l >> 1 & 1] + 4 * (l & 1) + 8 * (l >> 2);
}

INLINE sample read(const uint8_t *bytes, const int32_t texel[LANES], i8 weights) {
  sample r;
  for (int l = 0; l < LANES; l++)
    for (int c = 0; c < 4; c++) {
      const uint8_t *upper = bytes + 4 * (size_t)texel[l] + c;
      const uint8_t *lower_two = upper + 4 * PAGE_ROW_TEXELS;
      const int left = weights[l] & 0xff, right = weights[l] >> 8 & 0xff, down = weights[l] >> 16;
      const int a = upper[0] * left + upper[4] * right;
      const int b = lower_two[0] * left + lower_two[4] * right;
      const int fall = (((b - a) * (down << 8) >> 14) + 1) >> 1; /* as the instruction rounds */
      of_lane(&r, l)[c] = (uint16_t)(a + fall);
    }
  return r;
}

INLINE i8 heights_of(const sample *r) {
  sample copy = *r;
  i8 heights;
  for (int l = 0; l < LANES; l++) heights[l] = of_lane(&copy, l)[3];
  return heights;
}

INLINE void add(sample *sum, const sample *r, i8 share) {
  sample copy = *r;
  for (int l = 0; l < LANES; l++)
    for (int c = 0; c < 4; c++) {
      const uint32_t twice = 2u * of_lane(&copy, l)[c];
      of_lane(sum, l)[c] += (uint16_t)((twice * twice >> 16) * (uint32_t)share[l] >> 16);
    }
}

INLINE void add_roots(sample *sum, const uint8_t *bytes, const int32_t texel[LANES], i8 weights,
                      i8 factor) {
  for (int l = 0; l < LANES; l++)
    for (int c = 0; c < 4; c++) {
      const uint8_t *upper = bytes + 4 * (size_t)texel[l] + c;
      const uint8_t *lower_two = upper + 4 * PAGE_ROW_TEXELS;
      const uint32_t w = (uint32_t)weights[l];
      const uint32_t root = upper[0] * (w & 0xff) + upper[4] * (w >> 8 & 0xff) +
                            lower_two[0] * (w >> 16 & 0xff) + lower_two[4] * (w >> 24);
      of_lane(sum, l)[c] += (uint16_t)(2 * root * (uint32_t)factor[l] >> 16);
    }
}

INLINE void square(sample *roots, i8 share) {
  for (int l = 0; l < LANES; l++)
    for (int c = 0; c < 4; c++) {
      uint16_t *light = &of_lane(roots, l)[c];
      const uint32_t twice = (uint16_t)(*light << TWICE_SHIFT);
      *light = (uint16_t)((twice * twice >> 16) * (uint32_t)share[l] >> 16);
    }
}

INLINE void put(const sample *sum, uint16_t out[LANES][4]) {
  sample copy = *sum;
  for (int l = 0; l < LANES; l++) {
    for (int c = 0; c < 3; c++)
      out[l][c] = half_from_float((float)of_lane(&copy, l)[c] * LIGHT_UNIT);
    out[l][3] = HALF_ONE;
  }
}
#endif

/* Brings the sum over all lanes to the first. */
INLINE void join_lanes(sample *sum) {
  w16 v = sum->half[0] + sum->half[1];
  v += __builtin_shufflevector(v, v, 8, 9, 10, 11, 12, 13, 14, 15, 8, 9, 10, 11, 12, 13, 14, 15);
  v += __builtin_shufflevector(v, v, 4, 5, 6, 7, 4, 5, 6, 7, 4, 5, 6, 7, 4, 5, 6, 7);
  sum->half[0] = v;
}

/* Of weights' sums: what makes shares of them. */
INLINE f8 share_unit(f8 sum) {
  return (float)WHOLE / sum;
}

/* Of the total of all weights, of slices and of texels: what roots are added by. */
INLINE f8 root_unit(f8 total) {
  return (float)(ACROSS * ONCE) / larger(total, all(1e-3f));
}

#endif
