/* depth_lanes.h - eight numbers at once: the compiler's own vectors, with AVX2 by instructions
 * where the compiler makes too many of its own, and the same without.
 *
 * Part of depth_kernel.c, which alone includes it: once in each of its compilations. */
#ifndef DEPTH_LANES_H
#define DEPTH_LANES_H

#include <math.h>
#include <string.h>

#include "depth_kernel.h"

#if defined(__AVX2__)
#include <immintrin.h>
#endif

/* 1: for flat mirrors alone. */
#if !defined(FLAT)
#define FLAT 0
#endif

#define INLINE static inline __attribute__((always_inline))

typedef float f8 __attribute__((vector_size(32)));
typedef int32_t i8 __attribute__((vector_size(32))); /* numbers, or masks of -1 and 0 */
typedef uint16_t u16 __attribute__((vector_size(16)));
typedef uint16_t w16 __attribute__((vector_size(32)));
typedef uint8_t b32 __attribute__((vector_size(32)));
typedef int8_t c8 __attribute__((vector_size(8)));

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

INLINE f8 to_float(i8 v) {
  return __builtin_convertvector(v, f8);
}

INLINE i8 to_int(f8 v) {
  return __builtin_convertvector(v, i8);
}

#if defined(__AVX2__)
/* The compiler's own conversions take several times as many instructions. */
INLINE i8 load_u16(const uint16_t *x) {
  return (i8)_mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)(const void *)x));
}

INLINE i8 load_c8(const void *x) {
  return (i8)_mm256_cvtepi8_epi32(_mm_loadl_epi64((const __m128i *)x));
}

INLINE void store_u16(uint16_t *x, i8 v) {
  const __m256i low = _mm256_broadcastsi128_si256(
      _mm_setr_epi8(0, 1, 4, 5, 8, 9, 12, 13, -1, -1, -1, -1, -1, -1, -1, -1));
  __m256i halves = _mm256_permute4x64_epi64(_mm256_shuffle_epi8((__m256i)v, low), 0x08);
  _mm_storeu_si128((__m128i *)(void *)x, _mm256_castsi256_si128(halves));
}

INLINE void store_c8(void *x, i8 v) {
  const __m256i low = _mm256_broadcastsi128_si256(
      _mm_setr_epi8(0, 4, 8, 12, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1));
  __m256i quarters = _mm256_shuffle_epi8((__m256i)v, low);
  _mm_storel_epi64((__m128i *)x, _mm_unpacklo_epi32(_mm256_castsi256_si128(quarters),
                                                    _mm256_extracti128_si256(quarters, 1)));
}

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

/* Two texels side by side, eight bytes, of each lane: of lanes 0 1 4 5 and of lanes 2 3 6 7. */
INLINE void load_pairs(const uint8_t *bytes, const int32_t texel[LANES], __m256i *a, __m256i *b) {
  __m128 halves[4];
  for (int i = 0; i < 4; i++) {
    const int l = 2 * (i & 1) + 4 * (i >> 1);
    const uint8_t *first = bytes + 4 * (size_t)(uint32_t)texel[l];
    const uint8_t *next = bytes + 4 * (size_t)(uint32_t)texel[l + 1];
    halves[i] = _mm_castsi128_ps(_mm_loadl_epi64((const __m128i *)(const void *)first));
    halves[i] = _mm_loadh_pi(halves[i], (const __m64 *)(const void *)next);
  }
  *a = _mm256_castps_si256(_mm256_set_m128(halves[2], halves[0]));
  *b = _mm256_castps_si256(_mm256_set_m128(halves[3], halves[1]));
}

/* What they hold in even and in odd places, lane after lane. */
INLINE i8 even(__m256i a, __m256i b) {
  return (i8)_mm256_shuffle_ps(_mm256_castsi256_ps(a), _mm256_castsi256_ps(b), 0x88);
}

INLINE i8 odd(__m256i a, __m256i b) {
  return (i8)_mm256_shuffle_ps(_mm256_castsi256_ps(a), _mm256_castsi256_ps(b), 0xdd);
}

/* Of pairs of numbers, those with the indices. Faster here than the processor's own gathers. */
INLINE void gather_pairs(const float (*pairs)[2], i8 index, f8 *first, f8 *second) {
  int32_t at[LANES];
  __m256i a, b;
  index *= 2;
  memcpy(at, &index, sizeof at);
  load_pairs((const uint8_t *)pairs, at, &a, &b);
  *first = (f8)even(a, b), *second = (f8)odd(a, b);
}
#else
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

INLINE void gather_pairs(const float (*pairs)[2], i8 index, f8 *first, f8 *second) {
  for (int l = 0; l < LANES; l++)
    (*first)[l] = pairs[index[l]][0], (*second)[l] = pairs[index[l]][1];
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

INLINE i8 choose_int(i8 mask, i8 a, i8 b) {
  return (a & mask) | (b & ~mask);
}

/* The lanes whose bits are set. */
INLINE i8 lanes_of(unsigned bits) {
  const i8 lanes = {1, 2, 4, 8, 16, 32, 64, 128};
  return (all_int((int32_t)bits) & lanes) == lanes;
}

/* What is held of each texel, of those of the lanes. */
INLINE f8 pick(const float *of_texel, const uint8_t texels[LANES]) {
  f8 v;
  for (int l = 0; l < LANES; l++) v[l] = of_texel[texels[l]];
  return v;
}

INLINE float sum_of(f8 v) {
  return ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7]));
}

INLINE int32_t least_of(i8 v) {
  int32_t least = v[0];
  for (int l = 1; l < LANES; l++) least = v[l] < least ? v[l] : least;
  return least;
}

INLINE int32_t largest_of(i8 v) {
  return -least_of(-v);
}

#endif
