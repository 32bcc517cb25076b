/* Hard radiance for the encoder: none, more than a half float holds, less than none, no number;
 * checkerboards and impulses at the ends of the quality scale, in every angular scheme; layers of
 * one texel, of odd sizes, of 64x64 directions. */
#include "slf.h"

#include "tests/stability/closed_form.h"

static char path[] = "/tmp/slf_stability_radiance_XXXXXX";

/* Light that is given for each texel of each slice. */
typedef struct {
  uint32_t u_count, v_count, s_count, t_count;
  float (*light)(uint32_t u, uint32_t v, uint32_t s, uint32_t t, uint32_t channel);
  slf_curve curve;
} pattern;

static slf_result read_slice(void *context, uint32_t s, uint32_t t, float *rgb, slf_error *error) {
  const pattern *p = context;
  (void)error;
  for (uint32_t v = 0; v < p->v_count; v++)
    for (uint32_t u = 0; u < p->u_count; u++)
      for (uint32_t c = 0; c < 3; c++) *rgb++ = p->light(u, v, s, t, c);
  return SLF_OK;
}

static slf_result write_pattern(pattern p, slf_angular angular, float quality, slf_error *error) {
  grid square = make_grid(1, 1, square_at);
  const light_field hard = {.surface = {.name = "hard", .mesh = square.mesh},
                            .layer = {.curve = p.curve,
                                      .angular = angular,
                                      .u_count = p.u_count,
                                      .v_count = p.v_count,
                                      .s_count = p.s_count,
                                      .t_count = p.t_count,
                                      .quality = quality},
                            .source = {.read_slice = read_slice, .context = &p}};
  const slf_result result = write_light_fields(path, &hard, 1, error);
  free_grid(&square);
  return result;
}

typedef struct {
  double rms, worst_block_rms, worst; /* codes */
  double ratio;
} hdr_errors;

/* What light is coded as, without asking the library: LDR light is held to [0, 1], HDR light to [0,
 * 65504] on OpenEXR's DWA curve, 677 codes to white. */
static double code_of(slf_curve curve, double light) {
  if (!(light > 0)) return 0;
  if (curve == SLF_CURVE_SRGB) return light >= 1 ? 255 : slf_srgb_from_linear((float)light);
  return 677 * (light < 1 ? pow(light, 1 / 2.2) : 1 + log(fmin(light, 65504)) / 2.2);
}

/* 64 x R G B. */
static void decode_codes(const slf_file *file, slf_curve curve, slf_block_address at,
                         double codes[192]) {
  uint8_t srgb[SLF_BLOCK_NBYTES];
  float linear[192];
  slf_decode_block(file, 0, 0, at, srgb);
  slf_decode_block_linear(file, 0, 0, at, linear);
  for (int k = 0; k < 192; k++)
    codes[k] = curve == SLF_CURVE_SRGB ? srgb[k / 3 * 4 + k % 3] : code_of(curve, linear[k]);
}

/* Writes, verifies, decodes every block, and compares with the codes that the light has. */
static hdr_errors round_trip(pattern p, slf_angular angular, float quality) {
  slf_error error = {""};
  slf_file *file;
  if (write_pattern(p, angular, quality, &error) != SLF_OK ||
      slf_open(path, &file, &error) != SLF_OK || slf_verify(file, &error) != SLF_OK)
    fail_msg("%s", error.message);
  const slf_layer *layer = &slf_get_surface(file, 0)->layers[0];
  hdr_errors e = {0, 0, 0, (double)layer->raw_nbytes / (double)layer->payload_nbytes};
  double count = 0;
  for (uint32_t s = 0; s < p.s_count; s++)
    for (uint32_t t = 0; t < p.t_count; t++) {
      if (!slf_slice_exists(p.s_count, p.t_count, s, t)) continue;
      for (uint32_t b = 0; b < layer->block_u_count * layer->block_v_count; b++) {
        const uint32_t bu = b % layer->block_u_count, bv = b / layer->block_u_count;
        double codes[192];
        decode_codes(file, p.curve,
                     (slf_block_address){(uint16_t)s, (uint16_t)t, (uint16_t)bu, (uint16_t)bv},
                     codes);
        double sum = 0, texels = 0;
        for (uint32_t k = 0; k < 64; k++) {
          const uint32_t u = bu * 8 + k % 8, v = bv * 8 + k / 8;
          if (u >= p.u_count || v >= p.v_count) continue;
          for (uint32_t c = 0; c < 3; c++, texels++) {
            const double d = codes[3 * k + c] - code_of(p.curve, p.light(u, v, s, t, c));
            sum += d * d;
            e.worst = fmax(e.worst, fabs(d));
          }
        }
        e.worst_block_rms = fmax(e.worst_block_rms, sqrt(sum / texels));
        e.rms += sum;
        count += texels;
      }
    }
  e.rms = sqrt(e.rms / count);
  slf_close(file);
  return e;
}

static const slf_angular schemes[] = {SLF_ANGULAR_NONE, SLF_ANGULAR_IDENTICAL, SLF_ANGULAR_MOTION,
                                      SLF_ANGULAR_LAYERED};
static const char *const scheme_names[] = {"none", "identical", "motion", "layered"};

/* A block of one colour has a DC of 8 times its code in each channel, and at quality 100 the
 * largest step is 1.1 (0.95 + 0.007 * 14) = 1.2: the DC may be one step off, 0.15 codes, which 1.77
 * of chroma makes 0.4, and rounding: one code. */
static const double flat_error = 1;

/* ---- Radiance ----------------------------------------------------------------------------------
 */

static float hard_light[4];

static float light_of_the_place(uint32_t u, uint32_t v, uint32_t s, uint32_t t, uint32_t channel) {
  (void)s, (void)t, (void)channel;
  return hard_light[(u / 8 + v / 8) % 4];
}

/* LDR: light is held to [0,1]. Half floats end at 65504; -65504 is what POV-Ray's negative pigments
 * can give; 2^-149 and 2^-24 are the least float and half. */
static void light_beyond_the_display(void **state) {
  (void)state;
  static const float lights[][4] = {{0, 0, 0, 0},
                                    {65504, 65504, 65504, 65504},
                                    {0, 65504, 0, 65504},
                                    {-1, -65504, 0, 1},
                                    {-0.0f, 0x1p-149f, 0x1p-24f, 3e38f}};
  for (size_t i = 0; i < sizeof lights / sizeof *lights; i++)
    for (int scheme = 0; scheme < 4; scheme++) {
      memcpy(hard_light, lights[i], sizeof hard_light);
      const pattern p = {32, 32, 4, 4, light_of_the_place, SLF_CURVE_SRGB};
      const hdr_errors e = round_trip(p, schemes[scheme], 100);
      if (!(e.worst <= flat_error))
        fail_msg("light %g %g %g %g, %s: %g codes off", (double)lights[i][0], (double)lights[i][1],
                 (double)lights[i][2], (double)lights[i][3], scheme_names[scheme], e.worst);
    }
}

/* Powers of two from one light to the next. Sanitized, its ends: bad memory is no matter of
 * brightness. */
#if defined(__SANITIZE_ADDRESS__)
enum { POWERS = 31 };
#else
enum { POWERS = 1 };
#endif

/* HDR, from less than the curve tells from black to the largest half float and beyond. Steps are
 * those of LDR times 677 / 255: flat_error is 2.7 codes, of 2.2 / 677 of the radiance each above 1
 * and of 2.2 over the code itself below. */
static void light_of_any_brightness(void **state) {
  (void)state;
  const double hdr_error = flat_error * 677 / 255;
  for (int power = -14; power <= 17; power += POWERS) {
    const double light = fmin(exp2(power), 65504);
    for (int i = 0; i < 4; i++) hard_light[i] = (float)exp2(power);
    for (int scheme = 0; scheme < 4; scheme++) {
      const pattern p = {32, 32, 4, 4, light_of_the_place, SLF_CURVE_DWA};
      const hdr_errors e = round_trip(p, schemes[scheme], 100);
      if (!(e.worst <= hdr_error))
        fail_msg("light %g, %s: %g codes off", light, scheme_names[scheme], e.worst);
      /* Relative. */
      const double a_code = 2.2 / (light < 1 ? code_of(SLF_CURVE_DWA, light) : 677);
      if (scheme == 3 && power >= -10 && power <= 16)
        print_message("# figure: hdr_relative_error %g %.2e\n", light, e.worst * a_code);
    }
  }
  static const float lights[][4] = {{0, 65504, 0, 65504}, {-1, -65504, 3e38f, 1}};
  for (size_t i = 0; i < 2; i++)
    for (int scheme = 0; scheme < 4; scheme++) {
      memcpy(hard_light, lights[i], sizeof hard_light);
      const pattern p = {32, 32, 4, 4, light_of_the_place, SLF_CURVE_DWA};
      assert_true(round_trip(p, schemes[scheme], 100).worst <= hdr_error);
    }
}

/* A texel as bright as a half float can be amid dark ones, at every quality: the worst that a
 * transform can be asked for. worst_rms in codes of DWA, of which there are 4096. */
static float sun(uint32_t u, uint32_t v, uint32_t s, uint32_t t, uint32_t channel) {
  (void)s, (void)t, (void)channel;
  return u % 8 == 3 && v % 8 == 5 ? 65504 : 0.01f;
}

static float light_nowhere(uint32_t u, uint32_t v, uint32_t s, uint32_t t, uint32_t channel) {
  return u == 5 && v == 3 && s == 2 && t == 1 && channel == 1 ? hard_light[0] : 0.25f;
}

/* What is no number is refused, and said where; no file is left. */
static void light_that_is_no_number(void **state) {
  (void)state;
  static const float lights[] = {NAN, INFINITY, -INFINITY};
  for (int i = 0; i < 3; i++)
    for (int scheme = 0; scheme < 4; scheme++) {
      slf_error error = {""};
      hard_light[0] = lights[i];
      unlink(path);
      const pattern p = {9, 9, 4, 4, light_nowhere, SLF_CURVE_SRGB};
      assert_int_equal(write_pattern(p, schemes[scheme], 80, &error), SLF_ERROR_ARGUMENT);
      assert_non_null(strstr(error.message, "(2, 1)"));
      assert_non_null(strstr(error.message, "(5, 3)"));
      assert_int_equal(access(path, F_OK), -1);
    }
}

/* The display curve by itself. */
static void display_curve_at_its_ends(void **state) {
  (void)state;
  assert_int_equal(slf_srgb_from_linear(NAN), 0);
  assert_int_equal(slf_srgb_from_linear(-INFINITY), 0);
  assert_int_equal(slf_srgb_from_linear(-0x1p-149f), 0);
  assert_int_equal(slf_srgb_from_linear(-0.01f), 0);
  assert_int_equal(slf_srgb_from_linear(-1), 0);
  assert_int_equal(slf_srgb_from_linear(INFINITY), 255);
  assert_int_equal(slf_srgb_from_linear(65504), 255);
  assert_int_equal(slf_srgb_from_linear(nextafterf(1, 0)), 255);
  for (int code = 0; code < 256; code++)
    assert_int_equal(slf_srgb_from_linear(slf_linear_from_srgb((uint8_t)code)), code);
  /* Never falls, and never jumps: over the joint of its two pieces too. */
  int before = 0;
  for (int i = 0; i <= 1 << 16; i++) {
    const int code = slf_srgb_from_linear((float)i / (1 << 16));
    assert_true(code == before || code == before + 1);
    before = code;
  }
  assert_int_equal(before, 255);
}

/* ---- Blocks that no cosine likes ---------------------------------------------------------------
 */

static float checkerboard(uint32_t u, uint32_t v, uint32_t s, uint32_t t, uint32_t channel) {
  (void)s, (void)t, (void)channel;
  return (float)((u ^ v) & 1);
}
static float checkerboard_in_turn(uint32_t u, uint32_t v, uint32_t s, uint32_t t,
                                  uint32_t channel) {
  return (float)((u ^ v ^ s ^ t ^ channel) & 1);
}
static float impulse(uint32_t u, uint32_t v, uint32_t s, uint32_t t, uint32_t channel) {
  (void)channel;
  return (u + 16 * v) % 64 == (s * 6 + t) % 64;
}
static float impulse_in_one_slice(uint32_t u, uint32_t v, uint32_t s, uint32_t t,
                                  uint32_t channel) {
  return u == 7 && v == 7 && s == 5 && t == 5 && channel == 2;
}
static float noise(uint32_t u, uint32_t v, uint32_t s, uint32_t t, uint32_t channel) {
  uint32_t x = (((u * 64 + v) * 64 + s) * 64 + t) * 3 + channel;
  x = (x ^ x >> 15) * 0x2c1b3c6du;
  x = (x ^ x >> 12) * 0x297a2d39u;
  return (float)((x ^ x >> 15) & 1);
}

static const struct {
  const char *name;
  float (*light)(uint32_t, uint32_t, uint32_t, uint32_t, uint32_t);
} patterns[] = {{"checkerboard", checkerboard},
                {"checkerboard in turn", checkerboard_in_turn},
                {"impulse", impulse},
                {"impulse in one slice", impulse_in_one_slice},
                {"noise", noise}};
enum { PATTERNS = sizeof patterns / sizeof *patterns };

/* The transform is orthonormal, so a block's squared error is that of its coefficients. A level off
 * by a whole step (rounding down where bits are dear) is the worst a coefficient has: a step of
 * error each, RMS in the channel. (The steps of a base or a key are no larger.) Channels make RGB
 * of it: luma counts once, chroma (1.77^2 + 0.34^2 + 1.40^2 + 0.71^2) / 3 = 1.9, 2.9 in all.
 * However large the steps are, no error is larger than leaving a block as grey as the codes allow:
 * 128 codes. And no code is clipped to a worse one. */
static double worst_rms(float quality) {
  const double step = fmin(4000, exp2((100 - quality) / 8)) * 1.1 * (0.95 + 0.007 * 14);
  return fmin(128, sqrt(2.9) * fmax(step, 1)) + 0.5;
}

static void a_sun_in_the_dark(void **state) {
  (void)state;
  static const float qualities[] = {1, 30, 50, 70, 90, 100};
  for (size_t q = 0; q < sizeof qualities / sizeof *qualities; q++)
    for (int scheme = 0; scheme < 4; scheme++) {
      const pattern p = {16, 16, 4, 4, sun, SLF_CURVE_DWA};
      const hdr_errors e = round_trip(p, schemes[scheme], qualities[q]);
      const double step =
          fmin(4000, exp2((100 - (double)qualities[q]) / 8)) * 1.1 * 1.05 * 677 / 255;
      const double bound = fmin(2048, sqrt(2.9) * fmax(step, 1)) + 0.5;
      if (!(e.worst_block_rms <= bound))
        fail_msg("%s, quality %g: a block is %g codes off, bound %g", scheme_names[scheme],
                 (double)qualities[q], e.worst_block_rms, bound);
      if (scheme == 3)
        print_message("# figure: hdr_sun_codes_rms %g %.3f\n", (double)qualities[q], e.rms);
    }
}

static void checkerboards_and_impulses(void **state) {
  (void)state;
  static const float qualities[] = {1, 30, 50, 70, 100};
  for (int i = 0; i < PATTERNS; i++)
    for (int scheme = 0; scheme < 4; scheme++)
      for (size_t q = 0; q < sizeof qualities / sizeof *qualities; q++) {
        if (scheme < 3 && q != 0 && q != 4) continue; /* the ends, for the schemes of the paper */
        const pattern p = {16, 16, 6, 6, patterns[i].light, SLF_CURVE_SRGB};
        const hdr_errors e = round_trip(p, schemes[scheme], qualities[q]);
        if (!(e.worst_block_rms <= worst_rms(qualities[q])))
          fail_msg("%s, %s, quality %g: a block is %g codes off, bound %g", patterns[i].name,
                   scheme_names[scheme], (double)qualities[q], e.worst_block_rms,
                   worst_rms(qualities[q]));
        /* In codes, not radiance. */
        if (scheme == 3 && (i == 0 || i == 2 || i == 4))
          print_message("# figure: codec_%s_codes_rms %g %.3f\n", patterns[i].name,
                        (double)qualities[q], e.rms);
      }
}

/* ---- Sizes -------------------------------------------------------------------------------------
 */

static float smooth(uint32_t u, uint32_t v, uint32_t s, uint32_t t, uint32_t channel) {
  return (float)radiance(u / 64.0, v / 64.0, s / 32.0 - 1, t / 32.0 - 1, (int)channel);
}

/* From one texel in one direction on, by primes, by eights, and one beside them. What is beyond the
 * edge of a slice costs no accuracy within it. At quality 90 the bound is worst_rms(90). */
static void layers_of_any_size(void **state) {
  (void)state;
  static const uint32_t sizes[][4] = {
      {1, 1, 1, 1}, {1, 1, 64, 64}, {1, 1, 3, 2},   {1, 17, 5, 1}, {17, 1, 1, 5}, {7, 9, 3, 3},
      {8, 8, 2, 2}, {9, 7, 4, 4},   {33, 31, 2, 3}, {8, 8, 1, 64}, {3, 5, 33, 9}, {24, 16, 7, 6}};
  for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
    for (int scheme = 0; scheme < 4; scheme++) {
      const uint32_t *n = sizes[i];
      const pattern p = {n[0], n[1], n[2], n[3], smooth, SLF_CURVE_SRGB};
      const hdr_errors e = round_trip(p, schemes[scheme], 90);
      if (!(e.worst_block_rms <= worst_rms(90)))
        fail_msg("%ux%u texels, %ux%u directions, %s: a block is %g codes off, bound %g", n[0],
                 n[1], n[2], n[3], scheme_names[scheme], e.worst_block_rms, worst_rms(90));
    }
}

/* 64x64 directions, the largest of the paper: every slice that the mix can read is there. */
static void sixty_four_by_sixty_four_directions(void **state) {
  (void)state;
  for (int scheme = 0; scheme < 4; scheme++) {
    const pattern p = {8, 8, 64, 64, smooth, SLF_CURVE_SRGB};
    const hdr_errors e = round_trip(p, schemes[scheme], 90);
    print_message("64x64 directions, %s: %.2f codes rms, %.1f : 1\n", scheme_names[scheme], e.rms,
                  e.ratio);
    assert_true(e.worst_block_rms <= worst_rms(90));
  }
}

static int make_path(void **state) {
  (void)state;
  const int descriptor = mkstemp(path);
  return descriptor < 0 ? -1 : close(descriptor);
}

static int remove_path(void **state) {
  (void)state;
  unlink(path);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(light_beyond_the_display),
      cmocka_unit_test(light_of_any_brightness),
      cmocka_unit_test(light_that_is_no_number),
      cmocka_unit_test(display_curve_at_its_ends),
      cmocka_unit_test(a_sun_in_the_dark),
      cmocka_unit_test(checkerboards_and_impulses),
      cmocka_unit_test(layers_of_any_size),
      cmocka_unit_test(sixty_four_by_sixty_four_directions),
  };
  return cmocka_run_group_tests(tests, make_path, remove_path);
}
