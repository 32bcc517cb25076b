/* kernel.c - from the bits of a C-Block to texels. */
#include "codec/layer.h"

#include <stdlib.h>

/* ---- Bits ---------------------------------------------------------------------------------------
 */

static inline uint64_t load_be64(const uint8_t *p) {
  uint64_t value;
  memcpy(&value, p, sizeof value);
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  value = __builtin_bswap64(value);
#endif
  return value;
}

/* The next 57 bits or more, at the top. Beyond the end the last bytes repeat: loads stay inside the
 * stream's padding, and a block that runs there is damaged and comes out as some texels. */
static inline uint64_t peek(const bit_cursor *cursor) {
  uint64_t bit = cursor->bit < cursor->end_bit ? cursor->bit : cursor->end_bit;
  return load_be64(cursor->bytes + bit / 8) << bit % 8;
}

/* JPEG's magnitude bits (ISO/IEC 10918-1, F.1.2.1): size bits, negative where the first is 0. */
static inline int32_t extend(uint32_t value, unsigned size) {
  return size && value >> (size - 1) == 0 ? (int32_t)value - (int32_t)((1u << size) - 1)
                                          : (int32_t)value;
}

static inline uint32_t top_bits(uint64_t bits, unsigned count) {
  return (uint32_t)(bits >> 1 >> (63 - count));
}

/* ---- Tables -------------------------------------------------------------------------------------
 */

/* One AC symbol with its level out of `bits` bits; what it takes at *taken, 0 if it is not whole.
 */
typedef struct {
  unsigned taken, step;
  int32_t level;
  bool end;
} ac_token;

static ac_token token_in_window(const huffman_decoder *decoder, uint32_t window, unsigned bits) {
  ac_token token = {0};
  unsigned code_bits, symbol = huffman_read(decoder, 1, window << (16 - bits), &code_bits);
  unsigned size = symbol & 15, taken = code_bits + size;
  if (code_bits == 0 || taken > bits || symbol == SYMBOL_ESCAPE) return token;
  if (size == 0 && symbol != SYMBOL_END && symbol != SYMBOL_RUN_16) return token;
  token.taken = taken;
  token.end = symbol == SYMBOL_END;
  token.step = symbol == SYMBOL_RUN_16 ? 16 : (symbol >> 4) + 1;
  uint32_t magnitude = window >> (bits - taken) & ((1u << size) - 1);
  token.level = extend(magnitude, size);
  return token;
}

static uint64_t ac_entry(const huffman_decoder *decoder, uint32_t window) {
  ac_token first = token_in_window(decoder, window, FAST_AC_BITS);
  if (first.taken == 0) return 0;
  if (first.end) return first.taken | 64u << 8 | 1u << 24;
  uint64_t taken = first.taken, step = 0;
  int32_t level = first.level;
  bool end = false;
  unsigned left = FAST_AC_BITS - first.taken;
  for (int more = 0; more < 2 && left; more++) {
    ac_token next = token_in_window(decoder, window & ((1u << left) - 1), left);
    if (next.taken == 0 || (more && !next.end)) break;
    taken += next.taken;
    left -= next.taken;
    if ((end = next.end)) break;
    step = next.step;
    level = next.level;
  }
  return taken | (uint64_t)first.step << 8 | step << 16 | (uint64_t)end << 24 |
         (uint64_t)(uint16_t)first.level << 32 | (uint64_t)(uint16_t)level << 48;
}

static uint64_t dc_entry(const huffman_decoder *decoder, uint32_t window) {
  unsigned code_bits, size = huffman_read(decoder, 1, window << (16 - FAST_DC_BITS), &code_bits);
  unsigned taken = code_bits + size;
  if (code_bits == 0 || taken > FAST_DC_BITS) return 0;
  int32_t level = extend(window >> (FAST_DC_BITS - taken) & ((1u << size) - 1), size);
  return taken | (uint64_t)(uint16_t)level << 32;
}

void block_code_make(const huffman_code codes[CODE_COUNT], block_code *code) {
  for (int i = 0; i < CODE_COUNT; i++) huffman_make_decoder(&codes[i], &code->decoders[i]);
  for (int chroma = 0; chroma < 2; chroma++) {
    for (uint32_t w = 0; w < 1u << FAST_AC_BITS; w++)
      code->ac[chroma][w] = ac_entry(&code->decoders[CODE_AC_LUMA + chroma], w);
    for (uint32_t w = 0; w < 1u << FAST_DC_BITS; w++)
      code->dc[chroma][w] = dc_entry(&code->decoders[CODE_DC_LUMA + chroma], w);
  }
}

/* ---- Parsing ------------------------------------------------------------------------------------
 */

/* Place of the k-th level; a damaged block may step as far as 63 + 64 + 16, into the spare room. */
static const uint8_t places[COEFFICIENTS + 80] = {
    0,  1,  8,  16, 9,  2,  3,  10, 17, 24, 32, 25, 18, 11, 4,  5,  12, 19, 26, 33, 40, 48, 41, 34,
    27, 20, 13, 6,  7,  14, 21, 28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51,
    58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63, 64, 64, 64, 64, 64, 64, 64, 64,
    64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64,
    64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64,
    64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64};

static bool parse_dc(const block_code *code, int chroma, bit_cursor *cursor, int16_t *level) {
  uint64_t bits = peek(cursor), entry = code->dc[chroma][bits >> (64 - FAST_DC_BITS)];
  if (entry & 255) {
    cursor->bit += entry & 255;
    *level = (int16_t)(entry >> 32);
    return true;
  }
  unsigned code_bits;
  unsigned size =
      huffman_read(&code->decoders[CODE_DC_LUMA + chroma], 1, top_bits(bits, 16), &code_bits);
  if (code_bits == 0 || size > 15) return false;
  *level = (int16_t)extend(top_bits(bits << code_bits, size), size);
  cursor->bit += code_bits + size;
  return true;
}

/* A symbol that no table entry holds. False if the channel cannot go on. */
static bool parse_slow(const huffman_decoder *decoder, bit_cursor *cursor, unsigned *k,
                       int16_t *levels, bool *end) {
  uint64_t bits = peek(cursor);
  unsigned code_bits, symbol = huffman_read(decoder, 1, top_bits(bits, 16), &code_bits);
  unsigned size = symbol & 15;
  int32_t level = 0;
  if (code_bits == 0) return false;
  bits <<= code_bits;
  cursor->bit += code_bits;
  if (symbol == SYMBOL_END) {
    *end = true;
    return true;
  }
  if (symbol == SYMBOL_ESCAPE) {
    *k += top_bits(bits, 6) + 1;
    level = (int16_t)top_bits(bits << 6, 16);
    cursor->bit += 22;
  } else if (symbol == SYMBOL_RUN_16) {
    *k += 16;
  } else if (size) {
    *k += (symbol >> 4) + 1;
    level = extend(top_bits(bits, size), size);
    cursor->bit += size;
  } else {
    return false;
  }
  levels[places[*k]] = (int16_t)level;
  return true;
}

static bool parse_channel(const block_code *code, int chroma, bit_cursor *cursor, int16_t *levels) {
  if (!parse_dc(code, chroma, cursor, &levels[0])) return false;
  const uint64_t *table = code->ac[chroma];
  unsigned k = 0;
  for (;;) {
    uint64_t entry = table[peek(cursor) >> (64 - FAST_AC_BITS)];
    if ((entry & 255) == 0) {
      bool end = false;
      if (!parse_slow(&code->decoders[CODE_AC_LUMA + chroma], cursor, &k, levels, &end))
        return false;
      if (end) return true;
    } else {
      cursor->bit += entry & 255;
      k += entry >> 8 & 255;
      levels[places[k]] = (int16_t)(entry >> 32);
      k += entry >> 16 & 255;
      levels[places[k]] = (int16_t)(entry >> 48);
      if (entry >> 24 & 1) return true;
    }
    if (k >= COEFFICIENTS) return false;
  }
}

bool kernel_parse(const block_code *code, bit_cursor *cursor, int16_t levels[3][LEVELS_STRIDE]) {
  memset(levels, 0, 3 * LEVELS_STRIDE * sizeof levels[0][0]);
  for (int channel = 0; channel < 3; channel++)
    if (!parse_channel(code, channel > 0, cursor, levels[channel])) return false;
  return true;
}

/* ---- Transform ----------------------------------------------------------------------------------
 */

/* Arai, Agui and Nakajima's inverse on the columns of 8 rows, all eight columns side by side. */
static inline void inverse_columns(float b[8][8]) {
  for (int i = 0; i < 8; i++) {
    float even0 = b[0][i] + b[4][i], even1 = b[0][i] - b[4][i];
    float even3 = b[2][i] + b[6][i];
    float even2 = (b[2][i] - b[6][i]) * 1.414213562f - even3;
    float x0 = even0 + even3, x3 = even0 - even3, x1 = even1 + even2, x2 = even1 - even2;
    float z13 = b[5][i] + b[3][i], z10 = b[5][i] - b[3][i];
    float z11 = b[1][i] + b[7][i], z12 = b[1][i] - b[7][i];
    float y7 = z11 + z13;
    float y11 = (z11 - z13) * 1.414213562f;
    float z5 = (z10 + z12) * 1.847759065f;
    float y10 = z5 - z12 * 1.082392200f, y12 = z5 - z10 * 2.613125930f;
    float y6 = y12 - y7, y5 = y11 - y6, y4 = y10 - y5;
    b[0][i] = x0 + y7;
    b[7][i] = x0 - y7;
    b[1][i] = x1 + y6;
    b[6][i] = x1 - y6;
    b[2][i] = x2 + y5;
    b[5][i] = x2 - y5;
    b[3][i] = x3 + y4;
    b[4][i] = x3 - y4;
  }
}

static inline void transpose(float b[8][8]) {
  for (int y = 0; y < 8; y++)
    for (int x = 0; x < y; x++) {
      float swap = b[y][x];
      b[y][x] = b[x][y];
      b[x][y] = swap;
    }
}

void inverse_dct(float block[COEFFICIENTS]) {
  float(*b)[8] = (float(*)[8])block;
  inverse_columns(b);
  transpose(b);
  inverse_columns(b);
  transpose(b);
}

void forward_dct(const float texels[COEFFICIENTS], float coefficients[COEFFICIENTS]) {
  /* Half the cosines of (2x + 1) k pi / 16; row 0 times sqrt(1/2). */
  static const float c[8][8] = {{0.35355339f, 0.35355339f, 0.35355339f, 0.35355339f, 0.35355339f,
                                 0.35355339f, 0.35355339f, 0.35355339f},
                                {0.49039264f, 0.41573481f, 0.27778512f, 0.09754516f, -0.09754516f,
                                 -0.27778512f, -0.41573481f, -0.49039264f},
                                {0.46193977f, 0.19134172f, -0.19134172f, -0.46193977f, -0.46193977f,
                                 -0.19134172f, 0.19134172f, 0.46193977f},
                                {0.41573481f, -0.09754516f, -0.49039264f, -0.27778512f, 0.27778512f,
                                 0.49039264f, 0.09754516f, -0.41573481f},
                                {0.35355339f, -0.35355339f, -0.35355339f, 0.35355339f, 0.35355339f,
                                 -0.35355339f, -0.35355339f, 0.35355339f},
                                {0.27778512f, -0.49039264f, 0.09754516f, 0.41573481f, -0.41573481f,
                                 -0.09754516f, 0.49039264f, -0.27778512f},
                                {0.19134172f, -0.46193977f, 0.46193977f, -0.19134172f, -0.19134172f,
                                 0.46193977f, -0.46193977f, 0.19134172f},
                                {0.09754516f, -0.27778512f, 0.41573481f, -0.49039264f, 0.49039264f,
                                 -0.41573481f, 0.27778512f, -0.09754516f}};
  float rows[8][8]; /* transformed down the columns */
  for (int k = 0; k < 8; k++) {
    float sum[8] = {0};
    for (int y = 0; y < 8; y++)
      for (int x = 0; x < 8; x++) sum[x] += c[k][y] * texels[8 * y + x];
    memcpy(rows[k], sum, sizeof sum);
  }
  for (int k = 0; k < 8; k++)
    for (int j = 0; j < 8; j++) {
      float sum = 0;
      for (int x = 0; x < 8; x++) sum += c[j][x] * rows[k][x];
      coefficients[8 * k + j] = sum;
    }
}

/* ---- Texels -------------------------------------------------------------------------------------
 */

static inline uint8_t to_byte(float value) {
  value = value > 0 ? value : 0;
  value = value < 255 ? value : 255;
  return (uint8_t)(int)(value + 0.5f);
}

void kernel_reconstruct(const layer_state *layer, int16_t levels[3][LEVELS_STRIDE],
                        uint8_t *u_block) {
  float channels[3][COEFFICIENTS];
  for (int c = 0; c < 3; c++) {
    for (int i = 0; i < COEFFICIENTS; i++) channels[c][i] = levels[c][i] * layer->scales[c][i];
    inverse_dct(channels[c]);
  }
  /* JFIF's colours; the level shift of 128 is luma's alone. */
  for (int i = 0; i < COEFFICIENTS; i++) {
    float luma = channels[0][i] + 128, cb = channels[1][i], cr = channels[2][i];
    u_block[4 * i + 0] = to_byte(luma + 1.402f * cr);
    u_block[4 * i + 1] = to_byte(luma - 0.344136f * cb - 0.714136f * cr);
    u_block[4 * i + 2] = to_byte(luma + 1.772f * cb);
    u_block[4 * i + 3] = 255;
  }
}
