/* depth_sight.h - eight rays and the slices around them: where a slice sees what a ray meets at a
 * height, and what slices say of that height.
 *
 * Part of depth_kernel.c, which alone includes it: once in each of its compilations. */
#ifndef DEPTH_SIGHT_H
#define DEPTH_SIGHT_H

#include "depth_curved.h"
#include "depth_reading.h"

/* ---- Slices around rays ------------------------------------------------------------------------
 */

/* Eight rays, from texels of the light, less half a texel: behind a slab, from where they leave
 * it, as if its other sides did not mirror. */
typedef struct {
  f8 x, y, qx, qy;
  frame8 at; /* on a curved surface */
} bundle;

/* A slice for each of them. */
typedef struct {
  f8 dx, dy;               /* its slopes less the ray's */
  f8 through_x, through_y; /* to where it enters the slab */
  f8 weight;
  i8 texel; /* its first */
} sight;

INLINE bool has_slab(const depth_field *field) {
  return !FLAT && field->through;
}

INLINE i8 slice_of(const depth_field *field, i8 cell, int corner) {
  return cell + (corner & 1 ? (int32_t)(field->pages.t_count + 1) : 0) + (corner >> 1);
}

/* Another slice of the cell stands in for those that do not exist, and counts for nothing. */
static __attribute__((noinline)) void stand_in(const depth_field *field, const i8 *cell, sight *s,
                                               int count) {
  i8 any = *cell;
  for (int k = 0; k < 4; k++) {
    i8 number = slice_of(field, *cell, k);
    f8 slope, other;
    gather_pairs((const float(*)[2])field->slopes, number, &slope, &other);
    i8 exists = slope == slope;
    any = (number & exists) | (any & ~exists);
  }
  for (int k = 0; k < count; k++) {
    i8 exists = s[k].dx == s[k].dx;
    s[k].texel = (s[k].texel & exists) | (any * (int32_t)field->pages.slice_texels & ~exists);
    s[k].weight = choose(exists, s[k].weight, all(0));
    s[k].dx = choose(exists, s[k].dx, all(0));
    s[k].dy = choose(exists, s[k].dy, all(0));
    s[k].through_x = choose(exists, s[k].through_x, all(0));
    s[k].through_y = choose(exists, s[k].through_y, all(0));
  }
}

/* Slices of those numbers, one for each ray. */
INLINE sight sight_of(const depth_field *field, const bundle *b, i8 number, f8 weight) {
  sight s = {.through_x = all(0),
             .through_y = all(0),
             .weight = weight,
             .texel = number * (int32_t)field->pages.slice_texels};
  gather_pairs((const float(*)[2])field->slopes, number, &s.dx, &s.dy);
  s.dx -= b->qx, s.dy -= b->qy;
  if (has_slab(field))
    gather_pairs((const float(*)[2])field->through, number, &s.through_x, &s.through_y);
  return s;
}

/* The same slice for all of them. */
INLINE sight sight_of_one(const depth_field *field, const bundle *b, int32_t number, f8 weight) {
  sight s = {.dx = all(field->slopes[number][0]) - b->qx,
             .dy = all(field->slopes[number][1]) - b->qy,
             .through_x = all(0),
             .through_y = all(0),
             .weight = weight,
             .texel = all_int(number * (int32_t)field->pages.slice_texels)};
  if (has_slab(field))
    s.through_x = all(field->through[number][0]), s.through_y = all(field->through[number][1]);
  return s;
}

/* The same, of two numbers. */
INLINE sight sight_of_two(const depth_field *field, const bundle *b, int32_t number, int32_t other,
                          i8 others, f8 weight) {
  const float *one = field->slopes[number], *two = field->slopes[other];
  const int32_t texels = (int32_t)field->pages.slice_texels;
  sight s = {.dx = choose(others, all(two[0]), all(one[0])) - b->qx,
             .dy = choose(others, all(two[1]), all(one[1])) - b->qy,
             .through_x = all(0),
             .through_y = all(0),
             .weight = weight,
             .texel = all_int(number * texels) + (others & (other - number) * texels)};
  if (has_slab(field)) {
    one = field->through[number], two = field->through[other];
    s.through_x = choose(others, all(two[0]), all(one[0]));
    s.through_y = choose(others, all(two[1]), all(one[1]));
  }
  return s;
}

/* The four slices around the rays of eight texels. */
static void look_around(const depth_field *field, const depth_rays *rays,
                        const uint8_t texels[LANES], bundle *b, sight s[4]) {
  i8 k = load_c8(texels), cell;
  b->x = rays->x + field->texel_u * to_float(k & 7);
  b->y = rays->y + field->texel_v * to_float(k >> 3);
  b->qx = pick(rays->qx, texels), b->qy = pick(rays->qy, texels);
  f8 f = pick(rays->f, texels), g = pick(rays->g, texels);
  if (has_slab(field)) b->x -= pick(rays->through_x, texels), b->y -= pick(rays->through_y, texels);
  for (int l = 0; l < LANES; l++) cell[l] = rays->cell[texels[l]];
  if (is_curved(field)) frames_at(field, &b->x, &b->y, &b->at);
  i8 missing = all_int(0);
  const bool alike = !mask_bits(cell != all_int(cell[0]));
  for (int c = 0; c < 4; c++) {
    f8 along_s = c & 1 ? f : 1.0f - f, along_t = c & 2 ? g : 1.0f - g;
    f8 weight = along_s * along_t + LEAST_WEIGHT;
    i8 number = slice_of(field, cell, c);
    s[c] = alike ? sight_of_one(field, b, number[0], weight) : sight_of(field, b, number, weight);
    missing |= s[c].dx != s[c].dx;
  }
  if (mask_bits(missing)) stand_in(field, &cell, s, 4);
}

/* ---- Where they see a height -------------------------------------------------------------------
 */

/* Where the slice shows texel (x, y) of the light. */
INLINE reading find(const depth_field *field, const sight *s, f8 x, f8 y) {
  const depth_pages *p = &field->pages;
  reading r;
  if (!FLAT && p->wrap_u) {
    f8 round = all((float)p->u_count);
    x = choose(x < all(-0.5f), x + round, choose(x >= round - 0.5f, x - round, x));
  }
  f8 held_x = smaller(larger(x, all(0)), all((float)(p->u_count - 1)));
  f8 held_y = smaller(larger(y, all(0)), all((float)(p->v_count - 1)));
  r.inside = larger(magnitude(held_x - x), magnitude(held_y - y)) <= all(1);
  i8 i = to_int(held_x * (float)SPLIT), j = to_int(held_y * (float)SPLIT);
  r.fx = i & (SPLIT - 1), r.fy = j & (SPLIT - 1);
  /* 81 (block_u_count (j / 8) + i / 8) + 9 (j % 8) + i % 8, of whole texels */
  r.texel = s->texel + (j >> 10) * (int32_t)(PAGE_TEXELS * p->block_u_count - 8 * PAGE_ROW_TEXELS) +
            (i >> 10) * (PAGE_TEXELS - 8) + (j >> 7) * PAGE_ROW_TEXELS + (i >> 7);
  return r;
}

INLINE f8 height_of(const depth_field *field, f8 code) {
  return field->unit * code / (256.0f - code);
}

/* What a slab's side mirrors is seen on past the side as if that were not there: the ray and what a
 * slice shows have to leave on the same side of all edges, or one sees the thing and the other its
 * mirror image. */
INLINE i8 leave_alike(f8 at, f8 right, uint32_t count) {
  enum { MOST_SIDES = 1024 /* that are passed; so that truncating rounds down */ };
  const float part = 1.0f / (float)count;
  f8 left_at = (at + 0.5f) * part + (float)MOST_SIDES;
  return to_int(left_at) == to_int(left_at + right * part);
}

/* Where a slice sees, of a flat surface, what lies right_u, right_v from where the ray meets the
 * tangent plane. */
INLINE reading see_flat(const depth_field *field, const bundle *b, const sight *s, f8 right_u,
                        f8 right_v) {
  if (!has_slab(field)) return find(field, s, b->x + right_u, b->y + right_v);
  reading r = find(field, s, b->x + right_u + s->through_x, b->y + right_v + s->through_y);
  r.inside &= leave_alike(b->x, right_u, field->pages.u_count) &
              leave_alike(b->y, right_v, field->pages.v_count);
  return r;
}

/* The same of a curved one, from texel to texel, by Newton's method: what one slice sees through a
 * ripple lies beyond the next one's. Of all slices at once, so that the frames that one needs come
 * while others step. */
static __attribute__((noinline)) void see_curved(const depth_field *field, const bundle *b,
                                                 const sight *s, int count, const f8 *height,
                                                 f8 *expected, reading *at) {
  const place8 begin = {-*height * b->qx, -*height * b->qy, *height};
  meeting meetings[4];
  f8 point[3];
  unsigned going = 0;
  for (int k = 0; k < 3; k++)
    point[k] = b->at.position[k] + begin.u * b->at.tangent_u[k] + begin.v * b->at.tangent_v[k] +
               begin.height * b->at.normal[k];
  for (int k = 0; k < count; k++) {
    meeting *m = &meetings[k];
    m->q_u = b->qx + s[k].dx, m->q_v = b->qy + s[k].dy;
    m->x = b->x, m->y = b->y, m->moving = all_int(-1);
    step_meeting(m, &b->at, b->x, b->y, &begin);
    going |= (unsigned)(mask_bits(m->moving) != 0) << k;
  }
  for (int i = 0; i < MEET_STEPS && going; i++) {
    for (unsigned left = going; left; left &= left - 1) {
      meeting *m = &meetings[__builtin_ctz(left)];
      m->nearest = nearest_to(field, m->x, m->y);
      prefetch_frames(field->frames, m->nearest.texel);
    }
    for (unsigned left = going; left; left &= left - 1) {
      meeting *m = &meetings[__builtin_ctz(left)];
      frame8 next;
      load_frames(field->frames, m->nearest.texel, &next);
      const place8 there = place_in(&next, point);
      step_meeting(m, &next, m->x - m->nearest.e_u, m->y - m->nearest.e_v, &there);
      if (!mask_bits(m->moving)) going ^= left & -left;
    }
  }
  for (int k = 0; k < count; k++) {
    const meeting *m = &meetings[k];
    f8 there = larger(m->expected, all(0));
    expected[k] = 256.0f * there / (field->unit + there);
    at[k] = find(field, &s[k], m->x, m->y);
    at[k].inside &= ~m->moving;
  }
}

/* Where slices see what the ray meets at a height, and the codes that they should see there. */
INLINE void see(const depth_field *field, const bundle *b, const sight *s, int count, f8 code,
                f8 *expected, reading *at) {
  const f8 h = height_of(field, code);
  if (is_curved(field)) {
    see_curved(field, b, s, count, &h, expected, at);
    return;
  }
  for (int k = 0; k < count; k++) {
    at[k] = see_flat(field, b, &s[k], h * s[k].dx, h * s[k].dy);
    expected[k] = code;
  }
}

/* ---- What they say of it -----------------------------------------------------------------------
 */

/* In codes, of the tolerance in heights (depth_kernel.h). */
INLINE f8 tolerance(f8 code) {
  f8 left = 1.0f - code * (1.0f / 256);
  return left * (256 * TOLERANCE_UNITS * left + TOLERANCE_SHARE * code);
}

/* Of the tolerance: a guess this near is not looked at again. */
#define MOVED_SHARE 0.5f

/* 1 for the same height, 0 beyond twice the tolerance. */
INLINE f8 agreement(f8 off) {
  f8 a = larger(1.0f - 0.25f * off * off, all(0));
  return a * a;
}

/* What a slice sees there, less what it should. */
INLINE f8 look_from(depth_field *field, const bundle *b, const sight *s, f8 code, reading *at) {
  f8 expected;
  see(field, b, s, 1, code, &expected, at);
  return look(field, at) - expected;
}

/* What a slice says of a height: the weight with which it sees a thing there, and the score, less
 * than 0 where it looks through it. */
INLINE f8 witness(const sight *s, f8 off, f8 scale, i8 inside, f8 *score) {
  f8 weight = choose(inside, s->weight, all(0)), agreeing = weight * agreement(off * scale);
  *score = choose(off * scale > all(2), -weight, agreeing);
  return agreeing;
}

/* What the four slices around say of a height in each lane. */
typedef struct {
  f8 code;
  f8 score;  /* weight of those that see a thing there, less that of those that look through it */
  f8 agreed; /* weight of the former */
  f8 weight[4];
  reading at[4];
} verdict;

static void judge(depth_field *field, const bundle *b, const sight s[4], const f8 *code,
                  verdict *v) {
  f8 scale = 1.0f / tolerance(*code), score, seeing = all(0), expected[4];
  v->code = *code, v->score = all(0), v->agreed = all(0);
  see(field, b, s, 4, *code, expected, v->at);
  for (int k = 0; k < 4; k++) {
    f8 off = look(field, &v->at[k]) - expected[k];
    v->weight[k] = witness(&s[k], off, scale, v->at[k].inside, &score);
    v->agreed += v->weight[k], v->score += score;
    seeing += choose(v->at[k].inside, s[k].weight, all(0));
  }
  v->score /= larger(seeing, all(LEAST_SEEING));
}

/* Takes b's lanes of the mask over into a. */
static void take(verdict *a, const verdict *b, const i8 *mask) {
  a->code = choose(*mask, b->code, a->code);
  a->agreed = choose(*mask, b->agreed, a->agreed);
  a->score = choose(*mask, b->score, a->score);
  for (int k = 0; k < 4; k++) {
    a->weight[k] = choose(*mask, b->weight[k], a->weight[k]);
    a->at[k].fx = choose_int(*mask, b->at[k].fx, a->at[k].fx);
    a->at[k].fy = choose_int(*mask, b->at[k].fy, a->at[k].fy);
    a->at[k].texel = choose_int(*mask, b->at[k].texel, a->at[k].texel);
  }
}

#endif
