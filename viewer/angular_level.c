#include "angular_level.h"

#include <stdlib.h>

enum { AXIS_SAMPLES = 4 };

uint32_t angular_count(uint32_t count, uint32_t level) {
  return (count + (1u << level) - 1) >> level;
}

/* Up to AXIS_SAMPLES slices of level 0 along an axis that stand for slice i of n. */
static uint32_t axis_samples(uint32_t count, uint32_t n, uint32_t i,
                             uint32_t samples[AXIS_SAMPLES]) {
  uint32_t begin = (2 * i * count + n) / (2 * n), end = (2 * (i + 1) * count + n) / (2 * n);
  uint32_t width = end - begin, used = width < AXIS_SAMPLES ? width : AXIS_SAMPLES;
  for (uint32_t k = 0; k < used; k++) samples[k] = begin + (2 * k + 1) * width / (2 * used);
  return used;
}

/* One step towards the middle of the hemisphere, along the axis that is further from it. */
static void step_inwards(uint32_t s_count, uint32_t t_count, uint32_t *i, uint32_t *j) {
  int off_i = 2 * (int)*i + 1 - (int)s_count, off_j = 2 * (int)*j + 1 - (int)t_count;
  if (abs(off_i) >= abs(off_j))
    *i += off_i > 0 ? -1u : 1u;
  else
    *j += off_j > 0 ? -1u : 1u;
}

size_t angular_samples(uint32_t s_count, uint32_t t_count, uint32_t level, slice_index slice,
                       slice_index samples[ANGULAR_MAX_SAMPLES]) {
  uint32_t s[AXIS_SAMPLES], t[AXIS_SAMPLES];
  uint32_t s_used = axis_samples(s_count, angular_count(s_count, level), slice >> 8, s);
  uint32_t t_used = axis_samples(t_count, angular_count(t_count, level), slice & 0xff, t);
  size_t count = 0;
  for (uint32_t a = 0; a < s_used; a++)
    for (uint32_t b = 0; b < t_used; b++)
      if (slf_slice_exists(s_count, t_count, s[a], t[b]))
        samples[count++] = (slice_index)(s[a] << 8 | t[b]);
  if (count > 0) return count;
  uint32_t i = s[s_used / 2], j = t[t_used / 2];
  while (!slf_slice_exists(s_count, t_count, i, j)) step_inwards(s_count, t_count, &i, &j);
  samples[0] = (slice_index)(i << 8 | j);
  return 1;
}
