/* Hard directions: grazing, the rim and beyond it, S and T exactly 0 and 1, the ends of cells, one
 * direction and 65536 of them. */
#include "viewer/resample.h"

#include "slf.h"
#include "tests/stability/closed_form.h"

/* A hair that the resampler keeps inside the circle, 1e-4 of its radius (resample.c), and float32
 * in S and T. */
static const double rim_error = 1e-4 * 1.5 * 0.2 * 3 + 1e-6;

/* Largest error of a light field of one block of texels in the directions given, each of which must
 * be within its own bound. */
static double worst_error(closed_form *f, const float *s, const float *t, size_t count) {
  double worst = 0;
  resampler *r = resampler_create(f->s_count, f->t_count, closed_form_source(f));
  assert_non_null(r);
  for (size_t first = 0; first < count; first += 64) {
    block_directions d = {.mask = ~(uint64_t)0};
    mixed_block mixed;
    for (size_t k = 0; k < 64; k++) {
      const size_t i = first + k < count ? first + k : count - 1;
      d.s[k] = s[i];
      d.t[k] = t[i];
    }
    resample_block(r, 0, 0, &d, mixed.texels, MIXED_ROW_NBYTES);
    resample_flush(r);
    for (int k = 0; k < 64; k++) {
      double axes[3];
      slf_direction(d.s[k], d.t[k], 0, axes);
      for (int c = 0; c < 3; c++) {
        const double truth = radiance((k % 8 + 0.5) / 8, (k / 8 + 0.5) / 8, axes[0], axes[1], c);
        const double error = fabs(float_from_half(mixed.texels[4 * k + c]) - truth);
        if (!(error <= mix_error(f, axes[0], axes[1]) + rim_error))
          fail_msg("%ux%u directions, S %.9g T %.9g: error %g, bound %g", f->s_count, f->t_count,
                   (double)d.s[k], (double)d.t[k], error,
                   mix_error(f, axes[0], axes[1]) + rim_error);
        worst = fmax(worst, error);
      }
    }
  }
  resampler_free(r);
  return worst;
}

enum { AZIMUTHS = 1024 };

/* Directions of one radius in the (s,t) plane, all around. */
static void ring(double radius, float *s, float *t) {
  for (int i = 0; i < AZIMUTHS; i++) {
    const double angle = 2 * M_PI * i / AZIMUTHS;
    s[i] = (float)(0.5 + 0.5 * radius * cos(angle));
    t[i] = (float)(0.5 + 0.5 * radius * sin(angle));
  }
}

static void grazing_directions_to_the_horizon(void **state) {
  (void)state;
  static const double heights[] = {1, 0.5, 0.2, 0.1, 0.05, 0.01, 1e-6, 0};
  float s[AZIMUTHS], t[AZIMUTHS];
  for (uint32_t directions = 8; directions <= 64; directions *= 2) {
    closed_form f = closed_form_make(8, 8, directions, directions);
    for (size_t i = 0; i < sizeof heights / sizeof *heights; i++) {
      ring(sqrt(1 - heights[i] * heights[i]), s, t);
      const double error = worst_error(&f, s, t, AZIMUTHS);
      if (directions == 16 || directions == 64)
        print_message("# figure: grazing_n_%u_directions %g %.5f\n", directions, heights[i], error);
    }
    closed_form_free(&f);
  }
}

static void exactly_zero_and_one(void **state) {
  (void)state;
  static const float ends[] = {0, 0.5f, 1, -0.0f, 0x1p-149f, 1 - 0x1p-24f, 1 + 0x1p-23f};
  enum { ENDS = sizeof ends / sizeof *ends };
  float s[ENDS * ENDS], t[ENDS * ENDS];
  for (int i = 0; i < ENDS * ENDS; i++) {
    s[i] = ends[i % ENDS];
    t[i] = ends[i / ENDS];
  }
  static const uint32_t counts[] = {1, 2, 3, 16, 63, 64, 256};
  for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
    closed_form f = closed_form_make(8, 8, counts[i], counts[i]);
    worst_error(&f, s, t, ENDS * ENDS);
    closed_form_free(&f);
  }
}

/* Outside the circle a direction is the rim's at the same azimuth. */
static void beyond_the_rim(void **state) {
  (void)state;
  float s[AZIMUTHS], t[AZIMUTHS];
  closed_form f = closed_form_make(8, 8, 32, 32);
  /* As far as a float goes, 3.4e38 in S or 6.8e38 of radius: the azimuth stays. */
  for (double out = 1e-7; out < 1e39; out *= out < 1e37 ? 10 : 6.7) {
    ring(1 + out, s, t);
    worst_error(&f, s, t, AZIMUTHS);
  }
  /* What is no number reads as 1/2: straight up. */
  const float none[] = {NAN, INFINITY, -INFINITY};
  resampler *r = resampler_create(32, 32, closed_form_source(&f));
  mixed_block up, mixed;
  block_directions d = {.mask = ~(uint64_t)0};
  for (int k = 0; k < 64; k++) d.s[k] = d.t[k] = 0.5f;
  resample_block(r, 0, 0, &d, up.texels, MIXED_ROW_NBYTES);
  resample_flush(r);
  for (int k = 0; k < 64; k++) d.s[k] = none[k % 3], d.t[k] = none[k / 3 % 3];
  resample_block(r, 0, 0, &d, mixed.texels, MIXED_ROW_NBYTES);
  resample_flush(r);
  assert_memory_equal(&mixed, &up, sizeof up);
  resampler_free(r);
  closed_form_free(&f);
}

/* slf_direction itself, as far as a double goes: on the rim, at the azimuth asked for. */
static void far_directions_keep_their_azimuth(void **state) {
  (void)state;
  for (double radius = 1; radius < 1e308; radius *= 1e3)
    for (int i = 0; i < 360; i++) {
      const double angle = 2 * M_PI * (i + 0.25) / 360;
      double d[3];
      slf_direction(0.5 + radius * cos(angle), 0.5 + radius * sin(angle), 0.02, d);
      /* Of order 1, after a dozen roundings of 1.1e-16. */
      assert_true(fabs(d[0] - sqrt(1 - 0.02 * 0.02) * cos(angle)) < 2e-15);
      assert_true(fabs(d[1] - sqrt(1 - 0.02 * 0.02) * sin(angle)) < 2e-15);
      assert_true(d[2] == 0.02);
    }
}

/* Error falls with the square of the cell, from one direction to as many as the format has. */
static void one_direction_to_65536(void **state) {
  (void)state;
  static const uint32_t counts[][2] = {{1, 1},  {1, 7},   {7, 1},   {2, 2},     {3, 5},    {4, 4},
                                       {8, 8},  {16, 16}, {32, 32}, {64, 64},   {64, 1},   {1, 256},
                                       {13, 3}, {256, 2}, {63, 65}, {128, 128}, {256, 256}};
  enum { SIDE = 96 };
  static float s[SIDE * SIDE], t[SIDE * SIDE];
  for (int i = 0; i < SIDE * SIDE; i++) {
    s[i] = ((float)(i % SIDE) + 0.37f) / SIDE;
    t[i] = ((float)(i / SIDE) + 0.61f) / SIDE;
  }
  for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
    closed_form f = closed_form_make(8, 8, counts[i][0], counts[i][1]);
    const double error = worst_error(&f, s, t, SIDE * SIDE);
    if (counts[i][0] == counts[i][1])
      print_message("# figure: directions %u %.5f\n", counts[i][0], error);
    closed_form_free(&f);
  }
}

/* ---- The ends of cells -------------------------------------------------------------------------
 */

/* The hardest slices to mix: black and white in turn. */
static void fetch_checkerboard(void *context, uint32_t block_u, uint32_t block_v,
                               const slice_index *slices, size_t count, const uint8_t **u_blocks) {
  static uint8_t blocks[2][SLF_BLOCK_NBYTES];
  (void)context, (void)block_u, (void)block_v;
  memset(blocks[1], 255, sizeof blocks[1]);
  for (size_t i = 0; i < count; i++) u_blocks[i] = blocks[(slices[i] >> 8 ^ slices[i]) & 1];
}

static float ulp_beside(float x, int side) {
  return side < 0 ? nextafterf(x, -1) : side > 0 ? nextafterf(x, 2) : x;
}

/* At a slice's centre the mix changes cells. One ulp either side, and on it, the result is the
 * slice itself: S is off by 2^-24 and s, which is near twice that, by 2^-23; times count / 2 cells,
 * on each axis, and x = s count / 2 rounds again. In all less than 4 count 2^-24 of a white tap
 * falls on a black one, or is missing from a white one; and a half float near 1 is off by 2^-12,
 * white by 0.3 of a code, 0.0027. */
static void one_ulp_either_side_of_a_cell(void **state) {
  (void)state;
  static const uint32_t counts[] = {2, 3, 5, 8, 12, 16, 31, 32, 64, 100, 256};
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++) {
    const uint32_t count = counts[n];
    resampler *r = resampler_create(count, count, (block_source){.fetch = fetch_checkerboard});
    double worst = 0;
    for (uint32_t i = 0; i < count; i++)
      for (uint32_t j = 0; j < count; j++) {
        const float s = (float)((i + 0.5) / count), t = (float)((j + 0.5) / count);
        if (hypotf(2 * s - 1, 2 * t - 1) > 0.999f) continue; /* a centre that is out of reach */
        block_directions d = {.mask = 0x1ff};
        mixed_block mixed;
        for (int k = 0; k < 9; k++) {
          d.s[k] = ulp_beside(s, k % 3 - 1);
          d.t[k] = ulp_beside(t, k / 3 - 1);
        }
        resample_block(r, 0, 0, &d, mixed.texels, MIXED_ROW_NBYTES);
        resample_flush(r);
        for (int k = 0; k < 9; k++) {
          const double tap = (i ^ j) & 1;
          const double error = fabs(float_from_half(mixed.texels[4 * k]) - tap);
          assert_true(error <= count * 0x1p-22 + tap * (0x1p-12 + 0.0027));
          worst = fmax(worst, error);
        }
      }
    resampler_free(r);
    if (count == 16 || count == 64 || count == 256)
      print_message("# figure: ulp_beside_cell %u %.2e\n", count, worst);
  }
}

/* ---- What is stored ----------------------------------------------------------------------------
 */

typedef struct {
  uint32_t s_count, t_count;
} counts_of;

static void fetch_stored(void *context, uint32_t block_u, uint32_t block_v,
                         const slice_index *slices, size_t count, const uint8_t **u_blocks) {
  static const uint8_t block[SLF_BLOCK_NBYTES];
  const counts_of *n = context;
  (void)block_u, (void)block_v;
  for (size_t i = 0; i < count; i++) {
    if (!slf_slice_exists(n->s_count, n->t_count, slices[i] >> 8, slices[i] & 0xff))
      fail_msg("%ux%u directions: slice %u,%u is read but not stored", n->s_count, n->t_count,
               slices[i] >> 8, slices[i] & 0xff);
    u_blocks[i] = block;
  }
}

/* The rim reads what lies furthest out: for any number of directions all of it is stored. */
static void the_rim_reads_what_is_stored(void **state) {
  (void)state;
  float s[AZIMUTHS], t[AZIMUTHS];
  ring(1, s, t);
  for (uint32_t count = 1; count <= 256; count++)
    for (int other = 0; other < 2; other++) {
      counts_of n = {count, other ? 1 + count * 37 % 256 : count};
      resampler *r = resampler_create(n.s_count, n.t_count,
                                      (block_source){.fetch = fetch_stored, .context = &n});
      for (size_t first = 0; first < AZIMUTHS; first += 64) {
        block_directions d = {.mask = ~(uint64_t)0};
        mixed_block mixed;
        memcpy(d.s, s + first, sizeof d.s);
        memcpy(d.t, t + first, sizeof d.t);
        resample_block(r, 0, 0, &d, mixed.texels, MIXED_ROW_NBYTES);
        resample_flush(r);
      }
      resampler_free(r);
    }
}

/* Rays of every stored cell, its corners too, leave the surface at n >= 0.02 along a unit vector.
 */
static void rays_of_rim_cells_leave_the_surface(void **state) {
  (void)state;
  static const uint32_t counts[] = {1, 2, 3, 16, 64, 256};
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (uint32_t i = 0; i < counts[n]; i++)
      for (uint32_t j = 0; j < counts[n]; j++) {
        if (!slf_slice_exists(counts[n], counts[n], i, j)) continue;
        for (int corner = 0; corner < 4; corner++) {
          double d[3];
          slf_direction((double)(i + (uint32_t)(corner & 1)) / counts[n],
                        (double)(j + (uint32_t)(corner >> 1)) / counts[n], 0.02, d);
          assert_true(d[2] >= 0.02);
          /* Four roundings of 2^-53. */
          assert_true(fabs(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - 1) < 1e-15);
        }
      }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(grazing_directions_to_the_horizon),
      cmocka_unit_test(exactly_zero_and_one),
      cmocka_unit_test(beyond_the_rim),
      cmocka_unit_test(far_directions_keep_their_azimuth),
      cmocka_unit_test(one_direction_to_65536),
      cmocka_unit_test(one_ulp_either_side_of_a_cell),
      cmocka_unit_test(the_rim_reads_what_is_stored),
      cmocka_unit_test(rays_of_rim_cells_leave_the_surface),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
