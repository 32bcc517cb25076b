/* depth_steady.h - rows of texels where heights go on as they were: all that they need is found
 * first and read after, from three slices.
 *
 * Part of depth_kernel.c, which alone includes it: once in each of its compilations. */
#ifndef DEPTH_STEADY_H
#define DEPTH_STEADY_H

#include <string.h>

#include "depth_sight.h"

/* The rays of a row, and the three slices at the corners of the half of its cell that each lies in:
 * three are read in three quarters of the time of four, and go over into each other as smoothly. */
INLINE void look_along(const depth_field *field, const depth_rays *rays, int row, bundle *b,
                       sight s[3]) {
  const i8 columns = {0, 1, 2, 3, 4, 5, 6, 7};
  const int32_t column = (int32_t)(field->pages.t_count + 1);
  i8 cell, missing;
  b->x = rays->x + field->texel_u * to_float(columns);
  b->y = all(rays->y + field->texel_v * (float)row);
  b->qx = load(rays->qx + 8 * row), b->qy = load(rays->qy + 8 * row);
  if (has_slab(field))
    b->x -= load(rays->through_x + 8 * row), b->y -= load(rays->through_y + 8 * row);
  f8 f = load(rays->f + 8 * row), g = load(rays->g + 8 * row), left = 1.0f - f - g;
  memcpy(&cell, rays->cell + 8 * row, sizeof cell);
  if (is_curved(field)) frames_at(field, &b->x, &b->y, &b->at);
  i8 beyond = left < all(0);
  f8 along_s = choose(beyond, 1.0f - g, f) + LEAST_WEIGHT;
  f8 along_t = choose(beyond, 1.0f - f, g) + LEAST_WEIGHT;
  f8 corner = magnitude(left) + LEAST_WEIGHT;
  const int32_t first = cell[0];
  if (!mask_bits(cell != all_int(first))) {
    s[0] = sight_of_one(field, b, first + column, along_s);
    s[1] = sight_of_one(field, b, first + 1, along_t);
    s[2] = sight_of_two(field, b, first, first + column + 1, beyond, corner);
  } else {
    s[0] = sight_of(field, b, cell + column, along_s);
    s[1] = sight_of(field, b, cell + 1, along_t);
    s[2] = sight_of(field, b, cell + (beyond & (column + 1)), corner);
  }
  missing = (s[0].dx != s[0].dx) | (s[1].dx != s[1].dx) | (s[2].dx != s[2].dx);
  if (mask_bits(missing)) stand_in(field, &cell, s, 3);
}

/* Where a slice should see a height. */
typedef struct {
  int32_t texel[LANES];
  i8 weights;
  f8 weight, expected; /* of the slice, 0 beyond the surface */
} aim;

/* Where the texels of a row are looked for, in the three slices that their directions lie between.
 * What is made of each slice is written out one by one, not in loops: it stays in registers. */
typedef struct {
  int row;
  unsigned lanes; /* that count */
  f8 code, wanted;
  aim at[3];
} row_aim;

INLINE void aim_at(const depth_field *field, const sight *s, const reading *r, f8 expected,
                   aim *a) {
  memcpy(a->texel, &r->texel, sizeof a->texel);
  a->weights = weights_of(r);
  for (int l = 0; l < LANES; l += 2) /* the next one's lie beside them */
    __builtin_prefetch(field->pages.bytes + 4 * (size_t)(uint32_t)a->texel[l] + 20);
  a->weight = choose(r->inside, s->weight, all(0));
  if (!FLAT) a->expected = expected;
}

INLINE void aim_row(const depth_field *field, const depth_rays *rays, row_aim *a) {
  bundle b;
  sight s[3];
  reading at[3];
  f8 expected[3];
  look_along(field, rays, a->row, &b, s);
  see(field, &b, s, 3, a->code, expected, at);
  aim_at(field, &s[0], &at[0], expected[0], &a->at[0]);
  aim_at(field, &s[1], &at[1], expected[1], &a->at[1]);
  aim_at(field, &s[2], &at[2], expected[2], &a->at[2]);
}

/* What they show there. */
typedef struct {
  sample of[3];
  f8 weight[3];     /* with which each sees it there */
  f8 agreed, score; /* as in verdict */
  f8 moved;         /* mean of the codes seen less those expected: the slices' directions lie around
                       the ray's, so that it leads to what they see, right to first order wherever
                       along the ray they look */
} view;

INLINE void witness_row(const aim *a, const sample *r, f8 code, f8 scale, f8 *weight, view *v,
                        f8 *against) {
  f8 off = to_float(heights_of(r)) * CODE_UNIT - (FLAT ? code : a->expected);
  f8 scaled = off * scale;
  *weight = a->weight * agreement(scaled);
  v->moved += *weight * off;
  v->agreed += *weight;
  *against += choose(scaled > 2.0f, a->weight, all(0));
}

INLINE void read_row(depth_field *field, const row_aim *a, view *v) {
  const uint8_t *bytes = field->pages.bytes;
  const f8 scale = 1.0f / tolerance(a->code);
  f8 against = all(0);
  v->of[0] = read(bytes, a->at[0].texel, a->at[0].weights);
  v->of[1] = read(bytes, a->at[1].texel, a->at[1].weights);
  v->of[2] = read(bytes, a->at[2].texel, a->at[2].weights);
  i8 missing =
      (heights_of(&v->of[0]) == 0) | (heights_of(&v->of[1]) == 0) | (heights_of(&v->of[2]) == 0);
  if (__builtin_expect((mask_bits(missing) & a->lanes) != 0, 0))
    for (int k = 0; k < 3; k++)
      read_anew(field, a->at[k].texel, &a->at[k].weights, a->lanes, &v->of[k]);
  v->agreed = all(1e-6f), v->moved = all(0);
  witness_row(&a->at[0], &v->of[0], a->code, scale, &v->weight[0], v, &against);
  witness_row(&a->at[1], &v->of[1], a->code, scale, &v->weight[1], v, &against);
  witness_row(&a->at[2], &v->of[2], a->code, scale, &v->weight[2], v, &against);
  const f8 seeing = larger(a->at[0].weight + a->at[1].weight + a->at[2].weight, all(LEAST_SEEING));
  const f8 part = 1.0f / (v->agreed * seeing); /* one division for two */
  v->moved *= seeing * part, v->score = (v->agreed - against) * (v->agreed * part);
}

/* The whole row is written: what else is in it is mixed afterwards. Where what is good has moved,
 * it is read once more. */
INLINE unsigned mix_row(depth_field *field, depth_rays *rays, row_aim *a) {
  view v;
  sample sum = {{{0}}};
  read_row(field, a, &v);
  i8 moved = (magnitude(v.moved) > MOVED_SHARE * tolerance(a->code)) & (v.score > a->wanted);
  if (mask_bits(moved) & a->lanes) {
    a->code = smaller(larger(a->code + v.moved, all(0)), all(255));
    aim_row(field, rays, a);
    read_row(field, a, &v);
  }
  const f8 unit = share_unit(v.agreed);
  add(&sum, &v.of[0], to_int(v.weight[0] * unit));
  add(&sum, &v.of[1], to_int(v.weight[1] * unit));
  add(&sum, &v.of[2], to_int(v.weight[2] * unit));
  put(&sum, rays->rgba + 8 * a->row);
  store(rays->code + 8 * a->row, smaller(larger(a->code + v.moved, all(0)), all(255)));
  store(rays->score + 8 * a->row, larger(v.score, a->wanted + SCORE_SLACK));
  return mask_bits(v.score > a->wanted) & a->lanes;
}

static uint64_t mix_steady(depth_field *field, depth_rays *rays, const depth_memory *last,
                           uint64_t steady) {
  row_aim aims[8];
  int count = 0;
  uint64_t mixed = 0;
  for (int row = 0; row < 8; row++) {
    row_aim *a = &aims[count];
    if (!(a->lanes = steady >> 8 * row & 0xff)) continue;
    f8 score = 0.01f * to_float(load_c8(last->score + 8 * row));
    a->row = row;
    a->code = to_float(load_u16(last->code + 8 * row)) * (1.0f / 256);
    a->wanted = smaller(larger(score - SCORE_SLACK, all(LEAST_NEAR)), all(ALL_AGREE));
    aim_row(field, rays, a);
    count++;
  }
  for (int i = 0; i < count; i++)
    mixed |= (uint64_t)mix_row(field, rays, &aims[i]) << 8 * aims[i].row;
  return mixed;
}

#endif
