/* texels.c - the public side of decoding. */
#include "codec/file.h"
#include "codec/kernel.h"

enum { BLOCK_TEXELS = SLF_BLOCK_SIDE * SLF_BLOCK_SIDE };

static const layer_state *get_layer(const slf_file *file, uint32_t surface_index,
                                    uint32_t layer_index) {
  if (surface_index >= file->surface_count) return NULL;
  const surface_state *surface = &file->surfaces[surface_index];
  return layer_index < surface->public.layer_count ? &surface->layers[layer_index] : NULL;
}

static bool has_block(const layer_state *layer, slf_block_address a) {
  return layer && layer_has_slice(layer, a.s, a.t) && a.block_u < layer->public.block_u_count &&
         a.block_v < layer->public.block_v_count;
}

/* ---- Of a prefix --------------------------------------------------------------------------- */

static uint64_t place_of(const layer_state *layer, slf_block_address a) {
  return (uint64_t)a.block_v * layer->public.block_u_count + a.block_u;
}

/* An entry is there when its segment is: up to where the next one begins, and what may be loaded
 * beyond. */
static bool entry_is_there(const entry_site *site) {
  const layer_stream *stream = site->stream;
  const block_stream *blocks = &stream->blocks;
  if (!stream->partial) return true;
  uint64_t next = site->entry / 2 / SEGMENT_PAIRS + 1;
  if (!blocks->bytes || next >= stream_segment_count(blocks)) return false;
  return get_u48(blocks->bytes + next * DIRECTORY_ENTRY_NBYTES) <=
         blocks->nbytes - STREAM_PAD_NBYTES;
}

static bool base_is_there(const layer_state *layer, uint64_t place) {
  if (!layer_has(layer, STREAM_BASE)) return false;
  entry_site site = site_in_unit(&layer->streams[STREAM_BASE], 0, place, 1, 0);
  return entry_is_there(&site);
}

static bool key_is_there(const layer_state *layer, uint32_t group, uint64_t place) {
  if (!layer_has(layer, STREAM_KEYS)) return false;
  const layer_stream *keys = &layer->streams[STREAM_KEYS];
  entry_site site = site_in_unit(keys, layer->group_ranks[group], place, 1, 0);
  return base_is_there(layer, place) && entry_is_there(&site);
}

/* A block with all that it may be predicted from. */
static bool block_is_there(const layer_state *layer, slf_block_address a) {
  uint64_t place = place_of(layer, a);
  uint32_t first = a.s;
  if (layer->public.angular == SLF_ANGULAR_MOTION) first = layer_chain_start(layer, a.s, a.t);
  for (uint32_t s = first; s <= a.s; s++) {
    entry_site site = site_of_slice(layer, s, a.t, place);
    if (!entry_is_there(&site)) return false;
  }
  if (layer_is_key(layer, a.s, a.t)) return base_is_there(layer, place);
  return !layer->streams[STREAM_BASE].partial && !layer->streams[STREAM_KEYS].partial;
}

/* What stands in for a block that is not. */
static void stand_in(const layer_state *layer, slf_block_address a,
                     float channels[3][COEFFICIENTS]) {
  uint32_t group = layer_group(layer, a.s, a.t);
  uint64_t place = place_of(layer, a);
  fine_block fine = {{0}};
  if (key_is_there(layer, group, place))
    layer->kernel->key(layer, group, place, fine);
  else if (base_is_there(layer, place))
    layer->kernel->base(layer, place, fine);
  for (int c = 0; c < 3; c++) {
    for (int i = 0; i < COEFFICIENTS; i++) channels[c][i] = fine[c][i] * layer->scales[c][i];
    layer->kernel->inverse_dct(channels[c]);
  }
}

bool slf_has_block(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                   slf_block_address address) {
  const layer_state *layer = get_layer(file, surface_index, layer_index);
  return has_block(layer, address) && (!layer->partial || block_is_there(layer, address));
}

/* ---- Blocks -------------------------------------------------------------------------------- */

static void decode_codes(const layer_state *layer, slf_block_address a,
                         uint16_t codes[COEFFICIENTS][3]) {
  float channels[3][COEFFICIENTS];
  if (!layer->partial || block_is_there(layer, a))
    layer->kernel->channels(layer, a.s, a.t, place_of(layer, a), channels);
  else
    stand_in(layer, a, channels);
  layer_codes(layer, channels, codes);
}

static void decode_linear(const layer_state *layer, slf_block_address a, float *rgb) {
  uint16_t codes[COEFFICIENTS][3];
  decode_codes(layer, a, codes);
  bool hdr = layer->public.curve == SLF_CURVE_DWA;
  for (int i = 0; i < BLOCK_TEXELS; i++)
    for (int c = 0; c < 3; c++)
      rgb[3 * i + c] =
          hdr ? layer->linear[codes[i][c]] : slf_linear_from_srgb((uint8_t)codes[i][c]);
}

/* Blocks that are not the kernel's alone: of HDR, tone-mapped; of a prefix. */
static void decode_slowly(const layer_state *layer, slf_block_address a, uint8_t *u_block) {
  bool hdr = layer && layer->public.curve == SLF_CURVE_DWA;
  uint16_t codes[COEFFICIENTS][3];
  if (!has_block(layer, a)) {
    memset(u_block, 0, SLF_BLOCK_NBYTES);
    return;
  }
  decode_codes(layer, a, codes);
  for (int i = 0; i < BLOCK_TEXELS; i++) {
    for (int c = 0; c < 3; c++)
      u_block[4 * i + c] =
          hdr ? slf_srgb_from_linear(layer->linear[codes[i][c]]) : (uint8_t)codes[i][c];
    u_block[4 * i + 3] = 255;
  }
}

static void decode_blocks(const layer_state *layer, const slf_block_address *addresses,
                          size_t count, uint8_t *const *u_blocks) {
  if (layer && layer->public.curve == SLF_CURVE_SRGB && !layer->partial) {
    layer->kernel->blocks(layer, addresses, count, u_blocks);
    return;
  }
  for (size_t i = 0; i < count; i++)
    if (layer && layer->public.curve == SLF_CURVE_SRGB && has_block(layer, addresses[i]) &&
        block_is_there(layer, addresses[i]))
      layer->kernel->blocks(layer, &addresses[i], 1, &u_blocks[i]);
    else
      decode_slowly(layer, addresses[i], u_blocks[i]);
}

void slf_decode_block(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                      slf_block_address address, uint8_t *u_block) {
  slf_decode_blocks(file, surface_index, layer_index, &address, 1, &u_block);
}

void slf_decode_blocks(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                       const slf_block_address *addresses, size_t count, uint8_t *const *u_blocks) {
  decode_blocks(get_layer(file, surface_index, layer_index), addresses, count, u_blocks);
}

void slf_decode_block_linear(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                             slf_block_address address, float *rgb) {
  const layer_state *layer = get_layer(file, surface_index, layer_index);
  if (has_block(layer, address))
    decode_linear(layer, address, rgb);
  else
    memset(rgb, 0, 3 * BLOCK_TEXELS * sizeof *rgb);
}

static void put_block(const slf_layer *p, slf_block_address a, const float *block, float *rgb) {
  for (uint32_t y = 0; y < SLF_BLOCK_SIDE; y++)
    for (uint32_t x = 0; x < SLF_BLOCK_SIDE; x++) {
      uint32_t u = a.block_u * SLF_BLOCK_SIDE + x, v = a.block_v * SLF_BLOCK_SIDE + y;
      if (u < p->u_count && v < p->v_count)
        memcpy(rgb + 3 * ((size_t)v * p->u_count + u), block + 3 * (SLF_BLOCK_SIDE * y + x),
               3 * sizeof *rgb);
    }
}

slf_result slf_decode_slice(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                            uint32_t s_index, uint32_t t_index, float *rgb, slf_error *error) {
  const layer_state *layer = get_layer(file, surface_index, layer_index);
  if (!layer || !layer_has_slice(layer, s_index, t_index))
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: no slice (%u, %u) in layer %u of surface %u",
                    file->name, s_index, t_index, layer_index, surface_index);
  const slf_layer *p = &layer->public;
  float linear[256], block[3 * BLOCK_TEXELS];
  for (int code = 0; code < 256; code++) linear[code] = slf_linear_from_srgb((uint8_t)code);
  for (uint32_t v = 0; v < p->block_v_count; v++)
    for (uint32_t u = 0; u < p->block_u_count; u++) {
      slf_block_address a = {(uint16_t)s_index, (uint16_t)t_index, (uint16_t)u, (uint16_t)v};
      if (p->curve == SLF_CURVE_DWA) {
        decode_linear(layer, a, block);
      } else {
        uint8_t codes[SLF_BLOCK_NBYTES];
        decode_blocks(layer, &a, 1, (uint8_t *[]){codes});
        for (int i = 0; i < BLOCK_TEXELS; i++)
          for (int c = 0; c < 3; c++) block[3 * i + c] = linear[codes[4 * i + c]];
      }
      put_block(p, a, block, rgb);
    }
  return SLF_OK;
}
