/* layer.h - a layer as the decoder holds it, and the kernel that decodes its C-Blocks. */
#ifndef SLF_LAYER_H
#define SLF_LAYER_H

#include "codec/huffman.h"
#include "codec/stream.h"

enum {
  COEFFICIENTS = 64,
  STEP_ONE = 16, /* steps are stored in sixteenths */
  MAX_LEVEL = 32767,
  LEVELS_STRIDE = 80, /* a channel's 64 levels and room for what a damaged C-Block writes beyond */
  FAST_AC_BITS = 11,
  FAST_DC_BITS = 9,
  /* AC symbols are run << 4 | size as in JPEG, and with size 0: */
  SYMBOL_END = 0x00,    /* no level but 0 follows in the channel */
  SYMBOL_ESCAPE = 0x10, /* 6 bits of run, 16 bits of level */
  SYMBOL_RUN_16 = 0xf0, /* sixteen zeros */
  LAYER_FIXED_NBYTES = 32 + 3 * 64 * 2,
  MAX_RUN_LOG2 = 6,
  QUAD_SLICES = 4,
  CODE_DC_LUMA = 0,
  CODE_DC_CHROMA,
  CODE_AC_LUMA,
  CODE_AC_CHROMA,
  CODE_COUNT
};

/* Natural (row-major) place of the k-th coefficient of the zigzag scan. */
extern const uint8_t slf_zigzag[COEFFICIENTS];

/* AAN's factors: cos(k pi / 16) sqrt(2), 1 for k = 0 (Arai, Agui, Nakajima 1988). */
extern const double slf_aan[8];

/* An AC table's entry holds as many whole coefficients as FAST_AC_BITS show, two at most:
 * bits 0-7 how many bits they take, 0 if none is whole; 8-15 and 16-23 how far each lies behind the
 * one before (0: there is no second; 64: no first, the channel ends); 24 the channel ends here;
 * 32-47 and 48-63 the levels. A DC table's entry: bits 0-7 bits taken, 32-47 the level. */
typedef struct {
  uint64_t ac[2][1 << FAST_AC_BITS];
  uint64_t dc[2][1 << FAST_DC_BITS];
  huffman_decoder decoders[CODE_COUNT];
} block_code;

void block_code_make(const huffman_code codes[CODE_COUNT], block_code *code);

typedef struct {
  slf_layer public;
  uint16_t steps[3][COEFFICIENTS]; /* natural order */
  float scales[3][COEFFICIENTS];   /* steps times AAN's factors: what the inverse transform takes */
  huffman_code huffman[CODE_COUNT];
  block_code *code;
  uint32_t quad_s_count, quad_t_count, quad_count;
  uint32_t *quad_ranks; /* [t][s]: how many quads with a slice come before */
  uint8_t *quad_slices; /* [t][s]: bit 2 (t & 1) + (s & 1) set where the slice exists */
  uint32_t run_blocks;  /* block places an entry spans, a power of two */
  uint64_t entries_per_quad;
  block_stream stream;
} layer_state;

/* Fills what follows from public's dimensions: block counts, slices, quads. */
slf_result layer_make_quads(layer_state *layer, const char *name, slf_error *error);
void layer_make_scales(layer_state *layer); /* from steps */
void layer_free(layer_state *layer);

/* Where a place (quad, block) is: the stream's entry and the place in it. */
static inline uint64_t layer_entry(const layer_state *layer, uint32_t quad_rank, uint64_t block) {
  return quad_rank * layer->entries_per_quad + block / layer->run_blocks;
}

/* A position in a stream. */
typedef struct {
  const uint8_t *bytes;
  uint64_t bit, end_bit;
} bit_cursor;

/* Reads one C-Block's levels (natural order, zeros elsewhere); false if its bits are no C-Block. */
bool kernel_parse(const block_code *code, bit_cursor *cursor, int16_t levels[3][LEVELS_STRIDE]);

/* Levels to an 8x8 block of R G B X. */
void kernel_reconstruct(const layer_state *layer, int16_t levels[3][LEVELS_STRIDE],
                        uint8_t *u_block);

/* Inverse and forward 8x8 transform of one channel. Inverse: in natural order, already times the
 * AAN factors / 8. Forward: plain orthonormal coefficients. */
void inverse_dct(float block[COEFFICIENTS]);
void forward_dct(const float texels[COEFFICIENTS], float coefficients[COEFFICIENTS]);

#endif
