/* texels.c - the public side of decoding. */
#include "codec/file.h"
#include "codec/kernel.h"

static const layer_state *get_layer(const slf_file *file, uint32_t surface_index,
                                    uint32_t layer_index) {
  if (surface_index >= file->surface_count) return NULL;
  const surface_state *surface = &file->surfaces[surface_index];
  return layer_index < surface->public.layer_count ? &surface->layers[layer_index] : NULL;
}

void slf_decode_block(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                      slf_block_address address, uint8_t *u_block) {
  slf_decode_blocks(file, surface_index, layer_index, &address, 1, &u_block);
}

void slf_decode_blocks(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                       const slf_block_address *addresses, size_t count, uint8_t *const *u_blocks) {
  const layer_state *layer = get_layer(file, surface_index, layer_index);
  if (layer) layer->kernel->blocks(layer, addresses, count, u_blocks);
  for (size_t i = 0; !layer && i < count; i++) memset(u_blocks[i], 0, SLF_BLOCK_NBYTES);
}

slf_result slf_decode_slice(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                            uint32_t s_index, uint32_t t_index, float *rgb, slf_error *error) {
  const layer_state *layer = get_layer(file, surface_index, layer_index);
  if (!layer || !layer_has_slice(layer, s_index, t_index))
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
      layer->kernel->blocks(layer, &address, 1, (uint8_t *[]){texels});
      for (uint32_t y = 0; y < SLF_BLOCK_SIDE && bv * SLF_BLOCK_SIDE + y < p->v_count; y++)
        for (uint32_t x = 0; x < SLF_BLOCK_SIDE && bu * SLF_BLOCK_SIDE + x < p->u_count; x++) {
          size_t texel = (size_t)(bv * SLF_BLOCK_SIDE + y) * p->u_count + bu * SLF_BLOCK_SIDE + x;
          for (int c = 0; c < 3; c++) rgb[3 * texel + c] = linear[texels[32 * y + 4 * x + c]];
        }
    }
  return SLF_OK;
}
