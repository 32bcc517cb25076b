/* kernel.c - between levels and texels. */
#include "codec/kernel.h"

#include <string.h>

/* ---- Transform ----------------------------------------------------------------------------------
 */

/* Arai, Agui and Nakajima's inverse on the columns of 8 rows, all eight columns side by side. */
static inline void inverse_columns(float b[8][8]) {
  for (int i = 0; i < 8; i++) {
    float even0 = b[0][i] + b[4][i], even1 = b[0][i] - b[4][i];
    float even3 = b[2][i] + b[6][i];
    float even2 = (b[2][i] - b[6][i]) * 1.414213562f - even3;
    float x0 = even0 + even3, x3 = even0 - even3, x1 = even1 + even2, x2 = even1 - even2;
    float z13 = b[5][i] + b[3][i], z10 = b[5][i] - b[3][i];
    float z11 = b[1][i] + b[7][i], z12 = b[1][i] - b[7][i];
    float y7 = z11 + z13;
    float y11 = (z11 - z13) * 1.414213562f;
    float z5 = (z10 + z12) * 1.847759065f;
    float y10 = z5 - z12 * 1.082392200f, y12 = z5 - z10 * 2.613125930f;
    float y6 = y12 - y7, y5 = y11 - y6, y4 = y10 - y5;
    b[0][i] = x0 + y7;
    b[7][i] = x0 - y7;
    b[1][i] = x1 + y6;
    b[6][i] = x1 - y6;
    b[2][i] = x2 + y5;
    b[5][i] = x2 - y5;
    b[3][i] = x3 + y4;
    b[4][i] = x3 - y4;
  }
}

static inline void transpose(float b[8][8]) {
  for (int y = 0; y < 8; y++)
    for (int x = 0; x < y; x++) {
      float swap = b[y][x];
      b[y][x] = b[x][y];
      b[x][y] = swap;
    }
}

void inverse_dct(float block[COEFFICIENTS]) {
  float(*b)[8] = (float(*)[8])block;
  inverse_columns(b);
  transpose(b);
  inverse_columns(b);
  transpose(b);
}

void plain_inverse_dct(float block[COEFFICIENTS]) {
  for (int i = 0; i < COEFFICIENTS; i++) block[i] *= (float)(slf_aan[i / 8] * slf_aan[i % 8] / 8);
  inverse_dct(block);
}

void forward_dct(const float texels[COEFFICIENTS], float coefficients[COEFFICIENTS]) {
  /* Half the cosines of (2x + 1) k pi / 16; row 0 times sqrt(1/2). */
  static const float c[8][8] = {{0.35355339f, 0.35355339f, 0.35355339f, 0.35355339f, 0.35355339f,
                                 0.35355339f, 0.35355339f, 0.35355339f},
                                {0.49039264f, 0.41573481f, 0.27778512f, 0.09754516f, -0.09754516f,
                                 -0.27778512f, -0.41573481f, -0.49039264f},
                                {0.46193977f, 0.19134172f, -0.19134172f, -0.46193977f, -0.46193977f,
                                 -0.19134172f, 0.19134172f, 0.46193977f},
                                {0.41573481f, -0.09754516f, -0.49039264f, -0.27778512f, 0.27778512f,
                                 0.49039264f, 0.09754516f, -0.41573481f},
                                {0.35355339f, -0.35355339f, -0.35355339f, 0.35355339f, 0.35355339f,
                                 -0.35355339f, -0.35355339f, 0.35355339f},
                                {0.27778512f, -0.49039264f, 0.09754516f, 0.41573481f, -0.41573481f,
                                 -0.09754516f, 0.49039264f, -0.27778512f},
                                {0.19134172f, -0.46193977f, 0.46193977f, -0.19134172f, -0.19134172f,
                                 0.46193977f, -0.46193977f, 0.19134172f},
                                {0.09754516f, -0.27778512f, 0.41573481f, -0.49039264f, 0.49039264f,
                                 -0.41573481f, 0.27778512f, -0.09754516f}};
  float rows[8][8]; /* transformed down the columns */
  for (int k = 0; k < 8; k++) {
    float sum[8] = {0};
    for (int y = 0; y < 8; y++)
      for (int x = 0; x < 8; x++) sum[x] += c[k][y] * texels[8 * y + x];
    memcpy(rows[k], sum, sizeof sum);
  }
  for (int k = 0; k < 8; k++)
    for (int j = 0; j < 8; j++) {
      float sum = 0;
      for (int x = 0; x < 8; x++) sum += c[j][x] * rows[k][x];
      coefficients[8 * k + j] = sum;
    }
}

/* ---- Texels -------------------------------------------------------------------------------------
 */

static inline uint8_t to_byte(float value) {
  value = value > 0 ? value : 0;
  value = value < 255 ? value : 255;
  return (uint8_t)(int)(value + 0.5f);
}

void levels_to_channels(const layer_state *layer, int16_t fine[3][COEFFICIENTS],
                        float channels[3][COEFFICIENTS]) {
  for (int c = 0; c < 3; c++) {
    for (int i = 0; i < COEFFICIENTS; i++) channels[c][i] = fine[c][i] * layer->scales[c][i];
    inverse_dct(channels[c]);
  }
}

void channels_to_codes(float channels[3][COEFFICIENTS], uint8_t *u_block) {
  /* JFIF's colours; the level shift of 128 is luma's alone. */
  for (int i = 0; i < COEFFICIENTS; i++) {
    float luma = channels[0][i] + 128, cb = channels[1][i], cr = channels[2][i];
    u_block[4 * i + 0] = to_byte(luma + 1.402f * cr);
    u_block[4 * i + 1] = to_byte(luma - 0.344136f * cb - 0.714136f * cr);
    u_block[4 * i + 2] = to_byte(luma + 1.772f * cb);
    u_block[4 * i + 3] = 255;
  }
}
