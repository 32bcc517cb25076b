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

static void decode_linear(const layer_state *layer, slf_block_address a, float *rgb) {
  float channels[3][COEFFICIENTS];
  uint16_t codes[COEFFICIENTS][3];
  uint64_t place = (uint64_t)a.block_v * layer->public.block_u_count + a.block_u;
  layer->kernel->channels(layer, a.s, a.t, place, channels);
  layer_codes(layer, channels, codes);
  bool hdr = layer->public.curve == SLF_CURVE_DWA;
  for (int i = 0; i < BLOCK_TEXELS; i++)
    for (int c = 0; c < 3; c++)
      rgb[3 * i + c] =
          hdr ? layer->linear[codes[i][c]] : slf_linear_from_srgb((uint8_t)codes[i][c]);
}

static void decode_tone_mapped(const layer_state *layer, slf_block_address a, uint8_t *u_block) {
  float rgb[3 * BLOCK_TEXELS];
  if (!has_block(layer, a)) {
    memset(u_block, 0, SLF_BLOCK_NBYTES);
    return;
  }
  decode_linear(layer, a, rgb);
  for (int i = 0; i < BLOCK_TEXELS; i++) {
    for (int c = 0; c < 3; c++) u_block[4 * i + c] = slf_srgb_from_linear(rgb[3 * i + c]);
    u_block[4 * i + 3] = 255;
  }
}

void slf_decode_block(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                      slf_block_address address, uint8_t *u_block) {
  slf_decode_blocks(file, surface_index, layer_index, &address, 1, &u_block);
}

void slf_decode_blocks(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                       const slf_block_address *addresses, size_t count, uint8_t *const *u_blocks) {
  const layer_state *layer = get_layer(file, surface_index, layer_index);
  if (layer && layer->public.curve == SLF_CURVE_SRGB)
    layer->kernel->blocks(layer, addresses, count, u_blocks);
  else
    for (size_t i = 0; i < count; i++) decode_tone_mapped(layer, addresses[i], u_blocks[i]);
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
        layer->kernel->blocks(layer, &a, 1, (uint8_t *[]){codes});
        for (int i = 0; i < BLOCK_TEXELS; i++)
          for (int c = 0; c < 3; c++) block[3 * i + c] = linear[codes[4 * i + c]];
      }
      put_block(p, a, block, rgb);
    }
  return SLF_OK;
}
