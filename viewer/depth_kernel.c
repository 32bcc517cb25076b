/* Compiled four times: for any processor, and, with -mavx2 -mf16c, for those that have that; and
 * each of them for any surface, and, with -DFLAT=1, for flat mirrors. The vectors are the
 * compiler's own, so that both processors do the same operations in the same order.
 *
 * Here are a block's rays, and the mix of eight texels from four slices and of one from sixteen.
 * The headers below are parts of this file, which no other includes. They stand on more of them:
 * depth_lanes.h (eight numbers), depth_sample.h (four texels of a slice), depth_reading.h (a place
 * in a slice) and depth_curved.h (a curved surface). */
#include "depth_kernel.h"

#include <math.h>
#include <string.h>

#include "depth_cover.h"
#include "depth_remember.h"
#include "depth_sight.h"
#include "depth_steady.h"

#if defined(__AVX2__) && FLAT
#define KERNEL depth_kernel_avx2_flat
#elif defined(__AVX2__)
#define KERNEL depth_kernel_avx2
#elif FLAT
#define KERNEL depth_kernel_plain_flat
#else
#define KERNEL depth_kernel_plain
#endif

/* ---- Rays --------------------------------------------------------------------------------------
 */

/* A hair inside the circle, as in resample.c, but n must stay well above 0 for slopes. */
#define RIM 0.9997f

static void place(const depth_field *field, uint32_t block_u, uint32_t block_v,
                  const block_directions *directions, depth_rays *rays) {
  const float s_count = (float)field->pages.s_count, t_count = (float)field->pages.t_count;
  const float *scale = field->scale;
  const f8 i_last = all(s_count > 1 ? s_count - 2 : 0), j_last = all(t_count > 1 ? t_count - 2 : 0);
  rays->x = ((float)(8 * block_u) + 0.5f) * field->texel_u - 0.5f;
  rays->y = ((float)(8 * block_v) + 0.5f) * field->texel_v - 0.5f;
  for (int row = 0; row < 64; row += LANES) {
    f8 s = 2.0f * load(directions->s + row) - 1.0f, t = 2.0f * load(directions->t + row) - 1.0f;
    s = choose(magnitude(s) < all(1e9f), s, all(0)); /* NaN too */
    t = choose(magnitude(t) < all(1e9f), t, all(0));
    f8 radius_2 = s * s + t * t;
    i8 beyond = radius_2 > all(RIM * RIM);
    if (mask_bits(beyond)) {
      f8 pull = choose(beyond, RIM / root(radius_2), all(1));
      s *= pull, t *= pull;
    }
    f8 slope = 1.0f / root(1.0f - s * s - t * t);
    store(rays->qx + row, (scale[0] * s + scale[1] * t) * slope);
    store(rays->qy + row, (scale[2] * s + scale[3] * t) * slope);
    if (has_slab(field)) {
      const slf_slab *slab = &field->slab;
      f8 inside = slab->thickness / root(slab->ior * slab->ior - s * s - t * t);
      store(rays->through_x + row, (scale[0] * s + scale[1] * t) * inside);
      store(rays->through_y + row, (scale[2] * s + scale[3] * t) * inside);
    }
    f8 i = (0.5f * s_count) * s + (0.5f * s_count - 0.5f);
    f8 j = (0.5f * t_count) * t + (0.5f * t_count - 0.5f);
    i = smaller(larger(i, all(0)), all(s_count - 1));
    j = smaller(larger(j, all(0)), all(t_count - 1));
    i8 i0 = to_int(smaller(i, i_last)), j0 = to_int(smaller(j, j_last));
    i8 cell = i0 * (int32_t)(field->pages.t_count + 1) + j0;
    memcpy(rays->cell + row, &cell, sizeof cell);
    store(rays->f + row, i - to_float(i0)), store(rays->g + row, j - to_float(j0));
    store(rays->code + row, all(-1)), store(rays->score + row, all(0));
  }
}

/* ---- Mixing ------------------------------------------------------------------------------------
 */

/* What the slices that agree show of one thing. */
INLINE sample light_of_one(depth_field *field, const verdict *v) {
  sample sum = {{{0}}};
  i8 weights[4];
  f8 total = all(0);
  for (int k = 0; k < 4; k++) {
    weights[k] = weights_of_one(field, &v->at[k]);
    total += v->weight[k] * sum_of_four(weights[k]);
  }
  const f8 unit = root_unit(total);
  for (int k = 0; k < 4; k++) add_reading(field, &v->at[k], weights[k], v->weight[k] * unit, &sum);
  square(&sum, all_int(WHOLE));
  return sum;
}

/* Keeps what lanes of the mask were mixed from, the first one of each texel; returns their
 * texels. */
static uint64_t keep(depth_rays *rays, const depth_guess *guess, const verdict *v,
                     const sample *sum, unsigned mask) {
  float codes[LANES], scores[LANES];
  uint16_t rgba[LANES][4];
  uint64_t mixed = 0;
  put(sum, rgba);
  store(codes, v->code), store(scores, v->score);
  for (mask &= (1u << guess->count) - 1; mask; mask &= mask - 1) {
    int l = __builtin_ctz(mask);
    uint8_t k = guess->texels[l];
    if (mixed >> k & 1) continue;
    mixed |= 1ull << k;
    rays->code[k] = codes[l], rays->score[k] = scores[l];
    memcpy(rays->rgba[k], rgba[l], sizeof rgba[l]);
  }
  return mixed;
}

/* Mixes the lanes of the mask, the first one of each texel; returns their texels. */
static uint64_t write(depth_field *field, depth_rays *rays, const depth_guess *guess,
                      const verdict *v, unsigned mask) {
  if (!(mask & ((1u << guess->count) - 1))) return 0;
  const sample light = light_of_one(field, v);
  return keep(rays, guess, v, &light, mask);
}

/* From a guess to the height on which the ray and what a slice sees meet, by a secant; what is seen
 * there where there is an edge. Settled lanes are there already. */
static f8 meet(depth_field *field, const bundle *b, const sight *s, f8 guess) {
  reading at;
  f8 off = look_from(field, b, s, guess, &at);
  i8 settled = magnitude(off) < 0.2f * tolerance(guess);
  if (!mask_bits(~settled)) return guess;
  f8 next = smaller(larger(guess + off, all(0)), all(255)), step = next - guess;
  f8 next_off = look_from(field, b, s, next, &at), fall = off - next_off;
  i8 steady = (magnitude(fall) > 0.25f * magnitude(step)) & (magnitude(next_off) < all(EDGE_CODES));
  f8 code = choose(steady, guess + off * step / choose(steady, fall, all(1)), next + next_off);
  code = smaller(larger(code, all(0)), all(255));
  return choose(settled, guess, code);
}

static uint64_t mix(depth_field *field, depth_rays *rays, const depth_guess *guess_of) {
  const f8 guess = load(guess_of->codes), wanted = load(guess_of->wanted);
  bundle b;
  sight s[4];
  verdict v;
  look_around(field, rays, guess_of->texels, &b, s);
  /* The heaviest slice looks most nearly along the ray. */
  sight first = s[0];
  for (int k = 1; k < 4; k++) {
    i8 heavier = s[k].weight > first.weight;
    first.dx = choose(heavier, s[k].dx, first.dx), first.dy = choose(heavier, s[k].dy, first.dy);
    first.through_x = choose(heavier, s[k].through_x, first.through_x);
    first.through_y = choose(heavier, s[k].through_y, first.through_y);
    first.weight = choose(heavier, s[k].weight, first.weight);
    first.texel = choose_int(heavier, s[k].texel, first.texel);
  }
  f8 code = meet(field, &b, &first, guess);
  /* It may see something else than the ray does. */
  code = choose(magnitude(code - guess) < 4.0f * tolerance(guess), code, guess);
  judge(field, &b, s, &code, &v);
  i8 good = v.score > wanted;
  if (mask_bits(~good & (magnitude(code - guess) > MOVED_SHARE * tolerance(guess)))) {
    verdict unmoved;
    judge(field, &b, s, &guess, &unmoved);
    i8 better = ~good & (unmoved.score > v.score);
    take(&v, &unmoved, &better);
    good = v.score > wanted;
  }
  v.score = larger(v.score, wanted + SCORE_SLACK);
  return write(field, rays, guess_of, &v, mask_bits(good));
}

/* The paper's mix, at the texels themselves. */
static void mix_four_tap(depth_field *field, depth_rays *rays, const depth_guess *guess) {
  bundle b;
  sight s[4];
  const verdict none = {.code = all(0), .score = all(0)};
  sample sum = {{{0}}};
  f8 total = all(0);
  look_around(field, rays, guess->texels, &b, s);
  if (has_slab(field))
    b.x += pick(rays->through_x, guess->texels), b.y += pick(rays->through_y, guess->texels);
  for (int k = 0; k < 4; k++) total += s[k].weight;
  for (int k = 0; k < 4; k++) {
    const reading at = find(field, &s[k], b.x, b.y);
    add_light(field, &at, s[k].weight * share_unit(total), &sum);
  }
  keep(rays, guess, &none, &sum, (1u << LANES) - 1);
}

/* ---- Without a guess ---------------------------------------------------------------------------
 */

/* Where the ray and what a slice sees meet: along the ray the point at height h is seen at p + h d.
 * As long as the slice sees something higher there, the point is in the open; where it sees
 * something lower, the point is behind that. From the open to behind in a step without an edge is a
 * hit. Codes, below 0 for none. */
static f8 follow(depth_field *field, const bundle *b, const sight *s) {
  f8 d = larger(larger(magnitude(s->dx), magnitude(s->dy)), all(1e-3f));
  f8 step = (float)STEP_TEXELS / d, h = all(0), met = all(-1), last_open = all(1),
     last_code = all(0);
  i8 going = ((float)MAX_STEPS * step >= LEAST_REACH * field->unit) & (s->weight >= LEAST_WITNESS);
  i8 hidden = all_int(0); /* steps since it was in the open */
  for (int i = 0; i < MAX_STEPS && mask_bits(going); i++) {
    reading at = see_flat(field, b, s, h * s->dx, h * s->dy);
    f8 code = look(field, &at), seen = height_of(field, code), open = seen - h;
    i8 hit =
        (open <= all(0)) & (last_open > all(0)) & (magnitude(code - last_code) <= all(EDGE_CODES));
    f8 there = h - step * open / (open - last_open);
    if (i == 0) hit = open <= all(0), there = seen;
    /* Slices that look almost along the ray see what it meets at once. */
    i8 close = ~hit & (d * magnitude(open) < all(0.5f));
    going &= at.inside;
    met = choose(going & (hit | close), choose(hit, there, seen), met);
    hidden = (hidden + 1) & (open <= all(0));
    going &= ~(hit | close) & (hidden < MAX_HIDDEN_STEPS);
    last_open = open, last_code = code, h += step;
  }
  return choose(met < all(0), all(-1), 256.0f * met / (field->unit + met));
}

/* On a curved surface slices see the same thing close to each other: from what the slice sees at
 * the texel itself. */
static f8 follow_curved(depth_field *field, const bundle *b, const sight *s) {
  f8 code = all(0), met = all(-1);
  i8 going = s->weight > all(0);
  for (int i = 0; i <= CURVED_STEPS && mask_bits(going); i++) {
    reading at;
    f8 off = look_from(field, b, s, code, &at);
    going &= at.inside;
    i8 there = going & (magnitude(off) < 0.3f * tolerance(code));
    if (i > 0) met = choose(there, code, met), going &= ~there;
    going &= code + off >= all(0);
    code = smaller(larger(code + off, all(0)), all(255));
  }
  return met;
}

INLINE f8 follow_any(depth_field *field, const bundle *b, const sight *s) {
  return is_curved(field) ? follow_curved(field, b, s) : follow(field, b, s);
}

/* The lowest height that the slices see a thing at, by a share of what the best is judged, which is
 * the score. What is behind a thing may be in sight of all slices around, past it on every side. */
static uint64_t seek(depth_field *field, depth_rays *rays, const depth_guess *guess,
                     unsigned slices) {
  bundle b;
  sight s[4];
  verdict v[5], lowest;
  const f8 known = load(guess->codes);
  f8 best = all(0);
  int count = 0;
  look_around(field, rays, guess->texels, &b, s);
  for (int k = 0; k <= 4; k++) {
    if (!(slices >> k & 1)) continue;
    f8 code = k < 4 ? follow_any(field, &b, &s[k]) : known;
    for (int l = 0; l < LANES && k < 4; l++) rays->met[guess->texels[l]][k] = code[l];
    i8 none = code < all(0);
    code = larger(code, all(0));
    verdict *now = &v[count++];
    judge(field, &b, s, &code, now);
    now->score = choose(none, all(-1), now->score);
    best = larger(best, now->score);
  }
  lowest = v[0];
  lowest.code = all(256);
  for (int k = 0; k < count; k++) {
    i8 lower = (v[k].score >= LOWER_SHARE * best) & (v[k].code < lowest.code);
    take(&lowest, &v[k], &lower);
  }
  lowest.score = best;
  i8 good = (best >= load(guess->wanted)) & (lowest.agreed > all(1e-5f));
  return write(field, rays, guess, &lowest, mask_bits(good));
}

/* ---- One texel and many slices -----------------------------------------------------------------
 */

/* A ray in all lanes, and a slice in each: lanes beyond the count repeat one, without weight. */
enum { MOST_SIGHTS = 16 };
typedef struct {
  bundle b;
  sight s[MOST_SIGHTS / LANES];
  int group_count;
  f8 weight[MOST_SIGHTS / LANES]; /* with which each sees the height judged last */
  reading at[MOST_SIGHTS / LANES];
  float moved; /* as in view, depth_steady.h */
} fan;

/* Where they lie in the cells of (S,T), along S and along T, and how much narrower than two cells
 * their tents are: the four around, the corners of sixteen, and the others. */
static const f8 fan_places[MOST_SIGHTS / LANES][3] = {
    {{0, 1, 0, 1, -1, 2, -1, 2}, {0, 0, 1, 1, -1, -1, 2, 2}, {1, 1, 1, 1, 0.5f, 0.5f, 0.5f, 0.5f}},
    {{0, 1, -1, 2, -1, 2, 0, 1},
     {-1, -1, 0, 0, 1, 1, 2, 2},
     {0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f}}};

/* The slices within `reach` of the ray, the four around weighed as they are, those beyond by a tent
 * twice as wide. One that exists stands in for those that do not, and counts for nothing. */
static void open_fan(const depth_field *field, const depth_rays *rays, uint32_t texel, int reach,
                     fan *a) {
  const int32_t s_count = (int32_t)field->pages.s_count, t_count = (int32_t)field->pages.t_count;
  const int32_t cell = rays->cell[texel], i0 = cell / (t_count + 1), j0 = cell % (t_count + 1);
  i8 number[MOST_SIGHTS / LANES], exists[MOST_SIGHTS / LANES];
  int32_t any = 0;
  a->group_count = reach == 1 ? 1 : MOST_SIGHTS / LANES;
  a->b.x = all(rays->x + field->texel_u * (float)(texel % 8));
  a->b.y = all(rays->y + field->texel_v * (float)(texel / 8));
  a->b.qx = all(rays->qx[texel]), a->b.qy = all(rays->qy[texel]);
  if (has_slab(field)) a->b.x -= rays->through_x[texel], a->b.y -= rays->through_y[texel];
  if (is_curved(field)) frames_at(field, &a->b.x, &a->b.y, &a->b.at);
  for (int g = 0; g < a->group_count; g++) {
    const f8 *at = fan_places[g], narrow = at[2];
    i8 i = i0 + to_int(at[0]), j = j0 + to_int(at[1]);
    exists[g] = (i >= 0) & (j >= 0) & (i < s_count) & (j < t_count);
    if (reach == 1) exists[g] &= narrow == all(1);
    number[g] = (i * (t_count + 1) + j) & exists[g];
    f8 along_s = larger(1.0f - narrow * magnitude(at[0] - rays->f[texel]), all(0));
    f8 along_t = larger(1.0f - narrow * magnitude(at[1] - rays->g[texel]), all(0));
    a->s[g] = sight_of(field, &a->b, number[g], along_s * along_t * narrow + LEAST_WEIGHT);
    exists[g] &= a->s[g].dx == a->s[g].dx;
    const unsigned some = mask_bits(exists[g]);
    if (some) any = number[g][__builtin_ctz(some)];
  }
  for (int g = 0; g < a->group_count; g++) {
    sight *s = &a->s[g];
    if (!mask_bits(~exists[g])) continue;
    const sight other = sight_of_one(field, &a->b, any, all(0));
    s->dx = choose(exists[g], s->dx, other.dx), s->dy = choose(exists[g], s->dy, other.dy);
    s->through_x = choose(exists[g], s->through_x, other.through_x);
    s->through_y = choose(exists[g], s->through_y, other.through_y);
    s->weight = choose(exists[g], s->weight, all(0));
    s->texel = (s->texel & exists[g]) | (other.texel & ~exists[g]);
  }
}

static float judge_fan(depth_field *field, fan *a, float code) {
  f8 scale = 1.0f / tolerance(all(code)), sum = all(0), moved = all(0), near = all(0), score;
  f8 expected[MOST_SIGHTS / LANES];
  see(field, &a->b, a->s, a->group_count, all(code), expected, a->at);
  for (int g = 0; g < a->group_count; g++) {
    f8 off = look(field, &a->at[g]) - expected[g];
    a->weight[g] = witness(&a->s[g], off, scale, a->at[g].inside, &score);
    sum += score;
    f8 weight = choose((magnitude(off * scale) < all(4)) & a->at[g].inside, a->s[g].weight, all(0));
    moved += weight * off, near += weight;
  }
  a->moved = sum_of(moved) / (sum_of(near) + 1e-6f);
  return sum_of(sum);
}

/* Mixes where the slices see the height judged last. */
static bool mix_fan(depth_field *field, const fan *a, depth_rays *rays, uint32_t texel, float code,
                    float score) {
  sample sum = {{{0}}};
  uint16_t of_lanes[LANES][4];
  i8 weights[MOST_SIGHTS / LANES];
  f8 weight = all(0), total = all(0);
  for (int g = 0; g < a->group_count; g++) weight += a->weight[g];
  if (!(sum_of(weight) > 1e-5f)) return false;
  for (int g = 0; g < a->group_count; g++) {
    weights[g] = weights_of_one(field, &a->at[g]);
    total += a->weight[g] * sum_of_four(weights[g]);
  }
  const f8 unit = root_unit(all(sum_of(total)));
  for (int g = 0; g < a->group_count; g++)
    add_reading(field, &a->at[g], weights[g], a->weight[g] * unit, &sum);
  join_lanes(&sum);
  square(&sum, all_int(WHOLE));
  put(&sum, of_lanes);
  memcpy(rays->rgba[texel], of_lanes[0], sizeof of_lanes[0]);
  rays->code[texel] = code, rays->score[texel] = score;
  return true;
}

static bool mix_wide(depth_field *field, depth_rays *rays, uint32_t texel, float code,
                     float wanted) {
  fan a;
  open_fan(field, rays, texel, 2, &a);
  float score = judge_fan(field, &a, code);
  if (fabsf(a.moved) > MOVED_SHARE * tolerance(all(code))[0]) {
    code += a.moved;
    code = code < 0 ? 0 : code > 255 ? 255 : code;
    score = judge_fan(field, &a, code);
  }
  return score > wanted && mix_fan(field, &a, rays, texel, code, score);
}

static bool seek_alone(depth_field *field, depth_rays *rays, uint32_t texel, int reach,
                       float wanted) {
  fan a;
  float heights[MOST_SIGHTS], codes[MOST_SIGHTS], scores[MOST_SIGHTS], best = -1, lowest = 256;
  int count = 0;
  open_fan(field, rays, texel, reach, &a);
  if (reach == 1) {
    store(heights, follow_any(field, &a.b, &a.s[0]));
    memcpy(rays->met[texel], heights, sizeof rays->met[texel]);
  } else {
    store(heights, all(-1));
    memcpy(heights, rays->met[texel], sizeof rays->met[texel]);
    store(heights + LANES, follow_any(field, &a.b, &a.s[1]));
  }
  for (int l = 0; l < LANES * a.group_count; l++) {
    bool known = heights[l] < 0;
    const float near = 0.3f * tolerance(all(heights[l]))[0];
    for (int i = 0; i < count && !known; i++) known = fabsf(codes[i] - heights[l]) < near;
    if (known) continue;
    codes[count] = heights[l];
    scores[count] = judge_fan(field, &a, heights[l]);
    if (scores[count] > best) best = scores[count];
    count++;
  }
  if (!(best >= wanted)) return false;
  for (int i = 0; i < count; i++)
    if (scores[i] >= LOWER_SHARE * best && codes[i] < lowest) lowest = codes[i];
  judge_fan(field, &a, lowest);
  return mix_fan(field, &a, rays, texel, lowest, best);
}

const depth_kernel KERNEL = {place,      find_steady, find_kind,  mix,   mix_four_tap, seek,
                             seek_alone, mix_wide,    mix_steady, cover, lay_over,     remember};
