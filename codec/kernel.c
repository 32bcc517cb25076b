#include "codec/kernel.h"

int kernels_that_run(const kernel *kernels[MOST_KERNELS]) {
  int count = 0;
  kernels[count++] = &kernel_plain;
#ifdef SLF_HAS_AVX2
  /* What has BMI has LZCNT, which clang does not know by name. */
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("bmi") ||
      !__builtin_cpu_supports("bmi2") || !__builtin_cpu_supports("popcnt"))
    return count;
  kernels[count++] = &kernel_avx2;
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
      __builtin_cpu_supports("avx512vbmi") && __builtin_cpu_supports("avx512vbmi2"))
    kernels[count++] = &kernel_avx512;
#endif
  return count;
}

const kernel *kernel_choose(void) {
  const kernel *kernels[MOST_KERNELS];
  return kernels[kernels_that_run(kernels) - 1];
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
