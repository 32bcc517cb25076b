#include "codec/layer.h"

#include <stdlib.h>

const uint8_t slf_zigzag[COEFFICIENTS] = {
    0,  1,  8,  16, 9,  2,  3,  10, 17, 24, 32, 25, 18, 11, 4,  5,  12, 19, 26, 33, 40, 48,
    41, 34, 27, 20, 13, 6,  7,  14, 21, 28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23,
    30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63};

const double slf_aan[8] = {1.0, 1.387039845, 1.306562965, 1.175875602,
                           1.0, 0.785694958, 0.541196100, 0.275899379};

slf_result layer_make_quads(layer_state *layer, const char *name, slf_error *error) {
  slf_layer *p = &layer->public;
  p->block_u_count = (p->u_count + SLF_BLOCK_SIDE - 1) / SLF_BLOCK_SIDE;
  p->block_v_count = (p->v_count + SLF_BLOCK_SIDE - 1) / SLF_BLOCK_SIDE;
  layer->quad_s_count = (p->s_count + 1) / 2;
  layer->quad_t_count = (p->t_count + 1) / 2;
  size_t quads = (size_t)layer->quad_s_count * layer->quad_t_count;
  layer->quad_ranks = malloc(quads * sizeof *layer->quad_ranks);
  layer->quad_slices = calloc(quads, 1);
  if (!layer->quad_ranks || !layer->quad_slices)
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for %zu quads", name, quads);
  for (uint32_t t = 0; t < p->t_count; t++)
    for (uint32_t s = 0; s < p->s_count; s++)
      if (slf_slice_exists(p->s_count, p->t_count, s, t)) {
        layer->quad_slices[t / 2 * layer->quad_s_count + s / 2] |=
            (uint8_t)(1u << (2 * (t & 1) + (s & 1)));
        p->slice_count++;
      }
  for (size_t i = 0; i < quads; i++) {
    layer->quad_ranks[i] = layer->quad_count;
    if (layer->quad_slices[i]) layer->quad_count++;
  }
  uint64_t blocks = (uint64_t)p->block_u_count * p->block_v_count;
  layer->entries_per_quad = (blocks + layer->run_blocks - 1) / layer->run_blocks;
  layer->stream.entry_count = layer->entries_per_quad * layer->quad_count;
  p->raw_nbytes = (uint64_t)p->u_count * p->v_count * 3 * p->slice_count;
  return SLF_OK;
}

void layer_make_scales(layer_state *layer) {
  for (int channel = 0; channel < 3; channel++)
    for (int i = 0; i < COEFFICIENTS; i++)
      layer->scales[channel][i] = (float)(layer->steps[channel][i] / (double)STEP_ONE *
                                          slf_aan[i / 8] * slf_aan[i % 8] / 8);
}

void layer_free(layer_state *layer) {
  free(layer->quad_ranks);
  free(layer->quad_slices);
  free(layer->code);
}
