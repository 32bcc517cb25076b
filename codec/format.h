/* format.h - what FORMAT.md says, as constants and structs that the reader and the writer share. */
#ifndef SLF_FORMAT_H
#define SLF_FORMAT_H

#include "codec/slf.h"

#include <string.h>

enum {
  VERSION_MAJOR = 4,
  VERSION_MINOR = 1,
  HEADER_NBYTES = 32,
  CHUNK_ENTRY_NBYTES = 32,
  VIEW_NBYTES = SLF_NAME_NBYTES + 28,
  SURFACE_NBYTES = SLF_NAME_NBYTES + 16,
  VERTEX_NBYTES = 56,
  TRIANGLE_NBYTES = 12,
  SLAB_NBYTES = 8,
  MAX_VIEWS = 4096,
  MAX_VERTICES = 1 << 24,
  MAX_TRIANGLES = 1 << 25
};

#define FOURCC(a, b, c, d)                                                                         \
  ((uint32_t)(a) | (uint32_t)(b) << 8 | (uint32_t)(c) << 16 | (uint32_t)(d) << 24)

enum {
  CHUNK_SCENE = FOURCC('S', 'C', 'E', 'N'),
  CHUNK_MESH = FOURCC('M', 'E', 'S', 'H'),
  CHUNK_SLAB = FOURCC('S', 'L', 'A', 'B'),
  CHUNK_LAYER = FOURCC('L', 'A', 'Y', 'R'),
  /* The streams of a layer, in the order of stream_kind. */
  CHUNK_BASE = FOURCC('B', 'A', 'S', 'E'),
  CHUNK_KEYS = FOURCC('K', 'E', 'Y', 'S'),
  CHUNK_REST = FOURCC('R', 'E', 'S', 'T')
};

extern const uint8_t slf_magic[8];

/* No thickness, or one of a solid that bends light. */
static inline bool slab_is_valid(const slf_slab *s) {
  return s->thickness == 0 ||
         (s->thickness > 0 && s->thickness < 1e30f && s->ior > 1 && s->ior < 1e3f);
}
extern const uint32_t slf_stream_chunks[3]; /* types, by stream_kind */

/* One place for each way a chunk's bytes become numbers: little-endian, byte by byte. */
static inline uint32_t get_u16(const uint8_t *p) {
  return (uint32_t)p[0] | (uint32_t)p[1] << 8;
}
static inline uint32_t get_u32(const uint8_t *p) {
  return get_u16(p) | get_u16(p + 2) << 16;
}
static inline uint64_t get_u64(const uint8_t *p) {
  return (uint64_t)get_u32(p) | (uint64_t)get_u32(p + 4) << 32;
}
static inline uint64_t get_u48(const uint8_t *p) {
  return (uint64_t)get_u32(p) | (uint64_t)get_u16(p + 4) << 32;
}
static inline float get_f32(const uint8_t *p) {
  uint32_t bits = get_u32(p);
  float value;
  memcpy(&value, &bits, sizeof value);
  return value;
}
static inline void put_u16(uint8_t *p, uint32_t value) {
  p[0] = (uint8_t)value;
  p[1] = (uint8_t)(value >> 8);
}
static inline void put_u32(uint8_t *p, uint32_t value) {
  put_u16(p, value);
  put_u16(p + 2, value >> 16);
}
static inline void put_u64(uint8_t *p, uint64_t value) {
  put_u32(p, (uint32_t)value);
  put_u32(p + 4, (uint32_t)(value >> 32));
}
static inline void put_u48(uint8_t *p, uint64_t value) {
  put_u32(p, (uint32_t)value);
  put_u16(p + 4, (uint32_t)(value >> 32));
}
static inline void put_f32(uint8_t *p, float value) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof bits);
  put_u32(p, bits);
}

/* CRC-32 of IEEE 802.3 (the one of PNG and zlib); the second goes on from the CRC of what is
 * before.
 */
uint32_t slf_crc32(const void *bytes, size_t nbytes);
uint32_t slf_crc32_more(uint32_t crc, const void *bytes, size_t nbytes);

/* Fills *error (which may be NULL) and returns code. */
slf_result slf_fail(slf_error *error, slf_result code, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

#endif
