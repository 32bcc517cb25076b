/* rate.h - what symbols cost, and the levels that are worth their bits. */
#ifndef SLF_RATE_H
#define SLF_RATE_H

#include "codec/block_code.h"

/* Bits of symbols, their magnitude bits included. */
typedef struct {
  float head[64];
  float shift[32];
  float dc[4][17];  /* by size */
  float ac[8][256]; /* by run (0 .. 15) << 4 | size; [0] the end, [0xf0] sixteen zeros */
} code_costs;

/* A guess, before anything was counted; then what the codes say. */
void costs_guess(code_costs *costs);
void costs_from_codes(const block_codes *codes, code_costs *costs);

static inline unsigned level_size(int level) {
  unsigned magnitude = level < 0 ? (unsigned)-level : (unsigned)level;
  return magnitude ? 32 - (unsigned)__builtin_clz(magnitude) : 0;
}

/* A channel's choice. */
typedef struct {
  int16_t levels[COEFFICIENTS]; /* natural order */
  float cost;                   /* error + lambda bits, the head's apart */
  bool coded;                   /* its bit in the head */
} channel_choice;

/* Levels for coefficients x (natural order, in steps), such that squared error + lambda * bits is
 * least (a trellis over the levels that are not 0, Crouse and Ramchandran 1997). For intra,
 * previous_dc is what DC is coded against. coded[0] has the bit of the head clear, coded[1] set;
 * coded[1].coded is false where that is no choice. */
void choose_levels(const code_costs *costs, bool intra, bool chroma, const float x[COEFFICIENTS],
                   int previous_dc, float lambda, channel_choice choices[2]);

#endif
