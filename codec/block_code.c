#include "codec/block_code.h"

#include <string.h>

// clang-format off
const uint8_t slf_zigzag[COEFFICIENTS + 1] = {
     0,  8,  1,  2,  9, 16, 24, 17,
    10,  3,  4, 11, 18, 25, 32, 40,
    33, 26, 19, 12,  5,  6, 13, 20,
    27, 34, 41, 48, 56, 49, 42, 35,
    28, 21, 14,  7, 15, 22, 29, 36,
    43, 50, 57, 58, 51, 44, 37, 30,
    23, 31, 38, 45, 52, 59, 60, 53,
    46, 39, 47, 54, 61, 62, 55, 63,
    COEFFICIENTS};
// clang-format on

/* ---- Tables -------------------------------------------------------------------------------- */

/* An AC symbol out of `bits` bits; none taken if it is not whole, escapes, or is illegal. */
typedef struct {
  unsigned taken, step, size;
  bool end;
} ac_symbol;

static ac_symbol symbol_in_window(const huffman_decoder *decoder, uint32_t window, unsigned bits) {
  ac_symbol found = {0};
  unsigned taken, symbol = huffman_read(decoder, 1, window << (16 - bits) & 0xffff, &taken);
  if (taken == 0 || taken > bits || symbol == SYMBOL_ESCAPE) return found;
  found.end = symbol == SYMBOL_END;
  found.size = symbol & 15;
  if (found.size == 0 && !found.end && symbol != SYMBOL_RUN_16) return found;
  found.taken = taken;
  found.step = found.end ? 0 : symbol == SYMBOL_RUN_16 ? 16 : (symbol >> 4) + 1;
  return found;
}

/* What is taken, with its flags; what is seen at *symbols. */
static uint8_t ac_entry(const huffman_decoder *decoder, const huffman_decoder *later,
                        uint32_t window, unsigned window_bits, uint32_t *symbols) {
  unsigned taken = 0, reach = 0, count = 0;
  bool end = false;
  *symbols = 0;
  while (!end && taken < window_bits) {
    ac_symbol next = symbol_in_window(taken ? later : decoder, window, window_bits - taken);
    if (next.taken == 0 || reach + next.step > FAST_REACH) break;
    if (!next.end && count == FAST_SYMBOLS) break;
    taken += next.taken;
    reach += next.step;
    end = next.end;
    if (!end) *symbols |= 1u << (reach - 1) | next.size << (FAST_REACH + 4 * count++);
  }
  return (uint8_t)(taken ? taken | (end ? FAST_END : 0) : FAST_NONE);
}

static uint8_t dc_entry(const huffman_decoder *decoder, uint32_t window) {
  unsigned bits, size = huffman_read(decoder, 1, window << (16 - FAST_DC_BITS), &bits);
  return bits != 0 && bits <= FAST_DC_BITS && size <= FAST_DC_SIZE ? (uint8_t)(bits | size << 4)
                                                                   : LONG_DC;
}

static uint16_t symbol_entry(const huffman_decoder *decoder, uint32_t window) {
  unsigned bits, symbol = huffman_read(decoder, 1, window << (16 - FAST_DC_BITS), &bits);
  return bits <= FAST_DC_BITS ? (uint16_t)(bits | symbol << 8) : 0;
}

static uint32_t whole_head_entry(const block_tables *tables, uint32_t window) {
  unsigned bits, symbol = huffman_read(&tables->decoders[CODE_WHOLE_HEAD], 1,
                                       window << (16 - FAST_HEAD_BITS), &bits);
  if (bits == 0 || bits > FAST_HEAD_BITS || symbol == 0) return 0;
  uint32_t whole = tables->whole_heads[symbol];
  unsigned taken = bits;
  for (int channel = 0; channel < 3; channel++) taken += whole_head_size(whole, channel);
  return taken | bits << 6 | whole << 10;
}

/* A head out of `bits` bits, with no DC level behind it; what it takes, 0 if it is not whole. */
static unsigned bare_head_in_window(const block_tables *tables, uint32_t window, unsigned bits,
                                    unsigned *head) {
  uint32_t next = window << (16 - bits) & 0xffff;
  unsigned taken = 0, more;
  if (tables->has_whole_heads) {
    unsigned symbol = huffman_read(&tables->decoders[CODE_WHOLE_HEAD], 1, next, &taken);
    *head = whole_head_symbol(tables->whole_heads[symbol]);
    if (taken == 0 || symbol) return taken <= bits ? taken : 0;
    next = next << taken & 0xffff;
  }
  *head = huffman_read(&tables->decoders[CODE_HEAD], 1, next, &more);
  return more && taken + more <= bits ? taken + more : 0;
}

static uint16_t pass_entry(const block_tables *tables, unsigned state, uint32_t window) {
  unsigned taken = 0, level_bits = 0;
  while (state != PASS_END && taken < PASS_BITS) {
    const huffman_decoder *decoder = &tables->decoders[pass_code(state)];
    ac_symbol next = symbol_in_window(decoder, window, PASS_BITS - taken);
    if (next.taken == 0 || level_bits + next.size > PASS_MAX_LEVEL_BITS) break;
    taken += next.taken;
    level_bits += next.size;
    state = next.end ? pass_next_channel(state) : state | 1;
  }
  return (uint16_t)(taken ? taken | state << 4 | level_bits << 9 : 0);
}

static uint8_t bare_heads_entry(const block_tables *tables, uint32_t window) {
  unsigned taken = 0, count = 0;
  while (taken < PASS_BITS) {
    unsigned left = PASS_BITS - taken, head;
    unsigned bits = bare_head_in_window(tables, window, left, &head), how = head >> 3;
    if (bits == 0 || head & 7 || how == PREDICT_INTRA || how == PREDICT_SHIFT ||
        how >= PREDICTOR_COUNT)
      break;
    taken += bits;
    count++;
  }
  return (uint8_t)(taken | count << 4);
}

void block_tables_make(const block_codes *codes, block_tables *tables) {
  for (int i = 0; i < CODE_COUNT; i++) huffman_make_decoder(&codes->codes[i], &tables->decoders[i]);
  tables->has_whole_heads = codes->codes[CODE_WHOLE_HEAD].symbol_count > 0;
  memcpy(tables->whole_heads, codes->whole_heads, sizeof tables->whole_heads);
  for (uint32_t w = 0; w < 1u << FAST_HEAD_BITS; w++)
    tables->whole_head[w] = whole_head_entry(tables, w);
  for (uint32_t w = 0; w < 1u << FAST_DC_BITS; w++) {
    tables->head[w] = symbol_entry(&tables->decoders[CODE_HEAD], w);
    tables->shift[w] = symbol_entry(&tables->decoders[CODE_SHIFT], w);
    for (int i = 0; i < 4; i++) tables->dc[i][w] = dc_entry(&tables->decoders[CODE_DC + i], w);
  }
  for (int i = 0; i < 4; i++) {
    const huffman_decoder *first = &tables->decoders[CODE_AC + 2 * i], *later = first + 1;
    first_ac_table *at_first = &tables->first_ac[i];
    ac_table *then = &tables->later_ac[i];
    for (uint32_t w = 0; w < 1u << FAST_FIRST_BITS; w++)
      at_first->taken[w] = ac_entry(first, later, w, FAST_FIRST_BITS, &at_first->symbols[w]);
    for (uint32_t w = 0; w < 1u << FAST_BITS; w++)
      then->taken[w] = ac_entry(later, later, w, FAST_BITS, &then->symbols[w]);
  }
  for (uint32_t w = 0; w < 1u << PASS_BITS; w++) {
    tables->bare_heads[w] = bare_heads_entry(tables, w);
    for (unsigned i = 0; i < PASS_STATES; i++) tables->pass[i][w] = pass_entry(tables, i, w);
    tables->pass[PASS_END][w] = PASS_END << 4;
  }
  memset(tables->dc[NO_DC], 0, sizeof tables->dc[NO_DC]);
  tables->may_lean = false;
  const huffman_code *heads = &codes->codes[CODE_HEAD];
  for (int i = 0; i < heads->symbol_count; i++)
    if (heads->symbols[i] >> 3 == PREDICT_PREVIOUS) tables->may_lean = true;
  for (int i = 1; i < codes->codes[CODE_WHOLE_HEAD].symbol_count; i++)
    if (whole_head_symbol(codes->whole_heads[i]) >> 3 == PREDICT_PREVIOUS) tables->may_lean = true;
}
