/* depth_cover.h - outlines: how much of a texel a thing in front covers, and its light over what is
 * behind.
 *
 * Part of depth_kernel.c, which alone includes it: once in each of its compilations. */
#ifndef DEPTH_COVER_H
#define DEPTH_COVER_H

#include <string.h>

#include "depth_sight.h"
#include "half.h"

/* What slices show of a thing in front: the weights of those of their texels that see it. */
typedef struct {
  reading at[4];
  i8 weights[4];
  f8 say[4];
  f8 seen, passed; /* sums of weights, of texels that see it and of those that see past it, */
  f8 covered;      /* and of as much of either as it covers */
  f8 moved;        /* mean of the codes seen less those expected */
} front;

/* Four coverages (slf.h), of a texel, its right neighbour and the two below, in a number. */
INLINE i8 coverages_at(const depth_field *field, const sight *s, const reading *r) {
  const uint8_t *bytes = field->pages.bytes + field->pages.coverage_offset;
  i8 four;
  for (int l = 0; l < LANES; l++) {
    const uint8_t *upper = bytes + 3 * (size_t)(uint32_t)s->texel[l] + (uint32_t)r->texel[l];
    const uint8_t *below = upper + PAGE_ROW_TEXELS;
    const uint32_t codes =
        upper[0] | (uint32_t)upper[1] << 8 | (uint32_t)below[0] << 16 | (uint32_t)below[1] << 24;
    four[l] = (int32_t)codes;
  }
  return four;
}

/* How much of each texel the thing covers, of SLF_COVERED_BY_NONE: of those near its height all but
 * what shows higher things, of those further away what shows lower ones. */
INLINE i8 covered_by(i8 coverages, i8 near, i8 far) {
  const b32 codes = (b32)coverages;
  const b32 is_over = (b32)(codes > SLF_COVERED_BY_NONE);
  const b32 of_near = (codes & ~is_over) | (SLF_COVERED_BY_NONE & is_over);
  const b32 of_far = (codes - SLF_COVERED_BY_NONE) & is_over;
  return ((i8)of_near & near) | ((i8)of_far & far);
}

/* What hides the thing from a slice has no say. */
static void look_for(depth_field *field, const bundle *b, const sight s[4], const f8 *code,
                     front *v) {
  f8 expected[4];
  v->seen = v->passed = v->covered = v->moved = all(0);
  see(field, b, s, 4, *code, expected, v->at);
  for (int k = 0; k < 4; k++) {
    const f8 edge = all(0.5f * EDGE_CODES);
    const i8 codes = codes_at(field, &v->at[k]), weights = four_weights(&v->at[k]);
    const i8 low = to_int(larger(expected[k] - edge, all(0)));
    const i8 past = bytes_from(codes, to_int(smaller(expected[k] + edge + 1.0f, all(255))));
    const i8 seeing = bytes_from(codes, low) & ~past, near = seeing & weights;
    const f8 sum = sum_of_four(near);
    v->weights[k] = near;
    v->say[k] = choose(v->at[k].inside, s[k].weight, all(0));
    const i8 parts = covered_by(coverages_at(field, &s[k], &v->at[k]), seeing, past);
    v->seen += v->say[k] * sum;
    v->passed += v->say[k] * sum_of_four(past & weights);
    v->covered += v->say[k] * to_float(weigh(parts, weights));
    v->moved += v->say[k] * (to_float(weigh(codes, near)) - sum * expected[k]);
  }
  v->moved /= larger(v->seen, all(1e-3f));
}

/* Its light, as much of it as it covers of the texels. */
INLINE sample light_in_front(const depth_field *field, const front *v, f8 coverage) {
  sample sum = {{{0}}};
  const f8 unit = root_unit(v->seen);
  for (int k = 0; k < 4; k++) add_reading(field, &v->at[k], v->weights[k], v->say[k] * unit, &sum);
  square(&sum, to_int(coverage * (float)WHOLE));
  return sum;
}

static uint64_t cover(depth_field *field, depth_rays *rays, const depth_guess *guess,
                      uint64_t *partly) {
  f8 code = load(guess->codes);
  float coverages[LANES], codes[LANES], scores[LANES];
  uint16_t light[LANES][4];
  uint64_t wholly = 0;
  bundle b;
  sight s[4];
  front v;
  look_around(field, rays, guess->texels, &b, s);
  look_for(field, &b, s, &code, &v);
  /* A neighbour's height: where the thing bends away its own is higher. */
  const i8 moved = magnitude(v.moved) > all(LEAST_MOVE);
  if (mask_bits(moved)) {
    code = choose(moved, smaller(larger(code + v.moved, all(0)), all(255)), code);
    look_for(field, &b, s, &code, &v);
  }
  const f8 share = v.covered / (SLF_COVERED_BY_NONE * larger(v.seen + v.passed, all(1e-3f)));
  f8 coverage = smaller(larger((share - 0.5f) * field->sharpen + 0.5f, all(0)), all(1));
  coverage = choose(v.seen * (float)MOST_TIMES < all(ACROSS), all(0), coverage);
  unsigned mask = mask_bits(coverage > all(LEAST_COVERAGE)) & ((1u << guess->count) - 1);
  if (!mask) return 0;
  const sample sum = light_in_front(field, &v, coverage);
  put(&sum, light);
  store(coverages, coverage), store(scores, share + share - 1.0f);
  store(codes, smaller(larger(code + v.moved, all(0)), all(255)));
  for (; mask; mask &= mask - 1) {
    const int l = __builtin_ctz(mask);
    const uint8_t k = guess->texels[l];
    const bool whole = coverages[l] == 1;
    memcpy(whole ? rays->rgba[k] : rays->front[k], light[l], sizeof light[l]);
    if (whole)
      rays->code[k] = codes[l], rays->score[k] = scores[l], wholly |= 1ull << k;
    else
      rays->coverage[k] = coverages[l], rays->front_code[k] = codes[l], *partly |= 1ull << k;
  }
  return wholly;
}

static void lay_over(depth_rays *rays, uint64_t texels) {
  for (; texels; texels &= texels - 1) {
    const int k = __builtin_ctzll(texels);
    const float left = 1 - rays->coverage[k];
#if defined(__AVX2__)
    __m128 over = _mm_cvtph_ps(_mm_loadl_epi64((const __m128i *)(const void *)rays->front[k]));
    __m128 under = _mm_cvtph_ps(_mm_loadl_epi64((const __m128i *)(const void *)rays->rgba[k]));
    over = _mm_blend_ps(_mm_add_ps(over, _mm_mul_ps(_mm_set1_ps(left), under)), under, 0x8);
    _mm_storel_epi64((__m128i *)(void *)rays->rgba[k],
                     _mm_cvtps_ph(over, _MM_FROUND_TO_NEAREST_INT));
#else
    for (int c = 0; c < 3; c++) {
      const float under = left * float_from_half(rays->rgba[k][c]);
      rays->rgba[k][c] = half_from_float(float_from_half(rays->front[k][c]) + under);
    }
#endif
  }
}

#endif
