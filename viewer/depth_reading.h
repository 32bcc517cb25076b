/* depth_reading.h - what a slice shows at places, one in each of eight lanes: its heights and its
 * light, of pages that are brought in where they are missing.
 *
 * Part of depth_kernel.c, which alone includes it: once in each of its compilations. */
#ifndef DEPTH_READING_H
#define DEPTH_READING_H

#include <string.h>

#include "depth_sample.h"

/* What a slice shows at a place. */
typedef struct {
  i8 texel;  /* the first of the four texels around */
  i8 fx, fy; /* how far from it, of SPLIT */
  i8 inside;
} reading;

static __attribute__((noinline)) void load_pages(depth_field *field, const int32_t texel[LANES],
                                                 unsigned lanes) {
  field->missed |= field->shared;
  for (; lanes && !field->shared; lanes &= lanes - 1)
    depth_pages_load(&field->pages, (uint32_t)texel[__builtin_ctz(lanes)]);
}

/* Three bytes: the weights of the left texels and of the right ones, and how far down the place is,
 * of SPLIT. */
INLINE i8 weights_of(const reading *r) {
  return r->fx * 255 + ACROSS + (r->fy << 16);
}

/* As load_codes, of pages that are brought in; by itself, so that what it needs costs nothing where
 * all pages are there. */
static __attribute__((noinline)) i8 load_codes_anew(depth_field *field,
                                                    const int32_t texel[LANES]) {
  load_pages(field, texel, (1u << LANES) - 1);
  return load_codes(field->pages.bytes, texel);
}

/* The codes of the four texels around. */
INLINE i8 codes_at(depth_field *field, const reading *r) {
  int32_t texel[LANES];
  memcpy(texel, &r->texel, sizeof texel);
  i8 codes = load_codes(field->pages.bytes, texel);
  if (__builtin_expect(mask_bits(codes == 0) != 0, 0)) codes = load_codes_anew(field, texel);
  return codes;
}

INLINE i8 nearest_code(const reading *r, i8 codes) {
  const i8 right = r->fx > SPLIT / 2, below = r->fy > SPLIT / 2;
  return pick_code(codes, (right & 1) + (below & 2));
}

/* The code of the height that is seen there. */
INLINE f8 look(depth_field *field, const reading *r) {
  const i8 codes = codes_at(field, r);
  f8 code = to_float(code_between(codes, r->fx, r->fy)) * (1.0f / ACROSS / SPLIT);
  /* Between a thing and what is behind it there is nothing. */
  f8 nearest = to_float(nearest_code(r, codes));
  return choose(range_of(codes) > EDGE_CODES, nearest, code);
}

static __attribute__((noinline)) void read_anew(depth_field *field, const int32_t texel[LANES],
                                                const i8 *weights, unsigned lanes, sample *r) {
  load_pages(field, texel, lanes);
  *r = read(field->pages.bytes, texel, *weights);
}

/* Adds what is read, of pages that are brought in where they are missing. */
INLINE void add_light(depth_field *field, const reading *at, f8 share, sample *sum) {
  int32_t texel[LANES];
  const i8 weights = weights_of(at);
  memcpy(texel, &at->texel, sizeof texel);
  sample r = read(field->pages.bytes, texel, weights);
  if (__builtin_expect(mask_bits(heights_of(&r) == 0) != 0, 0)) {
    sample anew;
    read_anew(field, texel, &weights, (1u << LANES) - 1, &anew);
    r = anew;
  }
  add(sum, &r, to_int(share));
}

/* The bilinear weights of the four texels around, a byte each; they add up to ACROSS. */
INLINE i8 four_weights(const reading *r) {
  i8 left = ACROSS - r->fx, left_below = left * r->fy >> 7, right_below = r->fx * r->fy >> 7;
  return (left - left_below) | (r->fx - right_below) << 8 | left_below << 16 | right_below << 24;
}

/* Of those weights the ones of texels that see the same thing as the nearest does: what is behind
 * its edge must not shine through, nor it over that. */
INLINE i8 weights_of_one(depth_field *field, const reading *r) {
  const i8 codes = codes_at(field, r), nearest = nearest_code(r, codes);
  const i8 from = bytes_from(codes, higher(nearest - EDGE_CODES, all_int(0)));
  const i8 to = bytes_from(~codes, higher(255 - nearest - EDGE_CODES, all_int(0)));
  return four_weights(r) & from & to;
}

/* The sum of the four weights of each lane. */
INLINE f8 sum_of_four(i8 weights) {
  return to_float(weigh(all_int(0x01010101), weights));
}

/* Adds the roots of what a reading shows by weights of its texels. */
INLINE void add_reading(const depth_field *field, const reading *at, i8 weights, f8 factor,
                        sample *sum) {
  int32_t texel[LANES];
  memcpy(texel, &at->texel, sizeof texel);
  add_roots(sum, field->pages.bytes, texel, weights, to_int(smaller(factor, all(WHOLE))));
}

#endif
