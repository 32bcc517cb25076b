/* huffman.h - canonical Huffman codes of at most 16 bits over symbols of one byte. */
#ifndef SLF_HUFFMAN_H
#define SLF_HUFFMAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { CODE_MAX_BITS = 16 };

/* The code as the file states it: how many symbols have 1 .. 16 bits, and the symbols in the order
 * of their codes (ISO/IEC 10918-1, annex C). */
typedef struct {
  uint16_t length_counts[CODE_MAX_BITS + 1]; /* [0] unused */
  uint16_t symbol_count;
  uint8_t symbols[256];
} huffman_code;

/* For writing: bits[s] is 0 for a symbol without a code. */
typedef struct {
  uint16_t codes[256];
  uint8_t bits[256];
} huffman_encoder;

/* For reading one symbol from the 16 bits that come next. */
typedef struct {
  uint32_t limits[CODE_MAX_BITS + 2]; /* codes of n bits are below limits[n], left-aligned to 16 */
  int32_t offsets[CODE_MAX_BITS + 1]; /* code >> (16 - n) plus this indexes symbols */
  uint8_t symbols[256];
} huffman_decoder;

/* The best code for symbols that occur counts[s] times; symbols with count 0 get none. */
void huffman_build(const uint64_t counts[256], huffman_code *code);

/* The code as bytes: 16 counts of one byte, then the symbols. */
enum { HUFFMAN_MAX_NBYTES = 16 + 256 };
size_t huffman_put(const huffman_code *code, uint8_t *bytes);

/* Reads it back; 0 if the bytes are not a prefix code (Kraft's sum above one, a symbol twice, no
 * symbol), else how many bytes it took. */
size_t huffman_get(const uint8_t *bytes, size_t nbytes, huffman_code *code);

void huffman_make_encoder(const huffman_code *code, huffman_encoder *encoder);
void huffman_make_decoder(const huffman_code *code, huffman_decoder *decoder);

/* The symbol that `window`'s top bits (of 16) code; its length at *bits, 0 if there is none. */
static inline unsigned huffman_read(const huffman_decoder *decoder, unsigned first_bits,
                                    uint32_t window, unsigned *bits) {
  for (unsigned n = first_bits; n <= CODE_MAX_BITS; n++)
    if (window < decoder->limits[n]) {
      *bits = n;
      return decoder
          ->symbols[(uint8_t)((int32_t)(window >> (CODE_MAX_BITS - n)) + decoder->offsets[n])];
    }
  *bits = 0;
  return 0;
}

#endif
