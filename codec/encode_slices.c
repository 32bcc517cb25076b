/* encode_slices.c - from the source's slices to coefficients. */
#include "codec/encode_parts.h"

#include <math.h>

/* ---- Slices -------------------------------------------------------------------------------- */

static unit_slices slices_of_quad(const layer_state *layer, uint32_t quad) {
  unit_slices unit = {.slice_count = 0};
  for (uint32_t q = 0; q < QUAD_SLICES; q++) {
    if (!(layer->quad_slices[quad] >> q & 1)) continue;
    unit.s[unit.slice_count] = quad % layer->quad_s_count * 2 + (q == 1 || q == 2);
    unit.t[unit.slice_count++] = quad / layer->quad_s_count * 2 + (q >= 2);
  }
  return unit;
}

unit_slices unit_at(const layer_state *layer, stream_kind kind, uint32_t index) {
  if (kind == STREAM_REST) return slices_of_quad(layer, index);
  uint32_t key = layer->group_keys[index];
  return (unit_slices){{key & 0xffff}, {key >> 16}, key != NO_KEY};
}

uint32_t unit_index_count(const layer_state *layer, stream_kind kind) {
  if (kind == STREAM_REST) return layer->quad_s_count * layer->quad_t_count;
  return layer->group_s_count * layer->group_t_count;
}

slf_result slice_read(layer_encoder *e, uint32_t s, uint32_t t, uint16_t *codes, slf_error *error) {
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

slf_result unit_read(layer_encoder *e, const unit_slices *unit, slf_error *error) {
  slf_result result = SLF_OK;
  for (int i = 0; i < unit->slice_count && result == SLF_OK; i++)
    result = slice_read(e, unit->s[i], unit->t[i], e->slices[i], error);
  return result;
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

static void transform_block(const layer_encoder *e, const uint16_t *slice, uint64_t place,
                            coefficients c) {
  float rgb[COEFFICIENTS][3];
  for (uint32_t i = 0; i < COEFFICIENTS; i++) {
    const uint16_t *texel = slice + 3 * place_texel(&e->layer.public, place, i);
    for (int k = 0; k < 3; k++) rgb[i][k] = texel[k];
  }
  transform_texels(e, rgb, c);
}

void place_transform(const layer_encoder *e, const unit_slices *unit, const float *mean,
                     uint64_t place, coefficients *blocks) {
  if (mean) {
    float rgb[COEFFICIENTS][3];
    for (uint32_t i = 0; i < COEFFICIENTS; i++)
      memcpy(rgb[i], mean + 3 * place_texel(&e->layer.public, place, i), sizeof rgb[i]);
    transform_texels(e, rgb, blocks[0]);
    return;
  }
  for (int i = 0; i < unit->slice_count; i++) transform_block(e, e->slices[i], place, blocks[i]);
}
