/* Compiled four times: for any processor, and, with -mavx2 -mf16c, for those that have that; and
 * each of them for any surface, and, with -DFLAT=1, for flat mirrors. The vectors are the
 * compiler's own, so that both processors do the same operations in the same order. */
#include "depth_kernel.h"

#include <math.h>
#include <string.h>

#include "half.h"

#if !defined(FLAT)
#define FLAT 0
#endif
#if defined(__AVX2__)
#include <immintrin.h>
#endif
#if defined(__AVX2__) && FLAT
#define KERNEL depth_kernel_avx2_flat
#elif defined(__AVX2__)
#define KERNEL depth_kernel_avx2
#elif FLAT
#define KERNEL depth_kernel_plain_flat
#else
#define KERNEL depth_kernel_plain
#endif
/* Places are in 1/128 texel; a texel's and its right neighbour's weights add up to what a signed
 * byte holds; what is read is in parts of that, and shares of slices in parts of a whole. */
enum { SPLIT = 128, ACROSS = SPLIT - 1, WHOLE = UINT16_MAX };
/* Of the tolerance: a guess this near is not looked at again. */
#define MOVED_SHARE 0.5f
#define INLINE static inline __attribute__((always_inline))

typedef float f8 __attribute__((vector_size(32)));
typedef int32_t i8 __attribute__((vector_size(32))); /* numbers, or masks of -1 and 0 */
typedef uint16_t u16 __attribute__((vector_size(16)));
typedef uint16_t w16 __attribute__((vector_size(32)));
typedef uint8_t b32 __attribute__((vector_size(32)));
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

/* Eight of a curved surface's frames: depth_frames.h. */
typedef union {
  struct {
    f8 position[3], normal[3], tangent_u[3], tangent_v[3], across[4], bend[4], turn[2];
  };
  f8 numbers[sizeof(depth_frame) / sizeof(float)];
} frame8;

/* Eight rays, from texels of the light, less half a texel: behind a slab, from where they leave
 * it, as if its other sides did not mirror. */
typedef struct {
  f8 x, y, qx, qy;
  frame8 at; /* on a curved surface */
} bundle;

/* A slice for each of them. */
typedef struct {
  f8 dx, dy;               /* its slopes less the ray's */
  f8 through_x, through_y; /* to where it enters the slab */
  f8 weight;
  i8 texel; /* its first */
} sight;

/* What a slice shows at a place. */
typedef struct {
  i8 texel;  /* the first of the four texels around */
  i8 fx, fy; /* how far from it, of SPLIT */
  i8 inside;
} reading;

INLINE bool is_curved(const depth_field *field) {
  return !FLAT && field->frames;
}

INLINE bool has_slab(const depth_field *field) {
  return !FLAT && field->through;
}

static __attribute__((noinline)) void load_pages(depth_field *field, const int32_t texel[LANES],
                                                 unsigned lanes) {
  field->missed |= field->shared;
  for (; lanes && !field->shared; lanes &= lanes - 1)
    depth_pages_load(&field->pages, (uint32_t)texel[__builtin_ctz(lanes)]);
}

/* Where the slice shows texel (x, y) of the light. */
INLINE reading find(const depth_field *field, const sight *s, f8 x, f8 y) {
  const depth_pages *p = &field->pages;
  reading r;
  if (!FLAT && p->wrap_u) {
    f8 round = all((float)p->u_count);
    x = choose(x < all(-0.5f), x + round, choose(x >= round - 0.5f, x - round, x));
  }
  f8 held_x = smaller(larger(x, all(0)), all((float)(p->u_count - 1)));
  f8 held_y = smaller(larger(y, all(0)), all((float)(p->v_count - 1)));
  r.inside = larger(magnitude(held_x - x), magnitude(held_y - y)) <= all(1);
  i8 i = to_int(held_x * (float)SPLIT), j = to_int(held_y * (float)SPLIT);
  r.fx = i & (SPLIT - 1), r.fy = j & (SPLIT - 1);
  /* 81 (block_u_count (j / 8) + i / 8) + 9 (j % 8) + i % 8, of whole texels */
  r.texel = s->texel + (j >> 10) * (int32_t)(PAGE_TEXELS * p->block_u_count - 8 * PAGE_ROW_TEXELS) +
            (i >> 10) * (PAGE_TEXELS - 8) + (j >> 7) * PAGE_ROW_TEXELS + (i >> 7);
  return r;
}

/* Three bytes: the weights of the left texels and of the right ones, and how far down the place is,
 * of SPLIT. */
INLINE i8 weights_of(const reading *r) {
  return r->fx * 255 + ACROSS + (r->fy << 16);
}

/* As load_codes, of pages that are brought in; by itself, so that what it needs costs nothing where
 * all pages are there. */
static __attribute__((noinline)) i8 load_codes_anew(depth_field *field,
                                                    const int32_t texel[LANES]) {
  load_pages(field, texel, (1u << LANES) - 1);
  return load_codes(field->pages.bytes, texel);
}

/* The codes of the four texels around. */
INLINE i8 codes_at(depth_field *field, const reading *r) {
  int32_t texel[LANES];
  memcpy(texel, &r->texel, sizeof texel);
  i8 codes = load_codes(field->pages.bytes, texel);
  if (__builtin_expect(mask_bits(codes == 0) != 0, 0)) codes = load_codes_anew(field, texel);
  return codes;
}

INLINE i8 nearest_code(const reading *r, i8 codes) {
  const i8 right = r->fx > SPLIT / 2, below = r->fy > SPLIT / 2;
  return pick_code(codes, (right & 1) + (below & 2));
}

/* The code of the height that is seen there. */
INLINE f8 look(depth_field *field, const reading *r) {
  const i8 codes = codes_at(field, r);
  f8 code = to_float(code_between(codes, r->fx, r->fy)) * (1.0f / ACROSS / SPLIT);
  /* Between a thing and what is behind it there is nothing. */
  f8 nearest = to_float(nearest_code(r, codes));
  return choose(range_of(codes) > EDGE_CODES, nearest, code);
}

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

/* Of weights' sums: what makes shares of them. */
INLINE f8 share_unit(f8 sum) {
  return (float)WHOLE / sum;
}

/* ---- Eight rays --------------------------------------------------------------------------------
 */

/* A hair inside the circle, as in resample.c, but n must stay well above 0 for slopes. */
#define RIM 0.9997f

static void place(const depth_field *field, uint32_t block_u, uint32_t block_v,
                  const block_directions *directions, depth_rays *rays) {
  const float s_count = (float)field->pages.s_count, t_count = (float)field->pages.t_count;
  const float *scale = field->scale;
  const f8 i_last = all(s_count > 1 ? s_count - 2 : 0), j_last = all(t_count > 1 ? t_count - 2 : 0);
  rays->x = ((float)(8 * block_u) + 0.5f) * field->texel_u - 0.5f;
  rays->y = ((float)(8 * block_v) + 0.5f) * field->texel_v - 0.5f;
  for (int row = 0; row < 64; row += LANES) {
    f8 s = 2.0f * load(directions->s + row) - 1.0f, t = 2.0f * load(directions->t + row) - 1.0f;
    s = choose(magnitude(s) < all(1e9f), s, all(0)); /* NaN too */
    t = choose(magnitude(t) < all(1e9f), t, all(0));
    f8 radius_2 = s * s + t * t;
    i8 beyond = radius_2 > all(RIM * RIM);
    if (mask_bits(beyond)) {
      f8 pull = choose(beyond, RIM / root(radius_2), all(1));
      s *= pull, t *= pull;
    }
    f8 slope = 1.0f / root(1.0f - s * s - t * t);
    store(rays->qx + row, (scale[0] * s + scale[1] * t) * slope);
    store(rays->qy + row, (scale[2] * s + scale[3] * t) * slope);
    if (has_slab(field)) {
      const slf_slab *slab = &field->slab;
      f8 inside = slab->thickness / root(slab->ior * slab->ior - s * s - t * t);
      store(rays->through_x + row, (scale[0] * s + scale[1] * t) * inside);
      store(rays->through_y + row, (scale[2] * s + scale[3] * t) * inside);
    }
    f8 i = (0.5f * s_count) * s + (0.5f * s_count - 0.5f);
    f8 j = (0.5f * t_count) * t + (0.5f * t_count - 0.5f);
    i = smaller(larger(i, all(0)), all(s_count - 1));
    j = smaller(larger(j, all(0)), all(t_count - 1));
    i8 i0 = to_int(smaller(i, i_last)), j0 = to_int(smaller(j, j_last));
    i8 cell = i0 * (int32_t)(field->pages.t_count + 1) + j0;
    memcpy(rays->cell + row, &cell, sizeof cell);
    store(rays->f + row, i - to_float(i0)), store(rays->g + row, j - to_float(j0));
    store(rays->code + row, all(-1)), store(rays->score + row, all(0));
  }
}

INLINE f8 pick(const float *of_texel, const uint8_t texels[LANES]) {
  f8 v;
  for (int l = 0; l < LANES; l++) v[l] = of_texel[texels[l]];
  return v;
}

/* Eight frames side by side, each number of theirs in a vector. */
INLINE void load_frames(const depth_frame *frames, const int32_t texel[LANES], frame8 *at) {
  enum { COUNT = sizeof(depth_frame) / sizeof(float) };
  _Static_assert(COUNT % LANES == 0, "frames are read by the vector");
#if defined(__AVX2__)
  for (int k = 0; k < COUNT; k += LANES) {
    __m256 a[LANES], b[LANES];
    for (int l = 0; l < LANES; l++)
      a[l] = _mm256_loadu_ps((const float *)(const void *)&frames[texel[l]] + k);
    for (int l = 0; l < LANES; l += 2) {
      b[l] = _mm256_unpacklo_ps(a[l], a[l + 1]);
      b[l + 1] = _mm256_unpackhi_ps(a[l], a[l + 1]);
    }
    for (int l = 0; l < LANES; l += 4)
      for (int i = 0; i < 2; i++) {
        a[l + 2 * i] = _mm256_shuffle_ps(b[l + i], b[l + 2 + i], 0x44);
        a[l + 2 * i + 1] = _mm256_shuffle_ps(b[l + i], b[l + 2 + i], 0xee);
      }
    for (int i = 0; i < 4; i++) {
      at->numbers[k + i] = _mm256_permute2f128_ps(a[i], a[i + 4], 0x20);
      at->numbers[k + i + 4] = _mm256_permute2f128_ps(a[i], a[i + 4], 0x31);
    }
  }
#else
  for (int l = 0; l < LANES; l++) {
    float of_one[COUNT];
    memcpy(of_one, &frames[texel[l]], sizeof of_one);
    for (int k = 0; k < COUNT; k++) at->numbers[k][l] = of_one[k];
  }
#endif
}

/* The texels of the light that are nearest to places, and how far from them those lie. */
typedef struct {
  int32_t texel[LANES];
  f8 e_u, e_v;
} nearest8;

INLINE nearest8 nearest_to(const depth_field *field, f8 x, f8 y) {
  const depth_pages *p = &field->pages;
  nearest8 at;
  f8 u = x + 0.5f, v = y + 0.5f;
  if (!FLAT && p->wrap_u) {
    f8 round = all((float)p->u_count);
    u = choose(u < all(0), u + round, choose(u >= round, u - round, u));
  }
  i8 i = to_int(smaller(larger(u, all(0)), all((float)p->u_count - 0.5f)));
  i8 j = to_int(smaller(larger(v, all(0)), all((float)p->v_count - 0.5f)));
  i8 number = j * (int32_t)p->u_count + i;
  memcpy(at.texel, &number, sizeof number);
  at.e_u = u - to_float(i) - 0.5f, at.e_v = v - to_float(j) - 0.5f;
  return at;
}

INLINE void prefetch_frames(const depth_frame *frames, const int32_t texel[LANES]) {
  for (int l = 0; l < LANES; l++) {
    __builtin_prefetch(&frames[texel[l]]);
    __builtin_prefetch((const char *)&frames[texel[l] + 1] - 1);
  }
}

/* The frames at texels (x, y) of the light: those of the nearest, moved on by how they change. */
static __attribute__((noinline)) void frames_at(const depth_field *field, const f8 *x, const f8 *y,
                                                frame8 *at) {
  const nearest8 nearest = nearest_to(field, *x, *y);
  const f8 e_u = nearest.e_u, e_v = nearest.e_v;
  load_frames(field->frames, nearest.texel, at);
  f8 right_u = at->across[0] * e_u + at->across[1] * e_v;
  f8 right_v = at->across[2] * e_u + at->across[3] * e_v;
  f8 tilt_u = at->bend[0] * e_u + at->bend[1] * e_v, tilt_v = at->bend[2] * e_u + at->bend[3] * e_v;
  f8 turn = at->turn[0] * e_u + at->turn[1] * e_v;
  for (int k = 0; k < 3; k++) {
    f8 n = at->normal[k], t_u = at->tangent_u[k], t_v = at->tangent_v[k];
    at->position[k] += t_u * right_u + t_v * right_v;
    at->normal[k] += t_u * tilt_u + t_v * tilt_v;
    at->tangent_u[k] += t_v * turn - n * tilt_u;
    at->tangent_v[k] -= t_u * turn + n * tilt_v;
  }
}

INLINE i8 slice_of(const depth_field *field, i8 cell, int corner) {
  return cell + (corner & 1 ? (int32_t)(field->pages.t_count + 1) : 0) + (corner >> 1);
}

/* Another slice of the cell stands in for those that do not exist, and counts for nothing. */
static __attribute__((noinline)) void stand_in(const depth_field *field, const i8 *cell, sight *s,
                                               int count) {
  i8 any = *cell;
  for (int k = 0; k < 4; k++) {
    i8 number = slice_of(field, *cell, k);
    f8 slope, other;
    gather_pairs((const float(*)[2])field->slopes, number, &slope, &other);
    i8 exists = slope == slope;
    any = (number & exists) | (any & ~exists);
  }
  for (int k = 0; k < count; k++) {
    i8 exists = s[k].dx == s[k].dx;
    s[k].texel = (s[k].texel & exists) | (any * (int32_t)field->pages.slice_texels & ~exists);
    s[k].weight = choose(exists, s[k].weight, all(0));
    s[k].dx = choose(exists, s[k].dx, all(0));
    s[k].dy = choose(exists, s[k].dy, all(0));
    s[k].through_x = choose(exists, s[k].through_x, all(0));
    s[k].through_y = choose(exists, s[k].through_y, all(0));
  }
}

/* Slices of those numbers, one for each ray. */
INLINE sight sight_of(const depth_field *field, const bundle *b, i8 number, f8 weight) {
  sight s = {.through_x = all(0),
             .through_y = all(0),
             .weight = weight,
             .texel = number * (int32_t)field->pages.slice_texels};
  gather_pairs((const float(*)[2])field->slopes, number, &s.dx, &s.dy);
  s.dx -= b->qx, s.dy -= b->qy;
  if (has_slab(field))
    gather_pairs((const float(*)[2])field->through, number, &s.through_x, &s.through_y);
  return s;
}

/* The same slice for all of them. */
INLINE sight sight_of_one(const depth_field *field, const bundle *b, int32_t number, f8 weight) {
  sight s = {.dx = all(field->slopes[number][0]) - b->qx,
             .dy = all(field->slopes[number][1]) - b->qy,
             .through_x = all(0),
             .through_y = all(0),
             .weight = weight,
             .texel = all_int(number * (int32_t)field->pages.slice_texels)};
  if (has_slab(field))
    s.through_x = all(field->through[number][0]), s.through_y = all(field->through[number][1]);
  return s;
}

/* The same, of two numbers. */
INLINE sight sight_of_two(const depth_field *field, const bundle *b, int32_t number, int32_t other,
                          i8 others, f8 weight) {
  const float *one = field->slopes[number], *two = field->slopes[other];
  const int32_t texels = (int32_t)field->pages.slice_texels;
  sight s = {.dx = choose(others, all(two[0]), all(one[0])) - b->qx,
             .dy = choose(others, all(two[1]), all(one[1])) - b->qy,
             .through_x = all(0),
             .through_y = all(0),
             .weight = weight,
             .texel = all_int(number * texels) + (others & (other - number) * texels)};
  if (has_slab(field)) {
    one = field->through[number], two = field->through[other];
    s.through_x = choose(others, all(two[0]), all(one[0]));
    s.through_y = choose(others, all(two[1]), all(one[1]));
  }
  return s;
}

/* The four slices around the rays of eight texels. */
static void look_around(const depth_field *field, const depth_rays *rays,
                        const uint8_t texels[LANES], bundle *b, sight s[4]) {
  i8 k = load_c8(texels), cell;
  b->x = rays->x + field->texel_u * to_float(k & 7);
  b->y = rays->y + field->texel_v * to_float(k >> 3);
  b->qx = pick(rays->qx, texels), b->qy = pick(rays->qy, texels);
  f8 f = pick(rays->f, texels), g = pick(rays->g, texels);
  if (has_slab(field)) b->x -= pick(rays->through_x, texels), b->y -= pick(rays->through_y, texels);
  for (int l = 0; l < LANES; l++) cell[l] = rays->cell[texels[l]];
  if (is_curved(field)) frames_at(field, &b->x, &b->y, &b->at);
  i8 missing = all_int(0);
  const bool alike = !mask_bits(cell != all_int(cell[0]));
  for (int c = 0; c < 4; c++) {
    f8 along_s = c & 1 ? f : 1.0f - f, along_t = c & 2 ? g : 1.0f - g;
    f8 weight = along_s * along_t + LEAST_WEIGHT;
    i8 number = slice_of(field, cell, c);
    s[c] = alike ? sight_of_one(field, b, number[0], weight) : sight_of(field, b, number, weight);
    missing |= s[c].dx != s[c].dx;
  }
  if (mask_bits(missing)) stand_in(field, &cell, s, 4);
}

/* In codes, of the tolerance in heights (depth_kernel.h). */
INLINE f8 tolerance(f8 code) {
  f8 left = 1.0f - code * (1.0f / 256);
  return left * (256 * TOLERANCE_UNITS * left + TOLERANCE_SHARE * code);
}

/* 1 for the same height, 0 beyond twice the tolerance. */
INLINE f8 agreement(f8 off) {
  f8 a = larger(1.0f - 0.25f * off * off, all(0));
  return a * a;
}

INLINE f8 height_of(const depth_field *field, f8 code) {
  return field->unit * code / (256.0f - code);
}

/* What a slab's side mirrors is seen on past the side as if that were not there: the ray and what a
 * slice shows have to leave on the same side of all edges, or one sees the thing and the other its
 * mirror image. */
INLINE i8 leave_alike(f8 at, f8 right, uint32_t count) {
  enum { MOST_SIDES = 1024 /* that are passed; so that truncating rounds down */ };
  const float part = 1.0f / (float)count;
  f8 left_at = (at + 0.5f) * part + (float)MOST_SIDES;
  return to_int(left_at) == to_int(left_at + right * part);
}

/* Where a slice sees, of a flat surface, what lies right_u, right_v from where the ray meets the
 * tangent plane. */
INLINE reading see_flat(const depth_field *field, const bundle *b, const sight *s, f8 right_u,
                        f8 right_v) {
  if (!has_slab(field)) return find(field, s, b->x + right_u, b->y + right_v);
  reading r = find(field, s, b->x + right_u + s->through_x, b->y + right_v + s->through_y);
  r.inside &= leave_alike(b->x, right_u, field->pages.u_count) &
              leave_alike(b->y, right_v, field->pages.v_count);
  return r;
}

/* A point in frames: along their tangents, and above them. */
typedef struct {
  f8 u, v, height;
} place8;

INLINE f8 dot(const f8 a[3], const f8 b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* How many texels on a slice's ray, of slopes (q_u, q_v), meets the point, and how much higher the
 * point is there, to first order in frames at e, of which it leaves along -q + turn . e (q_v, -q_u)
 * + bend e in the tangent plane and rises by 1 + q . bend e: (across + h (bend + (q_v, -q_u) turn +
 * q (q . bend))) e = point + h q. */
INLINE void step_to(const frame8 *at, const place8 *point, f8 q_u, f8 q_v, f8 *e_u, f8 *e_v,
                    f8 *rise) {
  const f8 *p = at->across, *n = at->bend, *w = at->turn, h = point->height;
  f8 right_u = point->u + h * q_u, right_v = point->v + h * q_v;
  f8 rise_u = q_u * n[0] + q_v * n[2], rise_v = q_u * n[1] + q_v * n[3];
  f8 uu = p[0] + h * (n[0] + q_v * w[0] + q_u * rise_u),
     uv = p[1] + h * (n[1] + q_v * w[1] + q_u * rise_v);
  f8 vu = p[2] + h * (n[2] - q_u * w[0] + q_v * rise_u),
     vv = p[3] + h * (n[3] - q_u * w[1] + q_v * rise_v);
  f8 scale = 1.0f / (uu * vv - uv * vu);
  *e_u = (right_u * vv - right_v * uv) * scale, *e_v = (uu * right_v - vu * right_u) * scale;
  f8 shorten =
      (float)LONGEST_STEP / larger(larger(magnitude(*e_u), magnitude(*e_v)), all(LONGEST_STEP));
  *e_u *= shorten, *e_v *= shorten;
  *rise = (n[0] * *e_u + n[1] * *e_v) * point->u + (n[2] * *e_u + n[3] * *e_v) * point->v;
}

/* A search for where a slice sees a point. */
typedef struct {
  f8 q_u, q_v, x, y, expected;
  i8 moving;
  nearest8 nearest;
} meeting;

/* On from frames at texels (x, y), in which the point is at `at`. */
INLINE void step_meeting(meeting *m, const frame8 *frames, f8 x, f8 y, const place8 *at) {
  f8 e_u, e_v, rise;
  step_to(frames, at, m->q_u, m->q_v, &e_u, &e_v, &rise);
  x += e_u, y += e_v;
  f8 moved = larger(magnitude(x - m->x), magnitude(y - m->y));
  m->x = choose(m->moving, x, m->x), m->y = choose(m->moving, y, m->y);
  m->expected = at->height + rise;
  m->moving = ~(moved < all(SETTLED_TEXELS));
}

INLINE place8 place_in(const frame8 *frames, const f8 point[3]) {
  f8 off[3];
  for (int k = 0; k < 3; k++) off[k] = point[k] - frames->position[k];
  return (place8){dot(off, frames->tangent_u), dot(off, frames->tangent_v),
                  dot(off, frames->normal)};
}

/* The same from texel to texel, by Newton's method: what one slice sees through a ripple lies
 * beyond the next one's. Of all slices at once, so that the frames that one needs come while others
 * step. */
static __attribute__((noinline)) void see_curved(const depth_field *field, const bundle *b,
                                                 const sight *s, int count, const f8 *height,
                                                 f8 *expected, reading *at) {
  const place8 begin = {-*height * b->qx, -*height * b->qy, *height};
  meeting meetings[4];
  f8 point[3];
  unsigned going = 0;
  for (int k = 0; k < 3; k++)
    point[k] = b->at.position[k] + begin.u * b->at.tangent_u[k] + begin.v * b->at.tangent_v[k] +
               begin.height * b->at.normal[k];
  for (int k = 0; k < count; k++) {
    meeting *m = &meetings[k];
    m->q_u = b->qx + s[k].dx, m->q_v = b->qy + s[k].dy;
    m->x = b->x, m->y = b->y, m->moving = all_int(-1);
    step_meeting(m, &b->at, b->x, b->y, &begin);
    going |= (unsigned)(mask_bits(m->moving) != 0) << k;
  }
  for (int i = 0; i < MEET_STEPS && going; i++) {
    for (unsigned left = going; left; left &= left - 1) {
      meeting *m = &meetings[__builtin_ctz(left)];
      m->nearest = nearest_to(field, m->x, m->y);
      prefetch_frames(field->frames, m->nearest.texel);
    }
    for (unsigned left = going; left; left &= left - 1) {
      meeting *m = &meetings[__builtin_ctz(left)];
      frame8 next;
      load_frames(field->frames, m->nearest.texel, &next);
      const place8 there = place_in(&next, point);
      step_meeting(m, &next, m->x - m->nearest.e_u, m->y - m->nearest.e_v, &there);
      if (!mask_bits(m->moving)) going ^= left & -left;
    }
  }
  for (int k = 0; k < count; k++) {
    const meeting *m = &meetings[k];
    f8 there = larger(m->expected, all(0));
    expected[k] = 256.0f * there / (field->unit + there);
    at[k] = find(field, &s[k], m->x, m->y);
    at[k].inside &= ~m->moving;
  }
}

/* Where slices see what the ray meets at a height, and the codes that they should see there. */
INLINE void see(const depth_field *field, const bundle *b, const sight *s, int count, f8 code,
                f8 *expected, reading *at) {
  const f8 h = height_of(field, code);
  if (is_curved(field)) {
    see_curved(field, b, s, count, &h, expected, at);
    return;
  }
  for (int k = 0; k < count; k++) {
    at[k] = see_flat(field, b, &s[k], h * s[k].dx, h * s[k].dy);
    expected[k] = code;
  }
}

/* What a slice sees there, less what it should. */
INLINE f8 look_from(depth_field *field, const bundle *b, const sight *s, f8 code, reading *at) {
  f8 expected;
  see(field, b, s, 1, code, &expected, at);
  return look(field, at) - expected;
}

/* What a slice says of a height: the weight with which it sees a thing there, and the score, less
 * than 0 where it looks through it. */
INLINE f8 witness(const sight *s, f8 off, f8 scale, i8 inside, f8 *score) {
  f8 weight = choose(inside, s->weight, all(0)), agreeing = weight * agreement(off * scale);
  *score = choose(off * scale > all(2), -weight, agreeing);
  return agreeing;
}

/* What the four slices around say of a height in each lane. */
typedef struct {
  f8 code;
  f8 score;  /* weight of those that see a thing there, less that of those that look through it */
  f8 agreed; /* weight of the former */
  f8 weight[4];
  reading at[4];
} verdict;

static void judge(depth_field *field, const bundle *b, const sight s[4], const f8 *code,
                  verdict *v) {
  f8 scale = 1.0f / tolerance(*code), score, seeing = all(0), expected[4];
  v->code = *code, v->score = all(0), v->agreed = all(0);
  see(field, b, s, 4, *code, expected, v->at);
  for (int k = 0; k < 4; k++) {
    f8 off = look(field, &v->at[k]) - expected[k];
    v->weight[k] = witness(&s[k], off, scale, v->at[k].inside, &score);
    v->agreed += v->weight[k], v->score += score;
    seeing += choose(v->at[k].inside, s[k].weight, all(0));
  }
  v->score /= larger(seeing, all(LEAST_SEEING));
}

INLINE i8 choose_int(i8 mask, i8 a, i8 b) {
  return (a & mask) | (b & ~mask);
}

/* Takes b's lanes of the mask over into a. */
static void take(verdict *a, const verdict *b, const i8 *mask) {
  a->code = choose(*mask, b->code, a->code);
  a->agreed = choose(*mask, b->agreed, a->agreed);
  a->score = choose(*mask, b->score, a->score);
  for (int k = 0; k < 4; k++) {
    a->weight[k] = choose(*mask, b->weight[k], a->weight[k]);
    a->at[k].fx = choose_int(*mask, b->at[k].fx, a->at[k].fx);
    a->at[k].fy = choose_int(*mask, b->at[k].fy, a->at[k].fy);
    a->at[k].texel = choose_int(*mask, b->at[k].texel, a->at[k].texel);
  }
}

/* ---- Mixing ------------------------------------------------------------------------------------
 */

static __attribute__((noinline)) void read_anew(depth_field *field, const int32_t texel[LANES],
                                                const i8 *weights, unsigned lanes, sample *r) {
  load_pages(field, texel, lanes);
  *r = read(field->pages.bytes, texel, *weights);
}

/* Adds what is read, of pages that are brought in where they are missing. */
INLINE void add_light(depth_field *field, const reading *at, f8 share, sample *sum) {
  int32_t texel[LANES];
  const i8 weights = weights_of(at);
  memcpy(texel, &at->texel, sizeof texel);
  sample r = read(field->pages.bytes, texel, weights);
  if (__builtin_expect(mask_bits(heights_of(&r) == 0) != 0, 0)) {
    sample anew;
    read_anew(field, texel, &weights, (1u << LANES) - 1, &anew);
    r = anew;
  }
  add(sum, &r, to_int(share));
}

/* The bilinear weights of the four texels around, a byte each; they add up to ACROSS. */
INLINE i8 four_weights(const reading *r) {
  i8 left = ACROSS - r->fx, left_below = left * r->fy >> 7, right_below = r->fx * r->fy >> 7;
  return (left - left_below) | (r->fx - right_below) << 8 | left_below << 16 | right_below << 24;
}

/* Of those weights the ones of texels that see the same thing as the nearest does: what is behind
 * its edge must not shine through, nor it over that. */
INLINE i8 weights_of_one(depth_field *field, const reading *r) {
  const i8 codes = codes_at(field, r), nearest = nearest_code(r, codes);
  const i8 from = bytes_from(codes, higher(nearest - EDGE_CODES, all_int(0)));
  const i8 to = bytes_from(~codes, higher(255 - nearest - EDGE_CODES, all_int(0)));
  return four_weights(r) & from & to;
}

/* The sum of the four weights of each lane. */
INLINE f8 sum_of_four(i8 weights) {
  return to_float(weigh(all_int(0x01010101), weights));
}

/* Adds the roots of what a reading shows by weights of its texels. */
INLINE void add_reading(const depth_field *field, const reading *at, i8 weights, f8 factor,
                        sample *sum) {
  int32_t texel[LANES];
  memcpy(texel, &at->texel, sizeof texel);
  add_roots(sum, field->pages.bytes, texel, weights, to_int(smaller(factor, all(WHOLE))));
}

/* Of the total of all weights, of slices and of texels: what roots are added by. */
INLINE f8 root_unit(f8 total) {
  return (float)(ACROSS * ONCE) / larger(total, all(1e-3f));
}

/* What the slices that agree show of one thing. */
INLINE sample light_of_one(depth_field *field, const verdict *v) {
  sample sum = {{{0}}};
  i8 weights[4];
  f8 total = all(0);
  for (int k = 0; k < 4; k++) {
    weights[k] = weights_of_one(field, &v->at[k]);
    total += v->weight[k] * sum_of_four(weights[k]);
  }
  const f8 unit = root_unit(total);
  for (int k = 0; k < 4; k++) add_reading(field, &v->at[k], weights[k], v->weight[k] * unit, &sum);
  square(&sum, all_int(WHOLE));
  return sum;
}

/* Keeps what lanes of the mask were mixed from, the first one of each texel; returns their
 * texels. */
static uint64_t keep(depth_rays *rays, const depth_guess *guess, const verdict *v,
                     const sample *sum, unsigned mask) {
  float codes[LANES], scores[LANES];
  uint16_t rgba[LANES][4];
  uint64_t mixed = 0;
  put(sum, rgba);
  store(codes, v->code), store(scores, v->score);
  for (mask &= (1u << guess->count) - 1; mask; mask &= mask - 1) {
    int l = __builtin_ctz(mask);
    uint8_t k = guess->texels[l];
    if (mixed >> k & 1) continue;
    mixed |= 1ull << k;
    rays->code[k] = codes[l], rays->score[k] = scores[l];
    memcpy(rays->rgba[k], rgba[l], sizeof rgba[l]);
  }
  return mixed;
}

/* Mixes the lanes of the mask, the first one of each texel; returns their texels. */
static uint64_t write(depth_field *field, depth_rays *rays, const depth_guess *guess,
                      const verdict *v, unsigned mask) {
  if (!(mask & ((1u << guess->count) - 1))) return 0;
  const sample light = light_of_one(field, v);
  return keep(rays, guess, v, &light, mask);
}

/* From a guess to the height on which the ray and what a slice sees meet, by a secant; what is seen
 * there where there is an edge. Settled lanes are there already. */
static f8 meet(depth_field *field, const bundle *b, const sight *s, f8 guess) {
  reading at;
  f8 off = look_from(field, b, s, guess, &at);
  i8 settled = magnitude(off) < 0.2f * tolerance(guess);
  if (!mask_bits(~settled)) return guess;
  f8 next = smaller(larger(guess + off, all(0)), all(255)), step = next - guess;
  f8 next_off = look_from(field, b, s, next, &at), fall = off - next_off;
  i8 steady = (magnitude(fall) > 0.25f * magnitude(step)) & (magnitude(next_off) < all(EDGE_CODES));
  f8 code = choose(steady, guess + off * step / choose(steady, fall, all(1)), next + next_off);
  code = smaller(larger(code, all(0)), all(255));
  return choose(settled, guess, code);
}

static uint64_t mix(depth_field *field, depth_rays *rays, const depth_guess *guess_of) {
  const f8 guess = load(guess_of->codes), wanted = load(guess_of->wanted);
  bundle b;
  sight s[4];
  verdict v;
  look_around(field, rays, guess_of->texels, &b, s);
  /* The heaviest slice looks most nearly along the ray. */
  sight first = s[0];
  for (int k = 1; k < 4; k++) {
    i8 heavier = s[k].weight > first.weight;
    first.dx = choose(heavier, s[k].dx, first.dx), first.dy = choose(heavier, s[k].dy, first.dy);
    first.through_x = choose(heavier, s[k].through_x, first.through_x);
    first.through_y = choose(heavier, s[k].through_y, first.through_y);
    first.weight = choose(heavier, s[k].weight, first.weight);
    first.texel = choose_int(heavier, s[k].texel, first.texel);
  }
  f8 code = meet(field, &b, &first, guess);
  /* It may see something else than the ray does. */
  code = choose(magnitude(code - guess) < 4.0f * tolerance(guess), code, guess);
  judge(field, &b, s, &code, &v);
  i8 good = v.score > wanted;
  if (mask_bits(~good & (magnitude(code - guess) > MOVED_SHARE * tolerance(guess)))) {
    verdict unmoved;
    judge(field, &b, s, &guess, &unmoved);
    i8 better = ~good & (unmoved.score > v.score);
    take(&v, &unmoved, &better);
    good = v.score > wanted;
  }
  v.score = larger(v.score, wanted + SCORE_SLACK);
  return write(field, rays, guess_of, &v, mask_bits(good));
}

/* The paper's mix, at the texels themselves. */
static void mix_four_tap(depth_field *field, depth_rays *rays, const depth_guess *guess) {
  bundle b;
  sight s[4];
  const verdict none = {.code = all(0), .score = all(0)};
  sample sum = {{{0}}};
  f8 total = all(0);
  look_around(field, rays, guess->texels, &b, s);
  if (has_slab(field))
    b.x += pick(rays->through_x, guess->texels), b.y += pick(rays->through_y, guess->texels);
  for (int k = 0; k < 4; k++) total += s[k].weight;
  for (int k = 0; k < 4; k++) {
    const reading at = find(field, &s[k], b.x, b.y);
    add_light(field, &at, s[k].weight * share_unit(total), &sum);
  }
  keep(rays, guess, &none, &sum, (1u << LANES) - 1);
}

/* ---- Without a guess ---------------------------------------------------------------------------
 */

/* Where the ray and what a slice sees meet: along the ray the point at height h is seen at p + h d.
 * As long as the slice sees something higher there, the point is in the open; where it sees
 * something lower, the point is behind that. From the open to behind in a step without an edge is a
 * hit. Codes, below 0 for none. */
static f8 follow(depth_field *field, const bundle *b, const sight *s) {
  f8 d = larger(larger(magnitude(s->dx), magnitude(s->dy)), all(1e-3f));
  f8 step = (float)STEP_TEXELS / d, h = all(0), met = all(-1), last_open = all(1),
     last_code = all(0);
  i8 going = ((float)MAX_STEPS * step >= LEAST_REACH * field->unit) & (s->weight >= LEAST_WITNESS);
  i8 hidden = all_int(0); /* steps since it was in the open */
  for (int i = 0; i < MAX_STEPS && mask_bits(going); i++) {
    reading at = see_flat(field, b, s, h * s->dx, h * s->dy);
    f8 code = look(field, &at), seen = height_of(field, code), open = seen - h;
    i8 hit =
        (open <= all(0)) & (last_open > all(0)) & (magnitude(code - last_code) <= all(EDGE_CODES));
    f8 there = h - step * open / (open - last_open);
    if (i == 0) hit = open <= all(0), there = seen;
    /* Slices that look almost along the ray see what it meets at once. */
    i8 close = ~hit & (d * magnitude(open) < all(0.5f));
    going &= at.inside;
    met = choose(going & (hit | close), choose(hit, there, seen), met);
    hidden = (hidden + 1) & (open <= all(0));
    going &= ~(hit | close) & (hidden < MAX_HIDDEN_STEPS);
    last_open = open, last_code = code, h += step;
  }
  return choose(met < all(0), all(-1), 256.0f * met / (field->unit + met));
}

/* On a curved surface slices see the same thing close to each other: from what the slice sees at
 * the texel itself. */
static f8 follow_curved(depth_field *field, const bundle *b, const sight *s) {
  f8 code = all(0), met = all(-1);
  i8 going = s->weight > all(0);
  for (int i = 0; i <= CURVED_STEPS && mask_bits(going); i++) {
    reading at;
    f8 off = look_from(field, b, s, code, &at);
    going &= at.inside;
    i8 there = going & (magnitude(off) < 0.3f * tolerance(code));
    if (i > 0) met = choose(there, code, met), going &= ~there;
    going &= code + off >= all(0);
    code = smaller(larger(code + off, all(0)), all(255));
  }
  return met;
}

INLINE f8 follow_any(depth_field *field, const bundle *b, const sight *s) {
  return is_curved(field) ? follow_curved(field, b, s) : follow(field, b, s);
}

/* The lowest height that the slices see a thing at, by a share of what the best is judged, which is
 * the score. What is behind a thing may be in sight of all slices around, past it on every side. */
static uint64_t seek(depth_field *field, depth_rays *rays, const depth_guess *guess,
                     unsigned slices) {
  bundle b;
  sight s[4];
  verdict v[5], lowest;
  const f8 known = load(guess->codes);
  f8 best = all(0);
  int count = 0;
  look_around(field, rays, guess->texels, &b, s);
  for (int k = 0; k <= 4; k++) {
    if (!(slices >> k & 1)) continue;
    f8 code = k < 4 ? follow_any(field, &b, &s[k]) : known;
    for (int l = 0; l < LANES && k < 4; l++) rays->met[guess->texels[l]][k] = code[l];
    i8 none = code < all(0);
    code = larger(code, all(0));
    verdict *now = &v[count++];
    judge(field, &b, s, &code, now);
    now->score = choose(none, all(-1), now->score);
    best = larger(best, now->score);
  }
  lowest = v[0];
  lowest.code = all(256);
  for (int k = 0; k < count; k++) {
    i8 lower = (v[k].score >= LOWER_SHARE * best) & (v[k].code < lowest.code);
    take(&lowest, &v[k], &lower);
  }
  lowest.score = best;
  i8 good = (best >= load(guess->wanted)) & (lowest.agreed > all(1e-5f));
  return write(field, rays, guess, &lowest, mask_bits(good));
}

/* ---- One texel and many slices -----------------------------------------------------------------
 */

/* A ray in all lanes, and a slice in each: lanes beyond the count repeat one, without weight. */
enum { MOST_SIGHTS = 16 };
typedef struct {
  bundle b;
  sight s[MOST_SIGHTS / LANES];
  int group_count;
  f8 weight[MOST_SIGHTS / LANES]; /* with which each sees the height judged last */
  reading at[MOST_SIGHTS / LANES];
  float moved; /* as in view */
} fan;

/* Where they lie in the cells of (S,T), along S and along T, and how much narrower than two cells
 * their tents are: the four around, the corners of sixteen, and the others. */
static const f8 fan_places[MOST_SIGHTS / LANES][3] = {
    {{0, 1, 0, 1, -1, 2, -1, 2}, {0, 0, 1, 1, -1, -1, 2, 2}, {1, 1, 1, 1, 0.5f, 0.5f, 0.5f, 0.5f}},
    {{0, 1, -1, 2, -1, 2, 0, 1},
     {-1, -1, 0, 0, 1, 1, 2, 2},
     {0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f}}};

/* The slices within `reach` of the ray, the four around weighed as they are, those beyond by a tent
 * twice as wide. One that exists stands in for those that do not, and counts for nothing. */
static void open_fan(const depth_field *field, const depth_rays *rays, uint32_t texel, int reach,
                     fan *a) {
  const int32_t s_count = (int32_t)field->pages.s_count, t_count = (int32_t)field->pages.t_count;
  const int32_t cell = rays->cell[texel], i0 = cell / (t_count + 1), j0 = cell % (t_count + 1);
  i8 number[MOST_SIGHTS / LANES], exists[MOST_SIGHTS / LANES];
  int32_t any = 0;
  a->group_count = reach == 1 ? 1 : MOST_SIGHTS / LANES;
  a->b.x = all(rays->x + field->texel_u * (float)(texel % 8));
  a->b.y = all(rays->y + field->texel_v * (float)(texel / 8));
  a->b.qx = all(rays->qx[texel]), a->b.qy = all(rays->qy[texel]);
  if (has_slab(field)) a->b.x -= rays->through_x[texel], a->b.y -= rays->through_y[texel];
  if (is_curved(field)) frames_at(field, &a->b.x, &a->b.y, &a->b.at);
  for (int g = 0; g < a->group_count; g++) {
    const f8 *at = fan_places[g], narrow = at[2];
    i8 i = i0 + to_int(at[0]), j = j0 + to_int(at[1]);
    exists[g] = (i >= 0) & (j >= 0) & (i < s_count) & (j < t_count);
    if (reach == 1) exists[g] &= narrow == all(1);
    number[g] = (i * (t_count + 1) + j) & exists[g];
    f8 along_s = larger(1.0f - narrow * magnitude(at[0] - rays->f[texel]), all(0));
    f8 along_t = larger(1.0f - narrow * magnitude(at[1] - rays->g[texel]), all(0));
    a->s[g] = sight_of(field, &a->b, number[g], along_s * along_t * narrow + LEAST_WEIGHT);
    exists[g] &= a->s[g].dx == a->s[g].dx;
    const unsigned some = mask_bits(exists[g]);
    if (some) any = number[g][__builtin_ctz(some)];
  }
  for (int g = 0; g < a->group_count; g++) {
    sight *s = &a->s[g];
    if (!mask_bits(~exists[g])) continue;
    const sight other = sight_of_one(field, &a->b, any, all(0));
    s->dx = choose(exists[g], s->dx, other.dx), s->dy = choose(exists[g], s->dy, other.dy);
    s->through_x = choose(exists[g], s->through_x, other.through_x);
    s->through_y = choose(exists[g], s->through_y, other.through_y);
    s->weight = choose(exists[g], s->weight, all(0));
    s->texel = (s->texel & exists[g]) | (other.texel & ~exists[g]);
  }
}

INLINE float sum_of(f8 v) {
  return ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7]));
}

static float judge_fan(depth_field *field, fan *a, float code) {
  f8 scale = 1.0f / tolerance(all(code)), sum = all(0), moved = all(0), near = all(0), score;
  f8 expected[MOST_SIGHTS / LANES];
  see(field, &a->b, a->s, a->group_count, all(code), expected, a->at);
  for (int g = 0; g < a->group_count; g++) {
    f8 off = look(field, &a->at[g]) - expected[g];
    a->weight[g] = witness(&a->s[g], off, scale, a->at[g].inside, &score);
    sum += score;
    f8 weight = choose((magnitude(off * scale) < all(4)) & a->at[g].inside, a->s[g].weight, all(0));
    moved += weight * off, near += weight;
  }
  a->moved = sum_of(moved) / (sum_of(near) + 1e-6f);
  return sum_of(sum);
}

/* Brings the sum over all lanes to the first. */
INLINE void join_lanes(sample *sum) {
  w16 v = sum->half[0] + sum->half[1];
  v += __builtin_shufflevector(v, v, 8, 9, 10, 11, 12, 13, 14, 15, 8, 9, 10, 11, 12, 13, 14, 15);
  v += __builtin_shufflevector(v, v, 4, 5, 6, 7, 4, 5, 6, 7, 4, 5, 6, 7, 4, 5, 6, 7);
  sum->half[0] = v;
}

/* Mixes where the slices see the height judged last. */
static bool mix_fan(depth_field *field, const fan *a, depth_rays *rays, uint32_t texel, float code,
                    float score) {
  sample sum = {{{0}}};
  uint16_t of_lanes[LANES][4];
  i8 weights[MOST_SIGHTS / LANES];
  f8 weight = all(0), total = all(0);
  for (int g = 0; g < a->group_count; g++) weight += a->weight[g];
  if (!(sum_of(weight) > 1e-5f)) return false;
  for (int g = 0; g < a->group_count; g++) {
    weights[g] = weights_of_one(field, &a->at[g]);
    total += a->weight[g] * sum_of_four(weights[g]);
  }
  const f8 unit = root_unit(all(sum_of(total)));
  for (int g = 0; g < a->group_count; g++)
    add_reading(field, &a->at[g], weights[g], a->weight[g] * unit, &sum);
  join_lanes(&sum);
  square(&sum, all_int(WHOLE));
  put(&sum, of_lanes);
  memcpy(rays->rgba[texel], of_lanes[0], sizeof of_lanes[0]);
  rays->code[texel] = code, rays->score[texel] = score;
  return true;
}

static bool mix_wide(depth_field *field, depth_rays *rays, uint32_t texel, float code,
                     float wanted) {
  fan a;
  open_fan(field, rays, texel, 2, &a);
  float score = judge_fan(field, &a, code);
  if (fabsf(a.moved) > MOVED_SHARE * tolerance(all(code))[0]) {
    code += a.moved;
    code = code < 0 ? 0 : code > 255 ? 255 : code;
    score = judge_fan(field, &a, code);
  }
  return score > wanted && mix_fan(field, &a, rays, texel, code, score);
}

static bool seek_alone(depth_field *field, depth_rays *rays, uint32_t texel, int reach,
                       float wanted) {
  fan a;
  float heights[MOST_SIGHTS], codes[MOST_SIGHTS], scores[MOST_SIGHTS], best = -1, lowest = 256;
  int count = 0;
  open_fan(field, rays, texel, reach, &a);
  if (reach == 1) {
    store(heights, follow_any(field, &a.b, &a.s[0]));
    memcpy(rays->met[texel], heights, sizeof rays->met[texel]);
  } else {
    store(heights, all(-1));
    memcpy(heights, rays->met[texel], sizeof rays->met[texel]);
    store(heights + LANES, follow_any(field, &a.b, &a.s[1]));
  }
  for (int l = 0; l < LANES * a.group_count; l++) {
    bool known = heights[l] < 0;
    const float near = 0.3f * tolerance(all(heights[l]))[0];
    for (int i = 0; i < count && !known; i++) known = fabsf(codes[i] - heights[l]) < near;
    if (known) continue;
    codes[count] = heights[l];
    scores[count] = judge_fan(field, &a, heights[l]);
    if (scores[count] > best) best = scores[count];
    count++;
  }
  if (!(best >= wanted)) return false;
  for (int i = 0; i < count; i++)
    if (scores[i] >= LOWER_SHARE * best && codes[i] < lowest) lowest = codes[i];
  judge_fan(field, &a, lowest);
  return mix_fan(field, &a, rays, texel, lowest, best);
}

/* ---- Where heights go on as they were ----------------------------------------------------------
 */

/* The rays of a row, and the three slices at the corners of the half of its cell that each lies in:
 * three are read in three quarters of the time of four, and go over into each other as smoothly. */
INLINE void look_along(const depth_field *field, const depth_rays *rays, int row, bundle *b,
                       sight s[3]) {
  const i8 columns = {0, 1, 2, 3, 4, 5, 6, 7};
  const int32_t column = (int32_t)(field->pages.t_count + 1);
  i8 cell, missing;
  b->x = rays->x + field->texel_u * to_float(columns);
  b->y = all(rays->y + field->texel_v * (float)row);
  b->qx = load(rays->qx + 8 * row), b->qy = load(rays->qy + 8 * row);
  if (has_slab(field))
    b->x -= load(rays->through_x + 8 * row), b->y -= load(rays->through_y + 8 * row);
  f8 f = load(rays->f + 8 * row), g = load(rays->g + 8 * row), left = 1.0f - f - g;
  memcpy(&cell, rays->cell + 8 * row, sizeof cell);
  if (is_curved(field)) frames_at(field, &b->x, &b->y, &b->at);
  i8 beyond = left < all(0);
  f8 along_s = choose(beyond, 1.0f - g, f) + LEAST_WEIGHT;
  f8 along_t = choose(beyond, 1.0f - f, g) + LEAST_WEIGHT;
  f8 corner = magnitude(left) + LEAST_WEIGHT;
  const int32_t first = cell[0];
  if (!mask_bits(cell != all_int(first))) {
    s[0] = sight_of_one(field, b, first + column, along_s);
    s[1] = sight_of_one(field, b, first + 1, along_t);
    s[2] = sight_of_two(field, b, first, first + column + 1, beyond, corner);
  } else {
    s[0] = sight_of(field, b, cell + column, along_s);
    s[1] = sight_of(field, b, cell + 1, along_t);
    s[2] = sight_of(field, b, cell + (beyond & (column + 1)), corner);
  }
  missing = (s[0].dx != s[0].dx) | (s[1].dx != s[1].dx) | (s[2].dx != s[2].dx);
  if (mask_bits(missing)) stand_in(field, &cell, s, 3);
}

INLINE i8 lanes_of(unsigned bits) {
  const i8 lanes = {1, 2, 4, 8, 16, 32, 64, 128};
  return (all_int((int32_t)bits) & lanes) == lanes;
}

/* Where a slice should see a height. */
typedef struct {
  int32_t texel[LANES];
  i8 weights;
  f8 weight, expected; /* of the slice, 0 beyond the surface */
} aim;

/* Where the texels of a row are looked for, in the three slices that their directions lie between.
 * What is made of each slice is written out one by one, not in loops: it stays in registers. */
typedef struct {
  int row;
  unsigned lanes; /* that count */
  f8 code, wanted;
  aim at[3];
} row_aim;

INLINE void aim_at(const depth_field *field, const sight *s, const reading *r, f8 expected,
                   aim *a) {
  memcpy(a->texel, &r->texel, sizeof a->texel);
  a->weights = weights_of(r);
  for (int l = 0; l < LANES; l += 2) /* the next one's lie beside them */
    __builtin_prefetch(field->pages.bytes + 4 * (size_t)(uint32_t)a->texel[l] + 20);
  a->weight = choose(r->inside, s->weight, all(0));
  if (!FLAT) a->expected = expected;
}

INLINE void aim_row(const depth_field *field, const depth_rays *rays, row_aim *a) {
  bundle b;
  sight s[3];
  reading at[3];
  f8 expected[3];
  look_along(field, rays, a->row, &b, s);
  see(field, &b, s, 3, a->code, expected, at);
  aim_at(field, &s[0], &at[0], expected[0], &a->at[0]);
  aim_at(field, &s[1], &at[1], expected[1], &a->at[1]);
  aim_at(field, &s[2], &at[2], expected[2], &a->at[2]);
}

/* What they show there. */
typedef struct {
  sample of[3];
  f8 weight[3];     /* with which each sees it there */
  f8 agreed, score; /* as in verdict */
  f8 moved;         /* mean of the codes seen less those expected: the slices' directions lie around
                       the ray's, so that it leads to what they see, right to first order wherever
                       along the ray they look */
} view;

INLINE void witness_row(const aim *a, const sample *r, f8 code, f8 scale, f8 *weight, view *v,
                        f8 *against) {
  f8 off = to_float(heights_of(r)) * CODE_UNIT - (FLAT ? code : a->expected);
  f8 scaled = off * scale;
  *weight = a->weight * agreement(scaled);
  v->moved += *weight * off;
  v->agreed += *weight;
  *against += choose(scaled > 2.0f, a->weight, all(0));
}

INLINE void read_row(depth_field *field, const row_aim *a, view *v) {
  const uint8_t *bytes = field->pages.bytes;
  const f8 scale = 1.0f / tolerance(a->code);
  f8 against = all(0);
  v->of[0] = read(bytes, a->at[0].texel, a->at[0].weights);
  v->of[1] = read(bytes, a->at[1].texel, a->at[1].weights);
  v->of[2] = read(bytes, a->at[2].texel, a->at[2].weights);
  i8 missing =
      (heights_of(&v->of[0]) == 0) | (heights_of(&v->of[1]) == 0) | (heights_of(&v->of[2]) == 0);
  if (__builtin_expect((mask_bits(missing) & a->lanes) != 0, 0))
    for (int k = 0; k < 3; k++)
      read_anew(field, a->at[k].texel, &a->at[k].weights, a->lanes, &v->of[k]);
  v->agreed = all(1e-6f), v->moved = all(0);
  witness_row(&a->at[0], &v->of[0], a->code, scale, &v->weight[0], v, &against);
  witness_row(&a->at[1], &v->of[1], a->code, scale, &v->weight[1], v, &against);
  witness_row(&a->at[2], &v->of[2], a->code, scale, &v->weight[2], v, &against);
  const f8 seeing = larger(a->at[0].weight + a->at[1].weight + a->at[2].weight, all(LEAST_SEEING));
  const f8 part = 1.0f / (v->agreed * seeing); /* one division for two */
  v->moved *= seeing * part, v->score = (v->agreed - against) * (v->agreed * part);
}

/* The whole row is written: what else is in it is mixed afterwards. Where what is good has moved,
 * it is read once more. */
INLINE unsigned mix_row(depth_field *field, depth_rays *rays, row_aim *a) {
  view v;
  sample sum = {{{0}}};
  read_row(field, a, &v);
  i8 moved = (magnitude(v.moved) > MOVED_SHARE * tolerance(a->code)) & (v.score > a->wanted);
  if (mask_bits(moved) & a->lanes) {
    a->code = smaller(larger(a->code + v.moved, all(0)), all(255));
    aim_row(field, rays, a);
    read_row(field, a, &v);
  }
  const f8 unit = share_unit(v.agreed);
  add(&sum, &v.of[0], to_int(v.weight[0] * unit));
  add(&sum, &v.of[1], to_int(v.weight[1] * unit));
  add(&sum, &v.of[2], to_int(v.weight[2] * unit));
  put(&sum, rays->rgba + 8 * a->row);
  store(rays->code + 8 * a->row, smaller(larger(a->code + v.moved, all(0)), all(255)));
  store(rays->score + 8 * a->row, larger(v.score, a->wanted + SCORE_SLACK));
  return mask_bits(v.score > a->wanted) & a->lanes;
}

static uint64_t mix_steady(depth_field *field, depth_rays *rays, const depth_memory *last,
                           uint64_t steady) {
  row_aim aims[8];
  int count = 0;
  uint64_t mixed = 0;
  for (int row = 0; row < 8; row++) {
    row_aim *a = &aims[count];
    if (!(a->lanes = steady >> 8 * row & 0xff)) continue;
    f8 score = 0.01f * to_float(load_c8(last->score + 8 * row));
    a->row = row;
    a->code = to_float(load_u16(last->code + 8 * row)) * (1.0f / 256);
    a->wanted = smaller(larger(score - SCORE_SLACK, all(LEAST_NEAR)), all(ALL_AGREE));
    aim_row(field, rays, a);
    count++;
  }
  for (int i = 0; i < count; i++)
    mixed |= (uint64_t)mix_row(field, rays, &aims[i]) << 8 * aims[i].row;
  return mixed;
}

/* ---- Outlines ----------------------------------------------------------------------------------
 */

/* What slices show of a thing in front: the weights of those of their texels that see it. */
typedef struct {
  reading at[4];
  i8 weights[4];
  f8 say[4];
  f8 seen, passed; /* sums of weights, of texels that see it and of those that see past it, */
  f8 covered;      /* and of as much of either as it covers */
  f8 moved;        /* mean of the codes seen less those expected */
} front;

/* Four coverages (slf.h), of a texel, its right neighbour and the two below, in a number. */
INLINE i8 coverages_at(const depth_field *field, const sight *s, const reading *r) {
  const uint8_t *bytes = field->pages.bytes + field->pages.coverage_offset;
  i8 four;
  for (int l = 0; l < LANES; l++) {
    const uint8_t *upper = bytes + 3 * (size_t)(uint32_t)s->texel[l] + (uint32_t)r->texel[l];
    const uint8_t *below = upper + PAGE_ROW_TEXELS;
    const uint32_t codes =
        upper[0] | (uint32_t)upper[1] << 8 | (uint32_t)below[0] << 16 | (uint32_t)below[1] << 24;
    four[l] = (int32_t)codes;
  }
  return four;
}

/* How much of each texel the thing covers, of SLF_COVERED_BY_NONE: of those near its height all but
 * what shows higher things, of those further away what shows lower ones. */
INLINE i8 covered_by(i8 coverages, i8 near, i8 far) {
  const b32 codes = (b32)coverages;
  const b32 is_over = (b32)(codes > SLF_COVERED_BY_NONE);
  const b32 of_near = (codes & ~is_over) | (SLF_COVERED_BY_NONE & is_over);
  const b32 of_far = (codes - SLF_COVERED_BY_NONE) & is_over;
  return ((i8)of_near & near) | ((i8)of_far & far);
}

/* What hides the thing from a slice has no say. */
static void look_for(depth_field *field, const bundle *b, const sight s[4], const f8 *code,
                     front *v) {
  f8 expected[4];
  v->seen = v->passed = v->covered = v->moved = all(0);
  see(field, b, s, 4, *code, expected, v->at);
  for (int k = 0; k < 4; k++) {
    const f8 edge = all(0.5f * EDGE_CODES);
    const i8 codes = codes_at(field, &v->at[k]), weights = four_weights(&v->at[k]);
    const i8 low = to_int(larger(expected[k] - edge, all(0)));
    const i8 past = bytes_from(codes, to_int(smaller(expected[k] + edge + 1.0f, all(255))));
    const i8 seeing = bytes_from(codes, low) & ~past, near = seeing & weights;
    const f8 sum = sum_of_four(near);
    v->weights[k] = near;
    v->say[k] = choose(v->at[k].inside, s[k].weight, all(0));
    const i8 parts = covered_by(coverages_at(field, &s[k], &v->at[k]), seeing, past);
    v->seen += v->say[k] * sum;
    v->passed += v->say[k] * sum_of_four(past & weights);
    v->covered += v->say[k] * to_float(weigh(parts, weights));
    v->moved += v->say[k] * (to_float(weigh(codes, near)) - sum * expected[k]);
  }
  v->moved /= larger(v->seen, all(1e-3f));
}

/* Its light, as much of it as it covers of the texels. */
INLINE sample light_in_front(const depth_field *field, const front *v, f8 coverage) {
  sample sum = {{{0}}};
  const f8 unit = root_unit(v->seen);
  for (int k = 0; k < 4; k++) add_reading(field, &v->at[k], v->weights[k], v->say[k] * unit, &sum);
  square(&sum, to_int(coverage * (float)WHOLE));
  return sum;
}

static uint64_t cover(depth_field *field, depth_rays *rays, const depth_guess *guess,
                      uint64_t *partly) {
  f8 code = load(guess->codes);
  float coverages[LANES], codes[LANES], scores[LANES];
  uint16_t light[LANES][4];
  uint64_t wholly = 0;
  bundle b;
  sight s[4];
  front v;
  look_around(field, rays, guess->texels, &b, s);
  look_for(field, &b, s, &code, &v);
  /* A neighbour's height: where the thing bends away its own is higher. */
  const i8 moved = magnitude(v.moved) > all(LEAST_MOVE);
  if (mask_bits(moved)) {
    code = choose(moved, smaller(larger(code + v.moved, all(0)), all(255)), code);
    look_for(field, &b, s, &code, &v);
  }
  const f8 share = v.covered / (SLF_COVERED_BY_NONE * larger(v.seen + v.passed, all(1e-3f)));
  f8 coverage = smaller(larger((share - 0.5f) * field->sharpen + 0.5f, all(0)), all(1));
  coverage = choose(v.seen * (float)MOST_TIMES < all(ACROSS), all(0), coverage);
  unsigned mask = mask_bits(coverage > all(LEAST_COVERAGE)) & ((1u << guess->count) - 1);
  if (!mask) return 0;
  const sample sum = light_in_front(field, &v, coverage);
  put(&sum, light);
  store(coverages, coverage), store(scores, share + share - 1.0f);
  store(codes, smaller(larger(code + v.moved, all(0)), all(255)));
  for (; mask; mask &= mask - 1) {
    const int l = __builtin_ctz(mask);
    const uint8_t k = guess->texels[l];
    const bool whole = coverages[l] == 1;
    memcpy(whole ? rays->rgba[k] : rays->front[k], light[l], sizeof light[l]);
    if (whole)
      rays->code[k] = codes[l], rays->score[k] = scores[l], wholly |= 1ull << k;
    else
      rays->coverage[k] = coverages[l], rays->front_code[k] = codes[l], *partly |= 1ull << k;
  }
  return wholly;
}

static void lay_over(depth_rays *rays, uint64_t texels) {
  for (; texels; texels &= texels - 1) {
    const int k = __builtin_ctzll(texels);
    const float left = 1 - rays->coverage[k];
#if defined(__AVX2__)
    __m128 over = _mm_cvtph_ps(_mm_loadl_epi64((const __m128i *)(const void *)rays->front[k]));
    __m128 under = _mm_cvtph_ps(_mm_loadl_epi64((const __m128i *)(const void *)rays->rgba[k]));
    over = _mm_blend_ps(_mm_add_ps(over, _mm_mul_ps(_mm_set1_ps(left), under)), under, 0x8);
    _mm_storel_epi64((__m128i *)(void *)rays->rgba[k],
                     _mm_cvtps_ph(over, _MM_FROUND_TO_NEAREST_INT));
#else
    for (int c = 0; c < 3; c++) {
      const float under = left * float_from_half(rays->rgba[k][c]);
      rays->rgba[k][c] = half_from_float(float_from_half(rays->front[k][c]) + under);
    }
#endif
  }
}

/* ---- From frame to frame ------------------------------------------------------------------------
 */

static uint64_t find_kind(const uint8_t kinds[64], uint8_t kind) {
  uint64_t found = 0;
#if defined(__AVX2__)
  for (int k = 0; k < 64; k += 32) {
    __m256i v = _mm256_loadu_si256((const __m256i *)(const void *)(kinds + k));
    v = _mm256_cmpeq_epi8(v, _mm256_set1_epi8((char)kind));
    found |= (uint64_t)(uint32_t)_mm256_movemask_epi8(v) << k;
  }
#else
  for (int k = 0; k < 64; k++) found |= (uint64_t)(kinds[k] == kind) << k;
#endif
  return found;
}

/* 0 where there is none. */
INLINE i8 known_code(i8 code) {
  return code & (code != all_int(NO_CODE));
}

INLINE int32_t least_of(i8 v) {
  int32_t least = v[0];
  for (int l = 1; l < LANES; l++) least = v[l] < least ? v[l] : least;
  return least;
}

INLINE int32_t largest_of(i8 v) {
  return -least_of(-v);
}

/* A row of numbers one to the left and one to the right, what lies beyond its ends given. */
INLINE void shift_row(i8 row, int32_t left, int32_t right, i8 *before, i8 *after) {
  const i8 ends = {left, right};
  *before = __builtin_shufflevector(row, ends, 8, 0, 1, 2, 3, 4, 5, 6);
  *after = __builtin_shufflevector(row, ends, 1, 2, 3, 4, 5, 6, 7, 9);
}

/* The lowest of the codes of a row and of those beside it. */
INLINE i8 lowest_beside(i8 row, int32_t left, int32_t right, i8 above_and_below) {
  i8 before, after;
  shift_row(row, left, right, &before, &after);
  return lower(lower(row, above_and_below), lower(before, after));
}

/* The highest of them, 0 without any. */
INLINE i8 highest_beside(i8 row, int32_t left, int32_t right, i8 above, i8 below) {
  i8 before, after;
  shift_row(row, left, right, &before, &after);
  return higher(known_code(row), higher(higher(known_code(before), known_code(after)),
                                        higher(known_code(above), known_code(below))));
}

static uint64_t find_steady(const depth_memory *last, const depth_rim *const around[4],
                            depth_outline *beside) {
  const i8 none = all_int(NO_CODE);
  i8 codes[10], lows[10];
  uint64_t served = 0, certain = 0;
  beside->lower = beside->higher = 0;
  codes[0] = load_u16(around[RIM_ABOVE]->codes[RIM_BELOW]);
  codes[9] = load_u16(around[RIM_BELOW]->codes[RIM_ABOVE]);
  lows[0] = load_u16(around[RIM_ABOVE]->lowest[RIM_BELOW]);
  lows[9] = load_u16(around[RIM_BELOW]->lowest[RIM_ABOVE]);
  i8 least = lower(lower(lows[0], lows[9]), lower(load_u16(around[RIM_LEFT]->lowest[RIM_RIGHT]),
                                                  load_u16(around[RIM_RIGHT]->lowest[RIM_LEFT])));
  i8 most = higher(higher(known_code(codes[0]), known_code(codes[9])),
                   higher(known_code(load_u16(around[RIM_LEFT]->codes[RIM_RIGHT])),
                          known_code(load_u16(around[RIM_RIGHT]->codes[RIM_LEFT]))));
  for (int row = 0; row < 8; row++) {
    const i8 kind = load_c8(last->kind + 8 * row), near = kind == SEEN_NEAR;
    const i8 unseen = kind == SEEN_NOT; /* what has been forgotten still lies beside others */
    certain |= (uint64_t)mask_bits(load_c8(last->score + 8 * row) >= (int)(100 * MOST_AGREE))
               << 8 * row;
    served |= (uint64_t)mask_bits(near) << 8 * row;
    codes[row + 1] = load_u16(last->code + 8 * row) | (none & unseen);
    lows[row + 1] = lower(codes[row + 1], load_u16(last->front + 8 * row));
    least = lower(least, lows[row + 1]), most = higher(most, known_code(codes[row + 1]));
  }
  /* Most blocks show one thing. */
  if (largest_of(most) - least_of(least) <= 256 * EDGE_CODES) return served & certain;
  for (int row = 0; row < 8; row++) {
    const i8 lowest =
        lowest_beside(lows[row + 1], around[RIM_LEFT]->lowest[RIM_RIGHT][row],
                      around[RIM_RIGHT]->lowest[RIM_LEFT][row], lower(lows[row], lows[row + 2]));
    const i8 highest =
        highest_beside(codes[row + 1], around[RIM_LEFT]->codes[RIM_RIGHT][row],
                       around[RIM_RIGHT]->codes[RIM_LEFT][row], codes[row], codes[row + 2]);
    const i8 known = codes[row + 1] != none;
    const i8 own = choose_int(known, codes[row + 1], highest);
    const i8 hidden = lowest < own - 256 * EDGE_CODES;
    const i8 hiding = known & (highest > codes[row + 1] + 256 * EDGE_CODES);
    store_u16(beside->lowest + 8 * row, lowest), store_u16(beside->highest + 8 * row, highest);
    beside->lower |= (uint64_t)mask_bits(hidden) << 8 * row;
    beside->higher |= (uint64_t)mask_bits(hiding) << 8 * row;
  }
  return served & certain;
}

static void remember(const depth_rays *rays, const uint8_t kinds[64], uint64_t mask,
                     uint64_t partly, depth_memory *now, depth_rim *rim) {
  const i8 none = all_int(NO_CODE);
  for (int row = 0; row < 64; row += LANES) {
    i8 made = lanes_of((unsigned)(mask >> row & 0xff));
    i8 code = to_int(256.0f * larger(load(rays->code + row), all(0)));
    f8 at_most_1 = smaller(load(rays->score + row), all(1)); /* sixteen slices may give more */
    i8 score = to_int(100.0f * at_most_1), kind = load_c8(kinds + row);
    code = (code & made) | (load_u16(now->code + row) & ~made);
    kind = (kind & made) | (load_c8(now->kind + row) & ~made);
    store_u16(now->code + row, code);
    store_c8(now->score + row, (score & made) | (load_c8(now->score + row) & ~made));
    store_c8(now->kind + row, kind);
    i8 covers = load_u16(now->front + row) | made; /* NO_CODE */
    if (partly >> row & 0xff) {
      const i8 covered = lanes_of((unsigned)(partly >> row & 0xff));
      covers = (to_int(256.0f * load(rays->front_code + row)) & covered) | (covers & ~covered);
    }
    covers &= none;
    store_u16(now->front + row, covers);
    const i8 known = (kind == SEEN_NEAR) | (kind == SEEN_WIDE);
    const i8 shown = (code & known) | (none & ~known), lowest = lower(shown, covers);
    rim->codes[RIM_LEFT][row / 8] = (uint16_t)shown[0];
    rim->codes[RIM_RIGHT][row / 8] = (uint16_t)shown[7];
    rim->lowest[RIM_LEFT][row / 8] = (uint16_t)lowest[0];
    rim->lowest[RIM_RIGHT][row / 8] = (uint16_t)lowest[7];
    if (row == 0)
      store_u16(rim->codes[RIM_ABOVE], shown), store_u16(rim->lowest[RIM_ABOVE], lowest);
    if (row == 56)
      store_u16(rim->codes[RIM_BELOW], shown), store_u16(rim->lowest[RIM_BELOW], lowest);
  }
}

const depth_kernel KERNEL = {place,      find_steady, find_kind,  mix,   mix_four_tap, seek,
                             seek_alone, mix_wide,    mix_steady, cover, lay_over,     remember};
