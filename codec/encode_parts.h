/* encode_parts.h - what the parts of the encoder share. encode.c codes a layer: encode_colours.c
 * chooses its colours and steps, then come its streams, one after another. For each of them
 * encode_codes.c makes the codes, from a sample, and encode_stream.c goes through its units.
 * encode_slices.c reads those and transforms their places, encode_place.c chooses the blocks of a
 * place, and encode_symbols.c writes these, or counts what it would write. */
#ifndef SLF_ENCODE_PARTS_H
#define SLF_ENCODE_PARTS_H

#include "codec/encode.h"
#include "codec/kernel.h"
#include "codec/rate.h"

typedef float coefficients[3][COEFFICIENTS];

typedef struct {
  layer_state layer;
  const slf_source *source;
  scratch_file *scratch;
  scratch_map maps[STREAM_COUNT]; /* of the streams that others are predicted from */
  const char *name;
  uint32_t thread_count;
  float steps[3][COEFFICIENTS]; /* of a level of the rest, as numbers */
  int16_t to_rgb[3][3];         /* the layer's own colours, in COLOUR_ONEs */
  float from_rgb[3][3];         /* [channel][R G B] */
  code_costs costs;             /* of the stream that is being coded */
  float bits_a_ns;              /* likewise: what decoding it sooner is worth */
  huffman_encoder encoders[CODE_COUNT];
  uint8_t *whole_heads;          /* by whole head, its symbol, 0 where it has none */
  float *rgb;                    /* one slice */
  uint16_t *slices[QUAD_SLICES]; /* codes R G B of a unit's slices */
  /* The motion scheme: what the slice of an odd S decodes to, for t even and odd, by place. */
  float (*left[2])[3][COEFFICIENTS];
  _Atomic uint64_t squared_error; /* of all codes, as they will be decoded */
} layer_encoder;

/* ---- encode_colours.c */

/* The layer's own colours, or JFIF's, and the steps of its levels. */
slf_result colours_choose(layer_encoder *e, bool own, slf_error *error);

/* ---- encode_slices.c */

/* The slices of a unit, in the order of their C-Blocks at each place. */
typedef struct {
  uint32_t s[QUAD_SLICES], t[QUAD_SLICES];
  int slice_count;
} unit_slices;

/* The units of keys or rest by number; some have no slice, and so no blocks. */
uint32_t unit_index_count(const layer_state *layer, stream_kind kind);
unit_slices unit_at(const layer_state *layer, stream_kind kind, uint32_t index);

/* A slice as codes R G B; a unit's go to e->slices. */
slf_result slice_read(layer_encoder *e, uint32_t s, uint32_t t, uint16_t *codes, slf_error *error);
slf_result unit_read(layer_encoder *e, const unit_slices *unit, slf_error *error);

/* Texel i of a place; beyond the slice's edge the edge repeats. */
static inline size_t place_texel(const slf_layer *p, uint64_t place, uint32_t i) {
  uint32_t u = (uint32_t)(place % p->block_u_count) * SLF_BLOCK_SIDE + i % 8;
  uint32_t v = (uint32_t)(place / p->block_u_count) * SLF_BLOCK_SIDE + i / 8;
  u = u < p->u_count ? u : p->u_count - 1;
  v = v < p->v_count ? v : p->v_count - 1;
  return (size_t)v * p->u_count + u;
}

/* Coefficients of a place's blocks: of the unit that was read, or of the base, of its mean. */
void place_transform(const layer_encoder *e, const unit_slices *unit, const float *mean,
                     uint64_t place, coefficients *blocks);

/* ---- encode_symbols.c */

/* Symbols go to counts, or where counts is NULL out to bits. */
typedef struct {
  const layer_encoder *encoder;
  uint64_t (*counts)[256];
  _Atomic uint32_t *head_counts; /* by whole head; beside counts */
  bit_string *bits;
} symbol_sink;

/* What a place's blocks are predicted from, as the decoder will have it. */
typedef struct {
  int16_t intra_dc[3];
  bool has_previous;
  predictor anchor;      /* what the block before stands on, itself or through others, and */
  coefficients previous; /* what it decodes to */
  /* Of the motion scheme: channels of the left neighbour, by t & 1. */
  float (*left[2])[COEFFICIENTS];
} place_state;

/* How a block is coded. */
typedef struct {
  predictor predictor;
  int du, dv;
  unsigned flags;
  int16_t levels[3][COEFFICIENTS];
  float cost;
} block_choice;

/* DC of INTRA goes on in the state. */
void symbols_put_block(const symbol_sink *sink, const block_choice *b, place_state *state);

/* ---- encode_place.c */

/* Where an entry of the stream begins. */
place_state place_begin_entry(const layer_stream *stream);

/* Chooses and puts a place's blocks, each part's to its own sink. Returns their squared error where
 * `measured`: the slices are then the encoder's own. */
uint64_t encode_place(const layer_encoder *e, stream_kind kind, const unit_slices *unit,
                      uint64_t place, coefficients *blocks, const symbol_sink *sinks, bool measured,
                      place_state *state);

/* ---- encode_codes.c, encode_stream.c. `mean` is the base's, R G B a texel; else NULL. */

/* Makes a stream's codes, and with them what its entries span and where their DC begins. */
slf_result codes_make(layer_encoder *e, stream_kind kind, const float *mean, slf_error *error);

/* Appends a stream to the scratch file. From then on others can be predicted from it. */
slf_result encode_stream(layer_encoder *e, stream_kind kind, const float *mean,
                         encoded_chunk *encoded, double progress_begin, slf_error *error);

#endif
