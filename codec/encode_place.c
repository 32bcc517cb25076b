/* encode_place.c - the blocks of a place: what each is predicted from, and its levels. */
#include "codec/encode_parts.h"

#include <float.h>

/* What a bit is worth in squared steps. At high rate the slope of error against rate is
 * 2 ln 2 / 12 = 0.12; the small levels that most of our bits go to are worth a little more. */
static const float lambda = 0.12f;

/* Time that decoding a block takes more where its key is looked for, several are mixed or a
 * difference is shifted (cube, quality 90). What it is worth: encode_codes.c. */
static const float prediction_ns[PREDICTOR_COUNT] = {
    [PREDICT_KEY] = 45, [PREDICT_KEYS] = 100, [PREDICT_SHIFT] = 130};

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
    const uint16_t *texel = slice + 3 * place_texel(p, place, i);
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

place_state place_begin_entry(const layer_stream *stream) {
  place_state state = {.has_previous = false};
  memcpy(state.intra_dc, stream->dc_begin, sizeof state.intra_dc);
  return state;
}

/* A place's first block leans on none before it, and in an entry of its own it begins anew. */
static void begin_part(place_state *state, const layer_stream *stream) {
  state->has_previous = false;
  if (stream->parts_log2) memcpy(state->intra_dc, stream->dc_begin, sizeof state->intra_dc);
}

uint64_t encode_place(const layer_encoder *e, stream_kind kind, const unit_slices *unit,
                      uint64_t place, coefficients *blocks, const symbol_sink *sinks, bool measured,
                      place_state *state) {
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
      if (!motion) symbols_put_block(&sinks[i / width], &choices[i], state);
    }
  for (int i = 0; motion && i < unit->slice_count; i++) {
    block_site site = site_at(e, kind, unit, i, place);
    if (i % width == 0) begin_part(state, stream);
    if (!is_sampled_alone(&site, measured))
      symbols_put_block(&sinks[i / width], &choices[i], state);
  }
  return error;
}
