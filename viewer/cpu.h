/* cpu.h - what the processor that runs us has. */
#ifndef SLF_CPU_H
#define SLF_CPU_H

#include <stdbool.h>

#if defined(__x86_64__)
#include <cpuid.h>

/* AVX2 and the conversions to and from half floats (F16C, CPUID leaf 1, ECX bit 29: clang 14's
 * __builtin_cpu_supports does not know it by name). */
static inline bool cpu_has_avx2_f16c(void) {
  unsigned eax, ebx, ecx = 0, edx;
  return __builtin_cpu_supports("avx2") && __get_cpuid(1, &eax, &ebx, &ecx, &edx) && ecx >> 29 & 1;
}
#endif

#endif
