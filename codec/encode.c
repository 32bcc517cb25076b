/* encode.c - from slices to C-Blocks. */
#include "codec/encode.h"

#include "codec/kernel.h"
#include "codec/parallel.h"
#include "codec/rate.h"

#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>

enum {
  MAX_STEP = 3900,
  PAIR_BITS = 200,       /* a pair's bits are worth its index: 11 of them, */
  PART_PAIR_BITS = 256,  /* and if it is less than a place, DC that begins anew */
  SAMPLED_SLICES = 24,   /* the colours are made from so many slices, */
  SAMPLED_UNITS = 24,    /* the codes are made from places of so many units, */
  SAMPLED_PLACES = 3072, /* so many places in all, */
  TRAINING_ROUNDS = 3,   /* coded so often, each time with the codes of the time before */
  GROUPS_A_TASK = 16
};

/* What a bit is worth in squared steps. At high rate the slope of error against rate is
 * 2 ln 2 / 12 = 0.12; the small levels that most of our bits go to are worth a little more. */
static const float lambda = 0.12f;

/* Time counts, too: a percent of it as much as a third of a percent of the bits. A block of b bits
 * is decoded in 200 + 0.4 b ns, and in so many more where its key is looked for, several are mixed
 * or a difference is shifted (cube, quality 90). */
static const float time_worth = 1 / 3.0f, block_ns = 200, bit_ns = 0.4f;
static const float prediction_ns[PREDICTOR_COUNT] = {
    [PREDICT_KEY] = 45, [PREDICT_KEYS] = 100, [PREDICT_SHIFT] = 130};

typedef float coefficients[3][COEFFICIENTS];

typedef struct {
  layer_state layer;
  const slf_source *source;
  scratch_file *scratch;
  scratch_map maps[STREAM_COUNT]; /* of the streams that others are predicted from */
  const char *name;
  uint32_t thread_count;
  float steps[3][COEFFICIENTS]; /* of a level of the rest, as numbers */
  int16_t to_rgb[3][3];         /* the layer's own colours, in COLOUR_ONEs */
  float from_rgb[3][3];         /* [channel][R G B] */
  code_costs costs;             /* of the stream that is being coded */
  float bits_a_ns;              /* likewise: what decoding it sooner is worth */
  huffman_encoder encoders[CODE_COUNT];
  uint8_t *whole_heads;          /* by whole head, its symbol, 0 where it has none */
  float *rgb;                    /* one slice */
  uint16_t *slices[QUAD_SLICES]; /* codes R G B of a unit's slices */
  /* The motion scheme: what the slice of an odd S decodes to, for t even and odd, by place. */
  float (*left[2])[3][COEFFICIENTS];
  _Atomic uint64_t squared_error; /* of all codes, as they will be decoded */
} layer_encoder;

/* ---- Quality ------------------------------------------------------------------------------- */

/* A channel's error counts in R, G and B: luma's in all, Cb's 1.772 and 0.344, Cr's 1.402 and 0.714
 * times; of a layer's own colours as much as luma's. Steps in inverse proportion make every bit buy
 * the same error; the slight slope over the frequencies keeps whole-numbered steps from jumping all
 * at the same quality. Steps of the scheme without prediction are whole, so that a slice can leave
 * as a JPEG with the same coefficients. */
static void make_steps(layer_encoder *e) {
  static const double jfif_scale[3] = {1.0, 0.96, 1.10};
  double unit = e->layer.public.curve == SLF_CURVE_DWA ? DWA_SCALE / 255.0 : 1;
  double base = unit * exp2((100 - e->layer.public.quality) / 8.0);
  for (int channel = 0; channel < 3; channel++) {
    double scale = e->layer.own_colours ? 1 : jfif_scale[channel];
    double step = fmin(base * scale, MAX_STEP) * STEP_ONE;
    step_line *line = &e->layer.step_lines[channel];
    line->first = (uint32_t)fmax(STEP_ONE, floor(0.95 * step + 0.5));
    line->slope = (uint32_t)floor(0.007 * step * 16 + 0.5);
  }
  layer_make_steps(&e->layer);
  for (int channel = 0; channel < 3; channel++)
    for (int i = 0; i < COEFFICIENTS; i++)
      e->steps[channel][i] = (float)e->layer.steps[channel][i] / STEP_ONE;
  /* What many blocks lean on is worth eight times finer steps, and a key twice, as long as the
   * levels fit in 16 bits: a coefficient is at most 8 codes' range. */
  double range = e->layer.public.curve == SLF_CURVE_DWA ? DWA_CODES : 256;
  uint32_t gain = MAX_GAIN;
  while (gain > 1 && 8 * range * gain / base > MAX_LEVEL) gain /= 2;
  bool layered = e->layer.public.angular == SLF_ANGULAR_LAYERED;
  e->layer.gains[STREAM_REST] = layered ? gain : 1;
  e->layer.gains[STREAM_KEYS] = gain > 2 ? gain * 3 / 4 : 1;
  e->layer.gains[STREAM_BASE] = 1;
  layer_make_scales(&e->layer);
}

/* ---- Coefficients -------------------------------------------------------------------------- */

static void transform_texels(const layer_encoder *e, float rgb[COEFFICIENTS][3], coefficients c) {
  float texels[3][COEFFICIENTS], shift = e->layer.level_shift;
  for (int i = 0; i < COEFFICIENTS; i++) {
    float r = rgb[i][0] - shift, g = rgb[i][1] - shift, b = rgb[i][2] - shift;
    for (int k = 0; k < 3; k++)
      texels[k][i] = e->from_rgb[k][0] * r + e->from_rgb[k][1] * g + e->from_rgb[k][2] * b;
  }
  for (int channel = 0; channel < 3; channel++)
    e->layer.kernel->forward_dct(texels[channel], c[channel]);
}

/* Texel i of a place; beyond the slice's edge the edge repeats. */
static size_t texel_index(const slf_layer *p, uint64_t place, uint32_t i) {
  uint32_t u = (uint32_t)(place % p->block_u_count) * SLF_BLOCK_SIDE + i % 8;
  uint32_t v = (uint32_t)(place / p->block_u_count) * SLF_BLOCK_SIDE + i / 8;
  u = u < p->u_count ? u : p->u_count - 1;
  v = v < p->v_count ? v : p->v_count - 1;
  return (size_t)v * p->u_count + u;
}

static void transform_block(const layer_encoder *e, const uint16_t *slice, uint64_t place,
                            coefficients c) {
  float rgb[COEFFICIENTS][3];
  for (uint32_t i = 0; i < COEFFICIENTS; i++) {
    const uint16_t *texel = slice + 3 * texel_index(&e->layer.public, place, i);
    for (int k = 0; k < 3; k++) rgb[i][k] = texel[k];
  }
  transform_texels(e, rgb, c);
}

/* ---- Symbols ------------------------------------------------------------------------------- */

/* Symbols go to counts, or where counts is NULL out to bits. */
typedef struct {
  const layer_encoder *encoder;
  uint64_t (*counts)[256];
  _Atomic uint32_t *head_counts; /* by whole head; beside counts */
  bit_string *bits;
} symbol_sink;

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

/* What a place's blocks are predicted from, as the decoder will have it. */
typedef struct {
  int16_t intra_dc[3];
  bool has_previous;
  predictor anchor;      /* what the block before stands on, itself or through others, and */
  coefficients previous; /* what it decodes to */
  float (
      *left[2])[COEFFICIENTS]; /* of the motion scheme: channels of the left neighbour, by t & 1 */
} place_state;

typedef struct {
  predictor predictor;
  int du, dv;
  unsigned flags;
  int16_t levels[3][COEFFICIENTS];
  float cost;
} block_choice;

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

static void put_block(const symbol_sink *sink, const block_choice *b, place_state *state) {
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

/* ---- Choosing ------------------------------------------------------------------------------ */

typedef struct {
  const layer_encoder *encoder;
  stream_kind kind;
  uint32_t s, t; /* the slice, of keys and rest */
  uint64_t place;
  float step_scale; /* of this stream's level over the rest's */
} block_site;

/* Bits that a whole head takes beyond what it stands for, as choose_levels counted that. */
static float whole_head_change(const layer_encoder *e, predictor how, unsigned flags,
                               channel_choice choices[3][2], const int16_t intra_dc[3]) {
  if (!e->encoders[CODE_WHOLE_HEAD].bits[0]) return 0;
  unsigned sizes[3] = {0}, head = (unsigned)how << 3 | flags;
  int residual = how != PREDICT_INTRA;
  float parts = e->costs.head[head];
  for (int c = 0; c < 3; c++) {
    if (residual && !(flags >> c & 1)) continue;
    sizes[c] = level_size(choices[c][flags >> c & 1].levels[0] - (residual ? 0 : intra_dc[c]));
    parts += e->costs.dc[dc_code(residual, c > 0) - CODE_DC][sizes[c]] - (float)sizes[c];
  }
  unsigned symbol = e->whole_heads[whole_head(head, sizes)];
  return (float)e->encoders[CODE_WHOLE_HEAD].bits[symbol] - (symbol ? parts : 0);
}

/* The best levels for what a prediction leaves (NULL: nothing predicted). */
static void try_predictor(const block_site *site, predictor how, int du, int dv,
                          const coefficients target, coefficients prediction,
                          const place_state *state, block_choice *best) {
  const layer_encoder *e = site->encoder;
  const code_costs *costs = &e->costs;
  channel_choice choices[3][2];
  bool intra = how == PREDICT_INTRA;
  for (int c = 0; c < 3; c++) {
    float x[COEFFICIENTS];
    for (int i = 0; i < COEFFICIENTS; i++)
      x[i] = (target[c][i] - (prediction ? prediction[c][i] : 0)) /
             (e->steps[c][i] * site->step_scale);
    choose_levels(costs, intra, c > 0, x, state->intra_dc[c], lambda, choices[c]);
  }
  predictor anchor = how == PREDICT_PREVIOUS ? state->anchor : how;
  float fixed = lambda * e->bits_a_ns * prediction_ns[anchor];
  if (how == PREDICT_SHIFT) fixed += lambda * (costs->shift[du + 16] + costs->shift[dv + 16]);
  for (unsigned flags = 0; flags < 8; flags++) {
    float cost = fixed + lambda * costs->head[how << 3 | flags];
    bool possible = true;
    for (int c = 0; c < 3; c++) {
      const channel_choice *choice = &choices[c][flags >> c & 1];
      possible = possible && (!(flags >> c & 1) || choice->coded);
      cost += choice->cost;
    }
    if (possible) cost += lambda * whole_head_change(e, how, flags, choices, state->intra_dc);
    if (!possible || cost >= best->cost) continue;
    best->cost = cost;
    best->predictor = how;
    best->flags = flags;
    best->du = du;
    best->dv = dv;
    for (int c = 0; c < 3; c++)
      memcpy(best->levels[c], choices[c][flags >> c & 1].levels, sizeof best->levels[c]);
  }
}

/* The identical scheme's one choice beside INTRA: the prediction as it is. */
static void try_copy(const block_site *site, predictor how, const coefficients target,
                     coefficients prediction, block_choice *best) {
  const layer_encoder *e = site->encoder;
  float cost = lambda * e->costs.head[how << 3];
  for (int k = 0; k < 3 * COEFFICIENTS; k++) {
    float x = ((&target[0][0])[k] - (&prediction[0][0])[k]) / (&e->steps[0][0])[k];
    cost += x * x;
  }
  if (cost >= best->cost) return;
  *best = (block_choice){.predictor = how, .cost = cost};
}

static void fine_to_coefficients(const layer_encoder *e, int16_t fine[3][COEFFICIENTS],
                                 coefficients c) {
  for (int k = 0; k < 3 * COEFFICIENTS; k++)
    (&c[0][0])[k] = (&fine[0][0])[k] * (&e->steps[0][0])[k] / (float)e->layer.gains[STREAM_REST];
}

enum { WINDOW_SIDE = 24, WINDOW_BEGIN = 8 }; /* a block and what lies around it */

/* The shift for which the window is nearest to wanted luma. */
static void search_shift(float window[WINDOW_SIDE][WINDOW_SIDE], const float wanted[COEFFICIENTS],
                         int *du, int *dv) {
  float best = FLT_MAX;
  for (int y = -MAX_SHIFT; y <= MAX_SHIFT; y++)
    for (int x = -MAX_SHIFT; x <= MAX_SHIFT; x++) {
      float lanes[8] = {0}, sum = 0;
      for (int j = 0; j < 8; j++)
        for (int i = 0; i < 8; i++) {
          float d = window[WINDOW_BEGIN + y + j][WINDOW_BEGIN + x + i] - wanted[8 * j + i];
          lanes[i] += d * d;
        }
      for (int i = 0; i < 8; i++) sum += lanes[i];
      if (sum >= best) continue;
      best = sum;
      *du = x;
      *dv = y;
    }
}

static void add_coefficients(coefficients c, const coefficients more) {
  for (int k = 0; k < 3 * COEFFICIENTS; k++) (&c[0][0])[k] += (&more[0][0])[k];
}

/* base + shifted (key - base), where that moves best. */
static void try_shift(const block_site *site, const coefficients target,
                      coefficients predictions[PREDICTOR_COUNT], const place_state *state,
                      block_choice *best) {
  const layer_state *layer = &site->encoder->layer;
  uint32_t group = layer_group(layer, site->s, site->t);
  float window[WINDOW_SIDE][WINDOW_SIDE], wanted[COEFFICIENTS], block[3][COEFFICIENTS];
  for (int y = -8; y <= 8; y += 8)
    for (int x = -8; x <= 8; x += 8) {
      layer->kernel->shifted(layer, group, site->place, x, y, block);
      for (int i = 0; i < COEFFICIENTS; i++) window[y + 8 + i / 8][x + 8 + i % 8] = block[0][i];
    }
  for (int i = 0; i < COEFFICIENTS; i++) wanted[i] = target[0][i] - predictions[PREDICT_BASE][0][i];
  layer->kernel->plain_inverse_dct(wanted);
  int du = 0, dv = 0;
  search_shift(window, wanted, &du, &dv);
  if (!du && !dv) return; /* that is KEY */
  layer->kernel->shifted(layer, group, site->place, du, dv, block);
  for (int c = 0; c < 3; c++) layer->kernel->forward_dct(block[c], predictions[PREDICT_SHIFT][c]);
  add_coefficients(predictions[PREDICT_SHIFT], predictions[PREDICT_BASE]);
  try_predictor(site, PREDICT_SHIFT, du, dv, target, predictions[PREDICT_SHIFT], state, best);
}

static void try_layered(const block_site *site, const coefficients target,
                        coefficients predictions[PREDICTOR_COUNT], const place_state *state,
                        block_choice *best) {
  const layer_encoder *e = site->encoder;
  const layer_state *layer = &e->layer;
  fine_block fine;
  layer->kernel->key(layer, layer_group(layer, site->s, site->t), site->place, fine);
  fine_to_coefficients(e, fine, predictions[PREDICT_KEY]);
  try_predictor(site, PREDICT_KEY, 0, 0, target, predictions[PREDICT_KEY], state, best);
  layer->kernel->keys(layer, site->s, site->t, site->place, fine);
  fine_to_coefficients(e, fine, predictions[PREDICT_KEYS]);
  try_predictor(site, PREDICT_KEYS, 0, 0, target, predictions[PREDICT_KEYS], state, best);
  if (state->has_previous) {
    memcpy(predictions[PREDICT_PREVIOUS], state->previous, sizeof(coefficients));
    try_predictor(site, PREDICT_PREVIOUS, 0, 0, target, predictions[PREDICT_PREVIOUS], state, best);
  }
  try_shift(site, target, predictions, state, best);
}

/* The motion scheme: the left neighbour, shifted, its edges repeated. */
static void try_motion(const block_site *site, const coefficients target,
                       coefficients predictions[PREDICTOR_COUNT], const place_state *state,
                       block_choice *best) {
  const layer_state *layer = &site->encoder->layer;
  float(*left)[COEFFICIENTS] = state->left[site->t & 1];
  float window[WINDOW_SIDE][WINDOW_SIDE], wanted[COEFFICIENTS], block[3][COEFFICIENTS];
  for (int y = 0; y < WINDOW_SIDE; y++)
    for (int x = 0; x < WINDOW_SIDE; x++) {
      int u = x < 8 ? 0 : x > 15 ? 7 : x - 8, v = y < 8 ? 0 : y > 15 ? 7 : y - 8;
      window[y][x] = left[0][8 * v + u];
    }
  memcpy(wanted, target[0], sizeof wanted);
  layer->kernel->plain_inverse_dct(wanted);
  int du = 0, dv = 0;
  search_shift(window, wanted, &du, &dv);
  shift_channels(left, du, dv, block);
  for (int c = 0; c < 3; c++) layer->kernel->forward_dct(block[c], predictions[PREDICT_SHIFT][c]);
  try_predictor(site, PREDICT_SHIFT, du, dv, target, predictions[PREDICT_SHIFT], state, best);
}

/* The best way to code one block; state->previous becomes what the decoder will make of it. */
static void choose_block(const block_site *site, const coefficients target, place_state *state,
                         block_choice *best) {
  const layer_encoder *e = site->encoder;
  const layer_state *layer = &e->layer;
  slf_angular angular = layer->public.angular;
  coefficients predictions[PREDICTOR_COUNT];
  best->cost = FLT_MAX;
  memset(predictions[PREDICT_INTRA], 0, sizeof(coefficients));
  try_predictor(site, PREDICT_INTRA, 0, 0, target, NULL, state, best);
  if (site->kind != STREAM_BASE && layer_has(layer, STREAM_BASE)) {
    fine_block fine;
    layer->kernel->base(layer, site->place, fine);
    fine_to_coefficients(e, fine, predictions[PREDICT_BASE]);
    if (angular == SLF_ANGULAR_IDENTICAL)
      try_copy(site, PREDICT_BASE, target, predictions[PREDICT_BASE], best);
    else
      try_predictor(site, PREDICT_BASE, 0, 0, target, predictions[PREDICT_BASE], state, best);
  }
  if (site->kind == STREAM_REST && angular == SLF_ANGULAR_LAYERED)
    try_layered(site, target, predictions, state, best);
  if (angular == SLF_ANGULAR_MOTION && layer_chain_start(layer, site->s, site->t) != site->s)
    try_motion(site, target, predictions, state, best);
  memcpy(state->previous, predictions[best->predictor], sizeof(coefficients));
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < COEFFICIENTS; i++)
      state->previous[c][i] += best->levels[c][i] * e->steps[c][i] * site->step_scale;
  state->has_previous = true;
  if (best->predictor != PREDICT_PREVIOUS) state->anchor = best->predictor;
}

/* ---- Places -------------------------------------------------------------------------------- */

/* The blocks of a place, in the order of their C-Blocks, and where they are. */
typedef struct {
  uint32_t s[QUAD_SLICES], t[QUAD_SLICES];
  int slice_count;
} unit_slices;

static unit_slices slices_of_quad(const layer_state *layer, uint32_t quad) {
  unit_slices unit = {.slice_count = 0};
  for (uint32_t q = 0; q < QUAD_SLICES; q++) {
    if (!(layer->quad_slices[quad] >> q & 1)) continue;
    unit.s[unit.slice_count] = quad % layer->quad_s_count * 2 + (q == 1 || q == 2);
    unit.t[unit.slice_count++] = quad / layer->quad_s_count * 2 + (q >= 2);
  }
  return unit;
}

static block_site site_at(const layer_encoder *e, stream_kind kind, const unit_slices *unit, int i,
                          uint64_t place) {
  float step_scale = (float)e->layer.gains[kind] / (float)e->layer.gains[STREAM_REST];
  return (block_site){e, kind, unit->s[i], unit->t[i], place, step_scale};
}

/* The squared error of a block's codes, of texels that exist. */
static uint64_t block_error(const layer_encoder *e, const uint16_t *slice, uint64_t place,
                            const coefficients decoded) {
  const slf_layer *p = &e->layer.public;
  float channels[3][COEFFICIENTS];
  uint16_t codes[COEFFICIENTS][3];
  uint64_t sum = 0;
  memcpy(channels, decoded, sizeof channels);
  for (int c = 0; c < 3; c++) e->layer.kernel->plain_inverse_dct(channels[c]);
  layer_codes(&e->layer, channels, codes);
  for (uint32_t i = 0; i < COEFFICIENTS; i++) {
    if (place % p->block_u_count * 8 + i % 8 >= p->u_count ||
        place / p->block_u_count * 8 + i / 8 >= p->v_count)
      continue;
    const uint16_t *texel = slice + 3 * texel_index(p, place, i);
    for (int c = 0; c < 3; c++) {
      int64_t difference = (int64_t)texel[c] - codes[i][c];
      sum += (uint64_t)(difference * difference);
    }
  }
  return sum;
}

/* What the motion scheme needs of a block's left neighbour. */
static void keep_decoded(const block_site *site, place_state *state) {
  float(*left)[COEFFICIENTS] = state->left[site->t & 1];
  memcpy(left, state->previous, sizeof(coefficients));
  for (int c = 0; c < 3; c++) site->encoder->layer.kernel->plain_inverse_dct(left[c]);
}

/* A sample has two columns of slices, and so the first one's left neighbours are not at hand. */
static bool is_sampled_alone(const block_site *site, bool measured) {
  const layer_state *layer = &site->encoder->layer;
  return layer->public.angular == SLF_ANGULAR_MOTION && !measured && site->s % 2 == 0 &&
         layer_chain_start(layer, site->s, site->t) != site->s;
}

static place_state begin_entry(const layer_stream *stream) {
  place_state state = {.has_previous = false};
  memcpy(state.intra_dc, stream->dc_begin, sizeof state.intra_dc);
  return state;
}

/* A place's first block leans on none before it, and in an entry of its own it begins anew. */
static void begin_part(place_state *state, const layer_stream *stream) {
  state->has_previous = false;
  if (stream->parts_log2) memcpy(state->intra_dc, stream->dc_begin, sizeof state->intra_dc);
}

/* Chooses and puts a place's blocks, each part's to its own sink. Returns their squared error where
 * `measured`: the slices are then the encoder's own. */
static uint64_t put_place(const layer_encoder *e, stream_kind kind, const unit_slices *unit,
                          uint64_t place, coefficients *blocks, const symbol_sink *sinks,
                          bool measured, place_state *state) {
  bool motion = e->layer.public.angular == SLF_ANGULAR_MOTION;
  block_choice choices[QUAD_SLICES];
  uint64_t error = 0;
  const layer_stream *stream = &e->layer.streams[kind];
  int width = QUAD_SLICES >> stream->parts_log2;
  /* Motion goes along S, from column to column; else each block may lean on the one before. */
  for (int column = 0; column < 2; column++)
    for (int i = 0; i < unit->slice_count; i++) {
      if (motion ? (int)(unit->s[i] & 1) != column : column) continue;
      block_site site = site_at(e, kind, unit, i, place);
      if (i % width == 0) begin_part(state, stream);
      choose_block(&site, blocks[i], state, &choices[i]);
      if (motion) keep_decoded(&site, state);
      if (measured) error += block_error(e, e->slices[i], place, state->previous);
      if (!motion) put_block(&sinks[i / width], &choices[i], state);
    }
  for (int i = 0; motion && i < unit->slice_count; i++) {
    block_site site = site_at(e, kind, unit, i, place);
    if (i % width == 0) begin_part(state, stream);
    if (!is_sampled_alone(&site, measured)) put_block(&sinks[i / width], &choices[i], state);
  }
  return error;
}

/* ---- Slices -------------------------------------------------------------------------------- */

static slf_result read_slice(layer_encoder *e, uint32_t s, uint32_t t, uint16_t *codes,
                             slf_error *error) {
  const slf_layer *p = &e->layer.public;
  slf_result result = e->source->read_slice(e->source->context, s, t, e->rgb, error);
  if (result != SLF_OK) return result;
  size_t samples = 3 * (size_t)p->u_count * p->v_count;
  for (size_t k = 0; k < samples; k++) {
    if (!isfinite(e->rgb[k]))
      return slf_fail(error, SLF_ERROR_ARGUMENT,
                      "%s: slice (%u, %u): texel (%zu, %zu) is not finite", e->name, s, t,
                      k / 3 % p->u_count, k / 3 / p->u_count);
    codes[k] =
        p->curve == SLF_CURVE_SRGB ? slf_srgb_from_linear(e->rgb[k]) : dwa_from_linear(e->rgb[k]);
  }
  return SLF_OK;
}

static slf_result read_unit(layer_encoder *e, const unit_slices *unit, slf_error *error) {
  slf_result result = SLF_OK;
  for (int i = 0; i < unit->slice_count && result == SLF_OK; i++)
    result = read_slice(e, unit->s[i], unit->t[i], e->slices[i], error);
  return result;
}

/* The units of a stream, by rank, that have blocks. */
static unit_slices unit_at(const layer_state *layer, stream_kind kind, uint32_t index) {
  if (kind == STREAM_REST) return slices_of_quad(layer, index);
  uint32_t key = layer->group_keys[index];
  return (unit_slices){{key & 0xffff}, {key >> 16}, key != NO_KEY};
}

static uint32_t unit_index_count(const layer_state *layer, stream_kind kind) {
  if (kind == STREAM_REST) return layer->quad_s_count * layer->quad_t_count;
  return layer->group_s_count * layer->group_t_count;
}

/* ---- Colours ------------------------------------------------------------------------------- */

/* Adds what a slice's texels vary by within their blocks: what AC will have to say. */
static void add_covariance(const layer_encoder *e, const uint16_t *slice, double covariance[3][3]) {
  for (uint64_t place = 0; place < layer_place_count(&e->layer); place++) {
    int64_t sum[3] = {0}, products[3][3] = {{0}};
    for (uint32_t i = 0; i < COEFFICIENTS; i++) {
      const uint16_t *texel = slice + 3 * texel_index(&e->layer.public, place, i);
      for (int j = 0; j < 3; j++) {
        sum[j] += texel[j];
        for (int k = 0; k < 3; k++) products[j][k] += texel[j] * texel[k];
      }
    }
    for (int j = 0; j < 3; j++)
      for (int k = 0; k < 3; k++)
        covariance[j][k] += (double)products[j][k] - (double)(sum[j] * sum[k]) / COEFFICIENTS;
  }
}

/* Eigenvectors of a symmetric matrix as columns, by Jacobi's rotations; the matrix becomes its
 * eigenvalues. */
static void diagonalise(double a[3][3], double vectors[3][3]) {
  enum { SWEEPS = 12 };
  for (int k = 0; k < 9; k++) (&vectors[0][0])[k] = k % 4 == 0;
  for (int turn = 0; turn < 3 * SWEEPS; turn++) {
    int p = turn % 3 == 2, q = turn % 3 == 0 ? 1 : 2;
    if (a[p][q] == 0) continue;
    double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
    double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
    double c = 1 / sqrt(t * t + 1), s = t * c;
    for (int k = 0; k < 3; k++) {
      double x = a[k][p], y = a[k][q];
      a[k][p] = c * x - s * y;
      a[k][q] = s * x + c * y;
    }
    for (int k = 0; k < 3; k++) {
      double x = a[p][k], y = a[q][k];
      a[p][k] = c * x - s * y;
      a[q][k] = s * x + c * y;
      x = vectors[k][p], y = vectors[k][q];
      vectors[k][p] = c * x - s * y;
      vectors[k][q] = s * x + c * y;
    }
  }
}

static void invert(const float m[3][3], float inverse[3][3]) {
  double cofactors[3][3], determinant = 0;
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
      cofactors[i][j] = (double)m[a][c] * m[b][d] - (double)m[a][d] * m[b][c];
    }
  for (int j = 0; j < 3; j++) determinant += m[0][j] * cofactors[0][j];
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) inverse[j][i] = (float)(cofactors[i][j] / determinant);
}

/* The layer's own colours are the axes along which its texels vary most and least (Karhunen and
 * Loeve): what is left of three channels that vary together is one that does, and little else.
 * Their length is luma's, the square root of 3: the greatest error a code can make of a step. */
static void set_own_colours(layer_encoder *e, double covariance[3][3]) {
  double axes[3][3];
  diagonalise(covariance, axes);
  int order[3] = {0, 1, 2};
  for (int i = 0; i < 2; i++)
    for (int j = 0; j < 2; j++)
      if (covariance[order[j]][order[j]] < covariance[order[j + 1]][order[j + 1]]) {
        int swap = order[j];
        order[j] = order[j + 1];
        order[j + 1] = swap;
      }
  for (int c = 0; c < 3; c++) {
    double sum = axes[0][order[c]] + axes[1][order[c]] + axes[2][order[c]];
    double length = sum < 0 ? -sqrt(3) : sqrt(3);
    for (int k = 0; k < 3; k++)
      e->to_rgb[k][c] = (int16_t)lrint(length * COLOUR_ONE * axes[k][order[c]]);
  }
  layer_set_own_colours(&e->layer, (const int16_t(*)[3])e->to_rgb);
}

/* The paper's schemes keep JFIF's colours, so that a slice of independent blocks can leave as a
 * JPEG and the others stand beside it; heights and coverage are gray. */
static slf_result choose_colours(layer_encoder *e, bool own, slf_error *error) {
  const slf_layer *p = &e->layer.public;
  layer_set_jfif_colours(&e->layer);
  if (own && p->role != SLF_ROLE_HEIGHT && p->role != SLF_ROLE_COVERAGE) {
    uint32_t stride = (p->slice_count + SAMPLED_SLICES - 1) / SAMPLED_SLICES, seen = 0;
    double covariance[3][3] = {{0}};
    for (uint32_t i = 0; i < p->s_count * p->t_count; i++) {
      if (!e->layer.slices[i] || seen++ % stride != stride / 2) continue;
      slf_result result = read_slice(e, i % p->s_count, i / p->s_count, e->slices[0], error);
      if (result != SLF_OK) return result;
      add_covariance(e, e->slices[0], covariance);
    }
    set_own_colours(e, covariance);
  }
  invert((const float(*)[3])e->layer.to_rgb, e->from_rgb);
  make_steps(e);
  return SLF_OK;
}

/* ---- Codes --------------------------------------------------------------------------------- */

typedef struct {
  unit_slices unit;
  uint64_t place;
  coefficients blocks[QUAD_SLICES];
} sampled_place;

typedef struct {
  const layer_encoder *encoder;
  stream_kind kind;
  sampled_place *places;
  uint64_t place_count;
  uint64_t (*counts)[CODE_COUNT][256]; /* of each task: sums do not depend on who did it */
  _Atomic uint32_t *head_counts;       /* by whole head */
} training;

enum { PLACES_A_TASK = 64 };

static void count_places(void *context, uint64_t task) {
  training *tr = context;
  uint64_t end =
      (task + 1) * PLACES_A_TASK < tr->place_count ? (task + 1) * PLACES_A_TASK : tr->place_count;
  symbol_sink counter = {tr->encoder, tr->counts[task], tr->head_counts, NULL};
  symbol_sink sinks[QUAD_SLICES] = {counter, counter, counter, counter};
  for (uint64_t i = task * PLACES_A_TASK; i < end; i++) {
    coefficients left[2] = {{{0}}};
    place_state state = begin_entry(&tr->encoder->layer.streams[tr->kind]);
    for (int k = 0; k < 2; k++) state.left[k] = left[k];
    put_place(tr->encoder, tr->kind, &tr->places[i].unit, tr->places[i].place, tr->places[i].blocks,
              sinks, false, &state);
  }
}

/* Makes codes for what was counted; what the sample lacks the rest may have. */
static void build_codes(layer_encoder *e, stream_kind kind, uint64_t counts[CODE_COUNT][256]) {
  block_codes *codes = &e->layer.streams[kind].codes;
  slf_angular angular = e->layer.public.angular;
  bool predicts[PREDICTOR_COUNT] = {true};
  bool layered = kind == STREAM_REST && angular == SLF_ANGULAR_LAYERED;
  predicts[PREDICT_BASE] = kind != STREAM_BASE && layer_has(&e->layer, STREAM_BASE);
  predicts[PREDICT_KEY] = predicts[PREDICT_KEYS] = predicts[PREDICT_PREVIOUS] = layered;
  predicts[PREDICT_SHIFT] = layered || angular == SLF_ANGULAR_MOTION;
  bool residual =
      predicts[PREDICT_SHIFT] || (predicts[PREDICT_BASE] && angular == SLF_ANGULAR_LAYERED);
  for (int i = 0; i < PREDICTOR_COUNT * 8; i++) {
    bool copy_only = i / 8 == PREDICT_BASE && angular == SLF_ANGULAR_IDENTICAL;
    counts[CODE_HEAD][i] += predicts[i / 8] && !(copy_only && i % 8);
  }
  for (int i = -MAX_SHIFT; i <= MAX_SHIFT; i++)
    counts[CODE_SHIFT][i + 16] += predicts[PREDICT_SHIFT];
  for (int r = 0; r <= residual; r++)
    for (int chroma = 0; chroma < 2; chroma++) {
      for (int size = 0; size < 16; size++) counts[dc_code(r, chroma)][size]++;
      for (int later = 0; later < 2; later++) {
        uint64_t *ac = counts[ac_code(r, chroma, later)];
        ac[SYMBOL_ESCAPE]++;
        ac[SYMBOL_RUN_16]++;
        ac[SYMBOL_END] += later || r;
      }
    }
  for (int code = 0; code < CODE_COUNT; code++) {
    huffman_build(counts[code], &codes->codes[code]);
    huffman_make_encoder(&codes->codes[code], &e->encoders[code]);
  }
  costs_from_codes(codes, &e->costs);
}

/* What head and sizes take one by one. */
static unsigned head_part_bits(const layer_encoder *e, uint32_t whole) {
  unsigned head = whole_head_symbol(whole), bits = e->encoders[CODE_HEAD].bits[head];
  int residual = head >> 3 != PREDICT_INTRA;
  for (int channel = 0; channel < 3; channel++)
    if (!residual || (head >> channel & 1))
      bits += e->encoders[dc_code(residual, channel > 0)].bits[whole_head_size(whole, channel)];
  return bits;
}

static unsigned head_bits(const layer_encoder *e, uint32_t whole) {
  unsigned symbol = e->whole_heads[whole];
  return e->encoders[CODE_WHOLE_HEAD].bits[symbol] + (symbol ? 0 : head_part_bits(e, whole));
}

/* The most frequent whole heads, that the stream will have often enough to be worth stating. */
static int find_whole_heads(const training *tr, double least, uint32_t found[MAX_WHOLE_HEADS]) {
  int count = 0;
  for (uint32_t whole = 0; whole < 1u << WHOLE_HEAD_BITS; whole++) {
    uint32_t times = tr->head_counts[whole];
    int at = count;
    if (times == 0 || times < least) continue;
    if (count < MAX_WHOLE_HEADS)
      count++;
    else if (times <= tr->head_counts[found[--at]])
      continue;
    for (; at > 0 && times > tr->head_counts[found[at - 1]]; at--) found[at] = found[at - 1];
    found[at] = whole;
  }
  return count;
}

static void have_no_whole_heads(layer_encoder *e, stream_kind kind) {
  memset(e->whole_heads, 0, 1u << WHOLE_HEAD_BITS);
  e->layer.streams[kind].codes.codes[CODE_WHOLE_HEAD] = (huffman_code){0};
  e->encoders[CODE_WHOLE_HEAD] = (huffman_encoder){0};
}

/* A code for whole heads, if it makes up for its size, and the blocks without one are few: they
 * take a look more. Returns the bits that it saves in the
 * sample, of whose blocks the stream has `times` as many. */
static double build_whole_heads(layer_encoder *e, const training *tr, uint64_t block_count,
                                double times) {
  enum { LEAST_COUNT = 32 /* of which each is to save one bit */, MOST_ALONE = 16 };
  block_codes *codes = &e->layer.streams[tr->kind].codes;
  uint64_t counts[256] = {1};
  double saved = 0;
  int count = find_whole_heads(tr, LEAST_COUNT / times, codes->whole_heads + 1);
  memset(e->whole_heads, 0, 1u << WHOLE_HEAD_BITS);
  for (int i = 1; i <= count; i++) e->whole_heads[codes->whole_heads[i]] = (uint8_t)i;
  for (uint32_t whole = 0; whole < 1u << WHOLE_HEAD_BITS; whole++)
    counts[e->whole_heads[whole]] += tr->head_counts[whole];
  huffman_build(counts, &codes->codes[CODE_WHOLE_HEAD]);
  huffman_make_encoder(&codes->codes[CODE_WHOLE_HEAD], &e->encoders[CODE_WHOLE_HEAD]);
  for (uint32_t whole = 0; whole < 1u << WHOLE_HEAD_BITS; whole++)
    if (tr->head_counts[whole])
      saved += tr->head_counts[whole] * ((double)head_part_bits(e, whole) - head_bits(e, whole));
  double nbytes = CODE_MAX_BITS + 1 + count * (1 + WHOLE_HEAD_NBYTES);
  if (count && counts[0] * MOST_ALONE <= block_count && saved * times > 8 * nbytes) return saved;
  have_no_whole_heads(e, tr->kind);
  return 0;
}

static double counted_bits(const layer_encoder *e, uint64_t counts[CODE_COUNT][256]) {
  double bits = 0;
  for (int code = 0; code < CODE_COUNT; code++)
    for (int s = 0; s < 256; s++) {
      unsigned magnitude = code >= CODE_DC ? s & 15u : 0;
      bits += (double)counts[code][s] * (e->encoders[code].bits[s] + magnitude);
    }
  return bits;
}

/* From the bits of a place. */
static void choose_run(layer_encoder *e, stream_kind kind, double bits) {
  uint32_t run_log2 = 0, parts_log2 = 0;
  while (run_log2 < MAX_RUN_LOG2 && bits * (2u << run_log2) < PAIR_BITS) run_log2++;
  while (kind == STREAM_REST && parts_log2 < MAX_PARTS_LOG2 &&
         bits / (1u << parts_log2) > PART_PAIR_BITS)
    parts_log2++;
  layer_set_run(&e->layer, kind, run_log2, parts_log2);
}

/* From the bits of a block. */
static void choose_time_worth(layer_encoder *e, double bits) {
  bool layered = e->layer.public.angular == SLF_ANGULAR_LAYERED;
  e->bits_a_ns = layered ? time_worth * (float)bits / (block_ns + bit_ns * (float)bits) : 0;
}

/* DC of INTRA begins at the mean. */
static void choose_dc_begin(layer_encoder *e, const training *tr) {
  float step_scale = (float)e->layer.gains[tr->kind] / (float)e->layer.gains[STREAM_REST];
  for (int c = 0; c < 3; c++) {
    double sum = 0, count = 0;
    for (uint64_t i = 0; i < tr->place_count; i++)
      for (int k = 0; k < tr->places[i].unit.slice_count; k++, count++)
        sum += tr->places[i].blocks[k][c][0];
    double mean = sum / fmax(count, 1) / (e->steps[c][0] * step_scale);
    e->layer.streams[tr->kind].dc_begin[c] =
        (int16_t)lrint(fmax(-MAX_LEVEL, fmin(MAX_LEVEL, mean)));
  }
}

static uint64_t stream_block_count(const layer_state *layer, stream_kind kind) {
  uint64_t units = layer->streams[kind].unit_count;
  if (kind == STREAM_REST) {
    units = layer->public.slice_count;
    if (layer_has(layer, STREAM_KEYS)) units -= layer->streams[STREAM_KEYS].unit_count;
  }
  return units * layer_place_count(layer);
}

static slf_result train(layer_encoder *e, training *tr, slf_error *error) {
  uint64_t tasks = (tr->place_count + PLACES_A_TASK - 1) / PLACES_A_TASK;
  tr->counts = malloc(tasks * sizeof *tr->counts);
  tr->head_counts = malloc(sizeof *tr->head_counts << WHOLE_HEAD_BITS);
  if (!tr->counts || !tr->head_counts) {
    free(tr->counts);
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", e->name);
  }
  uint64_t block_count = 0, stream_count = stream_block_count(&e->layer, tr->kind);
  for (uint64_t i = 0; i < tr->place_count; i++)
    block_count += (uint64_t)tr->places[i].unit.slice_count;
  costs_guess(&e->costs);
  e->bits_a_ns = 0;
  have_no_whole_heads(e, tr->kind);
  choose_dc_begin(e, tr);
  for (int round = 0; round < TRAINING_ROUNDS; round++) {
    uint64_t sum[CODE_COUNT][256] = {{0}}, counted[CODE_COUNT][256];
    memset(tr->counts, 0, tasks * sizeof *tr->counts);
    memset(tr->head_counts, 0, sizeof *tr->head_counts << WHOLE_HEAD_BITS);
    parallel_for(e->thread_count, tasks, count_places, tr);
    for (uint64_t i = 0; i < tasks; i++)
      for (int k = 0; k < CODE_COUNT * 256; k++) (&sum[0][0])[k] += (&tr->counts[i][0][0])[k];
    memcpy(counted, sum, sizeof counted);
    build_codes(e, tr->kind, sum);
    double saved =
        build_whole_heads(e, tr, block_count, (double)stream_count / (double)block_count);
    double bits = counted_bits(e, counted) - saved;
    choose_run(e, tr->kind, bits / (double)tr->place_count);
    choose_time_worth(e, bits / (double)block_count);
  }
  free(tr->head_counts);
  free(tr->counts);
  return SLF_OK;
}

/* ---- Streams ------------------------------------------------------------------------------- */

/* Where a place's coefficients come from: slices that were read, or the base's own mean. */
typedef struct {
  layer_encoder *encoder;
  stream_kind kind;
  const float *mean; /* base only: R G B a texel */
  unit_slices unit;
  uint64_t entry_count; /* of the unit */
  bit_string *entries;
} unit_task;

static void transform_place(const unit_task *task, uint64_t place, coefficients *blocks) {
  const layer_encoder *e = task->encoder;
  if (task->mean) {
    float rgb[COEFFICIENTS][3];
    for (uint32_t i = 0; i < COEFFICIENTS; i++)
      memcpy(rgb[i], task->mean + 3 * texel_index(&e->layer.public, place, i), sizeof rgb[i]);
    transform_texels(e, rgb, blocks[0]);
    return;
  }
  for (int i = 0; i < task->unit.slice_count; i++)
    transform_block(e, e->slices[i], place, blocks[i]);
}

static void put_entries(void *context, uint64_t index) {
  const unit_task *task = context;
  layer_encoder *e = task->encoder;
  uint64_t error = 0;
  uint64_t places = layer_place_count(&e->layer);
  uint32_t run = e->layer.streams[task->kind].run_places;
  uint32_t parts_log2 = e->layer.streams[task->kind].parts_log2;
  uint64_t group_count = task->entry_count >> parts_log2;
  for (uint64_t group = index * GROUPS_A_TASK;
       group < (index + 1) * GROUPS_A_TASK && group < group_count; group++) {
    symbol_sink sinks[QUAD_SLICES];
    for (uint32_t part = 0; part < 1u << parts_log2; part++)
      sinks[part] = (symbol_sink){e, NULL, NULL, &task->entries[(group << parts_log2) + part]};
    place_state state = begin_entry(&e->layer.streams[task->kind]);
    for (uint64_t place = group * run; place < (group + 1) * run && place < places; place++) {
      coefficients blocks[QUAD_SLICES];
      transform_place(task, place, blocks);
      for (int i = 0; i < 2 && e->left[i]; i++) state.left[i] = e->left[i][place];
      bool measured = task->kind != STREAM_BASE;
      error += put_place(e, task->kind, &task->unit, place, blocks, sinks, measured, &state);
    }
  }
  atomic_fetch_add(&e->squared_error, error);
}

static slf_result put_unit(unit_task *task, stream_writer *writer, slf_error *error) {
  layer_encoder *e = task->encoder;
  task->entry_count = e->layer.streams[task->kind].entries_per_unit;
  task->entries = calloc(task->entry_count, sizeof *task->entries);
  if (!task->entries)
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for %" PRIu64 " entries", e->name,
                    task->entry_count);
  parallel_for(e->thread_count, (task->entry_count + GROUPS_A_TASK - 1) / GROUPS_A_TASK,
               put_entries, task);
  for (uint64_t i = 0; i < task->entry_count; i++) {
    stream_put(writer, &task->entries[i]);
    bits_free(&task->entries[i]);
  }
  free(task->entries);
  return SLF_OK;
}

/* Places for the codes, spread over the stream. */
static slf_result sample_stream(unit_task *task, training *tr, slf_error *error) {
  layer_encoder *e = task->encoder;
  const layer_stream *stream = &e->layer.streams[task->kind];
  uint64_t places = layer_place_count(&e->layer);
  uint32_t unit_stride = (stream->unit_count + SAMPLED_UNITS - 1) / SAMPLED_UNITS;
  uint64_t units = (stream->unit_count + unit_stride - 1) / unit_stride;
  uint64_t stride = (units * places + SAMPLED_PLACES - 1) / SAMPLED_PLACES;
  tr->places = malloc((units * (places / stride + 1)) * sizeof *tr->places);
  if (!tr->places) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", e->name);
  uint32_t index_count = task->mean ? 1 : unit_index_count(&e->layer, task->kind);
  for (uint32_t index = 0, seen = 0; index < index_count; index++) {
    if (!task->mean) task->unit = unit_at(&e->layer, task->kind, index);
    if (!task->unit.slice_count || seen++ % unit_stride != unit_stride / 2) continue;
    slf_result result = task->mean ? SLF_OK : read_unit(e, &task->unit, error);
    if (result != SLF_OK) return result;
    /* A stride that is prime to the row's length would be best; a start that moves does as well. */
    for (uint64_t place = seen % stride; place < places; place += stride) {
      sampled_place *sample = &tr->places[tr->place_count++];
      sample->unit = task->unit;
      sample->place = place;
      transform_place(task, place, sample->blocks);
    }
  }
  return SLF_OK;
}

static slf_result put_stream(layer_encoder *e, stream_kind kind, const float *mean,
                             encoded_chunk *encoded, double progress_begin, slf_error *error) {
  layer_stream *stream = &e->layer.streams[kind];
  unit_task task = {.encoder = e, .kind = kind, .mean = mean, .unit = {{0}, {0}, 1}};
  training tr = {.encoder = e, .kind = kind};
  stream_writer writer = {0};
  slf_result result = sample_stream(&task, &tr, error);
  if (result == SLF_OK) result = train(e, &tr, error);
  free(tr.places);
  uint32_t index_count = mean ? 1 : unit_index_count(&e->layer, kind), done = 0;
  stream_begin(&writer, e->scratch, &stream->blocks);
  for (uint32_t index = 0; index < index_count && result == SLF_OK; index++) {
    if (!mean) {
      task.unit = unit_at(&e->layer, kind, index);
      if (!task.unit.slice_count) continue;
      result = read_unit(e, &task.unit, error);
    }
    if (result == SLF_OK) result = put_unit(&task, &writer, error);
    done++;
    if (e->source->progress && kind == STREAM_REST)
      e->source->progress(e->source->context,
                          progress_begin + (1 - progress_begin) * done / stream->unit_count);
  }
  stream->payload_bits = writer.payload_bit_count;
  if (result == SLF_OK) result = stream_finish(&writer, e->name, &encoded->nbytes, error);
  stream_writer_free(&writer);
  encoded->offset = writer.begin;
  if (result != SLF_OK || kind == STREAM_REST) return result;
  /* From here on the stream can be decoded: what follows is predicted from it. */
  result = scratch_map_part(e->scratch, encoded->offset, encoded->nbytes, e->name, &e->maps[kind],
                            error);
  if (result != SLF_OK) return result;
  stream->blocks.bytes = e->maps[kind].bytes;
  stream->blocks.nbytes = encoded->nbytes;
  stream->tables = malloc(sizeof *stream->tables);
  if (!stream->tables) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", e->name);
  block_tables_make(&stream->codes, stream->tables);
  return SLF_OK;
}

/* ---- The base ------------------------------------------------------------------------------ */

/* The mean over all slices; of the identical scheme, the first slice. */
static slf_result make_mean(layer_encoder *e, float *mean, slf_error *error) {
  const slf_layer *p = &e->layer.public;
  size_t samples = 3 * (size_t)p->u_count * p->v_count;
  uint32_t count = 0;
  for (uint32_t t = 0; t < p->t_count; t++)
    for (uint32_t s = 0; s < p->s_count; s++) {
      if (!slf_slice_exists(p->s_count, p->t_count, s, t)) continue;
      if (count && p->angular == SLF_ANGULAR_IDENTICAL) continue;
      slf_result result = read_slice(e, s, t, e->slices[0], error);
      if (result != SLF_OK) return result;
      for (size_t k = 0; k < samples; k++) mean[k] += e->slices[0][k];
      count++;
      if (e->source->progress)
        e->source->progress(e->source->context, 0.1 * count / p->slice_count);
    }
  for (size_t k = 0; k < samples; k++) mean[k] /= (float)count;
  return SLF_OK;
}

static slf_result put_base(layer_encoder *e, encoded_chunk *encoded, slf_error *error) {
  const slf_layer *p = &e->layer.public;
  float *mean = calloc(3 * (size_t)p->u_count * p->v_count, sizeof *mean);
  if (!mean) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for the mean", e->name);
  slf_result result = make_mean(e, mean, error);
  if (result == SLF_OK) result = put_stream(e, STREAM_BASE, mean, encoded, 0, error);
  if (result == SLF_OK) result = layer_make_base(&e->layer, e->name, error);
  free(mean);
  return result;
}

/* ---- The layer ----------------------------------------------------------------------------- */

static slf_result put_header(const layer_encoder *e, encoded_layer *encoded, slf_error *error) {
  const layer_state *layer = &e->layer;
  uint8_t *b =
      calloc(1, LAYER_FIXED_NBYTES + COLOURS_NBYTES +
                    STREAM_COUNT * (STREAM_HEADER_NBYTES + CODE_COUNT * HUFFMAN_MAX_NBYTES +
                                    MAX_WHOLE_HEADS * WHOLE_HEAD_NBYTES));
  if (!b) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", e->name);
  const slf_layer *p = &layer->public;
  b[0] = (uint8_t)p->role;
  b[1] = (uint8_t)p->curve;
  b[2] = (uint8_t)p->angular;
  b[3] = layer->own_colours;
  put_u32(b + 4, p->u_count);
  put_u32(b + 8, p->v_count);
  put_u32(b + 12, p->s_count);
  put_u32(b + 16, p->t_count);
  put_f32(b + 20, p->quality);
  put_f32(b + 24, p->psnr);
  put_f32(b + 28, p->height_unit);
  for (int channel = 0; channel < 3; channel++) {
    put_u16(b + 32 + 4 * channel, layer->step_lines[channel].first);
    put_u16(b + 34 + 4 * channel, layer->step_lines[channel].slope);
  }
  uint8_t *at = b + LAYER_FIXED_NBYTES;
  for (int i = 0; i < 9 && layer->own_colours; i++, at += 2)
    put_u16(at, (uint16_t)(&e->to_rgb[0][0])[i]);
  for (int kind = 0; kind < STREAM_COUNT; kind++) {
    if (!layer_has(layer, kind)) continue;
    const layer_stream *stream = &layer->streams[kind];
    at[0] = (uint8_t)layer->gains[kind];
    at[1] = (uint8_t)(stream->run_log2 | stream->parts_log2 << 4);
    unsigned used = 0;
    for (int i = 0; i < CODE_COUNT; i++)
      used |= (unsigned)(stream->codes.codes[i].symbol_count > 0) << i;
    put_u16(at + 2, used);
    put_u64(at + 4, stream->payload_bits);
    for (int i = 0; i < 3; i++) put_u16(at + 12 + 2 * i, (uint16_t)stream->dc_begin[i]);
    at += STREAM_HEADER_NBYTES;
    for (int i = 0; i < CODE_COUNT; i++)
      if (used >> i & 1) at += huffman_put(&stream->codes.codes[i], at);
    for (int i = 1; i < stream->codes.codes[CODE_WHOLE_HEAD].symbol_count;
         i++, at += WHOLE_HEAD_NBYTES) {
      put_u16(at, (uint16_t)stream->codes.whole_heads[i]);
      at[2] = (uint8_t)(stream->codes.whole_heads[i] >> 16);
    }
  }
  encoded->header = (encoded_chunk){e->scratch->nbytes, (uint64_t)(at - b)};
  scratch_write(e->scratch, encoded->header.offset, b, encoded->header.nbytes);
  free(b);
  return SLF_OK;
}

static slf_result check_options(const slf_layer_options *o, const char *name, slf_error *error) {
  if (o->u_count - 1 >= SLF_MAX_TEXELS || o->v_count - 1 >= SLF_MAX_TEXELS ||
      o->s_count - 1 >= SLF_MAX_DIRECTIONS || o->t_count - 1 >= SLF_MAX_DIRECTIONS)
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: %ux%u texels, %ux%u directions", name,
                    o->u_count, o->v_count, o->s_count, o->t_count);
  if (!(o->quality >= 1 && o->quality <= 100))
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: quality %g, expected 1 to 100", name,
                    o->quality);
  if ((o->role == SLF_ROLE_HEIGHT) != (o->height_unit > 0) || !isfinite(o->height_unit))
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: a height unit of %g for role %d", name,
                    o->height_unit, o->role);
  if (o->curve != SLF_CURVE_SRGB && o->curve != SLF_CURVE_DWA)
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: curve %d is not known", name, (int)o->curve);
  if (o->angular > SLF_ANGULAR_LAYERED || o->role > SLF_ROLE_COVERAGE)
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: angular %d, role %d", name, (int)o->angular,
                    (int)o->role);
  return SLF_OK;
}

static slf_result encode_streams(layer_encoder *e, bool own_colours, encoded_layer *encoded,
                                 slf_error *error) {
  slf_result result = layer_make_units(&e->layer, e->name, error);
  if (result == SLF_OK) result = choose_colours(e, own_colours, error);
  bool base = layer_has(&e->layer, STREAM_BASE);
  if (result == SLF_OK && base) result = put_base(e, &encoded->streams[STREAM_BASE], error);
  if (result == SLF_OK && layer_has(&e->layer, STREAM_KEYS))
    result = put_stream(e, STREAM_KEYS, NULL, &encoded->streams[STREAM_KEYS], 0, error);
  if (result == SLF_OK)
    result =
        put_stream(e, STREAM_REST, NULL, &encoded->streams[STREAM_REST], base ? 0.15 : 0, error);
  if (result != SLF_OK) return result;
  double peak = e->layer.public.curve == SLF_CURVE_DWA ? DWA_SCALE : 255; /* of white */
  double mean = (double)e->squared_error / (double)e->layer.public.raw_nbytes;
  e->layer.public.psnr = (float)(10 * log10(peak * peak / fmax(mean, 1e-9)));
  result = put_header(e, encoded, error);
  uint64_t stored = encoded->header.nbytes;
  for (int kind = 0; kind < STREAM_COUNT; kind++) stored += encoded->streams[kind].nbytes;
  encoded->psnr = e->layer.public.psnr;
  encoded->ratio = (double)e->layer.public.raw_nbytes / (double)stored;
  return result;
}

slf_result encode_layer(const slf_layer_options *options, const slf_source *source,
                        scratch_file *scratch, const char *name, encoded_layer *encoded,
                        slf_error *error) {
  *encoded = (encoded_layer){0};
  slf_result result = check_options(options, name, error);
  if (result != SLF_OK) return result;
  layer_encoder *e = calloc(1, sizeof *e);
  if (!e) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", name);
  e->source = source;
  e->scratch = scratch;
  e->name = name;
  e->thread_count = options->thread_count ? options->thread_count : processor_count();
  bool single = options->s_count == 1 && options->t_count == 1;
  e->layer.public = (slf_layer){.role = options->role,
                                .curve = options->curve,
                                .angular = single ? SLF_ANGULAR_NONE : options->angular,
                                .u_count = options->u_count,
                                .v_count = options->v_count,
                                .s_count = options->s_count,
                                .t_count = options->t_count,
                                .quality = options->quality,
                                .height_unit = options->height_unit};
  layer_set_curve(&e->layer);
  size_t samples = 3 * (size_t)options->u_count * options->v_count;
  bool allocated = (e->rgb = malloc(samples * sizeof *e->rgb)) != NULL;
  allocated = (e->whole_heads = calloc(1u << WHOLE_HEAD_BITS, 1)) && allocated;
  for (int i = 0; i < QUAD_SLICES; i++)
    allocated = (e->slices[i] = malloc(samples * sizeof *e->slices[i])) && allocated;
  uint64_t places = ((uint64_t)options->u_count + 7) / 8 * (((uint64_t)options->v_count + 7) / 8);
  for (int i = 0; i < 2 && options->angular == SLF_ANGULAR_MOTION; i++)
    allocated = (e->left[i] = calloc(places, sizeof *e->left[i])) && allocated;
  if (allocated)
    result = encode_streams(e, options->angular == SLF_ANGULAR_LAYERED, encoded, error);
  else
    result =
        slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for slices of %zu samples", name, samples);
  for (int i = 0; i < QUAD_SLICES; i++) free(e->slices[i]);
  for (int i = 0; i < 2; i++) free(e->left[i]);
  free(e->rgb);
  free(e->whole_heads);
  layer_free(&e->layer);
  for (int kind = 0; kind < STREAM_COUNT; kind++) scratch_unmap(&e->maps[kind]);
  free(e);
  return result;
}
