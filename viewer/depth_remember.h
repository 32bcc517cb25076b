/* depth_remember.h - from frame to frame: what is kept of a block's texels, and which of them are
 * steady or lie beside something lower or higher.
 *
 * Part of depth_kernel.c, which alone includes it: once in each of its compilations. */
#ifndef DEPTH_REMEMBER_H
#define DEPTH_REMEMBER_H

#include "depth_lanes.h"

static uint64_t find_kind(const uint8_t kinds[64], uint8_t kind) {
  uint64_t found = 0;
#if defined(__AVX2__)
  for (int k = 0; k < 64; k += 32) {
    __m256i v = _mm256_loadu_si256((const __m256i *)(const void *)(kinds + k));
    v = _mm256_cmpeq_epi8(v, _mm256_set1_epi8((char)kind));
    found |= (uint64_t)(uint32_t)_mm256_movemask_epi8(v) << k;
  }
#else
  for (int k = 0; k < 64; k++) found |= (uint64_t)(kinds[k] == kind) << k;
#endif
  return found;
}

/* 0 where there is none. */
INLINE i8 known_code(i8 code) {
  return code & (code != all_int(NO_CODE));
}

/* A row of numbers one to the left and one to the right, what lies beyond its ends given. */
INLINE void shift_row(i8 row, int32_t left, int32_t right, i8 *before, i8 *after) {
  const i8 ends = {left, right};
  *before = __builtin_shufflevector(row, ends, 8, 0, 1, 2, 3, 4, 5, 6);
  *after = __builtin_shufflevector(row, ends, 1, 2, 3, 4, 5, 6, 7, 9);
}

/* The lowest of the codes of a row and of those beside it. */
INLINE i8 lowest_beside(i8 row, int32_t left, int32_t right, i8 above_and_below) {
  i8 before, after;
  shift_row(row, left, right, &before, &after);
  return lower(lower(row, above_and_below), lower(before, after));
}

/* The highest of them, 0 without any. */
INLINE i8 highest_beside(i8 row, int32_t left, int32_t right, i8 above, i8 below) {
  i8 before, after;
  shift_row(row, left, right, &before, &after);
  return higher(known_code(row), higher(higher(known_code(before), known_code(after)),
                                        higher(known_code(above), known_code(below))));
}

static uint64_t find_steady(const depth_memory *last, const depth_rim *const around[4],
                            depth_outline *beside) {
  const i8 none = all_int(NO_CODE);
  i8 codes[10], lows[10];
  uint64_t served = 0, certain = 0;
  beside->lower = beside->higher = 0;
  codes[0] = load_u16(around[RIM_ABOVE]->codes[RIM_BELOW]);
  codes[9] = load_u16(around[RIM_BELOW]->codes[RIM_ABOVE]);
  lows[0] = load_u16(around[RIM_ABOVE]->lowest[RIM_BELOW]);
  lows[9] = load_u16(around[RIM_BELOW]->lowest[RIM_ABOVE]);
  i8 least = lower(lower(lows[0], lows[9]), lower(load_u16(around[RIM_LEFT]->lowest[RIM_RIGHT]),
                                                  load_u16(around[RIM_RIGHT]->lowest[RIM_LEFT])));
  i8 most = higher(higher(known_code(codes[0]), known_code(codes[9])),
                   higher(known_code(load_u16(around[RIM_LEFT]->codes[RIM_RIGHT])),
                          known_code(load_u16(around[RIM_RIGHT]->codes[RIM_LEFT]))));
  for (int row = 0; row < 8; row++) {
    const i8 kind = load_c8(last->kind + 8 * row), near = kind == SEEN_NEAR;
    const i8 unseen = kind == SEEN_NOT; /* what has been forgotten still lies beside others */
    certain |= (uint64_t)mask_bits(load_c8(last->score + 8 * row) >= (int)(100 * MOST_AGREE))
               << 8 * row;
    served |= (uint64_t)mask_bits(near) << 8 * row;
    codes[row + 1] = load_u16(last->code + 8 * row) | (none & unseen);
    lows[row + 1] = lower(codes[row + 1], load_u16(last->front + 8 * row));
    least = lower(least, lows[row + 1]), most = higher(most, known_code(codes[row + 1]));
  }
  /* Most blocks show one thing. */
  if (largest_of(most) - least_of(least) <= 256 * EDGE_CODES) return served & certain;
  for (int row = 0; row < 8; row++) {
    const i8 lowest =
        lowest_beside(lows[row + 1], around[RIM_LEFT]->lowest[RIM_RIGHT][row],
                      around[RIM_RIGHT]->lowest[RIM_LEFT][row], lower(lows[row], lows[row + 2]));
    const i8 highest =
        highest_beside(codes[row + 1], around[RIM_LEFT]->codes[RIM_RIGHT][row],
                       around[RIM_RIGHT]->codes[RIM_LEFT][row], codes[row], codes[row + 2]);
    const i8 known = codes[row + 1] != none;
    const i8 own = choose_int(known, codes[row + 1], highest);
    const i8 hidden = lowest < own - 256 * EDGE_CODES;
    const i8 hiding = known & (highest > codes[row + 1] + 256 * EDGE_CODES);
    store_u16(beside->lowest + 8 * row, lowest), store_u16(beside->highest + 8 * row, highest);
    beside->lower |= (uint64_t)mask_bits(hidden) << 8 * row;
    beside->higher |= (uint64_t)mask_bits(hiding) << 8 * row;
  }
  return served & certain;
}

static void remember(const depth_rays *rays, const uint8_t kinds[64], uint64_t mask,
                     uint64_t partly, depth_memory *now, depth_rim *rim) {
  const i8 none = all_int(NO_CODE);
  for (int row = 0; row < 64; row += LANES) {
    i8 made = lanes_of((unsigned)(mask >> row & 0xff));
    i8 code = to_int(256.0f * larger(load(rays->code + row), all(0)));
    f8 at_most_1 = smaller(load(rays->score + row), all(1)); /* sixteen slices may give more */
    i8 score = to_int(100.0f * at_most_1), kind = load_c8(kinds + row);
    code = (code & made) | (load_u16(now->code + row) & ~made);
    kind = (kind & made) | (load_c8(now->kind + row) & ~made);
    store_u16(now->code + row, code);
    store_c8(now->score + row, (score & made) | (load_c8(now->score + row) & ~made));
    store_c8(now->kind + row, kind);
    i8 covers = load_u16(now->front + row) | made; /* NO_CODE */
    if (partly >> row & 0xff) {
      const i8 covered = lanes_of((unsigned)(partly >> row & 0xff));
      covers = (to_int(256.0f * load(rays->front_code + row)) & covered) | (covers & ~covered);
    }
    covers &= none;
    store_u16(now->front + row, covers);
    const i8 known = (kind == SEEN_NEAR) | (kind == SEEN_WIDE);
    const i8 shown = (code & known) | (none & ~known), lowest = lower(shown, covers);
    rim->codes[RIM_LEFT][row / 8] = (uint16_t)shown[0];
    rim->codes[RIM_RIGHT][row / 8] = (uint16_t)shown[7];
    rim->lowest[RIM_LEFT][row / 8] = (uint16_t)lowest[0];
    rim->lowest[RIM_RIGHT][row / 8] = (uint16_t)lowest[7];
    if (row == 0)
      store_u16(rim->codes[RIM_ABOVE], shown), store_u16(rim->lowest[RIM_ABOVE], lowest);
    if (row == 56)
      store_u16(rim->codes[RIM_BELOW], shown), store_u16(rim->lowest[RIM_BELOW], lowest);
  }
}

#endif
