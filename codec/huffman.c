#include "codec/huffman.h"

#include <string.h>

/* Code lengths by Huffman's algorithm; the longest is returned. 256 symbols make a simple search
 * for the two least counts cheap enough. */
static int code_lengths(const uint64_t counts[256], uint8_t lengths[256]) {
  uint64_t weights[511];
  int16_t parents[511];
  int live[256], live_count = 0, node_count = 256;
  for (int s = 0; s < 256; s++) {
    lengths[s] = 0;
    weights[s] = counts[s];
    if (counts[s]) live[live_count++] = s;
  }
  if (live_count == 1) {
    lengths[live[0]] = 1;
    return 1;
  }
  while (live_count > 1) {
    for (int pick = 0; pick < 2; pick++) { /* the two lightest to the end of the list */
      int last = live_count - 1 - pick, lightest = last;
      for (int i = 0; i < last; i++)
        if (weights[live[i]] < weights[live[lightest]]) lightest = i;
      int node = live[lightest];
      live[lightest] = live[last];
      live[last] = node;
    }
    int a = live[live_count - 1], b = live[live_count - 2];
    parents[a] = parents[b] = (int16_t)node_count;
    weights[node_count] = weights[a] + weights[b];
    live_count--;
    live[live_count - 1] = node_count++;
  }
  int longest = 0, root = node_count - 1;
  for (int s = 0; s < 256; s++) {
    if (!counts[s]) continue;
    int length = 0;
    for (int node = s; node != root; node = parents[node]) length++;
    lengths[s] = (uint8_t)length;
    if (length > longest) longest = length;
  }
  return longest;
}

void huffman_build(const uint64_t counts[256], huffman_code *code) {
  uint64_t flat[256];
  uint8_t lengths[256];
  memcpy(flat, counts, sizeof flat);
  /* Halving the counts flattens the code until it fits; 256 equal counts give 8 bits. */
  while (code_lengths(flat, lengths) > CODE_MAX_BITS)
    for (int s = 0; s < 256; s++)
      if (flat[s]) flat[s] = flat[s] / 2 + 1;
  memset(code, 0, sizeof *code);
  for (int n = 1; n <= CODE_MAX_BITS; n++)
    for (int s = 0; s < 256; s++)
      if (lengths[s] == n) {
        code->length_counts[n]++;
        code->symbols[code->symbol_count++] = (uint8_t)s;
      }
}

size_t huffman_put(const huffman_code *code, uint8_t *bytes) {
  for (int n = 1; n <= CODE_MAX_BITS; n++) bytes[n - 1] = (uint8_t)code->length_counts[n];
  memcpy(bytes + CODE_MAX_BITS, code->symbols, code->symbol_count);
  return CODE_MAX_BITS + (size_t)code->symbol_count;
}

size_t huffman_get(const uint8_t *bytes, size_t nbytes, huffman_code *code) {
  memset(code, 0, sizeof *code);
  if (nbytes < CODE_MAX_BITS) return 0;
  uint32_t kraft = 0, count = 0;
  for (int n = 1; n <= CODE_MAX_BITS; n++) {
    code->length_counts[n] = bytes[n - 1];
    count += bytes[n - 1];
    kraft += (uint32_t)bytes[n - 1] << (CODE_MAX_BITS - n);
  }
  if (count == 0 || count > 256 || kraft > 1u << CODE_MAX_BITS || nbytes - CODE_MAX_BITS < count)
    return 0;
  bool seen[256] = {false};
  for (uint32_t i = 0; i < count; i++) {
    uint8_t symbol = bytes[CODE_MAX_BITS + i];
    if (seen[symbol]) return 0;
    seen[symbol] = true;
    code->symbols[i] = symbol;
  }
  code->symbol_count = (uint16_t)count;
  return CODE_MAX_BITS + count;
}

void huffman_make_encoder(const huffman_code *code, huffman_encoder *encoder) {
  memset(encoder, 0, sizeof *encoder);
  uint32_t next = 0, index = 0;
  for (int n = 1; n <= CODE_MAX_BITS; n++, next <<= 1)
    for (int i = 0; i < code->length_counts[n]; i++, next++, index++) {
      encoder->codes[code->symbols[index]] = (uint16_t)next;
      encoder->bits[code->symbols[index]] = (uint8_t)n;
    }
}

void huffman_make_decoder(const huffman_code *code, huffman_decoder *decoder) {
  memset(decoder, 0, sizeof *decoder);
  memcpy(decoder->symbols, code->symbols, sizeof decoder->symbols);
  uint32_t next = 0, index = 0;
  for (int n = 1; n <= CODE_MAX_BITS; n++, next <<= 1) {
    decoder->offsets[n] = (int32_t)index - (int32_t)next;
    next += code->length_counts[n];
    index += code->length_counts[n];
    decoder->limits[n] = next << (CODE_MAX_BITS - n);
  }
}
