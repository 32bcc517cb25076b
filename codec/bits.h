/* bits.h - reading a stream's bits, most significant first, upwards or downwards by bytes:
 * FORMAT.md, "Block streams". */
#ifndef SLF_BITS_H
#define SLF_BITS_H

#include "codec/stream.h"

#include <string.h>

/* A position in a stream: the next `count` bits at the top of `bits`. `next` is the offset in
 * `bytes` where more are loaded from, upwards to `last` or backwards to 0; beyond, the bytes there
 * repeat: loads stay inside the stream, and a C-Block that runs there is damaged and comes out as
 * some levels. */
typedef struct {
  uint64_t bits, count;
  const uint8_t *bytes;
  int64_t next, last;
  bool backwards;
} bit_reader;

/* At the begin of an entry, where it was found. At most 8 bytes of what was loaded are still to be
 * read, and a pair has the directory and its segment's head before it: good blocks never meet these
 * bounds. No branch on where an entry is in its pair, which nobody foretells. */
static inline void reader_begin(bit_reader *reader, const block_stream *blocks, uint64_t entry,
                                uint64_t byte) {
  bool backwards = entry & 1;
  *reader = (bit_reader){.bytes = blocks->bytes,
                         .next = (int64_t)byte - ((int64_t)backwards << 3),
                         .last = (int64_t)blocks->nbytes - STREAM_PAD_NBYTES + 8,
                         .backwards = backwards};
}

/* Field by field, so that they stay in registers. */
static inline bit_reader reader_copy(const bit_reader *r, bool backwards) {
  return (bit_reader){r->bits, r->count, r->bytes, r->next, r->last, backwards};
}

static inline void reader_update(bit_reader *to, const bit_reader *r) {
  to->bits = r->bits;
  to->count = r->count;
  to->next = r->next;
}

static inline uint64_t load_be64(const uint8_t *p) {
  uint64_t value;
  memcpy(&value, p, sizeof value);
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  value = __builtin_bswap64(value);
#endif
  return value;
}

static inline uint64_t load_le64(const uint8_t *p) {
  return __builtin_bswap64(load_be64(p));
}

/* 56 bits or more (Giesen 2018, "Reading bits in far too many ways", variant 4). Backwards the byte
 * that comes first is the last one of those loaded. */
static inline __attribute__((always_inline)) void refill(bit_reader *r) {
  int64_t taken = (int64_t)((63 ^ r->count) >> 3);
  if (r->backwards) {
    r->next = r->next > 0 ? r->next : 0;
    r->bits |= load_le64(r->bytes + r->next) >> r->count;
    r->next -= taken;
  } else {
    r->next = r->next < r->last ? r->next : r->last;
    r->bits |= load_be64(r->bytes + r->next) >> r->count;
    r->next += taken;
  }
  r->count |= 56;
}

static inline void consume(bit_reader *r, unsigned count) {
  r->bits <<= count;
  r->count -= count;
}

static inline uint32_t top_bits(uint64_t bits, unsigned count) {
  return (uint32_t)(bits >> 1 >> (63 - count));
}

static inline uint32_t take(bit_reader *r, unsigned count) {
  uint32_t value = top_bits(r->bits, count);
  consume(r, count);
  return value;
}

/* JPEG's magnitude bits, the top `size` ones. No branch: which sign it is nobody foretells. */
static inline int32_t level_at_top(uint64_t bits, unsigned size) {
  int32_t most = (int32_t)((1u << size) - 1), negative = (int32_t)((int64_t)~bits >> 63);
  return (int32_t)top_bits(bits, size) - (negative & most);
}

static inline int32_t take_level(bit_reader *r, unsigned size) {
  int32_t level = level_at_top(r->bits, size);
  consume(r, size);
  return level;
}

/* Passes over any number of bits. */
static inline __attribute__((always_inline)) void reader_jump(bit_reader *r, unsigned bit_count) {
  if (bit_count <= r->count) {
    consume(r, bit_count);
    return;
  }
  int64_t bits = (int64_t)bit_count - (int64_t)r->count; /* behind those that were loaded */
  r->next += r->backwards ? -(bits >> 3) : bits >> 3;
  r->bits = r->count = 0;
  refill(r);
  consume(r, (unsigned)bits & 7);
}

/* Where the byte is that the next bit is in. */
static inline int64_t reader_byte(const bit_reader *r) {
  int64_t loaded = (int64_t)(r->count + 7) >> 3;
  return r->backwards ? r->next + 7 + loaded : r->next - loaded;
}

/* Whether so many bytes from there on are the stream's. */
static inline bool reader_has(const bit_reader *r, unsigned nbytes) {
  int64_t at = reader_byte(r), end = r->last + STREAM_PAD_NBYTES - 8;
  return r->backwards ? at >= (int64_t)nbytes && at < end : at >= 0 && at + nbytes <= end;
}

#endif
