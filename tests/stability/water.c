/* Hard water: steps far beyond what an explicit scheme bears, and reflections off ripples that no
 * lake would hold. */
#include "viewer/water.h"

#include "tests/stability/closed_form.h"

/* ---- The height field --------------------------------------------------------------------------
 */

static ripple *make_pond(uint32_t count, float courant, ripple_border border) {
  const ripple_options options = {.u_count = count,
                                  .v_count = count,
                                  .u_length = (float)count,
                                  .v_length = (float)count,
                                  .step_s = 1,
                                  .wave_speed = courant,
                                  .height_limit = 1000,
                                  .border = border};
  ripple *pond;
  slf_error error;
  if (ripple_create(&options, &pond, &error) != SLF_OK) fail_msg("%s", error.message);
  return pond;
}

static double mode_amplitude(const ripple *pond, int p) {
  const ripple_options *o = ripple_get_options(pond);
  size_t stride;
  const double *h = ripple_heights(pond, &stride);
  double sum = 0;
  for (size_t j = 0; j < o->v_count; j++)
    for (size_t i = 0; i < o->u_count; i++) {
      assert_true(isfinite(h[j * stride + i]));
      sum += h[j * stride + i] * cos(p * M_PI * ((double)i + 0.5) / o->u_count);
    }
  return sum;
}

/* The angle by which a mode turns in a step, by least squares of a(n+1) + a(n-1) = 2 cos(w) a(n).
 */
static double angle_a_step(ripple *pond, int p, int step_count) {
  double before = mode_amplitude(pond, p), top = 0, bottom = 0;
  ripple_step(pond);
  double here = mode_amplitude(pond, p);
  for (int n = 0; n < step_count; n++) {
    ripple_step(pond);
    const double after = mode_amplitude(pond, p);
    top += here * (after + before);
    bottom += 2 * here * here;
    before = here;
    here = after;
  }
  return acos(fmin(fmax(top / bottom, -1), 1));
}

/* An explicit scheme is stable up to Courant number 0.71. Here, up to the largest that is allowed,
 * energy never grows, and the longest wave of 128 cells is late by what the dispersion relation
 * says, tan(w / 2) = C sin(k / 2), and no more: 2 % as in the unit test. The truth is w = C k, as
 * long as that is less than half a turn a step. */
static void steps_far_beyond_the_explicit_limit(void **state) {
  (void)state;
  static const float courants[] = {0.1f, 0.70710678f, 2, 5, 10, 20, 50, 100, 999};
  for (size_t i = 0; i < sizeof courants / sizeof *courants; i++) {
    enum { COUNT = 64 };
    ripple *pond = make_pond(COUNT, courants[i], RIPPLE_REFLECTING);
    assert_true(ripple_drop(pond, 0.1f, 0.2f, 8, 1));
    ripple_step(pond); /* the drop's volume is taken from the pond at the first step */
    const double first = ripple_energy(pond), k = M_PI / COUNT;
    const double w = angle_a_step(pond, 1, 200);
    const double relation = 2 * atan(courants[i] * sin(k / 2));
    const double truth = courants[i] * k;
    if (truth < M_PI)
      print_message("# figure: water_speed_error_courant %g %.5f\n", (double)courants[i],
                    1 - w / truth);
    assert_true(fabs(w / relation - 1) < 0.02);
    /* Rounding may add 20 (1 + 4a) 2^-53 of the energy a step (ripple.h), a = C^2 / 4. */
    const double rounding = 20 * (1 + courants[i] * courants[i]) * 0x1p-53;
    double before = ripple_energy(pond), most = 0;
    for (int n = 0; n < 300; n++) {
      ripple_step(pond);
      const double energy = ripple_energy(pond), gain = energy / before - 1;
      if (!(gain <= rounding))
        fail_msg("Courant %g, step %d: energy grew by %g, bound %g", (double)courants[i], n, gain,
                 rounding);
      most = fmax(most, gain);
      before = energy;
    }
    assert_true(before <= first * (1 + sqrt(500) * rounding));
    /* Relative, not radiance. */
    print_message("# figure: water_energy_gain_courant %g %.2e\n", (double)courants[i], most);
    ripple_destroy(pond);
  }
}

/* The worst that can be done to it for a thousand steps: drops as narrow as a cell and as high as
 * is allowed, everywhere, at every step, at the largest Courant number, with either border. */
static void storm_at_the_largest_courant_number(void **state) {
  (void)state;
  for (int border = 0; border < 2; border++) {
    ripple *pond = make_pond(32, 999, border ? RIPPLE_ABSORBING : RIPPLE_REFLECTING);
    srand(12);
    for (int n = 0; n < 1000; n++) {
      for (int k = 0; k < 4; k++)
        ripple_drop(pond, (float)rand() / (float)RAND_MAX, (float)rand() / (float)RAND_MAX, 1,
                    k % 2 ? 1e30f : -1e30f);
      ripple_step(pond);
      size_t stride;
      const double *h = ripple_heights(pond, &stride);
      for (size_t j = 0; j < 32; j++)
        for (size_t i = 0; i < 32; i++) {
          /* Held to the limit of 1000 before a step; in a step a height moves by the mean of what
           * was there, and the old heights and velocities are each at most 2 limits. */
          assert_true(isfinite(h[j * stride + i]));
          assert_true(fabs(h[j * stride + i]) <= 4000);
        }
    }
    ripple_destroy(pond);
  }
}

/* ---- Reflections -------------------------------------------------------------------------------
 */

enum { TEXELS = 64 };

static char path[] = "/tmp/slf_stability_water_XXXXXX";
static slf_file *file;
static water *pond_water;

static slf_result read_grey(void *context, uint32_t s, uint32_t t, float *rgb, slf_error *error) {
  (void)context, (void)s, (void)t, (void)error;
  for (int i = 0; i < TEXELS * TEXELS * 3; i++) rgb[i] = 0.5f;
  return SLF_OK;
}

static int make_water(void **state) {
  (void)state;
  grid square = make_grid(1, 1, square_at);
  const light_field pond = {
      .surface = {.name = "pond", .flags = SLF_SURFACE_WATER, .mesh = square.mesh},
      .layer = {.u_count = TEXELS,
                .v_count = TEXELS,
                .s_count = 2,
                .t_count = 2,
                .quality = 80,
                .thread_count = 1},
      .source = {.read_slice = read_grey}};
  int failed = make_light_fields(path, &pond, 1, &file);
  free_grid(&square);
  slf_error error;
  if (!failed && water_create(file, 0, TEXELS, TEXELS, 0, &pond_water, &error) != SLF_OK)
    fprintf(stderr, "%s\n", error.message), failed = -1;
  return failed;
}

static int remove_water(void **state) {
  (void)state;
  water_free(pond_water);
  slf_close(file);
  return unlink(path);
}

/* water.h's construction in double: the direction d' that the flat mirror is asked for. */
static void reflect(const double d[3], double slope_u, double slope_v, double bent[3]) {
  const double length = sqrt(1 + slope_u * slope_u + slope_v * slope_v);
  const double m[3] = {-slope_u / length, -slope_v / length, 1 / length};
  const double along = m[0] * d[0] + m[1] * d[1] + m[2] * d[2];
  for (int k = 0; k < 3; k++) bent[k] = 2 * along * m[k] - d[k];
  bent[0] = -bent[0];
  bent[1] = -bent[1];
  bent[2] = fabs(bent[2]);
}

static double largest_bend_error(double slope, double eye_n) {
  static const direction_bend none = {NULL, NULL};
  water *w = pond_water;
  ripple_drop(w->pond, 0.5f, 0.5f, 0.1f, 0.01f); /* so that it bends */
  const direction_bend bend = water_begin_frame(w);
  assert_true(bend.bend != none.bend);
  double worst = 0;
  for (int i = 0; i < 64; i++) {
    const double tilt = 2 * M_PI * i / 64;
    w->slope_u[(size_t)(i / 8) * w->stride + (size_t)(i % 8)] = (float)(slope * cos(tilt));
    w->slope_v[(size_t)(i / 8) * w->stride + (size_t)(i % 8)] = (float)(slope * sin(tilt));
  }
  block_directions d = {.mask = ~(uint64_t)0};
  const double radius = sqrt(1 - eye_n * eye_n);
  for (int i = 0; i < 64; i++) {
    const double azimuth = 2 * M_PI * (i * 29 % 64) / 64;
    d.s[i] = (float)(0.5 + 0.5 * radius * cos(azimuth));
    d.t[i] = (float)(0.5 + 0.5 * radius * sin(azimuth));
  }
  const block_directions before = d;
  bend.bend(bend.context, 0, 0, &d);
  for (int i = 0; i < 64; i++) {
    assert_true(isfinite(d.s[i]) && isfinite(d.t[i]));
    const size_t at = (size_t)(i / 8) * w->stride + (size_t)(i % 8);
    double eye[3], bent[3];
    slf_direction(before.s[i], before.t[i], 0, eye);
    reflect(eye, w->slope_u[at], w->slope_v[at], bent);
    const double error = hypot(2.0 * d.s[i] - 1 - bent[0], 2.0 * d.t[i] - 1 - bent[1]);
    worst = fmax(worst, error);
  }
  return worst;
}

/* Slopes from level to cliffs, seen from above down to the horizon. A direction is unit length, so
 * (s,t) of d' is off by float32 roundings of terms that stay below 2, some ten of them: 2e-6. At
 * the horizon n = sqrt(1 - s^2 - t^2) of rounded s and t is off by sqrt(2^-23) = 3.5e-4, and with
 * it the ray, at most twice over: a hundredth of a cell of 32 directions is 6e-4. */
static void ripples_of_any_slope(void **state) {
  (void)state;
  static const double slopes[] = {0, 1e-6, 1e-3, 0.1, 0.5, 1, 10, 1e3, 1e6};
  static const double heights[] = {1, 0.3, 0.1, 0.01, 1e-3, 0};
  for (size_t i = 0; i < sizeof slopes / sizeof *slopes; i++) {
    double worst = 0;
    for (size_t k = 0; k < sizeof heights / sizeof *heights; k++) {
      const double error = largest_bend_error(slopes[i], heights[k]);
      const double n_error = heights[k] > 0 ? fmin(3.5e-4, 0x1p-23 / heights[k]) : 3.5e-4;
      if (!(error <= 2e-6 + 2 * n_error))
        fail_msg("slope %g, n = %g: (s,t) off by %g", slopes[i], heights[k], error);
      worst = fmax(worst, error);
    }
    /* In s and t, not radiance. */
    print_message("# figure: ripple_slope_direction %g %.2e\n", slopes[i], worst);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(steps_far_beyond_the_explicit_limit),
      cmocka_unit_test(storm_at_the_largest_courant_number),
      cmocka_unit_test(ripples_of_any_slope),
  };
  return cmocka_run_group_tests(tests, make_water, remove_water);
}
