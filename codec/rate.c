#include "codec/rate.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <string.h>

enum { LOOK_BACK = 12 }; /* levels of a trellis path that may be dropped in a row */

void costs_guess(code_costs *costs) {
  for (int i = 0; i < 64; i++) costs->head[i] = 3;
  for (int i = 0; i < 32; i++) costs->shift[i] = 4;
  for (int i = 0; i < 4; i++)
    for (int size = 0; size < 17; size++) costs->dc[i][size] = 2.5f + (float)size;
  for (int i = 0; i < 8; i++) {
    for (int symbol = 0; symbol < 256; symbol++)
      costs->ac[i][symbol] = 1.0f + 0.5f * (float)(symbol >> 4) + 2.2f * (float)(symbol & 15);
    costs->ac[i][SYMBOL_END] = i & 1 ? 2 : 4;
    costs->ac[i][SYMBOL_RUN_16] = 10;
  }
}

static void code_bits(const huffman_code *code, float bits[256], float absent) {
  huffman_encoder encoder;
  huffman_make_encoder(code, &encoder);
  for (int s = 0; s < 256; s++) bits[s] = encoder.bits[s] ? encoder.bits[s] : absent;
}

void costs_from_codes(const block_codes *codes, code_costs *costs) {
  float bits[256];
  code_bits(&codes->codes[CODE_HEAD], bits, FLT_MAX / 1e6f);
  memcpy(costs->head, bits, sizeof costs->head);
  code_bits(&codes->codes[CODE_SHIFT], bits, FLT_MAX / 1e6f);
  memcpy(costs->shift, bits, sizeof costs->shift);
  for (int i = 0; i < 4; i++) {
    code_bits(&codes->codes[CODE_DC + i], bits, FLT_MAX / 1e6f);
    for (int size = 0; size < 17; size++) costs->dc[i][size] = bits[size] + (float)size;
  }
  for (int i = 0; i < 8; i++) {
    code_bits(&codes->codes[CODE_AC + i], bits, 0);
    const float escaped = bits[SYMBOL_ESCAPE] + ESCAPED_RUN_BITS + ESCAPED_SIZE_BITS;
    for (int s = 0; s < 256; s++)
      costs->ac[i][s] = (bits[s] > 0 ? bits[s] : escaped) + (float)(s & 15);
  }
}

static float ac_bits(const code_costs *costs, int code, unsigned run, unsigned magnitude) {
  unsigned size = 32 - (unsigned)__builtin_clz(magnitude);
  assert(size <= MAX_SIZE); /* MAX_LEVEL's */
  float bits = costs->ac[code][(run & 15) << 4 | size];
  if (run < 16) return bits;
  int later = code | 1;
  bits = costs->ac[later][(run & 15) << 4 | size];
  return bits + costs->ac[code][SYMBOL_RUN_16] +
         (float)(run / 16 - 1) * costs->ac[later][SYMBOL_RUN_16];
}

/* Best DC: the nearest level or the one below it. */
static float choose_dc(const float *bits, float x, int previous, float lambda, int16_t *level) {
  int nearest = (int)lrintf(fmaxf(-MAX_LEVEL, fminf(MAX_LEVEL, x)));
  float best = FLT_MAX;
  for (int i = 0; i < 3; i++) {
    int l = i == 0 ? nearest : i == 1 ? nearest + (x < (float)nearest ? -1 : 1) : previous;
    unsigned size = level_size(l - previous);
    if (size > 15 || l < -MAX_LEVEL || l > MAX_LEVEL) continue;
    float d = x - (float)l, cost = d * d + lambda * bits[size];
    if (cost >= best) continue;
    best = cost;
    *level = (int16_t)l;
  }
  return best;
}

typedef struct {
  int k, from, level;
  float cost;
} trellis_node;

/* The trellis over AC. Returns the least cost of levels with at least one that is not 0, FLT_MAX if
 * all round to 0; the levels are written. zeros is the error of leaving all at 0. */
static float choose_ac(const code_costs *costs, int first_code, const float x[COEFFICIENTS],
                       float lambda, int16_t levels[COEFFICIENTS], float *zeros) {
  trellis_node nodes[COEFFICIENTS];
  float zeroed[COEFFICIENTS]; /* error of all candidates up to a node, left at 0 */
  float rest = 0;             /* error of what rounds to 0 in any case */
  int count = 1;
  nodes[0] = (trellis_node){0, -1, 0, 0};
  zeroed[0] = 0;
  for (int k = 1; k < COEFFICIENTS; k++) {
    float a = fabsf(x[slf_zigzag[k]]);
    if (a < 0.5f) {
      rest += a * a;
      continue;
    }
    trellis_node *node = &nodes[count];
    zeroed[count] = zeroed[count - 1] + a * a;
    *node = (trellis_node){k, 0, 0, FLT_MAX};
    int nearest = (int)fminf(a + 0.5f, MAX_LEVEL);
    for (int level = nearest; level >= 1 && level >= nearest - 1; level--) {
      float error = (a - (float)level) * (a - (float)level);
      for (int from = count - 1; from >= 0 && from >= count - LOOK_BACK; from--) {
        unsigned run = (unsigned)(k - nodes[from].k - 1);
        float cost =
            nodes[from].cost + zeroed[count - 1] - zeroed[from] + error +
            lambda * ac_bits(costs, from ? first_code | 1 : first_code, run, (unsigned)level);
        if (cost < node->cost) {
          node->cost = cost;
          node->from = from;
          node->level = level;
        }
      }
    }
    count++;
  }
  *zeros = zeroed[count - 1] + rest;
  int best = 0;
  float best_cost = FLT_MAX;
  for (int i = 1; i < count; i++) {
    float cost = nodes[i].cost + zeroed[count - 1] - zeroed[i] + rest;
    if (cost >= best_cost) continue;
    best_cost = cost;
    best = i;
  }
  if (best == 0) return FLT_MAX;
  for (int i = best; i > 0; i = nodes[i].from) {
    int at = slf_zigzag[nodes[i].k];
    levels[at] = (int16_t)(x[at] < 0 ? -nodes[i].level : nodes[i].level);
  }
  return best_cost + lambda * costs->ac[first_code | 1][SYMBOL_END];
}

void choose_levels(const code_costs *costs, bool intra, bool chroma, const float x[COEFFICIENTS],
                   int previous_dc, float lambda, channel_choice choices[2]) {
  const float *dc_bits = costs->dc[dc_code(!intra, chroma) - CODE_DC];
  int ac = ac_code(!intra, chroma, 0) - CODE_AC;
  float zeros;
  memset(choices, 0, 2 * sizeof *choices);
  float ac_cost = choose_ac(costs, ac, x, lambda, choices[1].levels, &zeros);
  int16_t dc = 0;
  float dc_cost = choose_dc(dc_bits, x[0], intra ? previous_dc : 0, lambda, &dc);
  choices[1].levels[0] = dc;
  choices[1].coded = ac_cost < FLT_MAX;
  choices[1].cost = choices[1].coded ? ac_cost + dc_cost : FLT_MAX;
  if (intra) {
    choices[0].levels[0] = dc;
    choices[0].cost = dc_cost + zeros;
    return;
  }
  choices[0].cost = x[0] * x[0] + zeros;
  /* A residual of DC alone: the first symbol is the end. */
  float alone = dc_cost + zeros + lambda * costs->ac[ac][SYMBOL_END];
  if (dc && alone < choices[1].cost) {
    memset(choices[1].levels, 0, sizeof choices[1].levels);
    choices[1].levels[0] = dc;
    choices[1].cost = alone;
    choices[1].coded = true;
  }
}
