#include "codec/format.h"

#include <stdarg.h>
#include <stdio.h>

/* As PNG's: the high bit and the two line ends catch a transfer that was not binary. */
const uint8_t slf_magic[8] = {0x89, 'S', 'L', 'F', '\r', '\n', 0x1a, '\n'};
const uint32_t slf_stream_chunks[3] = {CHUNK_BASE, CHUNK_KEYS, CHUNK_REST};

const char *slf_version(void) {
  return "1.0.0";
}

slf_result slf_fail(slf_error *error, slf_result code, const char *format, ...) {
  if (error) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(error->message, sizeof error->message, format, arguments);
    va_end(arguments);
  }
  return code;
}

/* Slicing by eight (Kounavis and Berry 2005). The tables are made for each call: 2,304 steps beside
 * the chunk's bytes, and no global state. */
uint32_t slf_crc32(const void *bytes, size_t nbytes) {
  return slf_crc32_more(0, bytes, nbytes);
}

uint32_t slf_crc32_more(uint32_t crc, const void *bytes, size_t nbytes) {
  uint32_t table[8][256];
  for (uint32_t i = 0; i < 256; i++) {
    uint32_t entry = i;
    for (int bit = 0; bit < 8; bit++) entry = entry >> 1 ^ (entry & 1 ? 0xedb88320u : 0);
    table[0][i] = entry;
  }
  for (uint32_t i = 0; i < 256; i++)
    for (int slice = 1; slice < 8; slice++) {
      uint32_t entry = table[slice - 1][i];
      table[slice][i] = entry >> 8 ^ table[0][entry & 255];
    }
  const uint8_t *p = bytes;
  crc = ~crc;
  for (; nbytes >= 8; nbytes -= 8, p += 8) {
    uint32_t low = crc ^ get_u32(p), high = get_u32(p + 4);
    crc = table[7][low & 255] ^ table[6][low >> 8 & 255] ^ table[5][low >> 16 & 255] ^
          table[4][low >> 24] ^ table[3][high & 255] ^ table[2][high >> 8 & 255] ^
          table[1][high >> 16 & 255] ^ table[0][high >> 24];
  }
  for (; nbytes; nbytes--, p++) crc = crc >> 8 ^ table[0][(crc ^ *p) & 255];
  return ~crc;
}
