#include "codec/stream.h"

#include <assert.h>
#include <inttypes.h>
#include <stdlib.h>

static uint64_t bytes_for_bits(uint64_t bits) {
  return (bits + 7) / 8;
}

/* ---- Writing ------------------------------------------------------------------------------- */

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

enum { DIRECTORY_BUFFER_NBYTES = 1 << 12 };

static void bits_clear(bit_string *bits) {
  if (bits->bytes) memset(bits->bytes, 0, bits->capacity_nbytes);
  bits->bit_count = 0;
}

static void flush_directory(stream_writer *writer) {
  uint64_t nbytes = writer->directory.bit_count / 8;
  scratch_write(writer->to, writer->directory_at, writer->directory.bytes, nbytes);
  writer->directory_at += nbytes;
  bits_clear(&writer->directory);
}

static void put_segment(stream_writer *writer, const uint8_t *bytes, uint64_t nbytes) {
  uint64_t at = writer->begin + writer->directory_nbytes + writer->segments_nbytes;
  scratch_write(writer->to, at, bytes, nbytes);
  writer->segments_nbytes += nbytes;
}

static void end_segment(stream_writer *writer) {
  uint32_t n = (uint32_t)((writer->entry_count / 2 - 1) % SEGMENT_PAIRS) + 1;
  uint64_t last = writer->offsets[n - 1];
  uint32_t low_bits = 0;
  /* Elias and Fano: as many low bits as the mean gap has; the high bits then take at most 3 each.
   */
  while (last >> low_bits > 2 * (uint64_t)n) low_bits++;
  uint32_t low_size = (uint32_t)bytes_for_bits((uint64_t)(n - 1) * low_bits);
  uint32_t high_nbytes = n > 1 ? (uint32_t)bytes_for_bits((last >> low_bits) + n - 1) : 0;

  uint8_t head[2 + SEGMENT_PAIRS * 4 + SEGMENT_PAIRS] = {(uint8_t)low_bits, (uint8_t)high_nbytes};
  for (uint32_t i = 1; i < n; i++) {
    uint64_t offset = writer->offsets[i];
    set_bits(head + 2, (uint64_t)(i - 1) * low_bits, offset, low_bits);
    set_bits(head + 2 + low_size, (offset >> low_bits) + i - 1, 1, 1);
  }
  uint64_t begin = writer->directory_nbytes + writer->segments_nbytes;
  for (int shift = 0; shift < 48; shift += 8) bits_put(&writer->directory, begin >> shift & 255, 8);
  if (writer->directory.bit_count >= 8 * DIRECTORY_BUFFER_NBYTES) flush_directory(writer);
  align_to_byte(&writer->segment);
  put_segment(writer, head, 2 + low_size + high_nbytes);
  put_segment(writer, writer->segment.bytes, writer->segment.bit_count / 8);
  bits_clear(&writer->segment);
}

void stream_begin(stream_writer *writer, scratch_file *to, const block_stream *stream) {
  *writer = (stream_writer){.to = to, .begin = to->nbytes};
  writer->directory_nbytes = stream_segment_count(stream) * DIRECTORY_ENTRY_NBYTES;
  writer->directory_at = to->nbytes;
}

/* An entry's bytes, the last one first. */
static void append_backwards(bit_string *bits, const bit_string *entry) {
  if (entry->failed) bits->failed = true;
  for (uint64_t left = bytes_for_bits(entry->bit_count); left; left--)
    bits_put(bits, entry->bytes[left - 1], 8);
}

void stream_put(stream_writer *writer, const bit_string *entry) {
  bit_string *segment = &writer->segment;
  if (writer->entry_count % 2) {
    append_backwards(segment, entry);
  } else {
    writer->offsets[writer->entry_count / 2 % SEGMENT_PAIRS] = segment->bit_count / 8;
    bits_append(segment, entry);
  }
  align_to_byte(segment);
  writer->payload_bit_count += entry->bit_count;
  writer->entry_count++;
  if (writer->entry_count % (2 * SEGMENT_PAIRS) == 0) end_segment(writer);
}

slf_result stream_finish(stream_writer *writer, const char *name, uint64_t *nbytes,
                         slf_error *error) {
  static const uint8_t padding[STREAM_PAD_NBYTES];
  assert(writer->entry_count % 2 == 0);
  if (writer->entry_count % (2 * SEGMENT_PAIRS)) end_segment(writer);
  flush_directory(writer);
  put_segment(writer, padding, sizeof padding);
  *nbytes = writer->directory_nbytes + writer->segments_nbytes;
  if (writer->directory.failed || writer->segment.failed)
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for a segment of blocks", name);
  if (writer->to->error_number)
    return slf_fail(error, SLF_ERROR_IO, "%s: %s", name, strerror(writer->to->error_number));
  assert(writer->directory_at == writer->begin + writer->directory_nbytes);
  return SLF_OK;
}

void stream_writer_free(stream_writer *writer) {
  bits_free(&writer->directory);
  bits_free(&writer->segment);
}
