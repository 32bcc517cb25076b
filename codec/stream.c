#include "codec/stream.h"

#include <assert.h>
#include <inttypes.h>
#include <stdlib.h>

/* ---- Reading ------------------------------------------------------------------------------------
 */

/* A segment: one byte low_bits, one byte high_nbytes, the low bits of the offsets of entries 1 ..,
 * packed from bit 0 up, filled to a byte; the high bits in unary, high_nbytes; then the payload. */
typedef struct {
  uint64_t begin; /* of the segment in the stream, in bytes */
  uint32_t entry_count;
  uint32_t low_bits, high_nbytes;
} segment;

static uint64_t bytes_for_bits(uint64_t bits) {
  return (bits + 7) / 8;
}

static uint32_t low_nbytes(const segment *s) {
  return (uint32_t)bytes_for_bits((uint64_t)(s->entry_count - 1) * s->low_bits);
}

/* False if its head does not lie in the stream. */
static bool find_segment(const block_stream *stream, uint64_t index, segment *s) {
  uint64_t end = stream->nbytes - STREAM_PAD_NBYTES;
  s->begin = get_u48(stream->bytes + index * DIRECTORY_ENTRY_NBYTES);
  uint64_t entries_left = stream->entry_count - index * SEGMENT_ENTRIES;
  s->entry_count = entries_left < SEGMENT_ENTRIES ? (uint32_t)entries_left : SEGMENT_ENTRIES;
  if (s->begin > end || end - s->begin < 2) return false;
  s->low_bits = stream->bytes[s->begin];
  s->high_nbytes = stream->bytes[s->begin + 1];
  return s->low_bits <= 32 && 2 + low_nbytes(s) + s->high_nbytes <= end - s->begin;
}

/* Position of the one-bit number `rank` (from 0) in nbytes of bits, or 8 * nbytes. Loads of 8 bytes
 * may run over the end by as much: the stream's padding is there for it. */
static uint32_t select_bit(const uint8_t *bytes, uint32_t nbytes, uint32_t rank) {
  for (uint32_t at = 0; at < nbytes; at += 8) {
    uint64_t word = get_u64(bytes + at);
    uint32_t ones = (uint32_t)__builtin_popcountll(word);
    if (rank < ones) {
      while (rank--) word &= word - 1;
      return at * 8 + (uint32_t)__builtin_ctzll(word);
    }
    rank -= ones;
  }
  return nbytes * 8;
}

/* Offset in bits of entry i of a segment from the segment's payload. */
static uint64_t entry_offset(const block_stream *stream, const segment *s, uint32_t i) {
  if (i == 0) return 0;
  const uint8_t *low = stream->bytes + s->begin + 2, *high = low + low_nbytes(s);
  uint64_t low_at = (uint64_t)(i - 1) * s->low_bits;
  uint64_t low_value = get_u64(low + low_at / 8) >> (low_at % 8) & ((1ull << s->low_bits) - 1);
  uint64_t high_value = select_bit(high, s->high_nbytes, i - 1) - (i - 1);
  return high_value << s->low_bits | low_value;
}

uint64_t stream_find(const block_stream *stream, uint64_t entry) {
  segment s;
  uint64_t end_bit = (stream->nbytes - STREAM_PAD_NBYTES) * 8;
  if (!find_segment(stream, entry / SEGMENT_ENTRIES, &s)) return end_bit;
  uint64_t payload = s.begin + 2 + low_nbytes(&s) + s.high_nbytes;
  uint64_t bit = payload * 8 + entry_offset(stream, &s, entry % SEGMENT_ENTRIES);
  return bit < end_bit ? bit : end_bit;
}

slf_result stream_check(const block_stream *stream, const char *name, slf_error *error) {
  uint64_t segment_count = stream_segment_count(stream->entry_count);
  uint64_t end = stream->nbytes - STREAM_PAD_NBYTES;
  uint64_t expected = segment_count * DIRECTORY_ENTRY_NBYTES;
  for (uint64_t index = 0; index < segment_count; index++) {
    segment s;
    bool inside = find_segment(stream, index, &s);
    if (!inside || s.begin < expected)
      return slf_fail(error, SLF_ERROR_FORMAT,
                      "%s: segment %" PRIu64 " begins at byte %" PRIu64 " of %" PRIu64, name, index,
                      s.begin, end);
    uint64_t payload = s.begin + 2 + low_nbytes(&s) + s.high_nbytes, previous = 0;
    for (uint32_t i = 0; i < s.entry_count; i++) {
      uint64_t offset = entry_offset(stream, &s, i);
      if (offset < previous || payload + offset / 8 > end)
        return slf_fail(error, SLF_ERROR_FORMAT,
                        "%s: entry %u of segment %" PRIu64 " lies at bit %" PRIu64, name, i, index,
                        offset);
      previous = offset;
    }
    expected = payload + previous / 8;
  }
  return SLF_OK;
}

/* ---- Writing ------------------------------------------------------------------------------------
 */

/* Makes room for so many bits more, and zeroes it. */
static bool reserve(bit_string *bits, uint64_t more) {
  if (bits->failed) return false;
  uint64_t needed = bytes_for_bits(bits->bit_count + more) + 8;
  if (needed <= bits->capacity_nbytes) return true;
  size_t capacity = bits->capacity_nbytes ? bits->capacity_nbytes : 64;
  while (capacity < needed) capacity *= 2;
  uint8_t *bytes = realloc(bits->bytes, capacity);
  if (!bytes) {
    bits->failed = true;
    return false;
  }
  memset(bytes + bits->capacity_nbytes, 0, capacity - bits->capacity_nbytes);
  bits->bytes = bytes;
  bits->capacity_nbytes = capacity;
  return true;
}

void bits_put(bit_string *bits, uint32_t value, unsigned count) {
  assert(count <= 32 && (count == 32 || value >> count == 0));
  if (!reserve(bits, count)) return;
  uint8_t *p = bits->bytes + bits->bit_count / 8;
  uint64_t shifted = (uint64_t)value << (64 - 8 - count) << 8 >> bits->bit_count % 8;
  for (unsigned i = 0; count && i < 5; i++) p[i] |= (uint8_t)(shifted >> (56 - 8 * i));
  bits->bit_count += count;
}

void bits_append(bit_string *bits, const bit_string *more) {
  if (more->failed) bits->failed = true;
  if (!reserve(bits, more->bit_count)) return;
  uint64_t left = more->bit_count;
  for (const uint8_t *p = more->bytes; left; p++) {
    unsigned count = left < 8 ? (unsigned)left : 8;
    bits_put(bits, (uint32_t)*p >> (8 - count), count);
    left -= count;
  }
}

static void align_to_byte(bit_string *bits) {
  bits_put(bits, 0, (unsigned)(-bits->bit_count & 7));
}

void bits_free(bit_string *bits) {
  free(bits->bytes);
  *bits = (bit_string){0};
}

/* Sets bits of an index part, least significant first. */
static void set_bits(uint8_t *bytes, uint64_t at, uint64_t value, unsigned count) {
  for (unsigned i = 0; i < count; i++, at++) bytes[at / 8] |= (uint8_t)((value >> i & 1) << at % 8);
}

static void end_segment(stream_writer *writer) {
  uint32_t n = (uint32_t)((writer->entry_count - 1) % SEGMENT_ENTRIES) + 1;
  uint64_t last = writer->offsets[n - 1];
  segment s = {.entry_count = n};
  /* Elias and Fano: as many low bits as the mean gap has; the high bits then take at most 3 each.
   */
  while (last >> s.low_bits > 2 * (uint64_t)n) s.low_bits++;
  uint32_t low_size = low_nbytes(&s);
  s.high_nbytes = n > 1 ? (uint32_t)bytes_for_bits((last >> s.low_bits) + n - 1) : 0;

  uint8_t head[2 + SEGMENT_ENTRIES * 4 + SEGMENT_ENTRIES] = {(uint8_t)s.low_bits,
                                                             (uint8_t)s.high_nbytes};
  for (uint32_t i = 1; i < n; i++) {
    uint64_t offset = writer->offsets[i];
    set_bits(head + 2, (uint64_t)(i - 1) * s.low_bits, offset, s.low_bits);
    set_bits(head + 2 + low_size, (offset >> s.low_bits) + i - 1, 1, 1);
  }
  uint64_t begin = writer->segments.bit_count / 8;
  bits_put(&writer->directory, (uint32_t)(begin >> 16), 32);
  bits_put(&writer->directory, (uint32_t)(begin & 0xffff), 16);
  for (uint32_t i = 0; i < 2 + low_size + s.high_nbytes; i++)
    bits_put(&writer->segments, head[i], 8);
  bits_append(&writer->segments, &writer->segment);
  align_to_byte(&writer->segments);
  if (writer->segment.bytes) memset(writer->segment.bytes, 0, writer->segment.capacity_nbytes);
  writer->segment.bit_count = 0;
}

void stream_put(stream_writer *writer, const bit_string *entry) {
  writer->offsets[writer->entry_count++ % SEGMENT_ENTRIES] = writer->segment.bit_count;
  bits_append(&writer->segment, entry);
  writer->payload_bit_count += entry->bit_count;
  if (writer->entry_count % SEGMENT_ENTRIES == 0) end_segment(writer);
}

slf_result stream_finish(stream_writer *writer, uint8_t **bytes, uint64_t *nbytes,
                         slf_error *error) {
  if (writer->entry_count % SEGMENT_ENTRIES) end_segment(writer);
  uint64_t segment_count = stream_segment_count(writer->entry_count);
  uint64_t directory_nbytes = segment_count * DIRECTORY_ENTRY_NBYTES;
  uint64_t segments_nbytes = writer->segments.bit_count / 8;
  *nbytes = directory_nbytes + segments_nbytes + STREAM_PAD_NBYTES;
  bool failed = writer->directory.failed || writer->segments.failed || writer->segment.failed;
  *bytes = failed ? NULL : calloc(1, *nbytes);
  if (!*bytes)
    return slf_fail(error, SLF_ERROR_MEMORY, "no memory for %" PRIu64 " bytes of blocks", *nbytes);
  for (uint64_t i = 0; i < segment_count; i++) {
    const uint8_t *p = writer->directory.bytes + i * DIRECTORY_ENTRY_NBYTES;
    uint64_t begin = 0;
    for (int k = 0; k < DIRECTORY_ENTRY_NBYTES; k++) begin = begin << 8 | p[k];
    put_u48(*bytes + i * DIRECTORY_ENTRY_NBYTES, directory_nbytes + begin);
  }
  if (segments_nbytes) memcpy(*bytes + directory_nbytes, writer->segments.bytes, segments_nbytes);
  return SLF_OK;
}

void stream_writer_free(stream_writer *writer) {
  bits_free(&writer->directory);
  bits_free(&writer->segments);
  bits_free(&writer->segment);
}
