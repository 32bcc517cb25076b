#include "depth_mix.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cpu.h"
#include "depth_kernel.h"
#include "half.h"

struct depth_mixer {
  depth_field field;
  const depth_kernel *kernel;
  uint32_t block_u_count, block_v_count; /* of what is mixed */
  depth_memory *last;                    /* of each block */
  depth_rim *rims, *last_rims; /* of each block, now and before this frame, and one of none */
  uint8_t *visits;             /* of each block */
  depth_mix_counts *counts;    /* of each row of blocks */
};

bool flat_texel_scale(const slf_mesh *mesh, uint32_t u_count, uint32_t v_count, float scale[4]) {
  const slf_vertex *v0 = &mesh->vertices[mesh->triangles[0]];
  const slf_vertex *v1 = &mesh->vertices[mesh->triangles[1]];
  const slf_vertex *v2 = &mesh->vertices[mesh->triangles[2]];
  float u1 = v1->u - v0->u, w1 = v1->v - v0->v, u2 = v2->u - v0->u, w2 = v2->v - v0->v;
  float det = u1 * w2 - u2 * w1, pu[3], pv[3], a = 0, b = 0, c = 0, d = 0, largest = 0;
  if (det == 0) return false;
  for (int k = 0; k < 3; k++) {
    float d1 = v1->position[k] - v0->position[k], d2 = v2->position[k] - v0->position[k];
    pu[k] = (d1 * w2 - d2 * w1) / det;
    pv[k] = (d2 * u1 - d1 * u2) / det;
    a += pu[k] * v0->tangent_u[k];
    b += pv[k] * v0->tangent_u[k];
    c += pu[k] * v0->tangent_v[k];
    d += pv[k] * v0->tangent_v[k];
    largest = fmaxf(largest, fabsf(pu[k]) + fabsf(pv[k]));
  }
  for (uint32_t i = 0; i < mesh->vertex_count; i++) {
    const slf_vertex *v = &mesh->vertices[i];
    for (int k = 0; k < 3; k++) {
      float p = v0->position[k] + pu[k] * (v->u - v0->u) + pv[k] * (v->v - v0->v);
      if (!(fabsf(p - v->position[k]) < 1e-4f * largest)) return false;
      if (!(fabsf(v->tangent_u[k] - v0->tangent_u[k]) < 1e-4f)) return false;
      if (!(fabsf(v->normal[k] - v0->normal[k]) < 1e-4f)) return false;
    }
  }
  float inverse = 1 / (a * d - b * c);
  scale[0] = d * inverse * (float)u_count;
  scale[1] = -b * inverse * (float)u_count;
  scale[2] = -c * inverse * (float)v_count;
  scale[3] = a * inverse * (float)v_count;
  return true;
}

/* ---- Blocks of texels --------------------------------------------------------------------------
 */

/* What was found for a texel last time is where it is looked for next. Texels with some slices that
 * disagree forget every 32nd frame, so that nothing wrong stays: those of a block at once, as
 * eight are followed at the cost of one. What is forgotten is judged where it was, too, and follows
 * two of the four slices around, the other two the next time; all of them where that gives nothing.
 * Those that the four slices around did not serve try their neighbours' heights every second frame;
 * those that no slice served follow the four along the ray every 16th, and forget that every 64th.
 * Blocks take turns. */
enum {
  FORGET = 32,
  FORGET_UNSEEN = 64,
  FOLLOW = 16,
  TRY = 2,
  TURN = 13 /* odd: all turns occur */
};

/* Halves of ALL_SLICES. */
enum { FIRST_AND_LAST = 0x9, TWO_BETWEEN = 0x6 };
/* Texels that are followed one by one. */
enum { FEW = 3 };

typedef struct {
  bool try, follow; /* this time */
  /* Of what has been forgotten: a mask as of depth_kernel's seek; 0 where nothing was known. */
  unsigned slices;
} patience;

static patience recall(const depth_mixer *m, size_t block, depth_memory *last) {
  const uint32_t turn = m->visits[block] + TURN * (uint32_t)block;
  *last = m->last[block];
  for (uint32_t k = 0; k < 64 && turn % FORGET == 0; k++)
    if (last->score[k] < (int)(100 * ALL_AGREE) &&
        (last->kind[k] != SEEN_NOT || turn % FORGET_UNSEEN == 0))
      last->kind[k] = SEEN_UNKNOWN;
  const unsigned slices = turn / FORGET % 2 ? FIRST_AND_LAST : TWO_BETWEEN;
  return (patience){.try = turn % TRY == 0,
                    .follow = turn % FOLLOW == 0,
                    .slices = m->visits[block] ? slices | GUESS_ITSELF : 0};
}

/* A little less than last time. What was wanted stays wanted until the next search: scores do not
 * wear off frame by frame. */
static float wanted_score(const depth_memory *last, uint32_t k) {
  float least = last->kind[k] == SEEN_WIDE ? LEAST_WIDE : LEAST_NEAR;
  float wanted = 0.01f * (float)last->score[k] - SCORE_SLACK;
  return wanted < least ? least : wanted < ALL_AGREE ? wanted : ALL_AGREE;
}

/* Where a guess comes from: the texel itself or its neighbours, last time. What moves, moves over a
 * texel from there. */
typedef enum {
  GUESS_AGAIN,
  GUESS_RIGHT,
  GUESS_LEFT,
  GUESS_BELOW,
  GUESS_ABOVE,
  GUESS_COUNT
} guess_origin;

/* Steps to a texel's neighbours, in the block. */
static const int8_t steps[GUESS_COUNT] = {0, 1, -1, 8, -8};

/* The texels that have such a neighbour among those of the mask. */
static uint64_t beside(uint64_t mask, guess_origin origin) {
  const uint64_t first_column = 0x0101010101010101u;
  switch (origin) {
  case GUESS_RIGHT:
    return mask >> 1 & ~(first_column << 7);
  case GUESS_LEFT:
    return mask << 1 & ~first_column;
  case GUESS_BELOW:
    return mask >> 8;
  case GUESS_ABOVE:
    return mask << 8;
  default:
    return mask;
  }
}

/* What was found last time, and for which texels the four slices around did, or nothing is
 * known. */
typedef struct {
  const depth_memory *last;
  uint64_t near, unknown;
} memories;

static void guess(const memories *known, uint32_t k, guess_origin origin, float *code,
                  float *wanted) {
  const uint32_t from = (uint32_t)((int)k + steps[origin]);
  *code = (float)known->last->code[from] / 256;
  *wanted = wanted_score(known->last, from);
}

static void add_guess(depth_guess *g, uint32_t texel, float code, float wanted) {
  g->texels[g->count] = (uint8_t)texel, g->codes[g->count] = code, g->wanted[g->count] = wanted;
  g->count++;
}

static void repeat_first(depth_guess *g) {
  for (int l = 1; l < LANES; l++) {
    const int from = l < g->count ? l : 0;
    g->texels[l] = g->texels[from], g->codes[l] = g->codes[from], g->wanted[l] = g->wanted[from];
  }
}

/* Mixes what it can of the texels from guesses of those origins, earlier ones first; returns
 * those. */
static uint64_t mix_guessed(depth_mixer *m, depth_rays *rays, uint64_t texels,
                            const memories *known, guess_origin first, guess_origin after_last) {
  uint64_t mixed = 0, may_guess[GUESS_COUNT], any = 0;
  depth_guess g = {.count = 0};
  for (guess_origin origin = first; origin < after_last; origin++) {
    may_guess[origin] = beside(known->near, origin);
    if (origin != GUESS_AGAIN) may_guess[origin] &= ~known->unknown;
    any |= may_guess[origin];
  }
  for (texels &= any; texels; texels &= texels - 1) {
    const uint32_t k = (uint32_t)__builtin_ctzll(texels);
    for (guess_origin origin = first; origin < after_last && !(mixed >> k & 1); origin++) {
      float code, wanted;
      if (!(may_guess[origin] >> k & 1)) continue;
      guess(known, k, origin, &code, &wanted);
      add_guess(&g, k, code, wanted);
      if (g.count < LANES) continue;
      mixed |= m->kernel->mix(&m->field, rays, &g);
      g.count = 0;
    }
  }
  if (g.count == 0) return mixed;
  repeat_first(&g);
  return mixed | m->kernel->mix(&m->field, rays, &g);
}

/* The same by following those slices along eight rays at once, or all four along one ray where
 * there are few. */
static uint64_t mix_sought(depth_mixer *m, depth_rays *rays, uint64_t texels,
                           const depth_memory *last, unsigned slices) {
  uint64_t mixed = 0;
  while (texels) {
    depth_guess g = {.count = 0};
    for (; texels && g.count < LANES; texels &= texels - 1) {
      const uint32_t k = (uint32_t)__builtin_ctzll(texels);
      add_guess(&g, k, (float)last->code[k] / 256, LEAST_NEAR);
    }
    repeat_first(&g);
    if (g.count > FEW || slices != ALL_SLICES)
      mixed |= m->kernel->seek(&m->field, rays, &g, slices);
    else
      for (int l = 0; l < g.count; l++)
        mixed |= (uint64_t)m->kernel->seek_alone(&m->field, rays, g.texels[l], 1, LEAST_NEAR)
                 << g.texels[l];
  }
  return mixed;
}

static void mix_four_tap(depth_mixer *m, depth_rays *rays, uint64_t texels, uint8_t kinds[64]) {
  while (texels) {
    depth_guess g = {.count = 0};
    for (; texels && g.count < LANES; texels &= texels - 1) {
      const uint32_t k = (uint32_t)__builtin_ctzll(texels);
      kinds[k] = SEEN_NOT;
      add_guess(&g, k, 0, 0);
    }
    repeat_first(&g);
    m->kernel->mix_four_tap(&m->field, rays, &g);
  }
}

/* Mixes what it can of the texels from sixteen slices, as last time; returns those. */
static uint64_t mix_wide(depth_mixer *m, depth_rays *rays, uint64_t texels,
                         const depth_memory *last, uint8_t kinds[64]) {
  uint64_t mixed = 0;
  for (; texels; texels &= texels - 1) {
    const uint32_t k = (uint32_t)__builtin_ctzll(texels);
    if (!m->kernel->mix_wide(&m->field, rays, k, (float)last->code[k] / 256, wanted_score(last, k)))
      continue;
    kinds[k] = SEEN_WIDE;
    mixed |= 1ull << k;
  }
  return mixed;
}

/* Mixes texels that are not steady; returns those that were foretold. Those that the four slices
 * around did not serve last time are mostly taken to be so still. */
static uint64_t mix_rest(depth_mixer *m, depth_rays *rays, uint64_t left, const memories *known,
                         patience p, uint8_t kinds[64]) {
  const depth_memory *last = known->last;
  const uint64_t wide = left & m->kernel->find_kind(last->kind, SEEN_WIDE);
  const uint64_t blind = left & m->kernel->find_kind(last->kind, SEEN_NOT);
  if (!p.try) left &= ~blind & ~mix_wide(m, rays, wide, last, kinds);
  uint64_t foretold = mix_guessed(m, rays, left, known, GUESS_AGAIN, GUESS_RIGHT);
  foretold |= mix_guessed(m, rays, left & ~foretold, known, GUESS_RIGHT, GUESS_COUNT);
  left &= ~foretold;
  if (p.try) left &= ~mix_wide(m, rays, left & wide, last, kinds);
  uint64_t unseen = blind & ~foretold;
  const uint64_t forgotten = left & known->unknown;
  if (p.slices && __builtin_popcountll(forgotten) > FEW)
    left &= ~mix_sought(m, rays, forgotten, last, p.slices);
  if (p.follow) {
    left &= ~mix_sought(m, rays, left, last, ALL_SLICES);
    unseen &= left;
  } else {
    left &= ~mix_sought(m, rays, left & ~blind, last, ALL_SLICES);
  }
  for (left &= ~blind; left; left &= left - 1) {
    const uint32_t k = (uint32_t)__builtin_ctzll(left);
    if (m->kernel->seek_alone(&m->field, rays, k, 2, LEAST_WIDE))
      kinds[k] = SEEN_WIDE;
    else
      unseen |= 1ull << k;
  }
  mix_four_tap(m, rays, unseen, kinds);
  return foretold;
}

static void count_texels(depth_mix_counts *counts, uint64_t mask, uint64_t foretold,
                         const uint8_t kinds[64]) {
  counts->texel_count += (uint64_t)__builtin_popcountll(mask);
  counts->foretold_count += (uint64_t)__builtin_popcountll(foretold);
  for (uint64_t left = mask & ~foretold; left; left &= left - 1) {
    uint8_t kind = kinds[__builtin_ctzll(left)];
    counts->wide_count += kind == SEEN_WIDE;
    counts->four_tap_count += kind == SEEN_NOT;
  }
}

/* The slices that some of the texels read stay longer than others. */
static void use_slices(const depth_pages *p, const depth_rays *rays) {
  int32_t before = -1;
  for (int k = 0; k < 64; k += 21) { /* two corners, and two in between */
    if (rays->cell[k] == before) continue;
    before = rays->cell[k];
    for (int32_t corner = 0; corner < 4; corner++) {
      const int32_t past = corner & 1 ? (int32_t)p->t_count + 1 : 0;
      atomic_store_explicit(&p->slices[before + past + (corner >> 1)].used, p->now,
                            memory_order_relaxed);
    }
  }
}

/* Mixes those that things at heights of those codes cover wholly; returns them. */
static uint64_t mix_covered(depth_mixer *m, depth_rays *rays, uint64_t texels,
                            const uint16_t codes[64], uint64_t *partly) {
  uint64_t mixed = 0;
  while (texels) {
    depth_guess g = {.count = 0};
    for (; texels && g.count < LANES; texels &= texels - 1) {
      const uint32_t k = (uint32_t)__builtin_ctzll(texels);
      add_guess(&g, k, (float)codes[k] / 256, 0);
    }
    repeat_first(&g);
    mixed |= m->kernel->cover(&m->field, rays, &g, partly);
  }
  return mixed;
}

/* Of texels those that show something lower than is beside them, and the codes of its height. */
static uint64_t find_front(const depth_rays *rays, const depth_outline *beside, uint64_t texels,
                           const uint8_t kinds[64], uint16_t codes[64]) {
  uint64_t found = 0;
  for (uint64_t left = texels; left; left &= left - 1) {
    const uint32_t k = (uint32_t)__builtin_ctzll(left);
    codes[k] = (uint16_t)(256 * rays->code[k]);
    if (kinds[k] != SEEN_NOT && codes[k] + 256 * EDGE_CODES < beside->highest[k])
      found |= 1ull << k;
  }
  return found;
}

/* What shows a thing at its edge is covered by it in part only: mixes what is behind, where slices
 * see that; and so what lies beside the thing and no slice served. */
static void mix_behind(depth_mixer *m, depth_rays *rays, const depth_outline *beside,
                       uint8_t kinds[64], uint64_t *partly) {
  uint16_t codes[64];
  const uint64_t unseen = beside->lower & m->kernel->find_kind(kinds, SEEN_NOT);
  uint64_t front = find_front(rays, beside, beside->higher | *partly, kinds, codes), mixed = 0;
  const uint64_t unasked = front & ~*partly;
  if (unasked) front &= ~mix_covered(m, rays, unasked, codes, partly);
  for (uint64_t left = front | unseen; left;) {
    depth_guess g = {.count = 0};
    for (; left && g.count < LANES; left &= left - 1) {
      const uint32_t k = (uint32_t)__builtin_ctzll(left);
      add_guess(&g, k, (float)beside->highest[k] / 256, LEAST_NEAR);
    }
    repeat_first(&g);
    mixed |= m->kernel->mix(&m->field, rays, &g);
  }
  for (uint64_t left = mixed; left; left &= left - 1) kinds[__builtin_ctzll(left)] = SEEN_NEAR;
  for (uint64_t left = (front | unseen) & ~mixed; left; left &= left - 1) {
    const uint32_t k = (uint32_t)__builtin_ctzll(left);
    if (!m->kernel->mix_wide(&m->field, rays, k, (float)beside->highest[k] / 256, LEAST_WIDE))
      continue;
    kinds[k] = SEEN_WIDE;
    mixed |= 1ull << k;
  }
  *partly &= ~front | mixed;
}

/* The rims of the blocks around, before this frame. */
static void find_rims(const depth_mixer *m, uint32_t block_u, uint32_t block_v,
                      const depth_rim *around[4]) {
  const depth_rim *none = &m->last_rims[(size_t)m->block_u_count * m->block_v_count];
  const depth_rim *own = &m->last_rims[(size_t)block_v * m->block_u_count + block_u];
  around[RIM_LEFT] = block_u > 0 ? own - 1 : none;
  around[RIM_RIGHT] = block_u + 1 < m->block_u_count ? own + 1 : none;
  around[RIM_ABOVE] = block_v > 0 ? own - m->block_u_count : none;
  around[RIM_BELOW] = block_v + 1 < m->block_v_count ? own + m->block_u_count : none;
}

/* False, and nothing remembered, if a page was missed. */
static bool mix_block(depth_mixer *m, uint32_t block_u, uint32_t block_v,
                      const block_directions *directions, uint16_t *out, size_t row_nbytes) {
  depth_rays rays;
  depth_memory last;
  uint8_t kinds[64];
  const size_t block = (size_t)block_v * m->block_u_count + block_u;
  const patience p = recall(m, block, &last);
  const memories known = {&last, m->kernel->find_kind(last.kind, SEEN_NEAR),
                          m->kernel->find_kind(last.kind, SEEN_UNKNOWN)};
  depth_outline beside;
  const depth_rim *around[4];
  find_rims(m, block_u, block_v, around);
  uint64_t partly = 0;
  uint64_t steady = m->kernel->find_steady(&last, around, &beside) & directions->mask;
  memset(kinds, SEEN_NEAR, sizeof kinds);
  m->kernel->place(&m->field, block_u, block_v, directions, &rays);
  use_slices(&m->field.pages, &rays);
  uint64_t foretold = m->kernel->mix_steady(&m->field, &rays, &last, steady);
  beside.lower &= directions->mask;
  if (beside.lower) foretold |= mix_covered(m, &rays, beside.lower, beside.lowest, &partly);
  if (m->field.missed) return false;
  if (directions->mask & ~foretold)
    foretold |= mix_rest(m, &rays, directions->mask & ~foretold, &known, p, kinds);
  beside.higher &= directions->mask;
  if (beside.higher | beside.lower) mix_behind(m, &rays, &beside, kinds, &partly);
  if (m->field.missed) return false;
  if (partly) m->kernel->lay_over(&rays, partly);
  for (uint64_t left = ~directions->mask; left; left &= left - 1)
    memset(rays.rgba[__builtin_ctzll(left)], 0, sizeof *rays.rgba);
  count_texels(&m->counts[block_v], directions->mask, foretold, kinds);
  m->visits[block]++;
  m->last[block] = last;
  m->kernel->remember(&rays, kinds, directions->mask, partly, &m->last[block], &m->rims[block]);
  for (int row = 0; row < 8; row++)
    memcpy((uint8_t *)out + (size_t)row * row_nbytes, rays.rgba[8 * row], 8 * sizeof *rays.rgba);
  return true;
}

void depth_mixer_begin_frame(depth_mixer *m) {
  memcpy(m->last_rims, m->rims, (size_t)m->block_u_count * m->block_v_count * sizeof *m->rims);
  m->field.pages.now++;
}

void depth_mix_block(depth_mixer *m, uint32_t block_u, uint32_t block_v,
                     const block_directions *directions, uint16_t *out, size_t row_nbytes) {
  depth_pages_make_room(&m->field.pages);
  m->field.pages.now++;
  mix_block(m, block_u, block_v, directions, out, row_nbytes);
}

bool depth_mix_block_shared(depth_mixer *m, uint32_t block_u, uint32_t block_v,
                            const block_directions *directions, uint16_t *out, size_t row_nbytes) {
  depth_mixer own = *m; /* what is missed is noted there */
  own.field.shared = true;
  return mix_block(&own, block_u, block_v, directions, out, row_nbytes);
}

void depth_mixer_use_kernel(depth_mixer *m, resample_kernel kernel) {
  const bool flat = !m->field.frames && !m->field.through;
  m->kernel = flat ? &depth_kernel_plain_flat : &depth_kernel_plain;
#if defined(__x86_64__)
  if (kernel == RESAMPLE_BEST && cpu_has_avx2_f16c())
    m->kernel = flat ? &depth_kernel_avx2_flat : &depth_kernel_avx2;
#endif
}

/* Of the slices by number: texels that they pass on a unit's height, or on their way through a
 * slab. NULL if memory ran out. */
static float (*find_slopes(const depth_pages *p, const float scale[4], const slf_slab *slab))[2] {
  float(*slopes)[2] = calloc(p->slice_count, sizeof *slopes);
  for (uint32_t number = 0; slopes && number < p->slice_count; number++) {
    const uint32_t i = number / (p->t_count + 1), j = number % (p->t_count + 1);
    double d[3];
    slopes[number][0] = slopes[number][1] = NAN;
    if (i == p->s_count || j == p->t_count || !slf_slice_exists(p->s_count, p->t_count, i, j))
      continue;
    slf_direction((i + 0.5) / p->s_count, (j + 0.5) / p->t_count, SLF_BAKED_N_MIN, d);
    double way =
        slab ? slab->thickness / sqrt((double)slab->ior * slab->ior - 1 + d[2] * d[2]) : 1 / d[2];
    slopes[number][0] = (scale[0] * (float)d[0] + scale[1] * (float)d[1]) * (float)way;
    slopes[number][1] = (scale[2] * (float)d[0] + scale[3] * (float)d[1]) * (float)way;
  }
  return slopes;
}

depth_mixer *depth_mixer_create(const depth_sources *sources, const slf_surface *surface,
                                uint32_t u_count, uint32_t v_count) {
  const slf_layer *reflected = sources->light.layer;
  depth_mixer *m = calloc(1, sizeof *m);
  if (!m) return NULL;
  depth_field *f = &m->field;
  f->texel_u = (float)reflected->u_count / (float)u_count;
  f->texel_v = (float)reflected->v_count / (float)v_count;
  f->sharpen = f->texel_u < 1 ? SHARPEN_FINER : SHARPEN;
  f->unit = sources->heights.layer->height_unit;
  bool wrap_u = surface->flags & SLF_SURFACE_WRAP_U;
  bool flat = flat_texel_scale(&surface->mesh, reflected->u_count, reflected->v_count, f->scale);
  if (!flat) {
    memcpy(f->scale, (float[4]){1, 0, 0, 1}, sizeof f->scale);
    f->frames = depth_frames_create(&surface->mesh, reflected->u_count, reflected->v_count, wrap_u);
  }
  m->block_u_count = (u_count + 7) / 8, m->block_v_count = (v_count + 7) / 8;
  size_t block_count = (size_t)m->block_u_count * m->block_v_count;
  m->last = calloc(block_count, sizeof *m->last);
  m->visits = calloc(block_count, 1);
  m->rims = malloc(block_count * sizeof *m->rims);
  m->last_rims = malloc((block_count + 1) * sizeof *m->rims);
  m->counts = calloc(m->block_v_count, sizeof *m->counts);
  bool is_slab = flat && surface->slab.thickness > 0;
  f->slab = surface->slab;
  if (depth_pages_create(&f->pages, sources)) {
    f->slopes = find_slopes(&f->pages, f->scale, NULL);
    if (is_slab) f->through = find_slopes(&f->pages, f->scale, &f->slab);
  }
  if (!f->slopes || !m->last || !m->rims || !m->last_rims || !m->visits || !m->counts ||
      (!flat && !f->frames) || (is_slab && !f->through)) {
    depth_mixer_free(m);
    return NULL;
  }
  for (size_t block = 0; block < block_count; block++) {
    memset(m->last[block].code, 0xff, sizeof m->last->code); /* NO_CODE */
    memset(m->last[block].front, 0xff, sizeof m->last->front);
  }
  memset(m->rims, 0xff, block_count * sizeof *m->rims); /* NO_CODE */
  memset(m->last_rims, 0xff, (block_count + 1) * sizeof *m->rims);
  f->pages.wrap_u = wrap_u && !flat;
  depth_mixer_use_kernel(m, RESAMPLE_BEST);
  return m;
}

depth_mix_counts depth_mixer_counts(const depth_mixer *m) {
  depth_mix_counts sum = {0};
  for (uint32_t row = 0; row < m->block_v_count; row++) {
    sum.texel_count += m->counts[row].texel_count;
    sum.foretold_count += m->counts[row].foretold_count;
    sum.wide_count += m->counts[row].wide_count;
    sum.four_tap_count += m->counts[row].four_tap_count;
  }
  return sum;
}

void depth_mixer_free(depth_mixer *m) {
  if (!m) return;
  free(m->field.slopes);
  free(m->field.through);
  free(m->field.frames);
  free(m->last);
  free(m->rims);
  free(m->last_rims);
  free(m->visits);
  free(m->counts);
  depth_pages_free(&m->field.pages);
  free(m);
}
