/* encode_symbols.c - from a block that was chosen to its symbols. */
#include "codec/encode_parts.h"

#include <stdatomic.h>

static void put_symbol(const symbol_sink *sink, int code, unsigned symbol) {
  if (sink->counts)
    sink->counts[code][symbol]++;
  else
    bits_put(sink->bits, sink->encoder->encoders[code].codes[symbol],
             sink->encoder->encoders[code].bits[symbol]);
}

static uint32_t magnitude_bits(int level, unsigned size) {
  return (uint32_t)(level < 0 ? level - 1 : level) & ((1u << size) - 1);
}

static void put_magnitude(const symbol_sink *sink, int level, unsigned size) {
  if (!sink->counts) bits_put(sink->bits, magnitude_bits(level, size), size);
}

/* The bits of AC levels, which follow all symbols of their block. */
typedef struct {
  uint32_t bits[MOST_LEVELS];
  uint8_t sizes[MOST_LEVELS];
  size_t count;
} level_bits;

static void keep_level(level_bits *levels, int level, unsigned size) {
  levels->sizes[levels->count] = (uint8_t)size;
  levels->bits[levels->count++] = magnitude_bits(level, size);
}

/* What stands for an AC level behind `run` zeros; what the codes lack escapes. Returns the code of
 * what follows. */
static int put_run_level(const symbol_sink *sink, int code, unsigned run, int level,
                         level_bits *levels) {
  unsigned size = level_size(level), tail = (run & 15) << 4 | size;
  const huffman_encoder *encoders = sink->encoder->encoders;
  const huffman_encoder *own = &encoders[run < 16 ? code : code | 1];
  bool coded = sink->counts ||
               (own->bits[tail] &&
                (run < 16 || (encoders[code].bits[SYMBOL_RUN_16] && own->bits[SYMBOL_RUN_16])));
  if (coded) {
    for (; run > 15; run -= 16, code |= 1) put_symbol(sink, code, SYMBOL_RUN_16);
    put_symbol(sink, code, tail);
  } else {
    put_symbol(sink, code, SYMBOL_ESCAPE);
    bits_put(sink->bits, run, ESCAPED_RUN_BITS);
    bits_put(sink->bits, size, ESCAPED_SIZE_BITS);
  }
  keep_level(levels, level, size);
  return code | 1;
}

static void put_shift(const symbol_sink *sink, const block_choice *b) {
  if (b->predictor != PREDICT_SHIFT) return;
  put_symbol(sink, CODE_SHIFT, (unsigned)(b->du + 16));
  put_symbol(sink, CODE_SHIFT, (unsigned)(b->dv + 16));
}

/* Head, shifts and DC levels: as a whole if that has a code; counted both ways. */
static void put_head(const symbol_sink *sink, const block_choice *b, const int dc[3]) {
  int residual = b->predictor != PREDICT_INTRA;
  unsigned head = (unsigned)b->predictor << 3 | b->flags, sizes[3];
  for (int channel = 0; channel < 3; channel++) sizes[channel] = level_size(dc[channel]);
  uint32_t whole = whole_head(head, sizes);
  unsigned symbol = sink->counts ? 0 : sink->encoder->whole_heads[whole];
  if (sink->counts)
    atomic_fetch_add(&sink->head_counts[whole], 1);
  else if (sink->encoder->encoders[CODE_WHOLE_HEAD].bits[0])
    put_symbol(sink, CODE_WHOLE_HEAD, symbol);
  if (symbol == 0) {
    put_symbol(sink, CODE_HEAD, head);
    put_shift(sink, b);
  }
  for (int channel = 0; channel < 3; channel++) {
    if (residual && !(b->flags >> channel & 1)) continue;
    if (symbol == 0) put_symbol(sink, dc_code(residual, channel > 0), sizes[channel]);
    put_magnitude(sink, dc[channel], sizes[channel]);
  }
  if (symbol) put_shift(sink, b);
}

void symbols_put_block(const symbol_sink *sink, const block_choice *b, place_state *state) {
  int residual = b->predictor != PREDICT_INTRA, dc[3];
  for (int channel = 0; channel < 3; channel++) {
    int level = b->levels[channel][0];
    dc[channel] = !residual                 ? level - state->intra_dc[channel]
                  : b->flags >> channel & 1 ? level
                                            : 0;
    if (!residual) state->intra_dc[channel] = b->levels[channel][0];
  }
  put_head(sink, b, dc);
  level_bits seen = {.count = 0};
  for (int channel = 0; channel < 3; channel++) {
    const int16_t *levels = b->levels[channel];
    if (!(b->flags >> channel & 1)) continue;
    int code = ac_code(residual, channel > 0, 0);
    unsigned run = 0;
    for (int k = 1; k < COEFFICIENTS; k++) {
      int level = levels[slf_zigzag[k]];
      if (level) code = put_run_level(sink, code, run, level, &seen);
      run = level ? 0 : run + 1;
    }
    put_symbol(sink, code, SYMBOL_END);
  }
  for (size_t i = 0; i < seen.count && !sink->counts; i++)
    bits_put(sink->bits, seen.bits[i], seen.sizes[i]);
}
