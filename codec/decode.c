/* decode.c - finding and decoding blocks. */
#include "codec/decode.h"

#include "codec/file.h"

#include <stdatomic.h>
#include <stdlib.h>

typedef int16_t fine_block[3][COEFFICIENTS];

/* ---- Levels -------------------------------------------------------------------------------------
 */

/* Reads an entry up to block `slice` of slice_count at a place; a damaged one ends early, with what
 * was read. */
static void parse_entry(const layer_stream *stream, uint32_t unit, uint64_t place,
                        uint32_t slice_count, uint32_t slice, entry_state *state) {
  const block_stream *blocks = &stream->blocks;
  uint64_t entry = unit * stream->entries_per_unit + place / stream->run_places;
  bit_cursor cursor = {blocks->bytes, stream_find(blocks, entry),
                       (blocks->nbytes - STREAM_PAD_NBYTES) * 8};
  entry_begin(state);
  uint32_t number = (uint32_t)(place % stream->run_places) * slice_count + slice;
  for (uint32_t i = 0; i <= number; i++)
    if (!block_parse(stream->tables, &cursor, i, i % slice_count == 0, state)) break;
}

static int16_t wrap(int32_t value) {
  return (int16_t)(uint16_t)(uint32_t)value;
}

static void add_levels(fine_block fine, const entry_state *state, uint32_t gain) {
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < COEFFICIENTS; i++)
      fine[c][i] = wrap(fine[c][i] + (int32_t)gain * state->levels[c][i]);
}

static void parse_base(const layer_state *layer, uint64_t place, fine_block fine) {
  const layer_stream *stream = &layer->streams[STREAM_BASE];
  entry_state state;
  parse_entry(stream, 0, place, 1, 0, &state);
  memset(fine, 0, sizeof(fine_block));
  add_levels(fine, &state, layer->gains[STREAM_BASE]);
}

void decode_base(const layer_state *layer, uint64_t place, fine_block fine) {
  _Atomic uint8_t *state = &layer->base_states[place];
  if (atomic_load_explicit(state, memory_order_acquire) == 2) {
    memcpy(fine, layer->base[place], sizeof(fine_block));
    return;
  }
  parse_base(layer, place, fine);
  uint8_t absent = 0;
  if (!atomic_compare_exchange_strong(state, &absent, 1))
    return; /* another thread writes the same */
  memcpy(layer->base[place], fine, sizeof(fine_block));
  atomic_store_explicit(state, 2, memory_order_release);
}

void decode_key(const layer_state *layer, uint32_t group, uint64_t place, fine_block fine) {
  const layer_stream *stream = &layer->streams[STREAM_KEYS];
  entry_state state;
  parse_entry(stream, layer->group_ranks[group], place, 1, 0, &state);
  if (state.predictor == PREDICT_BASE)
    decode_base(layer, place, fine);
  else
    memset(fine, 0, sizeof(fine_block));
  add_levels(fine, &state, layer->gains[STREAM_KEYS]);
}

void decode_keys(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                 fine_block fine) {
  key_tap taps[4];
  int count = layer_key_taps(layer, s, t, taps);
  int32_t sum[3 * COEFFICIENTS] = {0};
  for (int i = 0; i < count; i++) {
    fine_block key;
    decode_key(layer, taps[i].group, place, key);
    for (int k = 0; k < 3 * COEFFICIENTS; k++) sum[k] += taps[i].weight * (&key[0][0])[k];
  }
  for (int k = 0; k < 3 * COEFFICIENTS; k++) (&fine[0][0])[k] = wrap((sum[k] + 8) >> 4);
}

/* ---- Shifts -------------------------------------------------------------------------------------
 */

void shift_channels(float from[3][COEFFICIENTS], int du, int dv, float to[3][COEFFICIENTS]) {
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < 8; y++)
      for (int x = 0; x < 8; x++) {
        int u = x + du, v = y + dv;
        u = u < 0 ? 0 : u > 7 ? 7 : u;
        v = v < 0 ? 0 : v > 7 ? 7 : v;
        to[c][8 * y + x] = from[c][8 * v + u];
      }
}

static void key_difference(const layer_state *layer, uint32_t group, uint64_t place,
                           float channels[3][COEFFICIENTS]) {
  fine_block key, base;
  decode_key(layer, group, place, key);
  decode_base(layer, place, base);
  for (int k = 0; k < 3 * COEFFICIENTS; k++)
    (&key[0][0])[k] = wrap((&key[0][0])[k] - (&base[0][0])[k]);
  levels_to_channels(layer, key, channels);
}

void decode_shifted(const layer_state *layer, uint32_t group, uint64_t place, int du, int dv,
                    float channels[3][COEFFICIENTS]) {
  const slf_layer *p = &layer->public;
  int32_t u0 = (int32_t)(place % p->block_u_count) * 8 + du;
  int32_t v0 = (int32_t)(place / p->block_u_count) * 8 + dv;
  int32_t width = (int32_t)p->block_u_count * 8, height = (int32_t)p->block_v_count * 8;
  uint64_t have = UINT64_MAX;
  float block[3][COEFFICIENTS];
  /* Place by place, the part of the shifted block that lies there; the edge of the slice repeats.
   */
  for (int32_t by = 0; by < 2; by++)
    for (int32_t bx = 0; bx < 2; bx++) {
      int32_t x_begin = bx ? 8 - (u0 & 7) : 0, x_end = bx ? 8 : 8 - (u0 & 7);
      int32_t y_begin = by ? 8 - (v0 & 7) : 0, y_end = by ? 8 : 8 - (v0 & 7);
      if (x_begin == x_end || y_begin == y_end) continue;
      for (int32_t y = y_begin; y < y_end; y++)
        for (int32_t x = x_begin; x < x_end; x++) {
          int32_t u = u0 + x, v = v0 + y;
          u = u < 0 ? 0 : u >= width ? width - 1 : u;
          v = v < 0 ? 0 : v >= height ? height - 1 : v;
          uint64_t at = (uint64_t)(v / 8) * p->block_u_count + (uint64_t)(u / 8);
          if (at != have) key_difference(layer, group, have = at, block);
          for (int c = 0; c < 3; c++) channels[c][8 * y + x] = block[c][8 * (v & 7) + (u & 7)];
        }
    }
}

/* ---- Blocks -------------------------------------------------------------------------------------
 */

/* The entry's state at a block of the rest, and the slice of the block that it stands on. */
static void parse_rest(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                       entry_state *state, uint32_t *anchor_s, uint32_t *anchor_t) {
  const layer_stream *stream = &layer->streams[STREAM_REST];
  uint32_t quad = t / 2 * layer->quad_s_count + s / 2;
  unsigned slices = layer->quad_slices[quad], slice_count = (unsigned)__builtin_popcount(slices);
  unsigned slice = (unsigned)__builtin_popcount(slices & ((1u << quad_place(s, t)) - 1));
  parse_entry(stream, layer->quad_ranks[quad], place, slice_count, slice, state);
  /* The anchor's slice: the (anchor mod slices)-th that the quad has. */
  unsigned left = slices;
  for (unsigned i = state->anchor % slice_count; i; i--) left &= left - 1;
  unsigned q = (unsigned)__builtin_ctz(left);
  *anchor_s = (s & ~1u) + (q == 1 || q == 2);
  *anchor_t = (t & ~1u) + (q >= 2);
}

static void fine_to_channels(const layer_state *layer, fine_block fine, const entry_state *state,
                             float channels[3][COEFFICIENTS]) {
  add_levels(fine, state, layer->gains[STREAM_REST]);
  levels_to_channels(layer, fine, channels);
}

/* The motion scheme: from the chain's first slice, each block shifts the one before. */
static void decode_chain(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                         float channels[3][COEFFICIENTS]) {
  for (uint32_t at = layer_chain_start(layer, s, t); at <= s; at++) {
    entry_state state;
    uint32_t anchor_s, anchor_t;
    float shifted[3][COEFFICIENTS];
    fine_block fine = {{0}};
    parse_rest(layer, at, t, place, &state, &anchor_s, &anchor_t);
    if (state.predictor == PREDICT_SHIFT)
      shift_channels(channels, state.shift_u, state.shift_v, shifted);
    fine_to_channels(layer, fine, &state, channels);
    for (int k = 0; state.predictor == PREDICT_SHIFT && k < 3 * COEFFICIENTS; k++)
      (&channels[0][0])[k] += (&shifted[0][0])[k];
  }
}

void decode_channels(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                     float channels[3][COEFFICIENTS]) {
  fine_block fine = {{0}};
  if (layer_is_key(layer, s, t)) {
    decode_key(layer, layer_group(layer, s, t), place, fine);
    levels_to_channels(layer, fine, channels);
    return;
  }
  if (layer->public.angular == SLF_ANGULAR_MOTION) {
    memset(channels, 0, 3 * sizeof *channels);
    decode_chain(layer, s, t, place, channels);
    return;
  }
  entry_state state;
  uint32_t anchor_s, anchor_t;
  parse_rest(layer, s, t, place, &state, &anchor_s, &anchor_t);
  bool has_base = layer_has(layer, STREAM_BASE), has_keys = layer_has(layer, STREAM_KEYS);
  bool shifted = has_keys && state.predictor == PREDICT_SHIFT;
  uint32_t group = layer_group(layer, anchor_s, anchor_t);
  if (has_base && (shifted || state.predictor == PREDICT_BASE))
    decode_base(layer, place, fine);
  else if (has_keys && state.predictor == PREDICT_KEY)
    decode_key(layer, group, place, fine);
  else if (has_keys && state.predictor == PREDICT_KEYS)
    decode_keys(layer, anchor_s, anchor_t, place, fine);
  fine_to_channels(layer, fine, &state, channels);
  if (shifted) {
    float moved[3][COEFFICIENTS];
    decode_shifted(layer, group, place, state.shift_u, state.shift_v, moved);
    for (int k = 0; k < 3 * COEFFICIENTS; k++) (&channels[0][0])[k] += (&moved[0][0])[k];
  }
}

/* ---- Public -------------------------------------------------------------------------------------
 */

static const layer_state *get_layer(const slf_file *file, uint32_t surface_index,
                                    uint32_t layer_index) {
  if (surface_index >= file->surface_count) return NULL;
  const surface_state *surface = &file->surfaces[surface_index];
  return layer_index < surface->public.layer_count ? &surface->layers[layer_index] : NULL;
}

static bool slice_is_stored(const layer_state *layer, uint32_t s, uint32_t t) {
  return slf_slice_exists(layer->public.s_count, layer->public.t_count, s, t);
}

static void decode_one(const layer_state *layer, slf_block_address a, uint8_t *u_block) {
  const slf_layer *p = &layer->public;
  if (!slice_is_stored(layer, a.s, a.t) || a.block_u >= p->block_u_count ||
      a.block_v >= p->block_v_count) {
    memset(u_block, 0, SLF_BLOCK_NBYTES);
    return;
  }
  float channels[3][COEFFICIENTS];
  decode_channels(layer, a.s, a.t, (uint64_t)a.block_v * p->block_u_count + a.block_u, channels);
  channels_to_codes(channels, u_block);
}

void slf_decode_block(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                      slf_block_address address, uint8_t *u_block) {
  slf_decode_blocks(file, surface_index, layer_index, &address, 1, &u_block);
}

void slf_decode_blocks(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                       const slf_block_address *addresses, size_t count, uint8_t *const *u_blocks) {
  const layer_state *layer = get_layer(file, surface_index, layer_index);
  for (size_t i = 0; i < count; i++) {
    if (layer)
      decode_one(layer, addresses[i], u_blocks[i]);
    else
      memset(u_blocks[i], 0, SLF_BLOCK_NBYTES);
  }
}

slf_result slf_decode_slice(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                            uint32_t s_index, uint32_t t_index, float *rgb, slf_error *error) {
  const layer_state *layer = get_layer(file, surface_index, layer_index);
  if (!layer || !slice_is_stored(layer, s_index, t_index))
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: no slice (%u, %u) in layer %u of surface %u",
                    file->name, s_index, t_index, layer_index, surface_index);
  const slf_layer *p = &layer->public;
  float linear[256];
  for (int code = 0; code < 256; code++) linear[code] = slf_linear_from_srgb((uint8_t)code);
  for (uint32_t bv = 0; bv < p->block_v_count; bv++)
    for (uint32_t bu = 0; bu < p->block_u_count; bu++) {
      uint8_t texels[SLF_BLOCK_NBYTES];
      slf_block_address address = {(uint16_t)s_index, (uint16_t)t_index, (uint16_t)bu,
                                   (uint16_t)bv};
      decode_one(layer, address, texels);
      for (uint32_t y = 0; y < SLF_BLOCK_SIDE && bv * SLF_BLOCK_SIDE + y < p->v_count; y++)
        for (uint32_t x = 0; x < SLF_BLOCK_SIDE && bu * SLF_BLOCK_SIDE + x < p->u_count; x++) {
          size_t texel = (size_t)(bv * SLF_BLOCK_SIDE + y) * p->u_count + bu * SLF_BLOCK_SIDE + x;
          for (int c = 0; c < 3; c++) rgb[3 * texel + c] = linear[texels[32 * y + 4 * x + c]];
        }
    }
  return SLF_OK;
}
