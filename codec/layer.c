#include "codec/layer.h"

#include "codec/kernel.h"

#include <inttypes.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>

const double slf_aan[8] = {1.0, 1.387039845322148, 1.306562964876377, 1.175875602419359,
                           1.0, 0.785694958387102, 0.541196100146197, 0.275899379282943};

/* The slice of a group nearest to its centre (2, 2), the first of equals; NO_KEY without one. */
static uint32_t choose_key(const layer_state *layer, uint32_t group_s, uint32_t group_t) {
  uint32_t best = NO_KEY, best_distance = UINT32_MAX;
  for (uint32_t j = 0; j < GROUP_SIDE; j++)
    for (uint32_t i = 0; i < GROUP_SIDE; i++) {
      uint32_t s = group_s * GROUP_SIDE + i, t = group_t * GROUP_SIDE + j;
      uint32_t distance = (i - 2) * (i - 2) + (j - 2) * (j - 2);
      if (!layer_has_slice(layer, s, t) || distance >= best_distance) continue;
      best = t << 16 | s;
      best_distance = distance;
    }
  return best;
}

void layer_set_run(layer_state *layer, stream_kind kind, uint32_t run_log2, uint32_t parts_log2) {
  layer_stream *stream = &layer->streams[kind];
  stream->run_log2 = run_log2;
  stream->run_places = 1u << run_log2;
  stream->parts_log2 = parts_log2;
  stream->entries_per_unit =
      (layer_place_count(layer) + stream->run_places - 1) >> run_log2 << parts_log2;
  stream->entries_per_unit += stream->entries_per_unit % 2;
  stream->blocks.entry_count = stream->entries_per_unit * stream->unit_count;
}

slf_result layer_make_units(layer_state *layer, const char *name, slf_error *error) {
  slf_layer *p = &layer->public;
  layer->kernel = kernel_choose();
  p->block_u_count = (p->u_count + SLF_BLOCK_SIDE - 1) / SLF_BLOCK_SIDE;
  p->block_v_count = (p->v_count + SLF_BLOCK_SIDE - 1) / SLF_BLOCK_SIDE;
  layer->quad_s_count = (p->s_count + 1) / 2;
  layer->quad_t_count = (p->t_count + 1) / 2;
  layer->group_s_count = (p->s_count + GROUP_SIDE - 1) / GROUP_SIDE;
  layer->group_t_count = (p->t_count + GROUP_SIDE - 1) / GROUP_SIDE;
  size_t quads = (size_t)layer->quad_s_count * layer->quad_t_count;
  size_t groups = (size_t)layer->group_s_count * layer->group_t_count;
  layer->slices = malloc((size_t)p->s_count * p->t_count);
  layer->quad_ranks = malloc(quads * sizeof *layer->quad_ranks);
  layer->quad_slices = calloc(quads, 1);
  layer->group_ranks = malloc(groups * sizeof *layer->group_ranks);
  layer->group_keys = malloc(groups * sizeof *layer->group_keys);
  if (!layer->slices || !layer->quad_ranks || !layer->quad_slices || !layer->group_ranks ||
      !layer->group_keys)
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for %zu quads", name, quads);
  for (uint32_t i = 0; i < p->s_count * p->t_count; i++)
    layer->slices[i] = slf_slice_exists(p->s_count, p->t_count, i % p->s_count, i / p->s_count);
  layer->streams[STREAM_BASE].unit_count = 1;
  for (uint32_t i = 0; i < groups; i++) {
    layer->group_keys[i] = choose_key(layer, i % layer->group_s_count, i / layer->group_s_count);
    layer->group_ranks[i] = layer->streams[STREAM_KEYS].unit_count;
    if (layer->group_keys[i] != NO_KEY) layer->streams[STREAM_KEYS].unit_count++;
  }
  for (uint32_t t = 0; t < p->t_count; t++)
    for (uint32_t s = 0; s < p->s_count; s++) {
      if (!layer_has_slice(layer, s, t)) continue;
      p->slice_count++;
      if (!layer_is_key(layer, s, t))
        layer->quad_slices[t / 2 * layer->quad_s_count + s / 2] |=
            (uint8_t)(1u << quad_place(s, t));
    }
  for (size_t i = 0; i < quads; i++) {
    layer->quad_ranks[i] = layer->streams[STREAM_REST].unit_count;
    if (layer->quad_slices[i]) layer->streams[STREAM_REST].unit_count++;
  }
  for (int kind = 0; kind < STREAM_COUNT; kind++) layer_set_run(layer, kind, 0, 0);
  p->raw_nbytes = (uint64_t)p->u_count * p->v_count * 3 * p->slice_count;
  return SLF_OK;
}

bool layer_make_steps(layer_state *layer) {
  bool whole = layer->public.angular == SLF_ANGULAR_NONE;
  for (int channel = 0; channel < 3; channel++) {
    step_line line = layer->step_lines[channel];
    if (line.first < STEP_ONE || line.first + line.slope * 14 / 16 > UINT16_MAX - STEP_ONE)
      return false;
    for (uint32_t i = 0; i < COEFFICIENTS; i++) {
      uint32_t step = line.first + line.slope * (i / 8 + i % 8) / 16;
      if (whole) step = (step + STEP_ONE / 2) / STEP_ONE * STEP_ONE;
      layer->steps[channel][i] = (uint16_t)step;
    }
  }
  return true;
}

void layer_make_scales(layer_state *layer) {
  for (int channel = 0; channel < 3; channel++)
    for (int i = 0; i < COEFFICIENTS; i++)
      layer->scales[channel][i] =
          (float)(layer->steps[channel][i] / ((double)STEP_ONE * layer->gains[STREAM_REST]) *
                  slf_aan[i / 8] * slf_aan[i % 8] / 8);
}

void layer_set_curve(layer_state *layer) {
  bool dwa = layer->public.curve == SLF_CURVE_DWA;
  layer->level_shift = dwa ? DWA_CODES / 2 : 128;
  layer->difference_one = dwa ? DIFFERENCE_ONE_DWA : DIFFERENCE_ONE;
}

/* ITU-T T.871: Y, Cb, Cr. */
void layer_set_jfif_colours(layer_state *layer) {
  static const float to_rgb[3][3] = {{1, 0, 1.402f}, {1, -0.344136f, -0.714136f}, {1, 1.772f, 0}};
  layer->own_colours = false;
  memcpy(layer->to_rgb, to_rgb, sizeof to_rgb);
}

void layer_set_own_colours(layer_state *layer, const int16_t to_rgb[3][3]) {
  layer->own_colours = true;
  for (int i = 0; i < 3; i++)
    for (int c = 0; c < 3; c++) layer->to_rgb[i][c] = (float)to_rgb[i][c] / COLOUR_ONE;
}

slf_result layer_make_linear(layer_state *layer, const char *name, slf_error *error) {
  layer->linear = malloc(DWA_CODES * sizeof *layer->linear);
  if (!layer->linear) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", name);
  for (int code = 0; code < DWA_CODES; code++)
    layer->linear[code] = linear_from_dwa((uint16_t)code);
  return SLF_OK;
}

uint16_t dwa_from_linear(float radiance) {
  if (!(radiance > 0)) return 0;
  double x = fmin(radiance, 65504);
  double curve = x <= 1 ? pow(x, 1 / 2.2) : log(x) / 2.2 + 1;
  return (uint16_t)(curve * DWA_SCALE + 0.5);
}

float linear_from_dwa(uint16_t code) {
  double curve = (double)code / DWA_SCALE;
  return (float)(curve <= 1 ? pow(curve, 2.2) : exp(2.2 * (curve - 1)));
}

static uint16_t to_code(float value, float high) {
  value = value > 0 ? value : 0;
  value = value < high ? value : high;
  return (uint16_t)(value + 0.5f);
}

void layer_codes(const layer_state *layer, float channels[3][COEFFICIENTS],
                 uint16_t codes[COEFFICIENTS][3]) {
  float high = layer->public.curve == SLF_CURVE_DWA ? DWA_CODES - 1 : 255;
  for (int i = 0; i < COEFFICIENTS; i++) {
    for (int k = 0; k < 3; k++) {
      const float *m = layer->to_rgb[k];
      float code = m[0] * channels[0][i] + m[1] * channels[1][i] + m[2] * channels[2][i];
      codes[i][k] = to_code(code + layer->level_shift, high);
    }
  }
}

static slf_result make_store(block_store *store, uint64_t count, const char *name,
                             slf_error *error) {
  store->blocks = calloc(count, sizeof *store->blocks);
  store->states = calloc(count, sizeof *store->states);
  if (store->blocks && store->states) return SLF_OK;
  return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for %" PRIu64 " decoded blocks", name,
                  count);
}

slf_result layer_make_base(layer_state *layer, const char *name, slf_error *error) {
  return make_store(&layer->base, layer_place_count(layer), name, error);
}

slf_result layer_make_keys(layer_state *layer, const char *name, slf_error *error) {
  uint64_t count = layer_place_count(layer) * layer->streams[STREAM_KEYS].unit_count;
  if (count > MAX_STORED_KEYS) return SLF_OK;
  slf_result result = make_store(&layer->keys, count, name, error);
  return result ? result : make_store(&layer->differences, count, name, error);
}

static void free_store(block_store *store) {
  free(store->blocks);
  free((void *)store->states);
}

void layer_free(layer_state *layer) {
  free(layer->linear);
  free(layer->slices);
  free(layer->quad_ranks);
  free(layer->quad_slices);
  free(layer->group_ranks);
  free(layer->group_keys);
  free_store(&layer->base);
  free_store(&layer->keys);
  free_store(&layer->differences);
  for (int kind = 0; kind < STREAM_COUNT; kind++) free(layer->streams[kind].tables);
}

int layer_key_taps(const layer_state *layer, uint32_t s, uint32_t t, key_tap taps[4]) {
  /* Keys stand at 4 i + 2; two more and a group less keeps the division by four non-negative. */
  int32_t group_s = (int32_t)((s + 2) / GROUP_SIDE) - 1, at_s = (int32_t)((s + 2) % GROUP_SIDE);
  int32_t group_t = (int32_t)((t + 2) / GROUP_SIDE) - 1, at_t = (int32_t)((t + 2) % GROUP_SIDE);
  int count = 0, heaviest = 0;
  int32_t sum = 0;
  for (int j = 0; j < 2; j++)
    for (int i = 0; i < 2; i++) {
      int32_t gs = group_s + i, gt = group_t + j;
      int32_t weight = (i ? at_s : GROUP_SIDE - at_s) * (j ? at_t : GROUP_SIDE - at_t);
      if (weight == 0 || gs < 0 || gt < 0 || gs >= (int32_t)layer->group_s_count ||
          gt >= (int32_t)layer->group_t_count)
        continue;
      uint32_t group = (uint32_t)gt * layer->group_s_count + (uint32_t)gs;
      if (layer->group_keys[group] == NO_KEY) continue;
      taps[count++] = (key_tap){group, weight};
      sum += weight;
    }
  if (count == 0) {
    taps[0] = (key_tap){layer_group(layer, s, t), 16};
    return 1;
  }
  int32_t given = 0;
  for (int i = 0; i < count; i++) {
    taps[i].weight = taps[i].weight * 16 / sum;
    given += taps[i].weight;
    if (taps[i].weight > taps[heaviest].weight) heaviest = i;
  }
  taps[heaviest].weight += 16 - given;
  return count;
}

uint32_t layer_chain_start(const layer_state *layer, uint32_t s, uint32_t t) {
  uint32_t start = s / MOTION_CHAIN * MOTION_CHAIN;
  while (start < s && !layer_has_slice(layer, start, t)) start++;
  return start;
}
