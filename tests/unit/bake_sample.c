/* Where rays start and go: the orthogonal array, its strata, and that it never changes. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "bake/sample.h"

/* Strata of all four axes: u v s t of every ray. */
static void strata(uint32_t rays, uint32_t p, uint32_t (*out)[4]) {
  double uv[SAMPLE_MAX_RAYS][2], st[SAMPLE_MAX_RAYS][2];
  sample_texel_offsets(rays, uv);
  sample_cell_offsets(rays, 5, 9, st);
  for (uint32_t m = 0; m < rays; m++) {
    for (int axis = 0; axis < 4; axis++) {
      double offset = axis < 2 ? uv[m][axis] : st[m][axis - 2];
      assert_true(offset >= 0 && offset < 1);
      out[m][axis] = (uint32_t)(offset * p);
    }
  }
}

static void every_pair_of_axes_meets_every_stratum_once(void **state) {
  (void)state;
  const uint32_t primes[] = {3, 5, 7, 11};
  for (int i = 0; i < 4; i++) {
    uint32_t p = primes[i], stratum[SAMPLE_MAX_RAYS][4];
    strata(p * p, p, stratum);
    for (int a = 0; a < 4; a++) {
      for (int b = a + 1; b < 4; b++) {
        uint8_t met[SAMPLE_MAX_RAYS] = {0};
        for (uint32_t m = 0; m < p * p; m++) met[stratum[m][a] * p + stratum[m][b]]++;
        for (uint32_t m = 0; m < p * p; m++) assert_int_equal(met[m], 1);
      }
    }
  }
}

static void one_ray_goes_to_the_centre(void **state) {
  (void)state;
  double uv[1][2], st[1][2];
  sample_texel_offsets(1, uv);
  sample_cell_offsets(1, 3, 4, st);
  assert_true(uv[0][0] == 0.5 && uv[0][1] == 0.5 && st[0][0] == 0.5 && st[0][1] == 0.5);
}

static void the_middle_ray_starts_from_the_centre(void **state) {
  (void)state;
  double uv[SAMPLE_MAX_RAYS][2];
  const uint32_t counts[] = {1, 9, 25, 49, 121};
  for (int i = 0; i < 5; i++) {
    sample_texel_offsets(counts[i], uv);
    assert_true(uv[counts[i] / 2][0] == 0.5 && uv[counts[i] / 2][1] == 0.5);
  }
}

/* A tent's second moment is 1/24. With f(x) = 2 - 4|x| the slope of f x^2 is 0.37 in the root mean
 * square, a ray's offset is off its stratum's middle by 1/(p sqrt(12)), and p x p rays average:
 * 0.105/p^2, with the sum's own error 0.116/p^2; four of those are allowed. A box has 1/12. */
static void weights_are_a_tent(void **state) {
  (void)state;
  const uint32_t primes[] = {3, 5, 7, 11};
  for (int i = 0; i < 4; i++) {
    const uint32_t rays = primes[i] * primes[i];
    double uv[SAMPLE_MAX_RAYS][2], weights[SAMPLE_MAX_RAYS], sum = 0, moment = 0;
    sample_texel_offsets(rays, uv);
    sample_texel_weights(rays, weights);
    for (uint32_t m = 0; m < rays; m++) {
      assert_true(weights[m] >= 0 && weights[m] <= weights[rays / 2]);
      sum += weights[m];
      moment += weights[m] * (uv[m][0] - 0.5) * (uv[m][0] - 0.5);
    }
    assert_true(fabs(sum - 1) < 1e-12);
    assert_true(fabs(moment - 1.0 / 24) < 0.47 / rays);
  }
}

static void cells_differ_and_texels_do_not(void **state) {
  (void)state;
  double a[25][2], b[25][2];
  sample_cell_offsets(25, 3, 4, a);
  sample_cell_offsets(25, 4, 3, b);
  assert_memory_not_equal(a, b, sizeof a);
  sample_cell_offsets(25, 3, 4, b);
  assert_memory_equal(a, b, sizeof a);
  sample_texel_offsets(25, a);
  sample_texel_offsets(25, b);
  assert_memory_equal(a, b, sizeof a);
}

/* Means over many cells: each offset is uniform in a stratum of 1/5, so the mean of 256 x 25 has a
 * standard error of 1/5 / sqrt(12) / sqrt(6400) = 0.00072; four of those are allowed. */
static void offsets_are_centred(void **state) {
  (void)state;
  double sum[2] = {0, 0}, st[25][2];
  for (uint32_t s = 0; s < 16; s++) {
    for (uint32_t t = 0; t < 16; t++) {
      sample_cell_offsets(25, s, t, st);
      for (int m = 0; m < 25; m++) sum[0] += st[m][0], sum[1] += st[m][1];
    }
  }
  for (int axis = 0; axis < 2; axis++) {
    double mean = sum[axis] / (256 * 25);
    assert_true(mean > 0.5 - 0.0029 && mean < 0.5 + 0.0029);
  }
}

static void counts_are_checked(void **state) {
  (void)state;
  for (uint32_t rays = 0; rays < 200; rays++)
    assert_int_equal(sample_count_is_valid(rays),
                     rays == 1 || rays == 9 || rays == 25 || rays == 49 || rays == 121);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(every_pair_of_axes_meets_every_stratum_once),
      cmocka_unit_test(one_ray_goes_to_the_centre),
      cmocka_unit_test(the_middle_ray_starts_from_the_centre),
      cmocka_unit_test(weights_are_a_tent),
      cmocka_unit_test(cells_differ_and_texels_do_not),
      cmocka_unit_test(offsets_are_centred),
      cmocka_unit_test(counts_are_checked),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
