/* Coarser texture levels against a plain box filter in double precision; vector code against plain
 * C; and a part made anew against the whole. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "viewer/half.h"
#include "viewer/mipmap.h"

static mipmap_level make_level(uint32_t width, uint32_t height, uint32_t spare_texels) {
  size_t row_nbytes = (size_t)(width + spare_texels) * 8;
  return (mipmap_level){width, height, row_nbytes, calloc(height, row_nbytes)};
}

static uint16_t *texel_at(const mipmap_level *level, uint32_t x, uint32_t y) {
  return (uint16_t *)(void *)((uint8_t *)level->texels + y * level->row_nbytes) + 4 * x;
}

static float any_01(void) {
  return (float)rand() / (float)RAND_MAX;
}

/* Colours up to 4 times their alpha of 0 or 1: light above white, texels that were not made. */
static void fill_randomly(const mipmap_level *level, mipmap_area area) {
  for (uint32_t y = area.y0; y < area.y1; y++)
    for (uint32_t x = area.x0; x < area.x1; x++) {
      bool made = rand() % 3;
      for (int c = 0; c < 4; c++)
        texel_at(level, x, y)[c] = half_from_float(!made    ? 0
                                                   : c == 3 ? 1
                                                            : 4 * any_01() * any_01());
    }
}

static mipmap_area all_of(const mipmap_level *level) {
  return (mipmap_area){0, 0, level->width, level->height};
}

static uint32_t half_of(uint32_t side) {
  return side > 1 ? side / 2 : 1;
}

/* How much of finer texel j the coarse texel i covers, where both span the same side. */
static double overlap(uint32_t i, uint32_t coarse, uint32_t j, uint32_t fine) {
  double begin = (double)i / coarse * fine, end = (i + 1.0) / coarse * fine;
  return fmax(0, fmin(end, j + 1.0) - fmax(begin, j)) / (end - begin);
}

static void test_is_the_box_filter(void **state) {
  (void)state;
  static const uint32_t sides[] = {1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 31, 33, 44, 45};
  enum { SIDES = sizeof sides / sizeof *sides };
  srand(21);
  for (int n = 0; n < SIDES * SIDES; n++) {
    mipmap_level fine = make_level(sides[n % SIDES], sides[n / SIDES], 3);
    mipmap_level coarse = make_level(half_of(fine.width), half_of(fine.height), 0);
    fill_randomly(&fine, all_of(&fine));
    mipmap_reduce(&fine, &coarse, all_of(&coarse));
    for (uint32_t y = 0; y < coarse.height; y++)
      for (uint32_t x = 0; x < coarse.width; x++)
        for (int c = 0; c < 4; c++) {
          double sum = 0;
          for (uint32_t j = 0; j < fine.height; j++)
            for (uint32_t i = 0; i < fine.width; i++)
              sum += overlap(x, coarse.width, i, fine.width) *
                     overlap(y, coarse.height, j, fine.height) *
                     float_from_half(texel_at(&fine, i, j)[c]);
          /* Rounded to a half, 11 bits, or a step of 2^-24 below 2^-14; the sum of nine products in
           * float32 adds a hundredth of that. */
          double error = fabs(float_from_half(texel_at(&coarse, x, y)[c]) - sum);
          assert_true(error <= fmax(sum * 0x1p-11, 0x1p-25) * 1.01);
        }
    free(fine.texels);
    free(coarse.texels);
  }
}

static void test_vector_code_equals_plain_c(void **state) {
  (void)state;
  srand(22);
  for (int n = 0; n < 200; n++) {
    mipmap_level fine = make_level(1 + (uint32_t)rand() % 70, 1 + (uint32_t)rand() % 70, 0);
    mipmap_level a = make_level(half_of(fine.width), half_of(fine.height), 0), b = a;
    b.texels = calloc(b.height, b.row_nbytes);
    fill_randomly(&fine, all_of(&fine));
    mipmap_reduce(&fine, &a, all_of(&a));
    mipmap_reduce_plain(&fine, &b, all_of(&b));
    assert_memory_equal(a.texels, b.texels, a.height * a.row_nbytes);
    free(fine.texels);
    free(a.texels);
    free(b.texels);
  }
}

/* Colours of both lights, coverage of one; nothing outside the area. */
static void test_lights_add_up(void **state) {
  (void)state;
  srand(24);
  mipmap_level light = make_level(37, 21, 3), a = make_level(37, 21, 0), b = a, before = a;
  b.texels = calloc(b.height, b.row_nbytes);
  before.texels = calloc(b.height, b.row_nbytes);
  fill_randomly(&light, all_of(&light));
  fill_randomly(&a, all_of(&a));
  memcpy(b.texels, a.texels, a.height * a.row_nbytes);
  memcpy(before.texels, a.texels, a.height * a.row_nbytes);
  const mipmap_area area = {3, 5, 30, 20};
  mipmap_add(&light, &a, area);
  mipmap_add_plain(&light, &b, area);
  assert_memory_equal(a.texels, b.texels, a.height * a.row_nbytes);
  for (uint32_t y = 0; y < a.height; y++)
    for (uint32_t x = 0; x < a.width; x++)
      for (int c = 0; c < 4; c++) {
        bool inside = x >= area.x0 && x < area.x1 && y >= area.y0 && y < area.y1;
        float was = float_from_half(texel_at(&before, x, y)[c]);
        float more = inside && c < 3 ? float_from_half(texel_at(&light, x, y)[c]) : 0;
        assert_true(texel_at(&a, x, y)[c] == half_from_float(was + more));
      }
  free(light.texels);
  free(a.texels);
  free(b.texels);
  free(before.texels);
}

/* Where an area changes, what mipmap_reached names is all that needs to be made, down to 1x1. */
static void test_a_part_made_anew_is_the_whole(void **state) {
  (void)state;
  srand(23);
  for (int n = 0; n < 300; n++) {
    mipmap_level levels[2][MIPMAP_MAX_LEVELS];
    uint32_t width = 1 + (uint32_t)rand() % 100, height = 1 + (uint32_t)rand() % 100, count = 0;
    for (;; width = half_of(width), height = half_of(height), count++) {
      for (int k = 0; k < 2; k++) levels[k][count] = make_level(width, height, 0);
      if (width == 1 && height == 1) break;
    }
    const mipmap_level *top = &levels[0][0];
    uint32_t x0 = (uint32_t)rand() % top->width, y0 = (uint32_t)rand() % top->height;
    mipmap_area area = {x0, y0, x0 + 1 + (uint32_t)rand() % (top->width - x0),
                        y0 + 1 + (uint32_t)rand() % (top->height - y0)};
    fill_randomly(top, all_of(top));
    for (uint32_t i = 0; i < count; i++)
      mipmap_reduce(&levels[0][i], &levels[0][i + 1], all_of(&levels[0][i + 1]));
    fill_randomly(top, area);
    memcpy(levels[1][0].texels, top->texels, top->height * top->row_nbytes);
    for (uint32_t i = 0; i < count; i++) {
      area = mipmap_reached(&levels[0][i], area);
      mipmap_reduce(&levels[0][i], &levels[0][i + 1], area);
      mipmap_reduce(&levels[1][i], &levels[1][i + 1], all_of(&levels[1][i + 1]));
      assert_memory_equal(levels[0][i + 1].texels, levels[1][i + 1].texels,
                          levels[0][i + 1].height * levels[0][i + 1].row_nbytes);
    }
    for (uint32_t i = 0; i <= count; i++)
      for (int k = 0; k < 2; k++) free(levels[k][i].texels);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_is_the_box_filter),
      cmocka_unit_test(test_vector_code_equals_plain_c),
      cmocka_unit_test(test_lights_add_up),
      cmocka_unit_test(test_a_part_made_anew_is_the_whole),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
