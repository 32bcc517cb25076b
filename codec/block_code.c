#include "codec/block_code.h"

#include <stdlib.h>
#include <string.h>

// clang-format off
const uint8_t slf_zigzag[COEFFICIENTS + SPARE_PLACES] = {
     0,  8,  1,  2,  9, 16, 24, 17,
    10,  3,  4, 11, 18, 25, 32, 40,
    33, 26, 19, 12,  5,  6, 13, 20,
    27, 34, 41, 48, 56, 49, 42, 35,
    28, 21, 14,  7, 15, 22, 29, 36,
    43, 50, 57, 58, 51, 44, 37, 30,
    23, 31, 38, 45, 52, 59, 60, 53,
    46, 39, 47, 54, 61, 62, 55, 63,
    [COEFFICIENTS ... COEFFICIENTS + SPARE_PLACES - 1] = COEFFICIENTS};
// clang-format on

/* ---- Tables -------------------------------------------------------------------------------- */

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

/* A level that the window does not show whole. */
static uint8_t large_entry(const huffman_decoder *decoder, uint32_t window, unsigned window_bits,
                           uint32_t *levels) {
  unsigned bits, symbol = huffman_read(decoder, 1, window << (16 - window_bits), &bits);
  unsigned size = symbol & 15;
  *levels = 0;
  if (bits == 0 || bits > window_bits || size == 0) return FAST_NONE;
  *levels = ((symbol >> 4) + 1) | size << 8;
  return (uint8_t)(FAST_NONE | (bits + size));
}

/* What is taken, with its flags; the levels at *levels. */
static uint8_t ac_entry(const huffman_decoder *decoder, const huffman_decoder *later,
                        uint32_t window, unsigned window_bits, uint32_t *levels) {
  ac_token first = token_in_window(decoder, window, window_bits), second = {0};
  if (first.taken == 0) return large_entry(decoder, window, window_bits, levels);
  unsigned taken = first.taken, left = window_bits - taken;
  bool end = first.end;
  for (int more = 0; more < 2 && left && !end; more++) {
    ac_token next = token_in_window(later, window & ((1u << left) - 1), left);
    bool fits = next.end || (!more && next.step <= FAST_MAX_SECOND_STEP &&
                             abs(next.level) <= FAST_MAX_SECOND_LEVEL);
    if (next.taken == 0 || !fits) break;
    taken += next.taken;
    left -= next.taken;
    end = next.end;
    if (!end) second = next;
  }
  *levels = first.end ? 0
                      : first.step | second.step << 5 | ((uint32_t)second.level & 255) << 8 |
                            (uint32_t)first.level << 16;
  return (uint8_t)(taken | (end ? FAST_END : 0));
}

static uint8_t dc_entry(const huffman_decoder *decoder, uint32_t window) {
  unsigned bits, size = huffman_read(decoder, 1, window << (16 - FAST_DC_BITS), &bits);
  return bits != 0 && bits <= FAST_DC_BITS && size <= FAST_DC_SIZE ? (uint8_t)(bits | size << 4)
                                                                   : LONG_DC;
}

static uint16_t head_entry(const huffman_decoder *decoder, uint32_t window) {
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
  unsigned taken = 0;
  while (state != PASS_END && taken < PASS_BITS) {
    unsigned left = PASS_BITS - taken, bits;
    uint32_t rest = window << (16 - left) & 0xffff;
    unsigned symbol = huffman_read(&tables->decoders[pass_code(state)], 1, rest, &bits);
    unsigned size = symbol == SYMBOL_ESCAPE ? 22 : symbol & 15;
    if (bits == 0 || bits > left) break;
    if (size == 0 && symbol != SYMBOL_END && symbol != SYMBOL_RUN_16) break;
    if (taken + bits + size > PASS_MAX_TAKEN) break;
    taken += bits + size;
    state = symbol == SYMBOL_END ? pass_next_channel(state) : state | 1;
  }
  return (uint16_t)(taken ? taken | state << 6 : 0);
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
    tables->head[w] = head_entry(&tables->decoders[CODE_HEAD], w);
    for (int i = 0; i < 4; i++) tables->dc[i][w] = dc_entry(&tables->decoders[CODE_DC + i], w);
  }
  for (int i = 0; i < 4; i++) {
    const huffman_decoder *first = &tables->decoders[CODE_AC + 2 * i], *later = first + 1;
    first_ac_table *at_first = &tables->first_ac[i];
    ac_table *then = &tables->later_ac[i];
    for (uint32_t w = 0; w < 1u << FAST_FIRST_BITS; w++)
      at_first->taken[w] = ac_entry(first, later, w, FAST_FIRST_BITS, &at_first->levels[w]);
    for (uint32_t w = 0; w < 1u << FAST_BITS; w++)
      then->taken[w] = ac_entry(later, later, w, FAST_BITS, &then->levels[w]);
  }
  for (uint32_t w = 0; w < 1u << PASS_BITS; w++) {
    tables->bare_heads[w] = bare_heads_entry(tables, w);
    for (unsigned i = 0; i < PASS_STATES; i++) tables->pass[i][w] = pass_entry(tables, i, w);
    tables->pass[PASS_END][w] = PASS_END << 6;
  }
  memset(tables->dc[NO_DC], 0, sizeof tables->dc[NO_DC]);
  tables->may_lean = false;
  const huffman_code *heads = &codes->codes[CODE_HEAD];
  for (int i = 0; i < heads->symbol_count; i++)
    if (heads->symbols[i] >> 3 == PREDICT_PREVIOUS) tables->may_lean = true;
  for (int i = 1; i < codes->codes[CODE_WHOLE_HEAD].symbol_count; i++)
    if (whole_head_symbol(codes->whole_heads[i]) >> 3 == PREDICT_PREVIOUS) tables->may_lean = true;
}
