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

void reader_begin(bit_reader *r, const block_stream *blocks, uint64_t bit) {
  uint64_t end = blocks->nbytes - STREAM_PAD_NBYTES;
  /* At most 8 bytes of what was loaded are still to be read: good blocks never meet this bound. */
  *r = (bit_reader){0, 0, blocks->bytes + bit / 8, blocks->bytes + end + 8};
  refill(r);
  consume(r, bit % 8);
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
  uint32_t entry = tables->dc[code - CODE_DC][r->bits >> (64 - FAST_DC_BITS)];
  if (__builtin_expect(fast_taken(entry) != 0, 1)) {
    consume(r, fast_taken(entry));
    *level = (int32_t)entry >> 16;
    return true;
  }
  unsigned bits, size = read_symbol(&tables->decoders[code], r, &bits);
  if (bits == 0 || size > 15) return false;
  *level = extend(take(r, size), size);
  return true;
}

/* A symbol that no table entry holds; refilled before. False if the channel cannot go on. */
static __attribute__((noinline)) bool parse_long(const huffman_decoder *decoder, bit_reader *r,
                                                 bool skips, unsigned *k, int16_t *levels,
                                                 bool *end) {
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
  if (!skips) add_level(&levels[slf_zigzag[*k]], level);
  return true;
}

/* A channel's AC levels; levels are added, or where `skips` is set, passed over. */
static inline __attribute__((always_inline)) bool
parse_ac(const block_tables *tables, int code, bit_reader *r, bool skips, int16_t *levels) {
  const uint32_t *table = tables->ac[code - CODE_AC];
  unsigned k = 0;
  for (;;) {
    if (__builtin_expect(r->count < FAST_BITS, 0)) refill(r);
    uint32_t entry = table[r->bits >> (64 - FAST_BITS)];
    if (__builtin_expect(fast_taken(entry) == 0, 0)) {
      bool end = false;
      refill(r);
      if (!parse_long(&tables->decoders[code], r, skips, &k, levels, &end)) return false;
      if (end) return true;
    } else {
      consume(r, fast_taken(entry));
      k += fast_step(entry);
      if (!skips) add_level(&levels[slf_zigzag[k]], fast_level(entry));
      k += fast_second_step(entry);
      if (!skips) add_level(&levels[slf_zigzag[k]], fast_second_level(entry));
      if (entry & FAST_END) return true;
    }
    if (__builtin_expect(k >= COEFFICIENTS, 0)) return false;
    code |= 1;
    table = tables->ac[code - CODE_AC];
  }
}

static inline bool parse_head(const block_tables *tables, bit_reader *r, unsigned *head) {
  refill(r);
  unsigned entry = tables->head[r->bits >> (64 - FAST_DC_BITS)], bits = entry & 255;
  *head = entry >> 8;
  if (bits)
    consume(r, bits);
  else
    *head = read_symbol(&tables->decoders[CODE_HEAD], r, &bits);
  return bits != 0 && *head >> 3 < PREDICTOR_COUNT;
}

/* Shifts are coded as -16 .. 15, plus 16. */
static bool parse_shift(const block_tables *tables, bit_reader *r, int *shift) {
  unsigned bits, symbol = read_symbol(&tables->decoders[CODE_SHIFT], r, &bits);
  *shift = (int)symbol - 16;
  return bits != 0 && symbol < 32;
}

static inline __attribute__((always_inline)) bool parse_levels(const block_tables *tables,
                                                               unsigned head, bit_reader *r,
                                                               bool skips, entry_state *state) {
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
    if (!skips) add_level(&state->levels[channel][0], dc);
    int code = ac_code(residual, channel > 0, 0);
    if (coded && !parse_ac(tables, code, r, skips, state->levels[channel])) return false;
  }
  return true;
}

/* In wide stores: what a compiler makes of memset for so few bytes takes longer to begin. */
static inline void clear_levels(entry_state *state) {
  typedef uint64_t wide __attribute__((vector_size(32), aligned(2), may_alias));
  wide *to = (wide *)(void *)state->levels;
#pragma GCC unroll 15
  for (size_t i = 0; i < sizeof state->levels / sizeof *to; i++) to[i] = (wide){0};
}

/* Field by field, so that they stay in registers. */
static inline bit_reader reader_copy(const bit_reader *r) {
  return (bit_reader){r->bits, r->count, r->next, r->last};
}

static inline void reader_update(bit_reader *to, const bit_reader *r) {
  to->bits = r->bits;
  to->count = r->count;
  to->next = r->next;
}

bool block_parse(const block_tables *tables, bit_reader *reader, uint32_t number, bool first,
                 entry_state *state) {
  bit_reader r = reader_copy(reader);
  unsigned head;
  bool good = parse_head(tables, &r, &head);
  if (good && head >> 3 != PREDICT_PREVIOUS) {
    clear_levels(state);
    state->ac_flags = 0;
    state->predictor = head >> 3;
    state->anchor = number;
    if (head >> 3 == PREDICT_SHIFT)
      good = parse_shift(tables, &r, &state->shift_u) && parse_shift(tables, &r, &state->shift_v);
  } else if (first) {
    good = false;
    clear_levels(state);
  }
  state->ac_flags |= head & 7;
  good = good && parse_levels(tables, head, &r, false, state);
  reader_update(reader, &r);
  return good;
}

bool block_skip(const block_tables *tables, bit_reader *reader, entry_state *state,
                bool *leans_on_previous) {
  bit_reader r = reader_copy(reader);
  unsigned head;
  int shift;
  bool good = parse_head(tables, &r, &head);
  *leans_on_previous = head >> 3 == PREDICT_PREVIOUS;
  if (good && head >> 3 == PREDICT_SHIFT)
    good = parse_shift(tables, &r, &shift) && parse_shift(tables, &r, &shift);
  good = good && parse_levels(tables, head, &r, true, state);
  reader_update(reader, &r);
  return good;
}

bool block_leans_on_previous(const block_tables *tables, const bit_reader *reader) {
  bit_reader r = reader_copy(reader);
  unsigned head;
  return parse_head(tables, &r, &head) && head >> 3 == PREDICT_PREVIOUS;
}
