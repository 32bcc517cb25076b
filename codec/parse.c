/* parse.c - from the bits of a C-Block to its symbols. Compiled for each kernel: see kernel.h. */
#include "codec/kernel.h"

#ifdef __BMI2__
#include <immintrin.h>
#endif

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
  reader_update(r, &copy);
  return good;
}

/* Where in a channel's AC symbols the reader is. */
typedef struct {
  uint64_t places;      /* of levels; worth nothing once next is beyond the scan */
  uint64_t next;        /* the place behind the last one's */
  uint8_t *sizes;       /* of the levels, up to here */
  uint32_t taken, seen; /* what the last look saw: the bits, with flags, and the symbols */
  uint32_t sum;         /* of bits that the reader's count does not know of, modulo 64 */
} channel_reader;

/* Four bits each to a byte each. */
static inline uint32_t spread_sizes(uint32_t sizes) {
#ifdef __BMI2__
  return _pdep_u32(sizes, 0x0f0f0f0f);
#else
  sizes = (sizes | sizes << 8) & 0x00ff00ff;
  return (sizes | sizes << 4) & 0x0f0f0f0f;
#endif
}

static inline void put_sizes(uint8_t *to, uint32_t sizes) {
#if __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__
  sizes = __builtin_bswap32(sizes);
#endif
  memcpy(to, &sizes, sizeof sizes);
}

/* The place behind the last one ahead of a place. */
static inline uint64_t place_behind(uint64_t place, uint64_t ahead) {
#ifdef __LZCNT__
  return place + 64 - _lzcnt_u64(ahead);
#else
  return place + 63 - (unsigned)__builtin_clzll(ahead << 1 | 1);
#endif
}

static inline __attribute__((always_inline)) void take_seen(channel_reader *c, bit_reader *r) {
  const uint64_t ahead = c->seen & ((1u << FAST_REACH) - 1);
  r->bits <<= c->taken & FAST_TAKEN;
  c->sum += c->taken;
  put_sizes(c->sizes, spread_sizes(c->seen >> FAST_REACH));
  c->sizes += __builtin_popcountll(ahead);
  c->places |= ahead << (c->next & 63);
  c->next = place_behind(c->next, ahead);
}

/* Takes what a window shows, unless there is nothing to show or the channel ends: two in one, so
 * that a look is one branch. */
static inline __attribute__((always_inline)) bool look(channel_reader *c, bit_reader *r,
                                                       const uint8_t *taken,
                                                       const uint32_t *symbols,
                                                       unsigned window_bits) {
  uint64_t window = r->bits >> (64 - window_bits);
  c->taken = taken[window];
  c->seen = symbols[window];
  if (c->taken >= FAST_END) return false;
  take_seen(c, r);
  return true;
}

/* A symbol that no table entry holds. False if the channel cannot go on. */
static __attribute__((noinline)) bool parse_long(const huffman_decoder *decoder, bit_reader *r,
                                                 channel_reader *c, bool *end) {
  refill(r);
  unsigned bits, symbol = read_symbol(decoder, 1, r, &bits), size = symbol & 15;
  unsigned run = symbol >> 4;
  *end = bits && symbol == SYMBOL_END;
  if (bits == 0 || *end) return *end;
  if (symbol == SYMBOL_ESCAPE) {
    run = take(r, ESCAPED_RUN_BITS);
    size = take(r, ESCAPED_SIZE_BITS);
  } else if (size == 0 && symbol != SYMBOL_RUN_16) {
    return false;
  }
  if (c->next + run >= COEFFICIENTS) return false;
  *c->sizes++ = (uint8_t)size;
  c->places |= 1ull << (c->next + run);
  c->next += run + 1;
  return true;
}

/* The symbols of a channel's AC levels. */
static inline __attribute__((always_inline)) bool parse_channel(const block_tables *tables,
                                                                int code, int channel,
                                                                bit_reader *r,
                                                                coded_levels *coded) {
  enum { LOOKS = 4 }; /* later ones: 9 + 4 x 11 bits, which a refill gives */
  const first_ac_table *first = &tables->first_ac[(code - CODE_AC) / 2];
  const ac_table *later = &tables->later_ac[(code - CODE_AC) / 2];
  uint8_t *begin = coded->sizes + coded->count;
  channel_reader c = {.next = 1, .sizes = begin};
  refill(r);
  bool more = look(&c, r, first->taken, first->symbols, FAST_FIRST_BITS), end, good = true;
  for (;; more = true) {
    if (more) {
      code |= 1;
#pragma GCC unroll 4
      for (int i = 0; i < LOOKS; i++)
        if (!look(&c, r, later->taken, later->symbols, FAST_BITS)) break;
    }
    end = c.taken & FAST_END;
    if (end) take_seen(&c, r);
    r->count -= c.sum & FAST_TAKEN;
    c.sum = 0;
    if (__builtin_expect(c.taken == FAST_NONE, 0)) {
      bit_reader copy = *r;
      channel_reader there = c;
      good = parse_long(&tables->decoders[code], &copy, &there, &end);
      reader_update(r, &copy);
      c = there;
    }
    if (end || !good || __builtin_expect(c.next > COEFFICIENTS, 0)) break;
    refill(r);
  }
  coded->places[channel] = c.places;
  coded->count += (uint32_t)(c.sizes - begin);
  return good && end && c.next <= COEFFICIENTS;
}

/* One symbol that PASS_BITS do not show whole. False if it is none. There are bits for another step
 * behind it. */
static __attribute__((noinline)) bool pass_long(const block_tables *tables, unsigned *state,
                                                unsigned *level_bits, bit_reader *r) {
  refill(r);
  unsigned bits, symbol = read_symbol(&tables->decoders[pass_code(*state)], 1, r, &bits);
  unsigned size = symbol & 15;
  if (symbol == SYMBOL_ESCAPE) {
    consume(r, ESCAPED_RUN_BITS);
    size = take(r, ESCAPED_SIZE_BITS);
  }
  refill(r);
  *level_bits += size;
  *state = symbol == SYMBOL_END ? pass_next_channel(*state) : *state | 1;
  return bits != 0 && (symbol & 15 || symbol == SYMBOL_END || symbol == SYMBOL_RUN_16 ||
                       symbol == SYMBOL_ESCAPE);
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
  refill(r);
  unsigned u = tables->shift[r->bits >> (64 - FAST_DC_BITS)], u_bits = u & 255;
  unsigned v = tables->shift[r->bits << u_bits >> (64 - FAST_DC_BITS)], v_bits = v & 255;
  if (__builtin_expect(u_bits && v_bits && (u | v) >> 8 < 32, 1)) {
    consume(r, u_bits + v_bits);
    head->shift_u = (int)(u >> 8) - 16;
    head->shift_v = (int)(v >> 8) - 16;
    refill(r);
    return true;
  }
  bit_reader copy = *r;
  int shift_u, shift_v;
  bool good = parse_long_shifts(&tables->decoders[CODE_SHIFT], &copy, &shift_u, &shift_v);
  reader_update(r, &copy);
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
    reader_update(r, &copy);
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

static inline __attribute__((always_inline)) bool
parse_channels(const block_tables *tables, int residual, unsigned flags, bit_reader *r,
               texels_maker *meanwhile, coded_levels *coded) {
  coded->flags = flags;
  coded->count = 0;
  for (int channel = 0; channel < 3; channel++) coded->places[channel] = 0;
  for (unsigned left = flags; left; left &= left - 1) {
    int channel = __builtin_ctz(left);
    texels_go_on(meanwhile);
    if (!parse_channel(tables, ac_code(residual, channel > 0, 0), channel, r, coded)) return false;
  }
  return true;
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
static inline __attribute__((always_inline)) bool
pass_step(const block_tables *tables, unsigned *state, unsigned *level_bits, bit_reader *r) {
  unsigned entry = tables->pass[*state][r->bits >> (64 - PASS_BITS)];
  if (__builtin_expect(entry != 0, 1)) {
    consume(r, pass_taken(entry));
    *level_bits += pass_level_bits(entry);
    *state = pass_next(entry);
    return true;
  }
  bit_reader copy = *r;
  unsigned next = *state, bits = *level_bits;
  bool good = pass_long(tables, &next, &bits, &copy);
  *state = next;
  *level_bits = bits;
  reader_update(r, &copy);
  return good;
}

/* Four steps. */
static inline __attribute__((always_inline)) bool
pass_steps(const block_tables *tables, unsigned *state, unsigned *level_bits, bit_reader *r) {
  refill(r);
  return pass_step(tables, state, level_bits, r) && pass_step(tables, state, level_bits, r) &&
         pass_step(tables, state, level_bits, r) && pass_step(tables, state, level_bits, r);
}

/* AC levels in three channels are at most so many symbols. */
enum { PASS_MOST_STEPS = 3 * COEFFICIENTS };

static inline __attribute__((always_inline)) bool
pass_blocks(const block_tables *tables, bit_reader *r, int16_t intra_dc[3], uint32_t count) {
  bool good = true;
  while (count && good) {
    unsigned state = PASS_END, level_bits = 0, left = PASS_MOST_STEPS;
    good = pass_head(tables, r, intra_dc, &count, &state);
    if (state == PASS_END) continue;
    do /* most blocks have no more than four, and how many nobody foretells */
      good = good && pass_steps(tables, &state, &level_bits, r);
    while (good && state != PASS_END && left--);
    good = good && state == PASS_END;
    reader_jump(r, level_bits);
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
static inline __attribute__((always_inline)) bool
parse_block(const block_tables *tables, bit_reader *reader, bool backwards, uint32_t passed,
            uint32_t number, bool first, texels_maker *meanwhile, entry_state *state) {
  bit_reader r = reader_copy(reader, backwards);
  block_head head = {0};
  coded_levels coded;
  texels_go_on(meanwhile);
  bool good = pass_blocks(tables, &r, state->intra_dc, passed) && parse_head(tables, &r, &head);
  const predictor how = head.symbol >> 3;
  const bool residual = how != PREDICT_INTRA, adds = how == PREDICT_PREVIOUS;
  good = good && !(adds && first);
  if (good && !residual) add_intra_dc(state->intra_dc, &head);
  good = good && parse_channels(tables, residual, head.symbol & 7, &r, meanwhile, &coded);
  reader_update(reader, &r);
  texels_finish(meanwhile);
  if (!good) {
    state->block = (block_levels){.ac_flags = 0};
    return false;
  }
  if (!adds) {
    state->predictor = how;
    state->anchor = number;
    state->shift_u = head.shift_u;
    state->shift_v = head.shift_v;
  }
  levels_read(reader, &coded, head.dc, adds, &state->block);
  return true;
}

bool block_parse(const block_tables *tables, bit_reader *reader, uint32_t passed, uint32_t number,
                 bool first, texels_maker *meanwhile, entry_state *state) {
  return reader->backwards
             ? parse_block(tables, reader, true, passed, number, first, meanwhile, state)
             : parse_block(tables, reader, false, passed, number, first, meanwhile, state);
}
