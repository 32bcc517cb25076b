/* levels.c - from the bits of a block's AC levels, whose sizes its symbols said, to levels.
 * Compiled for each kernel: see kernel.h. Nothing here waits for what was read before: sums of
 * sizes say where the bits of each level are. */
#include "codec/kernel.h"

#if defined(__AVX2__)
#include <immintrin.h>
#endif

/* One after the other; returns how many bits they have. */
static unsigned read_one_by_one(const bit_reader *reader, const coded_levels *coded,
                                int16_t *levels) {
  bit_reader r = reader_copy(reader, reader->backwards);
  unsigned bit_count = 0;
  for (uint32_t i = 0; i < coded->count; i++) {
    if (r.count < MAX_SIZE) refill(&r);
    levels[i] = (int16_t)take_level(&r, coded->sizes[i]);
    bit_count += coded->sizes[i];
  }
  return bit_count;
}

/* ---- Several at once ----------------------------------------------------------------------- */

/* AT_ONCE levels out of BYTES that hold their bits in the order of reading, from first_bit on,
 * below
 * 8. Where a level is too large or all are more than MOST_SUM bits, they are read one by one. */
#if defined(__AVX512VBMI2__)
enum { AT_ONCE = 32, BYTES = 64, MOST_BITS = 9, MOST_SUM = 30 * 8 };
typedef __m256i some_sizes;

static inline some_sizes load_sizes(const uint8_t *sizes, uint32_t count) {
  return _mm256_maskz_loadu_epi8((uint32_t)_bzhi_u64(UINT32_MAX, count), sizes);
}

static inline bool are_shown(some_sizes sizes, unsigned sum) {
  return sum <= MOST_SUM && !_mm256_cmpgt_epi8_mask(sizes, _mm256_set1_epi8(MOST_BITS));
}

static inline unsigned sum_of(some_sizes sizes) {
  __m256i quarters = _mm256_sad_epu8(sizes, _mm256_setzero_si256());
  __m128i halves =
      _mm_add_epi64(_mm256_castsi256_si128(quarters), _mm256_extracti128_si256(quarters, 1));
  return (unsigned)(_mm_cvtsi128_si32(halves) + _mm_extract_epi32(halves, 2));
}

static inline void read_some(const uint8_t *from, bool backwards, unsigned first_bit,
                             some_sizes sizes, int16_t *levels) {
  __m256i sum = _mm256_add_epi8(sizes, _mm256_slli_si256(sizes, 1));
  sum = _mm256_add_epi8(sum, _mm256_slli_si256(sum, 2));
  sum = _mm256_add_epi8(sum, _mm256_slli_si256(sum, 4));
  sum = _mm256_add_epi8(sum, _mm256_slli_si256(sum, 8));
  __m256i of_half = _mm256_shuffle_epi8(sum, _mm256_set1_epi8(15));
  sum = _mm256_add_epi8(sum, _mm256_permute2x128_si256(of_half, of_half, 0x08));
  __m256i at = _mm256_add_epi8(_mm256_sub_epi8(sum, sizes), _mm256_set1_epi8((char)first_bit));
  __m256i byte = _mm256_and_si256(_mm256_srli_epi16(at, 3), _mm256_set1_epi8(31));
  __m256i bit = _mm256_and_si256(at, _mm256_set1_epi8(7));
  __m512i index = _mm512_mullo_epi16(_mm512_cvtepu8_epi16(byte), _mm512_set1_epi16(0x0101));
  index = _mm512_add_epi8(index, _mm512_set1_epi16(0x0001));
  index = _mm512_xor_si512(index, _mm512_set1_epi8(backwards ? BYTES - 1 : 0));
  __m512i window = _mm512_permutexvar_epi8(index, _mm512_loadu_si512(from));
  window = _mm512_sllv_epi16(window, _mm512_cvtepu8_epi16(bit));
  __m512i unused = _mm512_sub_epi16(_mm512_set1_epi16(16), _mm512_cvtepu8_epi16(sizes));
  __m512i value = _mm512_srlv_epi16(window, unused);
  __m512i most = _mm512_srlv_epi16(_mm512_set1_epi16(-1), unused);
  __mmask32 is_less = _knot_mask32(_mm512_movepi16_mask(window));
  _mm512_storeu_si512(levels, _mm512_mask_sub_epi16(value, is_less, value, most));
}
#elif defined(__AVX2__)
enum { AT_ONCE = 16, BYTES = 16, MOST_SUM = 11 * 8 };
typedef __m128i some_sizes;

static inline some_sizes load_sizes(const uint8_t *sizes, uint32_t count) {
  const __m128i number = _mm_setr_epi8(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  __m128i there = _mm_cmpgt_epi8(_mm_set1_epi8((char)count), number);
  return _mm_and_si128(_mm_loadu_si128((const __m128i *)(const void *)sizes), there);
}

static inline bool are_shown(some_sizes sizes, unsigned sum) {
  (void)sizes; /* windows of 32 bits show any */
  return sum <= MOST_SUM;
}

static inline unsigned sum_of(some_sizes sizes) {
  __m128i halves = _mm_sad_epu8(sizes, _mm_setzero_si128());
  return (unsigned)(_mm_cvtsi128_si32(halves) + _mm_extract_epi32(halves, 2));
}

/* Of the lower eight bytes' levels. */
static inline __m256i levels_of_eight(__m256i bytes, __m256i order, __m128i byte, __m128i bit,
                                      __m128i sizes) {
  const __m256i of_lane = _mm256_setr_epi8(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4,
                                           4, 5, 5, 5, 5, 6, 6, 6, 6, 7, 7, 7, 7);
  const __m256i big_endian = _mm256_set1_epi32(0x00010203), ones = _mm256_set1_epi32(-1);
  __m256i index = _mm256_shuffle_epi8(_mm256_broadcastsi128_si256(byte), of_lane);
  index = _mm256_xor_si256(_mm256_add_epi8(index, big_endian), order);
  __m256i window = _mm256_sllv_epi32(_mm256_shuffle_epi8(bytes, index), _mm256_cvtepu8_epi32(bit));
  __m256i unused = _mm256_sub_epi32(_mm256_set1_epi32(32), _mm256_cvtepu8_epi32(sizes));
  __m256i is_less = _mm256_srai_epi32(_mm256_xor_si256(window, ones), 31);
  __m256i most = _mm256_and_si256(_mm256_srlv_epi32(ones, unused), is_less);
  return _mm256_sub_epi32(_mm256_srlv_epi32(window, unused), most);
}

static inline void read_some(const uint8_t *from, bool backwards, unsigned first_bit,
                             some_sizes sizes, int16_t *levels) {
  __m128i sum = _mm_add_epi8(sizes, _mm_slli_si128(sizes, 1));
  sum = _mm_add_epi8(sum, _mm_slli_si128(sum, 2));
  sum = _mm_add_epi8(sum, _mm_slli_si128(sum, 4));
  sum = _mm_add_epi8(sum, _mm_slli_si128(sum, 8));
  __m128i at = _mm_add_epi8(_mm_sub_epi8(sum, sizes), _mm_set1_epi8((char)first_bit));
  __m128i byte = _mm_and_si128(_mm_srli_epi16(at, 3), _mm_set1_epi8(31));
  __m128i bit = _mm_and_si128(at, _mm_set1_epi8(7));
  __m256i bytes = _mm256_broadcastsi128_si256(_mm_loadu_si128((const __m128i *)(const void *)from));
  __m256i order = _mm256_set1_epi8(backwards ? BYTES - 1 : 0);
  __m256i low = levels_of_eight(bytes, order, byte, bit, sizes);
  __m256i high = levels_of_eight(bytes, order, _mm_srli_si128(byte, 8), _mm_srli_si128(bit, 8),
                                 _mm_srli_si128(sizes, 8));
  __m256i both = _mm256_permute4x64_epi64(_mm256_packs_epi32(low, high), 0xd8);
  _mm256_storeu_si256((__m256i *)(void *)levels, both);
}
#endif

#if defined(__AVX2__)
/* False where a level is too large for that, or the stream's end too near. */
static inline bool read_at_once(const bit_reader *r, const coded_levels *coded, int16_t *levels,
                                unsigned *bit_count) {
  if (!reader_has(r, 2 * coded->count + BYTES)) return false;
  const uint8_t *first = r->bytes + reader_byte(r);
  unsigned begin = -r->count & 7, bit = begin;
  for (uint32_t i = 0; i < coded->count; i += AT_ONCE) {
    uint32_t left = coded->count - i;
    some_sizes sizes = load_sizes(coded->sizes + i, left < AT_ONCE ? left : AT_ONCE);
    unsigned sum = sum_of(sizes);
    if (__builtin_expect(!are_shown(sizes, sum), 0)) return false;
    const uint8_t *from = r->backwards ? first - bit / 8 - (BYTES - 1) : first + bit / 8;
    read_some(from, r->backwards, bit % 8, sizes, levels + i);
    bit += sum;
  }
  *bit_count = bit - begin;
  return true;
}
#else
static inline bool read_at_once(const bit_reader *r, const coded_levels *coded, int16_t *levels,
                                unsigned *bit_count) {
  (void)r, (void)coded, (void)levels, (void)bit_count;
  return false;
}
#endif

/* ---- To their places ----------------------------------------------------------------------- */

/* In wide stores: what a compiler makes of memset for so few bytes takes longer to begin. */
static inline void put_zeros(int16_t *to) {
  typedef uint64_t wide __attribute__((vector_size(32), aligned(2), may_alias));
#pragma GCC unroll 4
  for (size_t i = 0; i < COEFFICIENTS * sizeof *to / sizeof(wide); i++)
    ((wide *)(void *)to)[i] = (wide){0};
}

#if defined(__AVX512VBMI2__)
/* Of each coefficient its place in the zigzag scan. */
static const uint16_t scan[COEFFICIENTS] = {
    0,  2,  3,  9,  10, 20, 21, 35, 1,  4,  8,  11, 19, 22, 34, 36, 5,  7,  12, 18, 23, 33,
    37, 48, 6,  13, 17, 24, 32, 38, 47, 49, 14, 16, 25, 31, 39, 46, 50, 57, 15, 26, 30, 40,
    45, 51, 56, 58, 27, 29, 41, 44, 52, 55, 59, 62, 28, 42, 43, 53, 54, 60, 61, 63};

static inline void put_channel(const int16_t *levels, uint64_t places, int32_t dc, bool adds,
                               int16_t *to) {
  if (!places && !adds) {
    put_zeros(to);
    to[0] = (int16_t)dc;
    return;
  }
  const uint32_t first = (uint32_t)places, second = (uint32_t)(places >> 32);
  const __mmask32 before = adds ? UINT32_MAX : 0;
  __m512i low = _mm512_maskz_expand_epi16(first, _mm512_loadu_si512(levels));
  levels += __builtin_popcount(first);
  __m512i high = _mm512_maskz_expand_epi16(second, _mm512_loadu_si512(levels));
  __m512i upper = _mm512_permutex2var_epi16(low, _mm512_loadu_si512(scan), high);
  __m512i lower = _mm512_permutex2var_epi16(low, _mm512_loadu_si512(scan + 32), high);
  upper = _mm512_add_epi16(upper, _mm512_zextsi128_si512(_mm_cvtsi32_si128(dc & 0xffff)));
  upper = _mm512_add_epi16(upper, _mm512_maskz_loadu_epi16(before, to));
  lower = _mm512_add_epi16(lower, _mm512_maskz_loadu_epi16(before, to + 32));
  _mm512_storeu_si512(to, upper);
  _mm512_storeu_si512(to + 32, lower);
}
#else
static inline int16_t sum_of_levels(int16_t a, int32_t b) {
  return (int16_t)(uint16_t)((uint32_t)a + (uint32_t)b);
}

static inline void put_channel(const int16_t *levels, uint64_t places, int32_t dc, bool adds,
                               int16_t *to) {
  if (adds) {
    to[0] = sum_of_levels(to[0], dc);
    for (; places; places &= places - 1, levels++) {
      int16_t *at = &to[slf_zigzag[__builtin_ctzll(places)]];
      *at = sum_of_levels(*at, *levels);
    }
    return;
  }
  put_zeros(to);
  to[0] = sum_of_levels(0, dc);
  for (; places; places &= places - 1) to[slf_zigzag[__builtin_ctzll(places)]] = *levels++;
}
#endif

static inline __attribute__((always_inline)) void put_channels(const int16_t *levels,
                                                               const coded_levels *coded,
                                                               const int32_t dc[3], bool adds,
                                                               block_levels *block) {
  block->ac_flags = (adds ? block->ac_flags : 0) | coded->flags;
#pragma GCC unroll 3
  for (int channel = 0; channel < 3; channel++) {
    const uint64_t places = coded->places[channel];
    const unsigned last = 63 - (unsigned)__builtin_clzll(places | 1);
    const unsigned before = adds ? block->last_k[channel] : 0;
    block->last_k[channel] = last > before ? last : before;
    put_channel(levels, places, dc[channel], adds, block->levels[channel]);
    levels += __builtin_popcountll(places);
  }
}

void levels_read(bit_reader *reader, const coded_levels *coded, const int32_t dc[3], bool adds,
                 block_levels *block) {
  int16_t levels[MOST_LEVELS + COEFFICIENTS]; /* behind them is room to load, to write */
  unsigned bit_count;
  if (!read_at_once(reader, coded, levels, &bit_count))
    bit_count = read_one_by_one(reader, coded, levels);
  if (adds)
    put_channels(levels, coded, dc, true, block);
  else
    put_channels(levels, coded, dc, false, block);
  reader_jump(reader, bit_count);
}
