/* parse.c - from the bits of a C-Block to levels. Compiled for each kernel: see kernel.h. */
#include "codec/kernel.h"

/* ---- Bits ---------------------------------------------------------------------------------- */

static inline uint64_t load_be64(const uint8_t *p) {
  uint64_t value;
  memcpy(&value, p, sizeof value);
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  value = __builtin_bswap64(value);
#endif
  return value;
}

/* The next `count` bits at the top of `bits`. Beyond `last` the bytes there repeat: loads stay
 * inside the stream's padding, and a C-Block that runs there is damaged and comes out as some
 * levels. */
typedef struct {
  uint64_t bits;
  int count;
  const uint8_t *next, *last;
} bit_reader;

/* 56 bits or more (Giesen 2018, "Reading bits in far too many ways", variant 4). */
static inline void refill(bit_reader *r) {
  r->next = r->next < r->last ? r->next : r->last;
  r->bits |= load_be64(r->next) >> r->count;
  r->next += (63 - r->count) >> 3;
  r->count |= 56;
}

static inline void consume(bit_reader *r, unsigned count) {
  r->bits <<= count;
  r->count -= (int)count;
}

static inline uint32_t top_bits(uint64_t bits, unsigned count) {
  return (uint32_t)(bits >> 1 >> (63 - count));
}

static inline uint32_t take(bit_reader *r, unsigned count) {
  uint32_t value = top_bits(r->bits, count);
  consume(r, count);
  return value;
}

static bit_reader reader_at(const bit_cursor *cursor) {
  uint64_t bit = cursor->bit < cursor->end_bit ? cursor->bit : cursor->end_bit;
  /* At most 8 bytes of what was loaded are still to be read: good blocks never meet this bound. */
  bit_reader r = {0, 0, cursor->bytes + bit / 8, cursor->bytes + cursor->end_bit / 8 + 8};
  refill(&r);
  consume(&r, bit % 8);
  return r;
}

static uint64_t reader_bit(const bit_reader *r, const bit_cursor *cursor) {
  return (uint64_t)(r->next - cursor->bytes) * 8 - (uint64_t)r->count;
}

/* ---- Symbols ------------------------------------------------------------------------------- */

static inline void add_level(int16_t *level, int32_t more) {
  *level = (int16_t)(uint16_t)((uint32_t)*level + (uint32_t)more);
}

/* A symbol of at most 16 bits; *bits is 0 if there is none. */
static inline unsigned read_symbol(const huffman_decoder *decoder, bit_reader *r, unsigned *bits) {
  unsigned symbol = huffman_read(decoder, 1, top_bits(r->bits, 16), bits);
  consume(r, *bits);
  return symbol;
}

static inline bool parse_dc(const block_tables *tables, int code, bit_reader *r, int32_t *level) {
  uint64_t entry = tables->dc[code - CODE_DC][r->bits >> (64 - FAST_BITS)];
  if (__builtin_expect((entry & 255) != 0, 1)) {
    consume(r, entry & 255);
    *level = (int16_t)(entry >> 32);
    return true;
  }
  unsigned bits, size = read_symbol(&tables->decoders[code], r, &bits);
  if (bits == 0 || size > 15) return false;
  *level = extend(take(r, size), size);
  return true;
}

/* A symbol that no table entry holds; refilled before. False if the channel cannot go on. */
static __attribute__((noinline)) bool parse_long(const huffman_decoder *decoder, bit_reader *r,
                                                 unsigned *k, int16_t *levels, bool *end) {
  unsigned bits, symbol = read_symbol(decoder, r, &bits), size = symbol & 15;
  int32_t level = 0;
  if (bits == 0) return false;
  if (symbol == SYMBOL_END) {
    *end = true;
    return true;
  }
  if (symbol == SYMBOL_ESCAPE) {
    *k += take(r, 6) + 1;
    level = (int16_t)take(r, 16);
  } else if (symbol == SYMBOL_RUN_16) {
    *k += 16;
  } else if (size) {
    *k += (symbol >> 4) + 1;
    level = extend(take(r, size), size);
  } else {
    return false;
  }
  add_level(&levels[slf_zigzag[*k]], level);
  return true;
}

static inline bool parse_ac(const block_tables *tables, int code, bit_reader *r, int16_t *levels) {
  const uint64_t *table = tables->ac[code - CODE_AC];
  unsigned k = 0;
  for (;;) {
    if (__builtin_expect(r->count < FAST_BITS, 0)) refill(r);
    uint64_t entry = table[r->bits >> (64 - FAST_BITS)];
    if (__builtin_expect((entry & 255) == 0, 0)) {
      bool end = false;
      refill(r);
      if (!parse_long(&tables->decoders[code], r, &k, levels, &end)) return false;
      if (end) return true;
    } else {
      consume(r, entry & 255);
      k += entry >> 8 & 255;
      int16_t *first = &levels[slf_zigzag[k]];
      k += entry >> 16 & 255;
      int16_t *second = &levels[slf_zigzag[k]];
      add_level(first, (int16_t)(entry >> 32));
      add_level(second, (int16_t)(entry >> 48));
      if (entry >> 24 & 1) return true;
    }
    if (__builtin_expect(k >= COEFFICIENTS, 0)) return false;
    code |= 1;
    table = tables->ac[code - CODE_AC];
  }
}

static bool parse_head(const block_tables *tables, bit_reader *r, unsigned *head) {
  unsigned entry = tables->head[r->bits >> (64 - FAST_BITS)], bits = entry & 255;
  *head = entry >> 8;
  if (bits)
    consume(r, bits);
  else
    *head = read_symbol(&tables->decoders[CODE_HEAD], r, &bits);
  return bits != 0 && *head >> 3 < PREDICTOR_COUNT;
}

/* Shifts are coded as their size over -16 .. 15, plus 16. */
static bool parse_shift(const block_tables *tables, bit_reader *r, int *shift) {
  unsigned bits, symbol = read_symbol(&tables->decoders[CODE_SHIFT], r, &bits);
  *shift = (int)symbol - 16;
  return bits != 0 && symbol < 32;
}

static bool parse_levels(const block_tables *tables, unsigned head, bit_reader *r,
                         entry_state *state) {
  int residual = head >> 3 != PREDICT_INTRA;
  for (int channel = 0; channel < 3; channel++) {
    bool coded = head >> channel & 1;
    if (residual && !coded) continue;
    int32_t dc;
    refill(r);
    if (!parse_dc(tables, dc_code(residual, channel > 0), r, &dc)) return false;
    if (!residual) {
      add_level(&state->intra_dc[channel], dc);
      dc = state->intra_dc[channel];
    }
    add_level(&state->levels[channel][0], dc);
    if (coded && !parse_ac(tables, ac_code(residual, channel > 0, 0), r, state->levels[channel]))
      return false;
  }
  return true;
}

bool block_parse(const block_tables *tables, bit_cursor *cursor, uint32_t number, bool first,
                 entry_state *state) {
  bit_reader r = reader_at(cursor);
  unsigned head;
  bool good = parse_head(tables, &r, &head);
  if (good && head >> 3 != PREDICT_PREVIOUS) {
    memset(state->levels, 0, sizeof state->levels);
    state->ac_flags = 0;
    state->predictor = head >> 3;
    state->anchor = number;
    if (head >> 3 == PREDICT_SHIFT)
      good = parse_shift(tables, &r, &state->shift_u) && parse_shift(tables, &r, &state->shift_v);
  } else if (first) {
    good = false;
    memset(state->levels, 0, sizeof state->levels);
  }
  state->ac_flags |= head & 7;
  good = good && parse_levels(tables, head, &r, state);
  cursor->bit = reader_bit(&r, cursor);
  return good;
}
