/* block_code.h - the symbols of a C-Block: FORMAT.md, "C-Blocks". */
#ifndef SLF_BLOCK_CODE_H
#define SLF_BLOCK_CODE_H

#include "codec/huffman.h"

enum {
  COEFFICIENTS = 64,
  MAX_LEVEL = 32767,
  MOST_LEVELS = 3 * (COEFFICIENTS - 1), /* AC, of a block */
  FAST_BITS = 11,
  FAST_FIRST_BITS = 9,
  FAST_DC_BITS = 9,
  FAST_HEAD_BITS = 10,
  /* AC symbols are run << 4 | size as in JPEG, and with size 0: */
  SYMBOL_END = 0x00,    /* no level but 0 follows in the channel */
  SYMBOL_ESCAPE = 0x10, /* run and size follow as numbers */
  SYMBOL_RUN_16 = 0xf0, /* sixteen zeros */
  ESCAPED_RUN_BITS = 6,
  ESCAPED_SIZE_BITS = 4,
  MAX_SIZE = 15
};

/* What a C-Block's levels are added to. A head symbol is predictor << 3 | one bit for each channel
 * with levels: for INTRA AC levels, for the others any. */
typedef enum {
  PREDICT_INTRA, /* nothing; DC from the last INTRA block of the entry */
  PREDICT_BASE,  /* the base's block */
  PREDICT_KEY,   /* the group's key */
  PREDICT_KEYS,  /* the keys around, mixed */
  PREDICT_SHIFT, /* base + shifted (key - base); in the motion scheme the shifted left neighbour */
  PREDICT_PREVIOUS, /* the block before of the same place */
  PREDICTOR_COUNT
} predictor;

/* The Huffman codes of a stream. INTRA blocks have their own codes for levels; chroma too; and so
 * has the first AC level of a channel, for which the end is no choice, or a rare one. */
enum {
  CODE_HEAD,
  CODE_SHIFT,
  CODE_DC,     /* + 2 residual + chroma */
  CODE_AC = 6, /* + 4 residual + 2 chroma + later */
  CODE_WHOLE_HEAD = 14,
  CODE_COUNT = 15
};

static inline int dc_code(int residual, int chroma) {
  return CODE_DC + 2 * residual + chroma;
}
static inline int ac_code(int residual, int chroma, int later) {
  return CODE_AC + 4 * residual + 2 * chroma + later;
}

/* A whole head: a head symbol and the sizes of the three DC levels, bits 0-5 and from bit 6 on four
 * bits each. They go together, and those that are frequent have a code of their own, whose symbols
 * number them from 1; symbol 0 says that head and sizes follow one by one. */
enum { WHOLE_HEAD_BITS = 18, MAX_WHOLE_HEADS = 255, WHOLE_HEAD_NBYTES = 3 };

static inline uint32_t whole_head(unsigned head, const unsigned sizes[3]) {
  return head | sizes[0] << 6 | sizes[1] << 10 | sizes[2] << 14;
}
static inline unsigned whole_head_symbol(uint32_t whole) {
  return whole & 63;
}
static inline unsigned whole_head_size(uint32_t whole, int channel) {
  return whole >> (6 + 4 * channel) & 15;
}

typedef struct {
  huffman_code codes[CODE_COUNT];            /* symbol_count 0: not used */
  uint32_t whole_heads[MAX_WHOLE_HEADS + 1]; /* [0] unused */
} block_codes;

/* Blocks of coefficients are column-major here: 8 * horizontal + vertical frequency, which spares
 * the inverse transform a transposition. Place of the k-th coefficient of JPEG's zigzag scan; what
 * lies behind the last one is at place 64, which means nothing. */
extern const uint8_t slf_zigzag[COEFFICIENTS + 1];

/* JPEG's magnitude bits (ISO/IEC 10918-1, F.1.2.1): size bits, negative where the first is 0. */
static inline int32_t extend(uint32_t value, unsigned size) {
  return size && value >> (size - 1) == 0 ? (int32_t)value - (int32_t)((1u << size) - 1)
                                          : (int32_t)value;
}

/* A look at AC symbols shows as many whole ones as a window has, four at most and no further than
 * FAST_REACH. What they take has a byte of its own, and flags: each look waits for the one before
 * to say it, and small tables stay in a first-level cache; those of the symbols, for which nothing
 * waits, need not. A channel's first look makes do with a smaller window.
 *
 * Symbols: bits 0-15 bit i set where a level lies i + 1 places behind the one before the look; from
 * bit 16 on four bits each, the sizes of those levels. RUN_16 is a level of no bits. With FAST_NONE
 * nothing is seen whole.
 *
 * A DC entry: bits 0-3 how many bits the code takes, 4-7 and then the level; 0 if the code has more
 * than FAST_DC_BITS. */
enum {
  FAST_TAKEN = 63,
  FAST_END = 1 << 6, /* the channel ends here */
  FAST_NONE = 1 << 7,
  FAST_SYMBOLS = 4,
  FAST_REACH = 16,
  FAST_DC_SIZE = 14, /* a head and two DC levels: 9 + 2 x (9 + 14) bits, which a refill gives */
  LONG_DC = 255,
  NO_DC = 4
};

typedef struct {
  uint32_t symbols[1 << FAST_BITS];
  uint8_t taken[1 << FAST_BITS];
} ac_table;

typedef struct {
  uint32_t symbols[1 << FAST_FIRST_BITS];
  uint8_t taken[1 << FAST_FIRST_BITS];
} first_ac_table;

/* To pass over AC levels, only their bits are counted. A state is what of a block is still to come:
 * residual or not, the channels, the first symbol of a channel or a later one. An entry: bits 0-3
 * bits taken by the symbols that PASS_BITS show whole, 0 if there is none; 4-8 the state behind
 * them; 9-15 bits that their levels have at the block's end. There nothing is taken. */
enum { PASS_BITS = 9, PASS_STATES = 20, PASS_END = PASS_STATES, PASS_MAX_LEVEL_BITS = 127 };
static inline unsigned pass_taken(unsigned entry) {
  return entry & 15;
}
static inline unsigned pass_next(unsigned entry) {
  return entry >> 4 & 31;
}
static inline unsigned pass_level_bits(unsigned entry) {
  return entry >> 9;
}
static inline unsigned pass_state(int residual, unsigned flags) {
  static const uint8_t states[2][8] = {{PASS_END, 4, 0, 6, 0, 6, 2, 8},
                                       {PASS_END, 14, 10, 16, 10, 16, 12, 18}};
  return states[residual][flags];
}
static inline int pass_code(unsigned state) {
  return ac_code(state >= 10, state % 10 < 4, state & 1);
}
/* The state when the channel has ended: luma, luma and chroma: the chroma; two chroma: one. */
static inline unsigned pass_next_channel(unsigned state) {
  static const uint8_t next[10] = {PASS_END, PASS_END, 0, 0, PASS_END, PASS_END, 0, 0, 2, 2};
  unsigned after = next[state % 10];
  return after == PASS_END ? PASS_END : state / 10 * 10 + after;
}

typedef struct {
  first_ac_table first_ac[4]; /* + 2 residual + chroma */
  ac_table later_ac[4];
  uint8_t dc[NO_DC + 1][1 << FAST_DC_BITS]; /* NO_DC: takes nothing, gives 0 */
  uint16_t head[1 << FAST_DC_BITS];         /* bits 0-7 bits taken, 0 if longer; 8-15 the symbol */
  uint16_t shift[1 << FAST_DC_BITS];        /* likewise */
  /* Bits 0-5 bits taken with the DC levels behind, 0 if this is not the place to look; 6-9 those of
   * the code; 10-27 the whole head. */
  uint32_t whole_head[1 << FAST_HEAD_BITS];
  uint16_t pass[PASS_STATES + 1][1 << PASS_BITS];
  /* Blocks that are a head and no more: bits 0-3 bits taken, 4-7 how many blocks. */
  uint8_t bare_heads[1 << PASS_BITS];
  bool may_lean; /* some block is predicted from the one before it */
  bool has_whole_heads;
  uint32_t whole_heads[MAX_WHOLE_HEADS + 1];
  huffman_decoder decoders[CODE_COUNT];
} block_tables;

void block_tables_make(const block_codes *codes, block_tables *tables);

/* A block's levels. */
typedef struct {
  int16_t levels[3][COEFFICIENTS]; /* column-major, in the stream's levels */
  unsigned ac_flags;               /* bit c: channel c may have an AC level, */
  unsigned last_k[3];              /* none of them behind this place of the zigzag scan */
} block_levels;

/* What the C-Blocks of an entry add up to so far. */
typedef struct {
  block_levels block; /* the one read last */
  int16_t intra_dc[3];
  predictor predictor; /* of the last block that was not PREVIOUS */
  int shift_u, shift_v;
  uint32_t anchor; /* that block's number in the entry */
} entry_state;

static inline const block_levels *entry_levels(const entry_state *state) {
  return &state->block;
}

static inline void entry_begin(entry_state *state, const int16_t dc_begin[3]) {
  for (int channel = 0; channel < 3; channel++) state->intra_dc[channel] = dc_begin[channel];
  state->predictor = PREDICT_INTRA;
  state->shift_u = state->shift_v = 0;
  state->anchor = 0;
}

#endif
