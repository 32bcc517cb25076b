/* decode.c - finding and decoding blocks. */
#include "codec/file.h"

#include <stdlib.h>

static const layer_state *get_layer(const slf_file *file, uint32_t surface_index,
                                    uint32_t layer_index) {
  if (surface_index >= file->surface_count) return NULL;
  const surface_state *surface = &file->surfaces[surface_index];
  return layer_index < surface->public.layer_count ? &surface->layers[layer_index] : NULL;
}

static bool slice_is_stored(const layer_state *layer, uint32_t s, uint32_t t) {
  if (s >= layer->public.s_count || t >= layer->public.t_count) return false;
  return layer->quad_slices[t / 2 * layer->quad_s_count + s / 2] >> (2 * (t & 1) + (s & 1)) & 1;
}

static void decode_one(const layer_state *layer, slf_block_address a, uint8_t *u_block) {
  const slf_layer *p = &layer->public;
  if (!slice_is_stored(layer, a.s, a.t) || a.block_u >= p->block_u_count ||
      a.block_v >= p->block_v_count) {
    memset(u_block, 0, SLF_BLOCK_NBYTES);
    return;
  }
  uint32_t quad = a.t / 2u * layer->quad_s_count + a.s / 2u;
  unsigned slice_bit = 2 * (a.t & 1u) + (a.s & 1u), slices = layer->quad_slices[quad];
  uint64_t block = (uint64_t)a.block_v * p->block_u_count + a.block_u;
  const block_stream *stream = &layer->stream;
  bit_cursor cursor = {stream->bytes,
                       stream_find(stream, layer_entry(layer, layer->quad_ranks[quad], block)),
                       (stream->nbytes - STREAM_PAD_NBYTES) * 8};
  /* The entry's blocks follow each other: those before this one are read and dropped. */
  unsigned skip = (unsigned)(block % layer->run_blocks) * (unsigned)__builtin_popcount(slices) +
                  (unsigned)__builtin_popcount(slices & ((1u << slice_bit) - 1));
  int16_t levels[3][LEVELS_STRIDE];
  while (skip-- && kernel_parse(layer->code, &cursor, levels)) continue;
  kernel_parse(layer->code, &cursor, levels);
  kernel_reconstruct(layer, levels, u_block);
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
