/* encode_codes.c - the codes of a stream, from a sample of it. */
#include "codec/encode_parts.h"

#include "codec/parallel.h"

#include <math.h>
#include <stdlib.h>

enum {
  PAIR_BITS = 200,       /* a pair's bits are worth its index: 11 of them, */
  PART_PAIR_BITS = 256,  /* and if it is less than a place, DC that begins anew */
  SAMPLED_UNITS = 24,    /* the codes are made from places of so many units, */
  SAMPLED_PLACES = 3072, /* so many places in all, */
  TRAINING_ROUNDS = 3,   /* coded so often, each time with the codes of the time before */
  PLACES_A_TASK = 64
};

/* Time counts, too: a percent of it as much as a third of a percent of the bits. A block of b bits
 * is decoded in 200 + 0.4 b ns (cube, quality 90), and predictions take more: encode_place.c. */
static const float time_worth = 1 / 3.0f, block_ns = 200, bit_ns = 0.4f;

typedef struct {
  unit_slices unit;
  uint64_t place;
  coefficients blocks[QUAD_SLICES];
} sampled_place;

typedef struct {
  layer_encoder *encoder;
  stream_kind kind;
  sampled_place *places;
  uint64_t place_count;
  uint64_t (*counts)[CODE_COUNT][256]; /* of each task: sums do not depend on who did it */
  _Atomic uint32_t *head_counts;       /* by whole head */
} training;

/* ---- The sample ---------------------------------------------------------------------------- */

/* Places for the codes, spread over the stream. */
static slf_result sample_stream(training *tr, const float *mean, slf_error *error) {
  layer_encoder *e = tr->encoder;
  const layer_stream *stream = &e->layer.streams[tr->kind];
  uint64_t places = layer_place_count(&e->layer);
  uint32_t unit_stride = (stream->unit_count + SAMPLED_UNITS - 1) / SAMPLED_UNITS;
  uint64_t units = (stream->unit_count + unit_stride - 1) / unit_stride;
  uint64_t stride = (units * places + SAMPLED_PLACES - 1) / SAMPLED_PLACES;
  tr->places = malloc((units * (places / stride + 1)) * sizeof *tr->places);
  if (!tr->places) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", e->name);
  uint32_t index_count = mean ? 1 : unit_index_count(&e->layer, tr->kind);
  unit_slices unit = {{0}, {0}, 1};
  for (uint32_t index = 0, seen = 0; index < index_count; index++) {
    if (!mean) unit = unit_at(&e->layer, tr->kind, index);
    if (!unit.slice_count || seen++ % unit_stride != unit_stride / 2) continue;
    slf_result result = mean ? SLF_OK : unit_read(e, &unit, error);
    if (result != SLF_OK) return result;
    /* A stride that is prime to the row's length would be best; a start that moves does as well. */
    for (uint64_t place = seen % stride; place < places; place += stride) {
      sampled_place *sample = &tr->places[tr->place_count++];
      sample->unit = unit;
      sample->place = place;
      place_transform(e, &unit, mean, place, sample->blocks);
    }
  }
  return SLF_OK;
}

/* ---- Codes --------------------------------------------------------------------------------- */

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

/* ---- Whole heads --------------------------------------------------------------------------- */

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
 * take a look more. Returns the bits that it saves in the sample, of whose blocks the stream has
 * `times` as many. */
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

/* ---- Training ------------------------------------------------------------------------------ */

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

static void count_places(void *context, uint64_t task) {
  training *tr = context;
  uint64_t end =
      (task + 1) * PLACES_A_TASK < tr->place_count ? (task + 1) * PLACES_A_TASK : tr->place_count;
  symbol_sink counter = {tr->encoder, tr->counts[task], tr->head_counts, NULL};
  symbol_sink sinks[QUAD_SLICES] = {counter, counter, counter, counter};
  for (uint64_t i = task * PLACES_A_TASK; i < end; i++) {
    coefficients left[2] = {{{0}}};
    place_state state = place_begin_entry(&tr->encoder->layer.streams[tr->kind]);
    for (int k = 0; k < 2; k++) state.left[k] = left[k];
    encode_place(tr->encoder, tr->kind, &tr->places[i].unit, tr->places[i].place,
                 tr->places[i].blocks, sinks, false, &state);
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

static slf_result train(training *tr, slf_error *error) {
  layer_encoder *e = tr->encoder;
  uint64_t tasks = (tr->place_count + PLACES_A_TASK - 1) / PLACES_A_TASK;
  tr->counts = malloc(tasks * sizeof *tr->counts);
  tr->head_counts = malloc(sizeof *tr->head_counts << WHOLE_HEAD_BITS);
  if (!tr->counts || !tr->head_counts) {
    free(tr->head_counts);
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

slf_result codes_make(layer_encoder *e, stream_kind kind, const float *mean, slf_error *error) {
  training tr = {.encoder = e, .kind = kind};
  slf_result result = sample_stream(&tr, mean, error);
  if (result == SLF_OK) result = train(&tr, error);
  free(tr.places);
  return result;
}
