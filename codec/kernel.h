/* kernel.h - the hot path: find, parse, levels, transform, decode.
 *
 * find.c, parse.c, levels.c, transform.c and decode.c are compiled once for any processor (the
 * reference) and, on x86-64, once more for AVX2, BMI2, LZCNT and POPCNT, and for AVX-512 with VBMI
 * and VBMI2. All give the same bits:
 * integers are exact, and floats are neither contracted nor reassociated. Outside of them only the
 * table of functions is seen, and kernel_choose picks it when a layer is made. */
#ifndef SLF_KERNEL_H
#define SLF_KERNEL_H

#include "codec/bits.h"
#include "codec/layer.h"

#ifdef SLF_KERNEL_AVX512
#define KERNEL(name) name##_avx512
#define SLF_KERNEL_NAME "AVX-512"
#elif defined SLF_KERNEL_AVX2
#define KERNEL(name) name##_avx2
#define SLF_KERNEL_NAME "AVX2"
#else
#define KERNEL(name) name##_plain
#define SLF_KERNEL_NAME "plain C"
#endif

/* ---- Find: FORMAT.md, "Block streams" ------------------------------------------------------ */

/* The byte of the stream at which entry `entry` (< entry_count) begins, or if it is the second of a
 * pair, before which it does; at most nbytes - STREAM_PAD_NBYTES, whatever the bytes. */
#define stream_find KERNEL(stream_find)
uint64_t stream_find(const block_stream *stream, uint64_t entry);

/* Checks that the directory and every segment's offsets lie inside and in order. */
#define stream_check KERNEL(stream_check)
slf_result stream_check(const block_stream *stream, const char *name, slf_error *error);

/* The same in two steps, the second of which reads what the first asked for. */
static inline const uint8_t *stream_directory(const block_stream *stream, uint64_t entry) {
  return stream->bytes + entry / 2 / SEGMENT_PAIRS * DIRECTORY_ENTRY_NBYTES;
}

/* Where the entry's segment begins: its head with the low bits, and where the high bits begin. */
static inline uint64_t stream_prefetch_segment(const block_stream *stream, uint64_t entry) {
  uint64_t begin = get_u48(stream_directory(stream, entry));
  uintptr_t at = (uintptr_t)stream->bytes + begin; /* a number: it may lie anywhere */
  for (int line = 0; line < 3; line++) __builtin_prefetch((const void *)(at + 64 * line));
  return begin;
}

#define stream_find_in_segment KERNEL(stream_find_in_segment)
uint64_t stream_find_in_segment(const block_stream *stream, uint64_t entry, uint64_t begin);

/* ---- Parse: FORMAT.md, "C-Blocks" ---------------------------------------------------------- */

/* What the symbols of a block's AC levels say: where they are, and how many bits each has. */
typedef struct {
  uint64_t places[3]; /* of each channel: bit k set for a level at place k of the zigzag scan */
  unsigned flags;     /* channels that may have one */
  uint32_t count;
  uint8_t sizes[MOST_LEVELS + COEFFICIENTS]; /* in their order; behind them is room to write */
} coded_levels;

/* Reads those levels, at the reader; the block's are these and dc, added to what is there or
 * not. */
#define levels_read KERNEL(levels_read)
void levels_read(bit_reader *reader, const coded_levels *coded, const int32_t dc[3], bool adds,
                 block_levels *block);

/* Differences (layer.h) of up to 2x2 places side by side, of which a shift shows 8x8 texels; and
 * where those begin. */
enum { WINDOW_ROW = 16, WINDOW_CHANNEL = 16 * WINDOW_ROW };
typedef struct {
  int16_t channels[3 * WINDOW_CHANNEL];
  uint32_t begin;
} shift_window;

/* The texels of a block that was read, to be made in steps: luma's, chroma's, then their codes.
 * Nothing in a step waits, where look-ups of symbols wait for each other: so the steps are taken
 * between the channels of the block read next. What is pointed to stays as it is until all are. */
typedef struct {
  const layer_state *layer;
  const int16_t (*prediction)[COEFFICIENTS];
  const block_levels *block;
  const shift_window *shifted;
  uint8_t *u_block;
  uint32_t gain;
  int step;                                  /* the next one */
  float luma[COEFFICIENTS], chroma[8][2][8]; /* made so far: rows, of chroma Cb and Cr in turn */
} texels_maker;
enum { TEXELS_LUMA, TEXELS_CHROMA, TEXELS_CODES, TEXELS_MADE };

/* As levels_to_channels. */
static inline void texels_begin(texels_maker *maker, const layer_state *layer,
                                const int16_t prediction[3][COEFFICIENTS],
                                const block_levels *block, uint32_t gain,
                                const shift_window *shifted, uint8_t *u_block) {
  maker->layer = layer;
  maker->prediction = prediction;
  maker->block = block;
  maker->shifted = shifted;
  maker->u_block = u_block;
  maker->gain = gain;
  maker->step = TEXELS_LUMA;
}

/* Takes the next step. */
#define texels_step KERNEL(texels_step)
void texels_step(texels_maker *maker);

static inline __attribute__((always_inline)) void texels_go_on(texels_maker *maker) {
  if (maker && maker->step != TEXELS_MADE) texels_step(maker);
}

static inline void texels_finish(texels_maker *maker) {
  while (maker && maker->step != TEXELS_MADE) texels_step(maker);
}

/* Passes over `passed` C-Blocks and reads the entry's next, its `number`-th from 0; `first` if it
 * is its place's first, which nothing precedes. False if its bits are no C-Block. Its levels
 * are the state's; if it is predicted from the block before, they are added to that one's, which
 * are there. Before they change, `meanwhile` is finished, unless it is NULL. */
#define block_parse KERNEL(block_parse)
bool block_parse(const block_tables *tables, bit_reader *reader, uint32_t passed, uint32_t number,
                 bool first, texels_maker *meanwhile, entry_state *state);

/* Passes over `count` of them; the DC levels of the last INTRA block go on. */
#define blocks_pass KERNEL(blocks_pass)
bool blocks_pass(const block_tables *tables, bit_reader *reader, int16_t intra_dc[3],
                 uint32_t count);

/* Whether the next C-Block is predicted from the one before it. */
#define block_leans_on_previous KERNEL(block_leans_on_previous)
bool block_leans_on_previous(const block_tables *tables, const bit_reader *reader);

/* ---- Transform ----------------------------------------------------------------------------- */

/* Inverse transform of one channel: column-major coefficients times AAN's factors / 8, in place, to
 * row-major texels. */
#define inverse_dct KERNEL(inverse_dct)
void inverse_dct(float block[COEFFICIENTS]);

/* The same from plain orthonormal coefficients. */
#define plain_inverse_dct KERNEL(plain_inverse_dct)
void plain_inverse_dct(float block[COEFFICIENTS]);

/* Row-major texels to column-major orthonormal coefficients. */
#define forward_dct KERNEL(forward_dct)
void forward_dct(const float texels[COEFFICIENTS], float coefficients[COEFFICIENTS]);

/* prediction (NULL: nothing; fine levels) + gain * a block's levels, to channels, without the
 * level shift, row-major; and on top what `shifted` shows, if it is not NULL. */
#define levels_to_channels KERNEL(levels_to_channels)
void levels_to_channels(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
                        const block_levels *block, uint32_t gain, const shift_window *shifted,
                        float channels[3][COEFFICIENTS]);

/* Fine levels to channels in fixed point, a difference. */
#define levels_to_difference KERNEL(levels_to_difference)
void levels_to_difference(const layer_state *layer, const int16_t fine[3][COEFFICIENTS],
                          int16_t difference[3][COEFFICIENTS]);

/* Channels to R G B X, 8 bits. */
#define channels_to_codes KERNEL(channels_to_codes)
void channels_to_codes(const layer_state *layer, float channels[3][COEFFICIENTS], uint8_t *u_block);

/* Levels to codes, without a stop between. */
#define levels_to_codes KERNEL(levels_to_codes)
void levels_to_codes(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
                     const block_levels *block, uint32_t gain, const shift_window *shifted,
                     uint8_t *u_block);

/* ---- The table ----------------------------------------------------------------------------- */

typedef int16_t fine_block[3][COEFFICIENTS];

struct kernel {
  const char *name;
  slf_result (*check_stream)(const block_stream *stream, const char *name, slf_error *error);
  uint64_t (*find)(const block_stream *stream, uint64_t entry);
  bool (*parse)(const block_tables *tables, bit_reader *reader, uint32_t passed, uint32_t number,
                bool first, texels_maker *meanwhile, entry_state *state);
  void (*inverse_dct)(float block[COEFFICIENTS]);
  void (*plain_inverse_dct)(float block[COEFFICIENTS]);
  void (*forward_dct)(const float texels[COEFFICIENTS], float coefficients[COEFFICIENTS]);
  void (*channels_to_codes)(const layer_state *layer, float channels[3][COEFFICIENTS],
                            uint8_t *u_block);
  void (*levels_to_codes)(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
                          const block_levels *block, uint32_t gain, const shift_window *shifted,
                          uint8_t *u_block);

  /* Fine levels of a base block, of a group's key, of the keys around a slice, mixed. */
  void (*base)(const layer_state *layer, uint64_t place, fine_block fine);
  void (*key)(const layer_state *layer, uint32_t group, uint64_t place, fine_block fine);
  void (*keys)(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place, fine_block fine);
  /* key - base, the texels (du, dv) away from a place's, as channels. */
  void (*shifted)(const layer_state *layer, uint32_t group, uint64_t place, int du, int dv,
                  float channels[3][COEFFICIENTS]);
  /* A block of an existing slice. */
  void (*channels)(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                   float channels[3][COEFFICIENTS]);
  /* slf_decode_blocks. */
  void (*blocks)(const layer_state *layer, const slf_block_address *addresses, size_t count,
                 uint8_t *const *u_blocks);
};

extern const kernel kernel_plain, kernel_avx2, kernel_avx512; /* the last two on x86-64 only */
enum { MOST_KERNELS = 3 };

/* The kernels that this processor runs, the best one last; returns how many. */
int kernels_that_run(const kernel *kernels[MOST_KERNELS]);

/* The best of them. */
const kernel *kernel_choose(void);

/* The motion scheme's shift: edges repeat. */
void shift_channels(float from[3][COEFFICIENTS], int du, int dv, float to[3][COEFFICIENTS]);

#endif
