/* The pond's numerics: stability, conservation, symmetry, speed, and every rule of ripple.h. */
#include "viewer/ripple.h"

#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static const double pi = 3.14159265358979323846;

/* A square pond whose cells have side 1 and whose Courant number is that of the wave speed. */
static ripple_options square(uint32_t count, float courant) {
  return (ripple_options){.u_count = count,
                          .v_count = count,
                          .u_length = (float)count,
                          .v_length = (float)count,
                          .step_s = 1,
                          .wave_speed = courant,
                          .height_limit = 10};
}

static ripple *make(ripple_options options) {
  ripple *pond;
  slf_error error;
  if (ripple_create(&options, &pond, &error) != SLF_OK) fail_msg("%s", error.message);
  return pond;
}

static double height_at(const ripple *pond, size_t i, size_t j) {
  size_t stride;
  return ripple_heights(pond, &stride)[j * stride + i];
}

static double peak(const ripple *pond) {
  const ripple_options *o = ripple_get_options(pond);
  double largest = 0;
  for (size_t j = 0; j < o->v_count; j++)
    for (size_t i = 0; i < o->u_count; i++) {
      assert_true(isfinite(height_at(pond, i, j)));
      largest = fmax(largest, fabs(height_at(pond, i, j)));
    }
  return largest;
}

static bool same_heights(const ripple *a, const ripple *b) {
  const ripple_options *o = ripple_get_options(a);
  size_t stride;
  const double *x = ripple_heights(a, &stride), *y = ripple_heights(b, &stride);
  for (size_t j = 0; j < o->v_count; j++)
    if (memcmp(x + j * stride, y + j * stride, o->u_count * sizeof *x) != 0) return false;
  return true;
}

/* Closes the cells whose centre lies within `radius` of (u, v). */
static bool close_disc(ripple *pond, float u, float v, float radius) {
  static uint8_t closed[64 * 64];
  const ripple_options *o = ripple_get_options(pond);
  for (uint32_t j = 0; j < o->v_count; j++)
    for (uint32_t i = 0; i < o->u_count; i++) {
      const float x = (((float)i + 0.5f) / (float)o->u_count - u) * o->u_length;
      const float y = (((float)j + 0.5f) / (float)o->v_count - v) * o->v_length;
      closed[j * o->u_count + i] = hypotf(x, y) <= radius;
    }
  return ripple_add_obstacle(pond, closed);
}

/* Drops of many sizes, the smallest about one cell wide: every wave that the grid can hold. */
static void disturb(ripple *pond, unsigned seed) {
  const float spacing =
      ripple_get_options(pond)->u_length / (float)ripple_get_options(pond)->u_count;
  srand(seed);
  for (int i = 0; i < 20; i++) {
    const float u = (float)rand() / (float)RAND_MAX, v = (float)rand() / (float)RAND_MAX;
    const float radius = spacing * (0.6f + 4 * (float)rand() / (float)RAND_MAX);
    assert_true(ripple_drop(pond, u, v, radius, (float)(rand() % 3 - 1) + 0.3f));
  }
}

static void options_are_checked(void **state) {
  (void)state;
  const ripple_options good = square(32, 0.5f);
  ripple_options bad[12];
  for (int i = 0; i < 12; i++) bad[i] = good;
  bad[0].u_count = 7;
  bad[1].v_count = 513;
  bad[2].u_length = 0;
  bad[3].v_length = NAN;
  bad[4].step_s = -1;
  bad[5].wave_speed = INFINITY;
  bad[6].damping_per_s = -0.1f;
  bad[7].viscosity = NAN;
  bad[8].height_limit = 0;
  bad[9].wave_speed = 1e9f;
  bad[10].viscosity = 1e9f;
  bad[11].wave_speed = 1e-9f;
  for (int i = 0; i < 12; i++) {
    ripple *pond = (ripple *)&good;
    slf_error error = {""};
    assert_int_equal(ripple_create(&bad[i], &pond, &error), SLF_ERROR_ARGUMENT);
    assert_null(pond);
    assert_true(strncmp(error.message, "ripple: ", 8) == 0);
  }
  ripple *pond = make(good);
  assert_int_equal(ripple_tune(pond, NAN, 0, NULL), SLF_ERROR_ARGUMENT);
  assert_true(ripple_get_options(pond)->wave_speed == good.wave_speed);
  assert_int_equal(ripple_tune(pond, 0.25f, 0.5f, NULL), SLF_OK);
  assert_true(ripple_get_options(pond)->wave_speed == 0.25f);
  ripple_destroy(pond);
  ripple_destroy(NULL);
}

/* A sanitized build checks memory, which every step uses alike, and is 20 times slower. */
#if defined(__SANITIZE_ADDRESS__)
enum { SLOWER = 20, MANY_STEPS = 20000 };
#else
enum { SLOWER = 1, MANY_STEPS = 1000000 };
#endif

/* What rounding may add to the energy in a step, of the energy: ripple.h. */
static double rounding_a_step(const ripple_options *o) {
  const double r = (double)o->wave_speed * o->wave_speed * o->step_s * o->step_s;
  return 20 * (1 + 4 * (0.25 * r + 0.5 * (double)o->viscosity / o->step_s)) * 0x1p-53;
}

/* Every variant has waves of every length, from one cell up, and steps up to the longest allowed.
 */
static void energy_never_grows(void **state) {
  (void)state;
  static const float courants[] = {0.1f, 0.5f, 0.70710678f, 1, 3, 10, 100, 999};
  for (size_t c = 0; c < sizeof courants / sizeof *courants; c++)
    for (int variant = 0; variant < 8; variant++) {
      ripple_options options = square(32, courants[c]);
      options.v_count = 24; /* cells of 1 x 4/3 */
      options.height_limit = 1000;
      options.border = variant & 1 ? RIPPLE_ABSORBING : RIPPLE_REFLECTING;
      options.damping_per_s = variant & 2 ? 0.01f : 0;
      options.viscosity = variant & 2 ? 0.2f : 0;
      ripple *pond = make(options);
      if (variant & 4) {
        assert_true(close_disc(pond, 0.5f, 0.5f, 6));
        assert_true(close_disc(pond, 0.1f, 0.9f, 3));
      }
      disturb(pond, 7);
      const double first = ripple_energy(pond);
      assert_true(first > 0);
      double before = first;
      for (int n = 0; n < 600 / SLOWER; n++) {
        ripple_step(pond);
        const double energy = ripple_energy(pond);
        if (!(energy <= before * (1 + rounding_a_step(&options))))
          fail_msg("Courant %g variant %d step %d: energy %.17g after %.17g", courants[c], variant,
                   n, energy, before);
        before = energy;
      }
      assert_true(before <= first * (1 + sqrt(600) * rounding_a_step(&options)));
      ripple_destroy(pond);
    }
}

/* Without damping the centred scheme keeps its energy: Kass and Miller's own would not. */
static void undamped_water_keeps_its_energy(void **state) {
  (void)state;
  ripple *pond = make(square(48, 0.5f));
  assert_true(ripple_drop(pond, 0.4f, 0.3f, 3, 1));
  const double first = ripple_energy(pond);
  for (int n = 0; n < 20000 / SLOWER; n++) ripple_step(pond);
  /* Relative rounding of 2^-53 a step, all of one sign, would be 2.2e-12. */
  assert_true(fabs(ripple_energy(pond) / first - 1) < 2.2e-12);
  ripple_destroy(pond);
}

static void stable_over_a_million_steps(void **state) {
  (void)state;
  /* The explicit limit in two dimensions is 1/sqrt(2). */
  static const float courants[] = {0.70710678f, 100, 999};
  for (int c = 0; c < 3; c++) {
    ripple_options options = square(16, courants[c]);
    options.height_limit = 1e4f; /* never reached: it would take energy */
    ripple *pond = make(options);
    disturb(pond, 3);
    ripple_step(pond); /* the disturbances' net volume is given back here */
    const double first = ripple_energy(pond);
    const double first_peak = peak(pond);
    for (int n = 0; n < MANY_STEPS; n++) ripple_step(pond);
    const double change = ripple_energy(pond) / first - 1;
    const double level = ripple_mean_height(pond) / first_peak;
    print_message("Courant %g: energy after %d steps changed by %.1g, mean height %.1g of peak\n",
                  courants[c], MANY_STEPS, change, level);
    assert_true(fabs(change) < sqrt(MANY_STEPS) * rounding_a_step(&options));
    /* The level is corrected beyond 2^-40 of the largest height, which at Courant number 999
     * reaches some 30 times the first peak. */
    assert_true(fabs(level) < 0x1p-34);
    ripple_destroy(pond);
  }
}

/* As damped as water.c's: at each step more is taken than rounding adds. */
static void damped_energy_falls_at_every_step(void **state) {
  (void)state;
  ripple_options options = square(64, 0.85f);
  options.damping_per_s = 0.2f / 120;
  options.viscosity = 64.0f * 64 / 8192 / 120;
  ripple *pond = make(options);
  assert_true(close_disc(pond, 0.5f, 0.5f, 8));
  disturb(pond, 5);
  double before = ripple_energy(pond);
  for (int n = 0; n < 5000 / SLOWER; n++) {
    ripple_step(pond);
    const double energy = ripple_energy(pond);
    assert_true(energy < before);
    before = energy;
  }
  ripple_destroy(pond);
}

static void volume_is_kept_at_every_step(void **state) {
  (void)state;
  for (float courant = 0.1f; courant < 200; courant *= 10) {
    ripple *pond = make(square(32, courant));
    assert_true(close_disc(pond, 0.4f, 0.6f, 5));
    disturb(pond, 9);
    for (int n = 0; n < 500; n++) {
      ripple_step(pond);
      /* Corrected beyond 2^-40; the correction's own rounding is far below that. */
      assert_true(fabs(ripple_mean_height(pond)) <= 0x1p-39 * peak(pond));
    }
    ripple_destroy(pond);
  }
}

static void a_symmetric_drop_stays_symmetric(void **state) {
  (void)state;
  enum { COUNT = 48 };
  static const float courants[] = {0.5f, 5};
  for (int c = 0; c < 2; c++) {
    ripple *pond = make(square(COUNT, courants[c]));
    assert_true(close_disc(pond, 0.25f, 0.25f, 3));
    assert_true(close_disc(pond, 0.75f, 0.25f, 3));
    assert_true(close_disc(pond, 0.25f, 0.75f, 3));
    assert_true(close_disc(pond, 0.75f, 0.75f, 3));
    assert_true(ripple_drop(pond, 0.5f, 0.5f, 3, 1));
    for (int n = 0; n < 3000; n++) ripple_step(pond);
    double largest = peak(pond), worst = 0;
    for (size_t j = 0; j < COUNT; j++)
      for (size_t i = 0; i < COUNT; i++) {
        const size_t x = COUNT - 1 - i, y = COUNT - 1 - j;
        const double here = height_at(pond, i, j);
        const double images[] = {height_at(pond, x, j), height_at(pond, i, y),
                                 height_at(pond, j, i), height_at(pond, y, x)};
        for (int k = 0; k < 4; k++) worst = fmax(worst, fabs(here - images[k]));
      }
    print_message("Courant %g: asymmetry %.2g of the peak after 3000 steps\n", courants[c],
                  worst / largest);
    /* sqrt(3000) roundings of 2^-53 are 6e-15; (1 + 4a) = 26 times that where Courant is 5; a
     * margin of 10. */
    assert_true(largest > 0.01);
    assert_true(worst < (c ? 2e-12 : 6e-14) * largest);
    ripple_destroy(pond);
  }
}

/* Amplitude of the mode cos(p pi u) cos(q pi v), an exact eigenvector between walls. */
static double mode_amplitude(const ripple *pond, int p, int q) {
  const ripple_options *o = ripple_get_options(pond);
  double sum = 0;
  for (size_t j = 0; j < o->v_count; j++)
    for (size_t i = 0; i < o->u_count; i++)
      sum += height_at(pond, i, j) * cos(p * pi * ((double)i + 0.5) / o->u_count) *
             cos(q * pi * ((double)j + 0.5) / o->v_count);
  return sum;
}

/* A mode's amplitudes obey a(n+1) + a(n-1) = 2 cos(w step) a(n): least squares gives w. */
static double measured_speed(ripple *pond, int p, int q, int step_count) {
  double before = mode_amplitude(pond, p, q), here, top = 0, bottom = 0;
  ripple_step(pond);
  here = mode_amplitude(pond, p, q);
  for (int n = 0; n < step_count; n++) {
    ripple_step(pond);
    const double after = mode_amplitude(pond, p, q);
    top += here * (after + before);
    bottom += 2 * here * here;
    before = here;
    here = after;
  }
  const ripple_options *o = ripple_get_options(pond);
  const double k = pi * hypot(p / (double)o->u_length, q / (double)o->v_length);
  return acos(fmin(fmax(top / bottom, -1), 1)) / o->step_s / k;
}

static void waves_travel_at_the_speed_of_the_dispersion_relation(void **state) {
  (void)state;
  static const float courants[] = {0.3f, 0.70710678f, 2, 20};
  static const int modes[][2] = {{1, 0}, {0, 3}, {2, 2}, {8, 0}, {5, 9}, {16, 16}, {31, 7}};
  for (size_t c = 0; c < sizeof courants / sizeof *courants; c++)
    for (size_t m = 0; m < sizeof modes / sizeof *modes; m++) {
      ripple_options options = square(32, courants[c]);
      options.v_length = 40;
      ripple *pond = make(options);
      /* Small and off the nodes of every mode. */
      assert_true(ripple_drop(pond, 0.011f, 0.017f, 0.7f, 1));
      const int p = modes[m][0], q = modes[m][1];
      const double speed = measured_speed(pond, p, q, 400);
      const double expected =
          ripple_phase_speed(&options, pi * p / options.u_length, pi * q / options.v_length);
      if (!(fabs(speed / expected - 1) < 0.02))
        fail_msg("Courant %g mode %d,%d: speed %g, dispersion relation %g", courants[c], p, q,
                 speed, expected);
      /* Waves of at least 32 cells at Courant numbers up to 1/sqrt(2) travel at c: there the
       * relation itself is (k spacing)^2 / 24 (1 + 2 r) = 0.3 % off. */
      if (p + q <= 3 && courants[c] < 1 && hypot(p, q) <= 2)
        assert_true(fabs(speed / courants[c] - 1) < 0.02);
      ripple_destroy(pond);
    }
}

static void energy_falls_as_damping_says(void **state) {
  (void)state;
  ripple_options options = square(64, 0.5f);
  options.damping_per_s = 0.01f;
  ripple *pond = make(options);
  assert_true(ripple_drop(pond, 0.5f, 0.5f, 8, 1));
  const double first = ripple_energy(pond);
  for (int n = 0; n < 300; n++) ripple_step(pond);
  /* exp(-3) = 0.0498; averages over a swing are not exact for so short a time. */
  assert_true(fabs(ripple_energy(pond) / first / exp(-3) - 1) < 0.05);
  ripple_destroy(pond);
}

static void damped_water_comes_to_rest_exactly(void **state) {
  (void)state;
  ripple_options options = square(32, 0.5f);
  options.damping_per_s = 0.05f;
  ripple *pond = make(options);
  assert_true(ripple_is_calm(pond));
  assert_true(ripple_drop(pond, 0.3f, 0.6f, 2, 1));
  assert_false(ripple_is_calm(pond));
  int n = 0;
  /* Amplitude falls as exp(-0.025 n) from 1 to 1e-5 in 460 steps. */
  for (; n < 2000 && !ripple_is_calm(pond); n++) ripple_step(pond);
  assert_in_range(n, 200, 700);
  assert_true(peak(pond) == 0);
  assert_true(ripple_energy(pond) == 0);
  assert_true(ripple_drop(pond, 0.3f, 0.6f, 2, 1));
  ripple_step(pond);
  assert_false(ripple_is_calm(pond));
  ripple_reset(pond);
  assert_true(ripple_is_calm(pond));
  ripple_destroy(pond);
}

static void frame_rate_does_not_change_the_physics(void **state) {
  (void)state;
  ripple_options options = square(32, 0.5f);
  options.step_s = 1.0f / 128; /* sums of binary fractions are exact */
  options.wave_speed *= 128;
  ripple *a = make(options), *b = make(options);
  assert_true(ripple_drop(a, 0.3f, 0.6f, 2, 1));
  assert_true(ripple_drop(b, 0.3f, 0.6f, 2, 1));
  uint32_t steps_a = 0, steps_b = 0;
  for (int frame = 0; frame < 512; frame++) steps_a += ripple_advance(a, 1.0 / 256);
  for (int frame = 0; frame < 64; frame++)
    steps_b += ripple_advance(b, (frame & 1 ? 3 : 5) / 128.0);
  assert_int_equal(steps_a, 256);
  assert_int_equal(steps_b, 256);
  assert_true(same_heights(a, b));
  ripple_destroy(a);
  ripple_destroy(b);
}

static void hitches_are_safe(void **state) {
  (void)state;
  ripple_options options = square(32, 0.5f);
  options.step_s = 1.0f / 128;
  options.wave_speed *= 128;
  ripple *pond = make(options);
  assert_true(ripple_drop(pond, 0.3f, 0.6f, 2, 1));
  const double first = ripple_energy(pond);
  static const struct {
    double elapsed_s;
    uint32_t step_count;
  } frames[] = {
      {0, 0},        {0.001, 0}, {10, RIPPLE_MAX_CATCH_UP},       {0, 0},
      {NAN, 0},      {-5, 0},    {INFINITY, RIPPLE_MAX_CATCH_UP}, {1e300, RIPPLE_MAX_CATCH_UP},
      {1.0 / 128, 1}};
  for (size_t i = 0; i < sizeof frames / sizeof *frames; i++)
    assert_int_equal(ripple_advance(pond, frames[i].elapsed_s), frames[i].step_count);
  assert_true(ripple_energy(pond) <= first * (1 + 1e-5));
  ripple_destroy(pond);
}

static void wild_disturbances_are_refused_or_clamped(void **state) {
  (void)state;
  ripple *pond = make(square(32, 0.5f));
  static const float wild[] = {NAN, INFINITY, -INFINITY};
  for (int i = 0; i < 3; i++) {
    const float x = wild[i];
    const ripple_ball ball = {0.5f, 0.5f, 0};
    assert_false(ripple_drop(pond, x, 0.5f, 1, 1));
    assert_false(ripple_drop(pond, 0.5f, x, 1, 1));
    assert_false(ripple_drop(pond, 0.5f, 0.5f, x, 1));
    assert_false(ripple_drop(pond, 0.5f, 0.5f, 1, x));
    assert_false(ripple_stroke(pond, x, 0, 1, 1, 1, 1));
    assert_false(ripple_stroke(pond, 0, 0, 1, x, 1, 1));
    assert_false(ripple_stroke(pond, 0, 0, 1, 1, 1, x));
    assert_false(ripple_move_ball(pond, ball, (ripple_ball){x, 0, 0}, 1));
    assert_false(ripple_move_ball(pond, (ripple_ball){0, 0, x}, ball, 1));
    assert_false(ripple_move_ball(pond, ball, ball, x));
    assert_false(ripple_rain(pond, x, 1, 1, 1));
  }
  assert_false(ripple_drop(pond, 0.5f, 0.5f, 0, 1));
  assert_false(ripple_drop(pond, 0.5f, 0.5f, -1, 1));
  assert_false(ripple_rain(pond, -1, 1, 1, 1));
  assert_false(close_disc(pond, 0.5f, 0.5f, 100)); /* no water would be left */
  assert_true(ripple_is_calm(pond));

  const float limit = ripple_get_options(pond)->height_limit;
  assert_true(ripple_drop(pond, 0.5f, 0.5f, 2, 1e6f));
  assert_true(peak(pond) <= limit && peak(pond) > 0.5f * limit);
  srand(1);
  for (int n = 0; n < 20000; n++) { /* in step with the waves and out of it, everywhere */
    const float u = (float)rand() / (float)RAND_MAX, v = (float)rand() / (float)RAND_MAX;
    assert_true(ripple_drop(pond, n & 1 ? 0.5f : u, n & 1 ? 0.5f : v, 2, n % 7 ? 1e6f : -1e6f));
    assert_true(ripple_stroke(pond, u, v, 1e30f, v, 1e3f, 1e6f));
    assert_true(ripple_drop(pond, 1e30f, -1e30f, FLT_MAX, FLT_MAX));
    ripple_step(pond);
    if (n % 100 == 0) assert_true(peak(pond) <= 4 * limit);
  }
  const double energy = ripple_energy(pond);
  assert_true(isfinite(energy));
  for (int n = 0; n < 2000; n++) ripple_step(pond);
  assert_true(ripple_energy(pond) <= energy * (1 + 1e-4));
  assert_true(peak(pond) <= 1.01f * limit);
  ripple_destroy(pond);
}

static void a_stroke_is_the_sum_of_its_parts(void **state) {
  (void)state;
  ripple *whole = make(square(48, 0.5f)), *parts = make(square(48, 0.5f));
  assert_true(ripple_stroke(whole, 0.1f, 0.2f, 0.8f, 0.6f, 2, 0.5f));
  for (int i = 0; i < 7; i++)
    assert_true(ripple_stroke(parts, 0.1f + 0.1f * (float)i, 0.2f + 0.4f * (float)i / 7,
                              0.1f + 0.1f * (float)(i + 1), 0.2f + 0.4f * (float)(i + 1) / 7, 2,
                              0.5f));
  for (size_t j = 0; j < 48; j++)
    for (size_t i = 0; i < 48; i++)
      assert_true(fabs(height_at(whole, i, j) - height_at(parts, i, j)) < 1e-5f);
  /* Amid a long straight way the crest is height * sqrt(pi). */
  assert_true(fabs(peak(whole) - 0.5 * sqrt(pi)) < 0.01);
  assert_true(ripple_stroke(whole, 0.5f, 0.5f, 0.5f, 0.5f, 2, 1)); /* no way, no water moved */
  ripple_destroy(whole);
  ripple_destroy(parts);
}

static void a_ball_displaces_its_volume(void **state) {
  (void)state;
  ripple *pond = make(square(64, 0.3f));
  const ripple_ball above = {0.5f, 0.5f, -8}, half = {0.5f, 0.5f, 0}, aside = {0.6f, 0.5f, 0};
  assert_true(ripple_move_ball(pond, above, half, 8));
  /* Half a ball of radius 8: 2/3 pi 8^3 = 1072; 16 points a cell sample it to 1 %. */
  assert_true(fabs(ripple_mean_height(pond) * 64 * 64 / (2.0 / 3 * pi * 512) - 1) < 0.01);
  ripple_reset(pond);
  assert_true(ripple_move_ball(pond, half, half, 8));
  assert_true(peak(pond) == 0);
  assert_true(ripple_move_ball(pond, half, aside, 8));
  assert_true(height_at(pond, 45, 32) > 0.5f && height_at(pond, 24, 32) < -0.5f);
  assert_true(fabs(ripple_mean_height(pond)) < 0.01);
  ripple_destroy(pond);
}

static void an_obstacle_casts_a_shadow(void **state) {
  (void)state;
  ripple *pond = make(square(64, 0.5f));
  for (int i = 0; i <= 32; i++) assert_true(close_disc(pond, 0.5f, (float)i / 32, 4));
  for (int n = 0; n < 10; n++) {
    assert_true(ripple_drop(pond, 0.2f, 0.4f, 3, n & 1 ? -1 : 1));
    for (int k = 0; k < 100; k++) ripple_step(pond);
  }
  double near = 0, far = 0;
  double mean_near = 0, mean_far = 0;
  for (size_t j = 0; j < 64; j++)
    for (size_t i = 0; i < 26; i++) {
      mean_near += height_at(pond, i, j) / (26 * 64);
      mean_far += height_at(pond, 63 - i, j) / (26 * 64);
    }
  for (size_t j = 0; j < 64; j++)
    for (size_t i = 0; i < 26; i++) {
      near = fmax(near, fabs(height_at(pond, i, j) - mean_near));
      far = fmax(far, fabs(height_at(pond, 63 - i, j) - mean_far));
    }
  /* 8 closed cells, through which M's blur falls by about 15 a cell. */
  assert_true(near > 0.05f);
  assert_true(far < 1e-4f * near);
  ripple_destroy(pond);
}

/* A front that fills the channel's width meets the border head on, where Sommerfeld is exact but
 * for the grid: nearly all of it leaves. The same front stays between walls. */
static void absorbing_borders_let_waves_out(void **state) {
  (void)state;
  for (int absorbing = 0; absorbing < 2; absorbing++) {
    ripple_options options = square(128, 0.5f);
    options.v_count = 8;
    options.v_length = 8;
    options.border = absorbing ? RIPPLE_ABSORBING : RIPPLE_REFLECTING;
    ripple *pond = make(options);
    assert_true(ripple_stroke(pond, 0.5f, -5, 0.5f, 6, 6, 0.5f));
    const double first = ripple_energy(pond);
    for (int n = 0; n < 300; n++) ripple_step(pond); /* 150 cells: past both ends */
    const double left = ripple_energy(pond) / first;
    print_message("%s: %.2g of the energy left\n", absorbing ? "absorbing" : "reflecting", left);
    /* The long sides absorb too, which only helps; walls keep all. */
    if (absorbing)
      assert_true(left < 0.01);
    else
      assert_true(fabs(left - 1) < 1e-3);
    ripple_destroy(pond);
  }
}

static void rain_is_repeatable_and_bounded(void **state) {
  (void)state;
  ripple_options options = square(32, 0.5f);
  options.damping_per_s = 0.002f;
  ripple *a = make(options), *b = make(options);
  assert_true(ripple_rain(a, 0.5f, 1.5f, -0.3f, 42));
  assert_true(ripple_rain(b, 0.5f, 1.5f, -0.3f, 42));
  for (int n = 0; n < 500; n++) {
    ripple_step(a);
    ripple_step(b);
  }
  assert_true(same_heights(a, b));
  assert_true(peak(a) > 0.05f);
  assert_true(ripple_rain(b, 1e9f, 1.5f, -1e6f, 1)); /* as heavy as can be */
  for (int n = 0; n < 2000; n++) ripple_step(b);
  assert_true(peak(b) <= 4 * options.height_limit);
  assert_true(ripple_rain(a, 0, 1, 0, 0));
  for (int n = 0; n < 20000 && !ripple_is_calm(a); n++) ripple_step(a);
  assert_true(ripple_is_calm(a));
  ripple_destroy(a);
  ripple_destroy(b);
}

static void vectors_give_the_same_bits(void **state) {
  (void)state;
  static const uint32_t sizes[][2] = {{8, 8}, {17, 31}, {64, 64}, {33, 100}};
  for (int k = 0; k < 4; k++) {
    ripple_options options = square(64, 0.6f);
    options.u_count = sizes[k][0];
    options.v_count = sizes[k][1];
    options.damping_per_s = 0.001f;
    options.viscosity = 0.01f;
    ripple *fast = make(options), *plain = make(options);
    ripple_set_reference(plain, true, false);
    disturb(fast, 5);
    disturb(plain, 5);
    for (int n = 0; n < 500; n++) {
      ripple_step(fast);
      ripple_step(plain);
    }
    assert_true(same_heights(fast, plain));
    ripple_destroy(fast);
    ripple_destroy(plain);
  }
}

static void flushing_denormals_changes_nothing_visible(void **state) {
  (void)state;
  ripple *flushed = make(square(128, 0.3f)), *kept = make(square(128, 0.3f));
  ripple_set_reference(kept, false, true);
  assert_true(ripple_drop(flushed, 0.1f, 0.1f, 1, 1));
  assert_true(ripple_drop(kept, 0.1f, 0.1f, 1, 1));
  for (int n = 0; n < 50; n++) {
    ripple_step(flushed);
    ripple_step(kept);
  }
  for (size_t j = 0; j < 128; j++)
    for (size_t i = 0; i < 128; i++)
      assert_true(fabs(height_at(flushed, i, j) - height_at(kept, i, j)) < 1e-30f);
  const volatile float least = FLT_MIN; /* the caller's mode is as it was */
  assert_true(least / 2 > 0);
  ripple_destroy(flushed);
  ripple_destroy(kept);
}

/* Uniform cubic B-spline by its definition as a fourfold box: Cox-de Boor on knots -2 .. 2. */
static double b_spline(double x, int degree) {
  if (degree == 0) return x >= -0.5 && x < 0.5;
  const double half = (degree + 1) / 2.0;
  return ((x + half) * b_spline(x + 0.5, degree - 1) + (half - x) * b_spline(x - 0.5, degree - 1)) /
         degree;
}

static double spline_height(const ripple *pond, double x, double y) {
  const ripple_options *o = ripple_get_options(pond);
  const int u_count = (int)o->u_count, v_count = (int)o->v_count;
  double sum = 0;
  for (int j = (int)floor(y) - 2; j <= (int)floor(y) + 3; j++)
    for (int i = (int)floor(x) - 2; i <= (int)floor(x) + 3; i++) {
      const int p = i < 0 ? -1 - i : i >= u_count ? 2 * u_count - 1 - i : i;
      const int q = j < 0 ? -1 - j : j >= v_count ? 2 * v_count - 1 - j : j;
      sum += b_spline(x - i, 3) * b_spline(y - j, 3) * height_at(pond, (size_t)p, (size_t)q);
    }
  return sum;
}

static void slopes_are_those_of_the_spline(void **state) {
  (void)state;
  ripple_options options = square(24, 0.5f);
  options.v_count = 16;
  options.u_length = 12; /* cells of 0.5 x 1.5 */
  ripple *pond = make(options);
  disturb(pond, 11);
  for (int n = 0; n < 20; n++) ripple_step(pond);
  static const uint32_t texels[][2] = {{24, 16}, {100, 40}, {9, 7}, {600, 16}};
  for (int k = 0; k < 4; k++) {
    const uint32_t u_count = texels[k][0], v_count = texels[k][1];
    float *slope_u = malloc(sizeof(float) * u_count * v_count);
    float *slope_v = malloc(sizeof(float) * u_count * v_count);
    ripple_slopes(pond, u_count, v_count, slope_u, slope_v, u_count);
    for (uint32_t j = 0; j < v_count; j += 3)
      for (uint32_t i = 0; i < u_count; i += 5) {
        const double x = (i + 0.5) * 24 / u_count - 0.5, y = (j + 0.5) * 16 / v_count - 0.5;
        const double step = 1e-4; /* of a cell; error of the difference about 1e-8 */
        const double du = spline_height(pond, x + step, y) - spline_height(pond, x - step, y);
        const double dv = spline_height(pond, x, y + step) - spline_height(pond, x, y - step);
        assert_true(fabs(du / (2 * step * 0.5) - slope_u[j * u_count + i]) < 1e-4);
        assert_true(fabs(dv / (2 * step * 1.5) - slope_v[j * u_count + i]) < 1e-4);
      }
    free(slope_u);
    free(slope_v);
  }
  ripple_destroy(pond);
}

/* Water that stands level beside an obstacle has no slope there, whatever the obstacle's cells. */
static void water_runs_level_into_obstacles(void **state) {
  (void)state;
  ripple *pond = make(square(32, 0.5f));
  assert_true(ripple_drop(pond, 0.5f, 0.5f, 1e4f, 1)); /* raises all cells by the same */
  assert_true(close_disc(pond, 0.5f, 0.5f, 6));
  enum { SIDE = 64 };
  static float slope_u[SIDE * SIDE], slope_v[SIDE * SIDE];
  ripple_slopes(pond, SIDE, SIDE, slope_u, slope_v, SIDE);
  for (int j = 0; j < SIDE; j++)
    for (int i = 0; i < SIDE; i++) {
      if (hypot(i - 31.5, j - 31.5) < 11) continue; /* inside */
      assert_true(fabsf(slope_u[j * SIDE + i]) < 1e-4f && fabsf(slope_v[j * SIDE + i]) < 1e-4f);
    }
  ripple_destroy(pond);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(options_are_checked),
      cmocka_unit_test(energy_never_grows),
      cmocka_unit_test(undamped_water_keeps_its_energy),
      cmocka_unit_test(stable_over_a_million_steps),
      cmocka_unit_test(damped_energy_falls_at_every_step),
      cmocka_unit_test(volume_is_kept_at_every_step),
      cmocka_unit_test(a_symmetric_drop_stays_symmetric),
      cmocka_unit_test(waves_travel_at_the_speed_of_the_dispersion_relation),
      cmocka_unit_test(energy_falls_as_damping_says),
      cmocka_unit_test(damped_water_comes_to_rest_exactly),
      cmocka_unit_test(frame_rate_does_not_change_the_physics),
      cmocka_unit_test(hitches_are_safe),
      cmocka_unit_test(wild_disturbances_are_refused_or_clamped),
      cmocka_unit_test(a_stroke_is_the_sum_of_its_parts),
      cmocka_unit_test(a_ball_displaces_its_volume),
      cmocka_unit_test(an_obstacle_casts_a_shadow),
      cmocka_unit_test(absorbing_borders_let_waves_out),
      cmocka_unit_test(rain_is_repeatable_and_bounded),
      cmocka_unit_test(vectors_give_the_same_bits),
      cmocka_unit_test(flushing_denormals_changes_nothing_visible),
      cmocka_unit_test(slopes_are_those_of_the_spline),
      cmocka_unit_test(water_runs_level_into_obstacles),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
