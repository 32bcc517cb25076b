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

void reader_skip(bit_reader *reader, unsigned bit_count) {
  refill(reader);
  consume(reader, bit_count);
}

/* ---- Symbols ------------------------------------------------------------------------------- */

static inline void add_level(int16_t *level, int32_t more) {
  *level = (int16_t)(uint16_t)((uint32_t)*level + (uint32_t)more);
}

/* A symbol of first_bits to 16 bits; *bits is 0 if there is none. */
static inline unsigned read_symbol(const huffman_decoder *decoder, unsigned first_bits,
                                   bit_reader *r, unsigned *bits) {
  unsigned symbol = huffman_read(decoder, first_bits, top_bits(r->bits, 16), bits);
  consume(r, *bits);
  return symbol;
}

/* What the tables do not hold takes a copy of the reader: the reader itself then stays in
 * registers.
 */
static __attribute__((noinline)) bool parse_long_dc(const huffman_decoder *decoder, bit_reader *r,
                                                    int32_t *level) {
  refill(r);
  unsigned bits, size = read_symbol(decoder, 1, r, &bits);
  if (bits == 0 || size > 15) return false;
  *level = take_level(r, size);
  refill(r);
  return true;
}

/* Nothing where it is not present, by a table of its own: which channels have levels nobody
 * foretells. */
static inline __attribute__((always_inline)) bool
parse_dc(const block_tables *tables, int code, bool present, bit_reader *r, int32_t *level) {
  const uint8_t *table = tables->dc[NO_DC + (code - CODE_DC - NO_DC) * present];
  unsigned entry = table[r->bits >> (64 - FAST_DC_BITS)];
  if (__builtin_expect(entry != LONG_DC, 1)) {
    consume(r, entry & 15);
    *level = take_level(r, entry >> 4);
    return true;
  }
  bit_reader copy = *r;
  int32_t found = 0;
  bool good = parse_long_dc(&tables->decoders[code], &copy, &found);
  *level = found;
  *r = copy;
  return good;
}

/* A symbol that no table entry holds. False if the channel cannot go on. */
static __attribute__((noinline)) bool parse_long(const huffman_decoder *decoder, bit_reader *r,
                                                 unsigned *k, int16_t *levels, bool *end) {
  refill(r);
  unsigned bits, symbol = read_symbol(decoder, 1, r, &bits), size = symbol & 15;
  int32_t level = 0;
  *end = false;
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
    level = take_level(r, size);
  } else {
    return false;
  }
  add_level(&levels[slf_zigzag[*k]], level);
  return true;
}

/* Where in a channel's AC levels the reader is. */
typedef struct {
  int16_t *levels;
  uint64_t k;           /* of the level read last */
  uint32_t taken, seen; /* what the last look saw: the bits, with flags, and the levels */
  uint32_t sum;         /* of bits that the reader's count does not know of, modulo 64 */
} channel_reader;

static inline __attribute__((always_inline)) void take_seen(channel_reader *c, bit_reader *r) {
  r->bits <<= c->taken & FAST_TAKEN;
  c->sum += c->taken;
  c->k += fast_step(c->seen);
  add_level(&c->levels[slf_zigzag[c->k]], fast_level(c->seen));
  c->k += fast_second_step(c->seen);
  add_level(&c->levels[slf_zigzag[c->k]], fast_second_level(c->seen));
}

/* Takes what a window shows, unless there is nothing to show or the channel ends: two in one, so
 * that a look is one branch. */
static inline __attribute__((always_inline)) bool look(channel_reader *c, bit_reader *r,
                                                       const uint8_t *taken, const uint32_t *levels,
                                                       unsigned window_bits) {
  uint64_t window = r->bits >> (64 - window_bits);
  c->taken = taken[window];
  c->seen = levels[window];
  if (c->taken >= FAST_END) return false;
  take_seen(c, r);
  return true;
}

/* A level of which the last look saw the code. */
static inline __attribute__((always_inline)) void take_large(channel_reader *c, bit_reader *r) {
  unsigned taken = c->taken & FAST_TAKEN, size = large_size(c->seen);
  if (r->count < FAST_BITS + 15) refill(r);
  c->k += fast_step(c->seen);
  add_level(&c->levels[slf_zigzag[c->k]], level_at_top(r->bits << (taken - size), size));
  consume(r, taken);
}

/* A channel's AC levels, added to what is there; *last_k grows to the last one's place. */
static inline __attribute__((always_inline)) bool
parse_ac(const block_tables *tables, int code, bit_reader *r, int16_t *levels, unsigned *last_k) {
  const first_ac_table *first = &tables->first_ac[(code - CODE_AC) / 2];
  const ac_table *later = &tables->later_ac[(code - CODE_AC) / 2];
  channel_reader c = {.levels = levels};
  refill(r);
  bool more = look(&c, r, first->taken, first->levels, FAST_FIRST_BITS);
  for (;; more = true) {
    if (more) {
      code |= 1;
#pragma GCC unroll 4
      for (int i = 1; i < FAST_READS; i++)
        if (!look(&c, r, later->taken, later->levels, FAST_BITS)) break;
    }
    if ((c.taken & (FAST_END | FAST_NONE)) == FAST_END) take_seen(&c, r);
    r->count -= c.sum & FAST_TAKEN;
    c.sum = 0;
    bool end = c.taken & FAST_END, good = true;
    if (__builtin_expect(c.taken == FAST_NONE, 0)) {
      bit_reader copy = *r;
      unsigned k = (unsigned)c.k;
      good = k < COEFFICIENTS && parse_long(&tables->decoders[code], &copy, &k, levels, &end);
      *r = copy;
      c.k = k;
    } else if (c.taken & FAST_NONE) {
      take_large(&c, r);
    }
    if (end) *last_k = c.k > *last_k ? (unsigned)c.k : *last_k;
    if (end || !good || __builtin_expect(c.k >= COEFFICIENTS, 0))
      return end && good && c.k < COEFFICIENTS;
    refill(r);
  }
}

/* One symbol that PASS_BITS do not show whole. False if it is none. There are bits for another step
 * behind it. */
static __attribute__((noinline)) bool pass_long(const block_tables *tables, unsigned *state,
                                                bit_reader *r) {
  refill(r);
  unsigned bits, symbol = read_symbol(&tables->decoders[pass_code(*state)], 1, r, &bits);
  unsigned size = symbol == SYMBOL_ESCAPE ? 22 : symbol & 15;
  consume(r, size);
  refill(r);
  *state = symbol == SYMBOL_END ? pass_next_channel(*state) : *state | 1;
  return bits != 0 && (size != 0 || symbol == SYMBOL_END || symbol == SYMBOL_RUN_16);
}

/* ---- Heads --------------------------------------------------------------------------------- */

/* What stands before a block's AC levels. */
typedef struct {
  unsigned symbol;
  int shift_u, shift_v; /* of SHIFT */
  int32_t dc[3];        /* as they are coded */
} block_head;

static inline __attribute__((always_inline)) bool parse_head_symbol(const block_tables *tables,
                                                                    bit_reader *r, unsigned *head) {
  refill(r);
  unsigned entry = tables->head[r->bits >> (64 - FAST_DC_BITS)], bits = entry & 255;
  *head = entry >> 8;
  if (__builtin_expect(bits != 0, 1)) {
    consume(r, bits);
  } else {
    *head = read_symbol(&tables->decoders[CODE_HEAD], FAST_DC_BITS + 1, r, &bits);
    refill(r);
  }
  return bits != 0 && *head >> 3 < PREDICTOR_COUNT;
}

/* Two shifts, coded as -16 .. 15, plus 16. */
static __attribute__((noinline)) bool parse_long_shifts(const huffman_decoder *decoder,
                                                        bit_reader *r, int *shift_u, int *shift_v) {
  unsigned bits_u, bits_v;
  refill(r);
  unsigned u = read_symbol(decoder, 1, r, &bits_u), v = read_symbol(decoder, 1, r, &bits_v);
  refill(r);
  *shift_u = (int)u - 16;
  *shift_v = (int)v - 16;
  return bits_u != 0 && bits_v != 0 && u < 32 && v < 32;
}

static inline __attribute__((always_inline)) bool parse_shifts(const block_tables *tables,
                                                               bit_reader *r, block_head *head) {
  bit_reader copy = *r;
  int shift_u, shift_v;
  bool good = parse_long_shifts(&tables->decoders[CODE_SHIFT], &copy, &shift_u, &shift_v);
  *r = copy;
  head->shift_u = shift_u;
  head->shift_v = shift_v;
  return good;
}

static inline __attribute__((always_inline)) bool
parse_dcs(const block_tables *tables, int residual, bit_reader *r, block_head *head) {
#pragma GCC unroll 3
  for (int channel = 0; channel < 3; channel++) {
    if (channel > 1) refill(r);
    bool present = !residual || (head->symbol >> channel & 1);
    if (!parse_dc(tables, dc_code(residual, channel > 0), present, r, &head->dc[channel]))
      return false;
  }
  return true;
}

/* Head, shifts and DC levels one by one. */
static inline __attribute__((always_inline)) bool
parse_parts_of_head(const block_tables *tables, bit_reader *r, block_head *head) {
  if (!parse_head_symbol(tables, r, &head->symbol)) return false;
  if (head->symbol >> 3 == PREDICT_INTRA) return parse_dcs(tables, 0, r, head);
  if (head->symbol >> 3 == PREDICT_SHIFT && !parse_shifts(tables, r, head)) return false;
  return parse_dcs(tables, 1, r, head);
}

/* A head that the table of whole ones does not hold. */
static __attribute__((noinline)) bool parse_long_head(const block_tables *tables, bit_reader *r,
                                                      block_head *head) {
  unsigned bits, symbol = read_symbol(&tables->decoders[CODE_WHOLE_HEAD], 1, r, &bits);
  refill(r);
  if (bits == 0) return false;
  if (symbol == 0) return parse_parts_of_head(tables, r, head);
  uint32_t whole = tables->whole_heads[symbol];
  head->symbol = whole_head_symbol(whole);
  for (int channel = 0; channel < 3; channel++)
    head->dc[channel] = take_level(r, whole_head_size(whole, channel));
  return head->symbol >> 3 != PREDICT_SHIFT || parse_shifts(tables, r, head);
}

/* Of a stream with whole heads one look, and all that stands before AC is known. */
static inline __attribute__((always_inline)) bool parse_head(const block_tables *tables,
                                                             bit_reader *r, block_head *head) {
  if (!tables->has_whole_heads) return parse_parts_of_head(tables, r, head);
  refill(r);
  uint32_t entry = tables->whole_head[r->bits >> (64 - FAST_HEAD_BITS)], whole = entry >> 10;
  if (__builtin_expect(entry == 0, 0)) {
    block_head found = {0};
    bit_reader copy = *r;
    bool good = parse_long_head(tables, &copy, &found);
    *r = copy;
    *head = found;
    return good;
  }
  uint64_t levels = r->bits << (entry >> 6 & 15);
  consume(r, entry & 63);
  head->symbol = whole_head_symbol(whole);
#pragma GCC unroll 3
  for (int channel = 0; channel < 3; channel++) {
    unsigned size = whole_head_size(whole, channel);
    head->dc[channel] = level_at_top(levels, size);
    levels <<= size;
  }
  return head->symbol >> 3 != PREDICT_SHIFT || parse_shifts(tables, r, head);
}

/* DC levels of INTRA blocks go on from the last one's. */
static inline __attribute__((always_inline)) void add_intra_dc(int16_t intra_dc[3],
                                                               block_head *head) {
#pragma GCC unroll 3
  for (int channel = 0; channel < 3; channel++) {
    add_level(&intra_dc[channel], head->dc[channel]);
    head->dc[channel] = intra_dc[channel];
  }
}

static inline __attribute__((always_inline)) bool parse_levels(const block_tables *tables,
                                                               int residual, block_head *head,
                                                               bit_reader *r, entry_state *state) {
  block_levels *block = &state->block;
  block->ac_flags |= head->symbol & 7;
  if (!residual) add_intra_dc(state->intra_dc, head);
#pragma GCC unroll 3
  for (int channel = 0; channel < 3; channel++)
    add_level(&block->levels[channel][0], head->dc[channel]);
  for (unsigned left = head->symbol & 7; left; left &= left - 1) {
    int channel = __builtin_ctz(left), code = ac_code(residual, channel > 0, 0);
    if (!parse_ac(tables, code, r, block->levels[channel], &block->last_k[channel])) {
      block->last_k[channel] = COEFFICIENTS - 1;
      return false;
    }
  }
  return true;
}

/* A new block's levels, of zeros. In wide stores: what a compiler makes of memset for so few bytes
 * takes longer to begin. */
static inline void begin_levels(entry_state *state) {
  typedef uint64_t wide __attribute__((vector_size(32), aligned(2), may_alias));
  block_levels *block = &state->block;
  wide *to = (wide *)(void *)block->levels;
#pragma GCC unroll 15
  for (size_t i = 0; i < sizeof block->levels / sizeof *to; i++) to[i] = (wide){0};
  block->ac_flags = 0;
  for (int channel = 0; channel < 3; channel++) block->last_k[channel] = 0;
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

/* ---- Passing over -------------------------------------------------------------------------- */

/* The next block up to its AC levels, which *state says; or some that are heads and no more. */
static inline __attribute__((always_inline)) bool pass_head(const block_tables *tables,
                                                            bit_reader *r, int16_t intra_dc[3],
                                                            uint32_t *count, unsigned *state) {
  unsigned bare = tables->bare_heads[r->bits >> (64 - PASS_BITS)];
  block_head head = {0};
  if (bare && bare >> 4 <= *count && r->count >= PASS_BITS) {
    consume(r, bare & 15);
    *count -= bare >> 4;
    *state = PASS_END;
    return true;
  }
  *count -= 1;
  if (!parse_head(tables, r, &head)) return false;
  bool residual = head.symbol >> 3 != PREDICT_INTRA;
  *state = pass_state(residual, head.symbol & 7);
  if (!residual) add_intra_dc(intra_dc, &head);
  return true;
}

/* What PASS_BITS show, or one symbol. */
static inline __attribute__((always_inline)) bool pass_step(const block_tables *tables,
                                                            unsigned *state, bit_reader *r) {
  unsigned entry = tables->pass[*state][r->bits >> (64 - PASS_BITS)];
  if (__builtin_expect(entry != 0, 1)) {
    consume(r, entry & 63);
    *state = entry >> 6;
    return true;
  }
  bit_reader copy = *r;
  unsigned next = *state;
  bool good = pass_long(tables, &next, &copy);
  *state = next;
  *r = copy;
  return good;
}

static inline __attribute__((always_inline)) bool pass_two_steps(const block_tables *tables,
                                                                 unsigned *state, bit_reader *r) {
  refill(r);
  return pass_step(tables, state, r) && pass_step(tables, state, r);
}

/* AC levels in three channels are at most so many symbols. */
enum { PASS_MOST_STEPS = 3 * COEFFICIENTS };

static inline __attribute__((always_inline)) bool
pass_blocks(const block_tables *tables, bit_reader *r, int16_t intra_dc[3], uint32_t count) {
  bool good = true;
  while (count && good) {
    unsigned state = PASS_END, left = PASS_MOST_STEPS;
    good = pass_head(tables, r, intra_dc, &count, &state);
    if (state == PASS_END) continue;
    /* Four at once: most blocks have no more, and how many nobody foretells. */
    good = good && pass_two_steps(tables, &state, r) && pass_two_steps(tables, &state, r);
    while (good && state != PASS_END) good = left-- && pass_two_steps(tables, &state, r);
  }
  return good;
}

static inline __attribute__((always_inline)) bool
pass_either_way(const block_tables *tables, bit_reader *reader, bool backwards, int16_t intra_dc[3],
                uint32_t count) {
  bit_reader r = reader_copy(reader, backwards);
  bool good = pass_blocks(tables, &r, intra_dc, count);
  reader_update(reader, &r);
  return good;
}

bool blocks_pass(const block_tables *tables, bit_reader *reader, int16_t intra_dc[3],
                 uint32_t count) {
  return reader->backwards ? pass_either_way(tables, reader, true, intra_dc, count)
                           : pass_either_way(tables, reader, false, intra_dc, count);
}

bool block_leans_on_previous(const block_tables *tables, const bit_reader *reader) {
  bit_reader r = reader_copy(reader, reader->backwards);
  block_head head = {0};
  return parse_head(tables, &r, &head) && head.symbol >> 3 == PREDICT_PREVIOUS;
}

/* ---- Blocks -------------------------------------------------------------------------------- */

/* Compiled for each way of reading. */
static inline __attribute__((always_inline)) bool parse_block(const block_tables *tables,
                                                              bit_reader *reader, bool backwards,
                                                              uint32_t passed, uint32_t number,
                                                              bool first, entry_state *state) {
  bit_reader r = reader_copy(reader, backwards);
  block_head head = {0};
  bool good = pass_blocks(tables, &r, state->intra_dc, passed) && parse_head(tables, &r, &head);
  predictor how = head.symbol >> 3;
  if (good && how != PREDICT_PREVIOUS) {
    begin_levels(state);
    state->predictor = how;
    state->anchor = number;
    state->shift_u = head.shift_u;
    state->shift_v = head.shift_v;
  } else if (first || !good) {
    good = false;
    begin_levels(state);
  }
  good = good && parse_levels(tables, how != PREDICT_INTRA, &head, &r, state);
  reader_update(reader, &r);
  return good;
}

bool block_parse(const block_tables *tables, bit_reader *reader, uint32_t passed, uint32_t number,
                 bool first, entry_state *state) {
  return reader->backwards ? parse_block(tables, reader, true, passed, number, first, state)
                           : parse_block(tables, reader, false, passed, number, first, state);
}
