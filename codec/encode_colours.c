/* encode_colours.c - the colours of a layer, and its steps. */
#include "codec/encode_parts.h"

#include <math.h>

enum {
  MAX_STEP = 3900,
  SAMPLED_SLICES = 24 /* the colours are made from so many slices */
};

/* ---- Steps --------------------------------------------------------------------------------- */

/* A channel's error counts in R, G and B: luma's in all, Cb's 1.772 and 0.344, Cr's 1.402 and 0.714
 * times; of a layer's own colours as much as luma's. Steps in inverse proportion make every bit buy
 * the same error; the slight slope over the frequencies keeps whole-numbered steps from jumping all
 * at the same quality. Steps of the scheme without prediction are whole, so that a slice can leave
 * as a JPEG with the same coefficients. */
static void make_steps(layer_encoder *e) {
  static const double jfif_scale[3] = {1.0, 0.96, 1.10};
  double unit = e->layer.public.curve == SLF_CURVE_DWA ? DWA_SCALE / 255.0 : 1;
  double base = unit * exp2((100 - e->layer.public.quality) / 8.0);
  for (int channel = 0; channel < 3; channel++) {
    double scale = e->layer.own_colours ? 1 : jfif_scale[channel];
    double step = fmin(base * scale, MAX_STEP) * STEP_ONE;
    step_line *line = &e->layer.step_lines[channel];
    line->first = (uint32_t)fmax(STEP_ONE, floor(0.95 * step + 0.5));
    line->slope = (uint32_t)floor(0.007 * step * 16 + 0.5);
  }
  layer_make_steps(&e->layer);
  for (int channel = 0; channel < 3; channel++)
    for (int i = 0; i < COEFFICIENTS; i++)
      e->steps[channel][i] = (float)e->layer.steps[channel][i] / STEP_ONE;
  /* What many blocks lean on is worth eight times finer steps, and a key twice, as long as the
   * levels fit in 16 bits: a coefficient is at most 8 codes' range. */
  double range = e->layer.public.curve == SLF_CURVE_DWA ? DWA_CODES : 256;
  uint32_t gain = MAX_GAIN;
  while (gain > 1 && 8 * range * gain / base > MAX_LEVEL) gain /= 2;
  bool layered = e->layer.public.angular == SLF_ANGULAR_LAYERED;
  e->layer.gains[STREAM_REST] = layered ? gain : 1;
  e->layer.gains[STREAM_KEYS] = gain > 2 ? gain * 3 / 4 : 1;
  e->layer.gains[STREAM_BASE] = 1;
  layer_make_scales(&e->layer);
}

/* ---- Colours ------------------------------------------------------------------------------- */

/* Adds what a slice's texels vary by within their blocks: what AC will have to say. */
static void add_covariance(const layer_encoder *e, const uint16_t *slice, double covariance[3][3]) {
  for (uint64_t place = 0; place < layer_place_count(&e->layer); place++) {
    int64_t sum[3] = {0}, products[3][3] = {{0}};
    for (uint32_t i = 0; i < COEFFICIENTS; i++) {
      const uint16_t *texel = slice + 3 * place_texel(&e->layer.public, place, i);
      for (int j = 0; j < 3; j++) {
        sum[j] += texel[j];
        for (int k = 0; k < 3; k++) products[j][k] += texel[j] * texel[k];
      }
    }
    for (int j = 0; j < 3; j++)
      for (int k = 0; k < 3; k++)
        covariance[j][k] += (double)products[j][k] - (double)(sum[j] * sum[k]) / COEFFICIENTS;
  }
}

/* Eigenvectors of a symmetric matrix as columns, by Jacobi's rotations; the matrix becomes its
 * eigenvalues. */
static void diagonalise(double a[3][3], double vectors[3][3]) {
  enum { SWEEPS = 12 };
  for (int k = 0; k < 9; k++) (&vectors[0][0])[k] = k % 4 == 0;
  for (int turn = 0; turn < 3 * SWEEPS; turn++) {
    int p = turn % 3 == 2, q = turn % 3 == 0 ? 1 : 2;
    if (a[p][q] == 0) continue;
    double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
    double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
    double c = 1 / sqrt(t * t + 1), s = t * c;
    for (int k = 0; k < 3; k++) {
      double x = a[k][p], y = a[k][q];
      a[k][p] = c * x - s * y;
      a[k][q] = s * x + c * y;
    }
    for (int k = 0; k < 3; k++) {
      double x = a[p][k], y = a[q][k];
      a[p][k] = c * x - s * y;
      a[q][k] = s * x + c * y;
      x = vectors[k][p], y = vectors[k][q];
      vectors[k][p] = c * x - s * y;
      vectors[k][q] = s * x + c * y;
    }
  }
}

static void invert(const float m[3][3], float inverse[3][3]) {
  double cofactors[3][3], determinant = 0;
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
      cofactors[i][j] = (double)m[a][c] * m[b][d] - (double)m[a][d] * m[b][c];
    }
  for (int j = 0; j < 3; j++) determinant += m[0][j] * cofactors[0][j];
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) inverse[j][i] = (float)(cofactors[i][j] / determinant);
}

/* The layer's own colours are the axes along which its texels vary most and least (Karhunen and
 * Loeve): what is left of three channels that vary together is one that does, and little else.
 * Their length is luma's, the square root of 3: the greatest error a code can make of a step. */
static void set_own_colours(layer_encoder *e, double covariance[3][3]) {
  double axes[3][3];
  diagonalise(covariance, axes);
  int order[3] = {0, 1, 2};
  for (int i = 0; i < 2; i++)
    for (int j = 0; j < 2; j++)
      if (covariance[order[j]][order[j]] < covariance[order[j + 1]][order[j + 1]]) {
        int swap = order[j];
        order[j] = order[j + 1];
        order[j + 1] = swap;
      }
  for (int c = 0; c < 3; c++) {
    double sum = axes[0][order[c]] + axes[1][order[c]] + axes[2][order[c]];
    double length = sum < 0 ? -sqrt(3) : sqrt(3);
    for (int k = 0; k < 3; k++)
      e->to_rgb[k][c] = (int16_t)lrint(length * COLOUR_ONE * axes[k][order[c]]);
  }
  layer_set_own_colours(&e->layer, (const int16_t(*)[3])e->to_rgb);
}

/* The paper's schemes keep JFIF's colours, so that a slice of independent blocks can leave as a
 * JPEG and the others stand beside it; heights and coverage are gray. */
slf_result colours_choose(layer_encoder *e, bool own, slf_error *error) {
  const slf_layer *p = &e->layer.public;
  layer_set_jfif_colours(&e->layer);
  if (own && p->role != SLF_ROLE_HEIGHT && p->role != SLF_ROLE_COVERAGE) {
    uint32_t stride = (p->slice_count + SAMPLED_SLICES - 1) / SAMPLED_SLICES, seen = 0;
    double covariance[3][3] = {{0}};
    for (uint32_t i = 0; i < p->s_count * p->t_count; i++) {
      if (!e->layer.slices[i] || seen++ % stride != stride / 2) continue;
      slf_result result = slice_read(e, i % p->s_count, i / p->s_count, e->slices[0], error);
      if (result != SLF_OK) return result;
      add_covariance(e, e->slices[0], covariance);
    }
    set_own_colours(e, covariance);
  }
  invert((const float(*)[3])e->layer.to_rgb, e->from_rgb);
  make_steps(e);
  return SLF_OK;
}
