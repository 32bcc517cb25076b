/* transform.c - levels to texels. Compiled for each kernel: see kernel.h.
 *
 * Eight lanes are eight columns or rows. A compiler without 256-bit registers splits them; the sums
 * and products stay the same ones. */
#include "codec/kernel.h"

typedef float lanes __attribute__((vector_size(32)));
typedef int32_t int_lanes __attribute__((vector_size(32)));
typedef int16_t short_lanes __attribute__((vector_size(16)));

static inline __attribute__((always_inline)) lanes splat(float x) {
  return (lanes){x, x, x, x, x, x, x, x};
}

static inline __attribute__((always_inline)) void load(const float *from, lanes b[8]) {
  memcpy(b, from, 8 * sizeof *b);
}

/* Arai, Agui and Nakajima's inverse along the index, in each lane. */
static inline __attribute__((always_inline)) void inverse_pass(lanes b[8]) {
  lanes even0 = b[0] + b[4], even1 = b[0] - b[4];
  lanes even3 = b[2] + b[6];
  lanes even2 = (b[2] - b[6]) * splat(1.414213562f) - even3;
  lanes x0 = even0 + even3, x3 = even0 - even3, x1 = even1 + even2, x2 = even1 - even2;
  lanes z13 = b[5] + b[3], z10 = b[5] - b[3];
  lanes z11 = b[1] + b[7], z12 = b[1] - b[7];
  lanes y7 = z11 + z13;
  lanes y11 = (z11 - z13) * splat(1.414213562f);
  lanes z5 = (z10 + z12) * splat(1.847759065f);
  lanes y10 = z5 - z12 * splat(1.082392200f), y12 = z5 - z10 * splat(2.613125930f);
  lanes y6 = y12 - y7, y5 = y11 - y6, y4 = y10 - y5;
  b[0] = x0 + y7;
  b[7] = x0 - y7;
  b[1] = x1 + y6;
  b[6] = x1 - y6;
  b[2] = x2 + y5;
  b[5] = x2 - y5;
  b[3] = x3 + y4;
  b[4] = x3 - y4;
}

static inline __attribute__((always_inline)) void transpose(lanes b[8]) {
  lanes p[8], q[8];
  for (int i = 0; i < 8; i += 2) {
    p[i] = __builtin_shufflevector(b[i], b[i + 1], 0, 8, 1, 9, 4, 12, 5, 13);
    p[i + 1] = __builtin_shufflevector(b[i], b[i + 1], 2, 10, 3, 11, 6, 14, 7, 15);
  }
  for (int i = 0; i < 8; i += 4)
    for (int k = 0; k < 2; k++) {
      q[i + 2 * k] = __builtin_shufflevector(p[i + k], p[i + k + 2], 0, 1, 8, 9, 4, 5, 12, 13);
      q[i + 2 * k + 1] =
          __builtin_shufflevector(p[i + k], p[i + k + 2], 2, 3, 10, 11, 6, 7, 14, 15);
    }
  for (int i = 0; i < 4; i++) {
    b[i] = __builtin_shufflevector(q[i], q[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
    b[i + 4] = __builtin_shufflevector(q[i], q[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
  }
}

static inline __attribute__((always_inline)) void inverse(lanes b[8]) {
  inverse_pass(b);
  transpose(b);
  inverse_pass(b);
}

void inverse_dct(float block[COEFFICIENTS]) {
  lanes b[8];
  load(block, b);
  inverse(b);
  memcpy(block, b, sizeof b);
}

void plain_inverse_dct(float block[COEFFICIENTS]) {
  for (int i = 0; i < COEFFICIENTS; i++) block[i] *= (float)(slf_aan[i / 8] * slf_aan[i % 8] / 8);
  inverse_dct(block);
}

/* Half the cosines of (2x + 1) k pi / 16; row 0 times sqrt(1/2). */
static const float cosines[8][8] = {{0.35355339f, 0.35355339f, 0.35355339f, 0.35355339f,
                                     0.35355339f, 0.35355339f, 0.35355339f, 0.35355339f},
                                    {0.49039264f, 0.41573481f, 0.27778512f, 0.09754516f,
                                     -0.09754516f, -0.27778512f, -0.41573481f, -0.49039264f},
                                    {0.46193977f, 0.19134172f, -0.19134172f, -0.46193977f,
                                     -0.46193977f, -0.19134172f, 0.19134172f, 0.46193977f},
                                    {0.41573481f, -0.09754516f, -0.49039264f, -0.27778512f,
                                     0.27778512f, 0.49039264f, 0.09754516f, -0.41573481f},
                                    {0.35355339f, -0.35355339f, -0.35355339f, 0.35355339f,
                                     0.35355339f, -0.35355339f, -0.35355339f, 0.35355339f},
                                    {0.27778512f, -0.49039264f, 0.09754516f, 0.41573481f,
                                     -0.41573481f, -0.09754516f, 0.49039264f, -0.27778512f},
                                    {0.19134172f, -0.46193977f, 0.46193977f, -0.19134172f,
                                     -0.19134172f, 0.46193977f, -0.46193977f, 0.19134172f},
                                    {0.09754516f, -0.27778512f, 0.41573481f, -0.49039264f,
                                     0.49039264f, -0.41573481f, 0.27778512f, -0.09754516f}};

static inline __attribute__((always_inline)) void forward_pass(const lanes from[8], lanes to[8]) {
  for (int k = 0; k < 8; k++) {
    to[k] = splat(cosines[k][0]) * from[0];
    for (int x = 1; x < 8; x++) to[k] += splat(cosines[k][x]) * from[x];
  }
}

void forward_dct(const float texels[COEFFICIENTS], float coefficients[COEFFICIENTS]) {
  lanes rows[8], once[8];
  load(texels, rows);
  forward_pass(rows, once); /* down the columns: [vertical][x] */
  transpose(once);          /* [x][vertical] */
  forward_pass(once, rows); /* [horizontal][vertical] */
  memcpy(coefficients, rows, sizeof rows);
}

/* ---- Levels -------------------------------------------------------------------------------- */

/* Int16 arithmetic wraps: a damaged file may ask for anything. */
typedef uint16_t word_lanes __attribute__((vector_size(16)));

static inline __attribute__((always_inline)) void channel_texels(const int16_t *prediction,
                                                                 const int16_t *levels,
                                                                 uint16_t gain, const float *scales,
                                                                 lanes b[8]) {
  load(scales, b);
  for (int i = 0; i < 8; i++) {
    word_lanes level;
    memcpy(&level, levels + 8 * i, sizeof level);
    level *= gain;
    if (prediction) {
      word_lanes predicted;
      memcpy(&predicted, prediction + 8 * i, sizeof predicted);
      level += predicted;
    }
    int_lanes wide = __builtin_convertvector((short_lanes)level, int_lanes);
    b[i] *= __builtin_convertvector(wide, lanes);
  }
  inverse(b);
}

/* Without AC all texels are the DC: the transform adds zeros to it. */
static inline __attribute__((always_inline)) void flat_texels(int16_t level, uint16_t gain,
                                                              const float *scales, lanes b[8]) {
  lanes dc = splat((float)(int16_t)(uint16_t)((uint16_t)level * (uint32_t)gain) * scales[0]);
  for (int i = 0; i < 8; i++) b[i] = dc;
}

static inline __attribute__((always_inline)) void
make_texels(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
            const entry_state *state, uint32_t gain, lanes b[3][8]) {
  for (int c = 0; c < 3; c++) {
    if (prediction)
      channel_texels(prediction[c], state->levels[c], (uint16_t)gain, layer->scales[c], b[c]);
    else if (state->ac_flags >> c & 1)
      channel_texels(NULL, state->levels[c], (uint16_t)gain, layer->scales[c], b[c]);
    else
      flat_texels(state->levels[c][0], (uint16_t)gain, layer->scales[c], b[c]);
  }
}

/* Clamped to 0 .. 255 and rounded. */
static inline __attribute__((always_inline)) int_lanes to_code(lanes x) {
  const lanes low = splat(0), high = splat(255);
  int_lanes above_low = x > low, below_high = x < high;
  x = (lanes)((int_lanes)x & above_low);
  x = (lanes)(((int_lanes)x & below_high) | ((int_lanes)high & ~below_high));
  return __builtin_convertvector(x + splat(0.5f), int_lanes);
}

/* JFIF's colours; the level shift of 128 is luma's alone. */
static inline __attribute__((always_inline)) void put_codes(lanes b[3][8], uint8_t *u_block) {
  for (int y = 0; y < 8; y++) {
    lanes luma = b[0][y] + splat(128), cb = b[1][y], cr = b[2][y];
    int_lanes red = to_code(luma + splat(1.402f) * cr);
    int_lanes green = to_code(luma - splat(0.344136f) * cb - splat(0.714136f) * cr);
    int_lanes blue = to_code(luma + splat(1.772f) * cb);
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
    int_lanes texels = red | green << 8 | blue << 16 | (int32_t)0xff000000;
#else
    int_lanes texels = red << 24 | green << 16 | blue << 8 | 255;
#endif
    memcpy(u_block + 32 * y, &texels, sizeof texels);
  }
}

void levels_to_channels(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
                        const entry_state *state, uint32_t gain, float channels[3][COEFFICIENTS]) {
  lanes b[3][8];
  make_texels(layer, prediction, state, gain, b);
  memcpy(channels, b, sizeof b);
}

void channels_to_codes(float channels[3][COEFFICIENTS], uint8_t *u_block) {
  lanes b[3][8];
  memcpy(b, channels, sizeof b);
  put_codes(b, u_block);
}

void levels_to_codes(const layer_state *layer, const int16_t prediction[3][COEFFICIENTS],
                     const entry_state *state, uint32_t gain, uint8_t *u_block) {
  lanes b[3][8];
  make_texels(layer, prediction, state, gain, b);
  put_codes(b, u_block);
}
