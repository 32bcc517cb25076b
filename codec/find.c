/* find.c - where an entry's bits are. Compiled for each kernel: see kernel.h. */
#include "codec/kernel.h"

#include <inttypes.h>
#ifdef __BMI2__
#include <immintrin.h>
#endif

/* ---- Reading ------------------------------------------------------------------------------- */

/* A segment: one byte low_bits, one byte high_nbytes, the low bits of the offsets of pairs 1 ..,
 * packed from bit 0 up, filled to a byte; the high bits in unary, high_nbytes; then the payload. */
typedef struct {
  uint64_t begin; /* of the segment in the stream, in bytes */
  uint32_t pair_count;
  uint32_t low_bits, high_nbytes;
} segment;

static uint64_t bytes_for_bits(uint64_t bits) {
  return (bits + 7) / 8;
}

static uint32_t low_nbytes(const segment *s) {
  return (uint32_t)bytes_for_bits((uint64_t)(s->pair_count - 1) * s->low_bits);
}

static inline uint64_t segment_begin(const block_stream *stream, uint64_t index) {
  return get_u48(stream->bytes + index * DIRECTORY_ENTRY_NBYTES);
}

/* False if its head does not lie in the stream. */
static inline __attribute__((always_inline)) bool
find_segment(const block_stream *stream, uint64_t index, uint64_t begin, segment *s) {
  uint64_t end = stream->nbytes - STREAM_PAD_NBYTES;
  s->begin = begin;
  uint64_t pairs_left = stream->entry_count / 2 - index * SEGMENT_PAIRS;
  s->pair_count = pairs_left < SEGMENT_PAIRS ? (uint32_t)pairs_left : SEGMENT_PAIRS;
  if (s->begin > end || end - s->begin < 2) return false;
  s->low_bits = stream->bytes[s->begin];
  s->high_nbytes = stream->bytes[s->begin + 1];
  return s->low_bits <= 32 && 2 + low_nbytes(s) + s->high_nbytes <= end - s->begin;
}

static inline uint32_t select_in_word(uint64_t word, uint32_t rank) {
#ifdef __BMI2__
  return (uint32_t)__builtin_ctzll(_pdep_u64(1ull << rank, word));
#else
  while (rank--) word &= word - 1;
  return (uint32_t)__builtin_ctzll(word);
#endif
}

/* Position of the one-bit number `rank` (from 0) in nbytes of bits, or 8 * nbytes. Loads of 8 bytes
 * may run over the end by as much: the stream's padding is there for it. */
static uint32_t select_by_loop(const uint8_t *bytes, uint32_t nbytes, uint32_t rank) {
  for (uint32_t at = 0; at < nbytes; at += 8) {
    uint64_t word = get_u64(bytes + at);
    uint32_t ones = (uint32_t)__builtin_popcountll(word);
    if (rank < ones) {
      uint32_t bit = at * 8 + select_in_word(word, rank);
      return bit < nbytes * 8 ? bit : nbytes * 8;
    }
    rank -= ones;
  }
  return nbytes * 8;
}

/* The same without a branch that nobody foretells, where the bits are in the SELECT_WORDS words
 * that an encoder's segments have at most. */
enum { SELECT_WORDS = 6, SELECT_NBYTES = 8 * SELECT_WORDS };
static inline __attribute__((always_inline)) uint32_t
select_bit(const uint8_t *bytes, uint32_t nbytes, uint32_t rank, const uint8_t *end) {
  if (__builtin_expect(nbytes > SELECT_NBYTES || end - bytes < SELECT_NBYTES, 0))
    return select_by_loop(bytes, nbytes, rank);
  uint32_t before = 0, sum = 0, at = 0;
#pragma GCC unroll 6
  for (int i = 0; i < SELECT_WORDS - 1; i++) {
    sum += (uint32_t)__builtin_popcountll(get_u64(bytes + 8 * i));
    bool beyond = rank >= sum;
    before = beyond ? sum : before;
    at += 8 * beyond;
  }
  uint64_t word = get_u64(bytes + at);
  rank -= before;
  uint32_t bit = rank < (uint32_t)__builtin_popcountll(word) ? at * 8 + select_in_word(word, rank)
                                                             : nbytes * 8;
  return bit < nbytes * 8 ? bit : nbytes * 8;
}

/* Offset of pair i of a segment from the segment's payload. */
static inline __attribute__((always_inline)) uint64_t pair_offset(const block_stream *stream,
                                                                  const segment *s, uint32_t i) {
  if (i == 0) return 0;
  const uint8_t *low = stream->bytes + s->begin + 2, *high = low + low_nbytes(s);
  const uint8_t *end = stream->bytes + stream->nbytes;
  uint64_t low_at = (uint64_t)(i - 1) * s->low_bits;
  uint64_t low_value = get_u64(low + low_at / 8) >> (low_at % 8) & ((1ull << s->low_bits) - 1);
  uint64_t high_value = select_bit(high, s->high_nbytes, i - 1, end) - (i - 1);
  return high_value << s->low_bits | low_value;
}

/* Where segment `index` ends: the next one begins there, or the padding. */
static uint64_t segment_end(const block_stream *stream, uint64_t index) {
  return index + 1 < stream_segment_count(stream) ? segment_begin(stream, index + 1)
                                                  : stream->nbytes - STREAM_PAD_NBYTES;
}

uint64_t stream_find_in_segment(const block_stream *stream, uint64_t entry, uint64_t begin) {
  segment s;
  uint64_t end = stream->nbytes - STREAM_PAD_NBYTES, pair = entry / 2, at;
  if (!find_segment(stream, pair / SEGMENT_PAIRS, begin, &s)) return end;
  /* The second of a pair begins where the next pair does. */
  uint32_t i = (uint32_t)(pair % SEGMENT_PAIRS + entry % 2);
  uint64_t payload = s.begin + 2 + low_nbytes(&s) + s.high_nbytes;
  if (__builtin_expect(i == s.pair_count, 0))
    at = segment_end(stream, pair / SEGMENT_PAIRS);
  else
    at = payload + pair_offset(stream, &s, i);
  return at < end ? at : end;
}

uint64_t stream_find(const block_stream *stream, uint64_t entry) {
  return stream_find_in_segment(stream, entry, get_u48(stream_directory(stream, entry)));
}

slf_result stream_check(const block_stream *stream, const char *name, slf_error *error) {
  uint64_t segment_count = stream_segment_count(stream);
  uint64_t end = stream->nbytes - STREAM_PAD_NBYTES;
  uint64_t expected = segment_count * DIRECTORY_ENTRY_NBYTES;
  for (uint64_t index = 0; index < segment_count; index++) {
    segment s;
    bool inside = find_segment(stream, index, segment_begin(stream, index), &s);
    if (!inside || s.begin < expected)
      return slf_fail(error, SLF_ERROR_FORMAT,
                      "%s: segment %" PRIu64 " begins at byte %" PRIu64 " of %" PRIu64, name, index,
                      s.begin, end);
    uint64_t payload = s.begin + 2 + low_nbytes(&s) + s.high_nbytes, previous = 0;
    for (uint32_t i = 0; i < s.pair_count; i++) {
      uint64_t offset = pair_offset(stream, &s, i);
      if (offset < previous || payload + offset > end)
        return slf_fail(error, SLF_ERROR_FORMAT,
                        "%s: pair %u of segment %" PRIu64 " lies at byte %" PRIu64, name, i, index,
                        offset);
      previous = offset;
    }
    expected = payload + previous;
  }
  return SLF_OK;
}
