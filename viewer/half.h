/* half.h - IEEE half floats in plain C, bit for bit what the processor's own instructions give. */
#ifndef HALF_H
#define HALF_H

#include <math.h>
#include <stdint.h>
#include <string.h>

enum { HALF_ONE = 0x3c00 };

/* To the nearest half, ties to even. x in [0, 65520). */
static inline uint16_t half_from_float(float x) {
  uint32_t bits;
  if (x < 0x1p-14f) return (uint16_t)lrintf(x * 0x1p24f); /* subnormal: steps of 2^-24 */
  memcpy(&bits, &x, sizeof bits);
  bits += 0xfff + (bits >> 13 & 1);
  return (uint16_t)((bits - (112u << 23)) >> 13);
}

/* x within what half_from_float takes; NaN gives 0. */
static inline float half_range(float x) {
  return x > 0 ? (x < 65504 ? x : 65504) : 0;
}

/* Exact. Non-negative finite halves. */
static inline float float_from_half(uint16_t half) {
  if (half < 0x400) return (float)half * 0x1p-24f;
  uint32_t bits = ((uint32_t)half << 13) + (112u << 23);
  float x;
  memcpy(&x, &bits, sizeof x);
  return x;
}

#endif
