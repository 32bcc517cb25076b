/* inverse_pass.h - the inverse transform along one index, for transform.c: included once for each
 * width of vectors, with LANES, their type, and INVERSE_PASS, the function's name.
 *
 * Arai, Agui and Nakajima's, in each lane. Where it is `low`, the upper four are zeros, and what
 * adds them is left out. */
static inline __attribute__((always_inline)) void INVERSE_PASS(LANES b[8], bool low) {
  LANES even0 = low ? b[0] : b[0] + b[4], even1 = low ? b[0] : b[0] - b[4];
  LANES even3 = low ? b[2] : b[2] + b[6];
  LANES even2 = (low ? b[2] : b[2] - b[6]) * 1.414213562f - even3;
  LANES x0 = even0 + even3, x3 = even0 - even3, x1 = even1 + even2, x2 = even1 - even2;
  LANES z13 = low ? b[3] : b[5] + b[3], z10 = low ? -b[3] : b[5] - b[3];
  LANES z11 = low ? b[1] : b[1] + b[7], z12 = low ? b[1] : b[1] - b[7];
  LANES y7 = z11 + z13;
  LANES y11 = (z11 - z13) * 1.414213562f;
  LANES z5 = (z10 + z12) * 1.847759065f;
  LANES y10 = z5 - z12 * 1.082392200f, y12 = z5 - z10 * 2.613125930f;
  LANES y6 = y12 - y7, y5 = y11 - y6, y4 = y10 - y5;
  b[0] = x0 + y7;
  b[7] = x0 - y7;
  b[1] = x1 + y6;
  b[6] = x1 - y6;
  b[2] = x2 + y5;
  b[5] = x2 - y5;
  b[3] = x3 + y4;
  b[4] = x3 - y4;
}
#undef LANES
#undef INVERSE_PASS
