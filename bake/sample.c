#include "sample.h"

/* splitmix64 (Steele, Lea, Flood 2014): a good generator in three lines, the same everywhere. */
static double next_random(uint64_t *state) {
  uint64_t z = (*state += 0x9e3779b97f4a7c15u);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

static uint32_t level_count(uint32_t rays) {
  uint32_t p = 1;
  while (p * p < rays) p++;
  return p;
}

bool sample_count_is_valid(uint32_t rays) {
  return rays == 1 || rays == 9 || rays == 25 || rays == 49 || rays == 121;
}

/* Texels and cells draw from streams of their own, or U's offset would follow S's. */
void sample_texel_offsets(uint32_t rays, double (*uv)[2]) {
  uint32_t p = level_count(rays);
  uint64_t state = 1;
  for (uint32_t a = 0; a < p; a++) {
    for (uint32_t b = 0; b < p; b++) {
      uv[a * p + b][0] = (a + next_random(&state)) / p;
      uv[a * p + b][1] = (b + next_random(&state)) / p;
    }
  }
  uv[rays / 2][0] = uv[rays / 2][1] = 0.5;
}

static double tent(double offset) {
  return offset < 0.5 ? 2 * offset : 2 - 2 * offset;
}

void sample_texel_weights(uint32_t rays, double *weights) {
  double uv[SAMPLE_MAX_RAYS][2], sum = 0;
  sample_texel_offsets(rays, uv);
  for (uint32_t m = 0; m < rays; m++) sum += weights[m] = tent(uv[m][0]) * tent(uv[m][1]);
  for (uint32_t m = 0; m < rays; m++) weights[m] /= sum;
}

void sample_cell_offsets(uint32_t rays, uint32_t s_index, uint32_t t_index, double (*st)[2]) {
  uint32_t p = level_count(rays);
  uint64_t state = ((uint64_t)s_index << 32 | t_index) + 2;
  state = (uint64_t)(next_random(&state) * 0x1p53);
  for (uint32_t a = 0; a < p; a++) {
    for (uint32_t b = 0; b < p; b++) {
      st[a * p + b][0] = p == 1 ? 0.5 : ((a + b) % p + next_random(&state)) / p;
      st[a * p + b][1] = p == 1 ? 0.5 : ((a + 2 * b) % p + next_random(&state)) / p;
    }
  }
}
