#include "codec/kernel.h"

const kernel *kernel_choose(void) {
#ifdef SLF_HAS_AVX2
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") &&
      __builtin_cpu_supports("bmi2") && __builtin_cpu_supports("popcnt"))
    return &kernel_avx2;
#endif
  return &kernel_plain;
}

void shift_channels(float from[3][COEFFICIENTS], int du, int dv, float to[3][COEFFICIENTS]) {
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < 8; y++)
      for (int x = 0; x < 8; x++) {
        int u = x + du, v = y + dv;
        u = u < 0 ? 0 : u > 7 ? 7 : u;
        v = v < 0 ? 0 : v > 7 ? 7 : v;
        to[c][8 * y + x] = from[c][8 * v + u];
      }
}
