/* The water of a file: its rectangle, what stands in it, where rippled texels look, its script. */
#include "viewer/water.h"
#include "tests/light_field.h"
#include "viewer/half.h"
#include "viewer/pick.h"

enum { TEXELS = 40, ROUND = 16 };

static char path[] = "/tmp/slf_water_XXXXXX", script_path[] = "/tmp/slf_water_script_XXXXXX";
static slf_file *file;

static slf_result read_slice(void *context, uint32_t s_index, uint32_t t_index, float *rgb,
                             slf_error *error) {
  (void)context, (void)s_index, (void)t_index, (void)error;
  for (int i = 0; i < TEXELS * TEXELS * 3; i++) rgb[i] = 0.5f;
  return SLF_OK;
}

/* The water: y = 1, u runs 6 units along -z, v 3 units along x. */
static slf_vertex water_at(float u, float v) {
  return (slf_vertex){.position = {-1 + 3 * v, 1, 4 - 6 * u},
                      .normal = {0, 1, 0},
                      .tangent_u = {0, 0, -1},
                      .tangent_v = {1, 0, 0}};
}

/* A wall along the water's side v = 0. */
static slf_vertex wall_at(float u, float v) {
  return (slf_vertex){.position = {-1, 1 + 2 * v, 4 - 6 * u},
                      .normal = {1, 0, 0},
                      .tangent_u = {0, 0, -1},
                      .tangent_v = {0, 1, 0}};
}

/* A screen of no thickness that stands in the water at u = 0.9, v = 0 .. 0.4. */
static slf_vertex screen_at(float u, float v) {
  return (slf_vertex){.position = {-1 + 1.2f * u, 1 + v, 4 - 6 * 0.9f},
                      .normal = {0, 0, 1},
                      .tangent_u = {1, 0, 0},
                      .tangent_v = {0, 1, 0}};
}

/* A column of radius 0.5 that stands on the water's level at (x, z) = (0.5, 1). */
static slf_vertex column_at(float u, float v) {
  const float a = 6.2831853f * u;
  return (slf_vertex){.position = {0.5f + 0.5f * cosf(a), 1 + 2 * v, 1 + 0.5f * sinf(a)},
                      .normal = {cosf(a), 0, sinf(a)},
                      .tangent_u = {-sinf(a), 0, cosf(a)},
                      .tangent_v = {0, 1, 0}};
}

/* A ball of radius 0.4 that hovers over the water at (1.4, -1). */
static slf_vertex ball_at(float u, float v) {
  const float a = 6.2831853f * u, b = 3.14159265f * v;
  const float n[3] = {cosf(a) * sinf(b), cosf(b), sinf(a) * sinf(b)};
  return (slf_vertex){.position = {1.4f + 0.4f * n[0], 1.8f + 0.4f * n[1], -1 + 0.4f * n[2]},
                      .normal = {n[0], n[1], n[2]},
                      .tangent_u = {-sinf(a), 0, cosf(a)},
                      .tangent_v = {cosf(a) * cosf(b), -sinf(b), sinf(a) * cosf(b)}};
}

/* Water that is no rectangle: bulging; far below. */
static slf_vertex bulge_at(float u, float v) {
  slf_vertex x = water_at(u, v);
  x.position[1] += 0.1f * u * (1 - u) - 5;
  return x;
}

static int write_file(void **state) {
  (void)state;
  static const struct {
    const char *name;
    uint32_t columns, rows, flags;
    surface_point at;
  } shapes[] = {{"water", 2, 4, SLF_SURFACE_WATER, water_at},
                {"wall", 1, 1, 0, wall_at},
                {"column", ROUND, 3, SLF_SURFACE_WRAP_U, column_at},
                {"ball", ROUND, 8, SLF_SURFACE_WRAP_U, ball_at},
                {"screen", 1, 1, 0, screen_at},
                {"bulge", 4, 4, SLF_SURFACE_WATER, bulge_at}};
  enum { COUNT = sizeof shapes / sizeof *shapes };
  light_field fields[COUNT];
  grid grids[COUNT];
  for (size_t i = 0; i < COUNT; i++) {
    const uint32_t directions = shapes[i].flags & SLF_SURFACE_WATER ? 4 : 1;
    grids[i] = make_grid(shapes[i].columns, shapes[i].rows, shapes[i].at);
    fields[i] = (light_field){.surface = {.flags = shapes[i].flags, .mesh = grids[i].mesh},
                              .layer = {.u_count = TEXELS,
                                        .v_count = TEXELS,
                                        .s_count = directions,
                                        .t_count = directions,
                                        .quality = 80,
                                        .thread_count = 1},
                              .source = {.read_slice = read_slice}};
    snprintf(fields[i].surface.name, SLF_NAME_NBYTES, "%s", shapes[i].name);
  }
  const int script = mkstemp(script_path), failed = make_light_fields(path, fields, COUNT, &file);
  for (size_t i = 0; i < COUNT; i++) free_grid(&grids[i]);
  if (script < 0) return -1;
  close(script);
  return failed;
}

static int remove_file(void **state) {
  (void)state;
  slf_close(file);
  return unlink(path) | unlink(script_path);
}

static water *make(uint32_t cells) {
  water *w;
  slf_error error;
  if (water_create(file, 0, TEXELS, TEXELS, cells, &w, &error) != SLF_OK)
    fail_msg("%s", error.message);
  return w;
}

static ripple_script *script_of(const char *text, slf_error *error) {
  FILE *out = fopen(script_path, "w");
  assert_non_null(out);
  fputs(text, out);
  fclose(out);
  ripple_script *script;
  const slf_result result = ripple_script_read(script_path, &script, error);
  assert_true((result == SLF_OK) == (script != NULL));
  return script;
}

static void water_is_a_flat_rectangle(void **state) {
  (void)state;
  water *w = make(64);
  const water_rectangle *r = &w->rectangle;
  assert_float_equal(r->u_length, 6, 1e-4);
  assert_float_equal(r->v_length, 3, 1e-4);
  assert_float_equal(r->corner[2], 4, 1e-4);
  assert_float_equal(r->normal[1], 1, 1e-6);
  assert_int_equal(ripple_get_options(w->pond)->u_count, 64); /* square cells */
  assert_int_equal(ripple_get_options(w->pond)->v_count, 32);
  water_free(w);
  slf_error error = {""};
  assert_int_equal(water_create(file, 5, TEXELS, TEXELS, 64, &w, &error), SLF_ERROR_ARGUMENT);
  assert_null(w);
  assert_non_null(strstr(error.message, "'bulge'"));
  water_free(NULL);
}

/* Water raised evenly leaves a mark only where it is not: heights of closed cells stay zero. */
static void what_stands_in_the_water_is_an_obstacle(void **state) {
  (void)state;
  water *w = make(64);
  assert_true(ripple_drop(w->pond, 0.5f, 0.5f, 1e4f, 0.1f));
  size_t stride;
  const double *h = ripple_heights(w->pond, &stride);
  for (int j = 0; j < 32; j++)
    for (int i = 0; i < 64; i++) {
      const double x = -1 + 3 * (j + 0.5) / 32, z = 4 - 6 * (i + 0.5) / 64;
      const double distance = hypot(x - 0.5, z - 1);
      /* The column's mesh has ROUND sides: its flats lie at 0.5 cos(pi / 16) = 0.490. The wall,
       * the screen and the ball leave the water open. */
      if (distance < 0.489) assert_true(h[(size_t)j * stride + (size_t)i] == 0);
      if (distance > 0.501) assert_true(h[(size_t)j * stride + (size_t)i] > 0);
    }
  water_free(w);
}

static void calm_water_is_the_flat_picture(void **state) {
  (void)state;
  water *w = make(64);
  assert_null(water_begin_frame(w).bend);
  w->fresnel = true;
  assert_non_null(water_begin_frame(w).bend);
  w->fresnel = false;
  assert_true(ripple_drop(w->pond, 0.5f, 0.5f, 0.3f, 0.1f));
  assert_non_null(water_begin_frame(w).bend);
  water_reset(w);
  assert_null(water_begin_frame(w).bend);
  water_free(w);
}

static uint64_t noise;

static double random_number(void) {
  noise = noise * 6364136223846793005u + 1442695040888963407u;
  return (double)(noise >> 11) * 0x1p-53;
}

/* Mirrors in double precision: what the flat surface shows along d' is what the ripple reflects. */
static void texels_look_along_the_reflected_ray(void **state) {
  (void)state;
  water *w = make(64);
  assert_true(ripple_drop(w->pond, 0.3f, 0.2f, 0.3f, 0.3f));
  for (int n = 0; n < 60; n++) ripple_step(w->pond);
  const direction_bend bend = water_begin_frame(w);
  uint64_t below = 0;
  for (uint32_t block = 0; block < 25; block++) {
    block_directions d = {.mask = UINT64_MAX}, flat;
    for (int k = 0; k < 64; k++) {
      const double radius = sqrt(random_number()), angle = 6.2831853 * random_number();
      d.s[k] = (float)(0.5 + 0.5 * radius * cos(angle));
      d.t[k] = (float)(0.5 + 0.5 * radius * sin(angle));
    }
    flat = d;
    bend.bend(bend.context, block % 5, block / 5, &d);
    for (size_t k = 0; k < 64; k++) {
      const size_t at = (block / 5 * 8 + k / 8) * w->stride + block % 5 * 8 + k % 8;
      const double s = 2.0 * flat.s[k] - 1, t = 2.0 * flat.t[k] - 1;
      const double eye[3] = {s, t, sqrt(fmax(0, 1 - s * s - t * t))};
      double m[3] = {-w->slope_u[at], -w->slope_v[at], 1};
      const double length = sqrt(m[0] * m[0] + m[1] * m[1] + 1);
      const double along = (m[0] * eye[0] + m[1] * eye[1] + eye[2]) / length;
      const double up = 2 * along / length - eye[2];
      if (up < 0) below++;
      /* (S,T) of (-r_u, -r_v, |r_n|); n comes from 1 - s^2 - t^2, whose rounding 2^-23 near the rim
       * is 3.5e-4 of n. */
      assert_float_equal(2 * d.s[k] - 1, eye[0] - 2 * along * m[0] / length, 1e-3);
      assert_float_equal(2 * d.t[k] - 1, eye[1] - 2 * along * m[1] / length, 1e-3);
    }
  }
  assert_true(water_get_counts(w).ray_count == 25 * 64);
  assert_true(below > 0 && water_get_counts(w).below_count > 0);
  /* Those within rounding of the horizon may count either way. */
  assert_true(llabs((long long)(below - water_get_counts(w).below_count)) <= 2);
  water_free(w);
}

/* The paper: reflections near the base of a wall wiggle less than those further from it. Under one
 * tilt all over the water, what a texel shows of the wall moves as far as the wall is away. */
static void reflections_near_a_wall_move_less(void **state) {
  (void)state;
  water *w = make(64);
  assert_true(ripple_drop(w->pond, 0.5f, 0.5f, 0.3f, 0.1f));
  const direction_bend bend = water_begin_frame(w);
  const size_t rows = TEXELS, stride = w->stride;
  for (size_t at = 0; at < rows * stride; at++) w->slope_u[at] = w->slope_v[at] = 0.02f;
  double moved[TEXELS];
  for (uint32_t row = 0; row < TEXELS; row++) {
    /* The eye looks at the texels of one column along (0, 0.8, 0.6) of the frame, away from the
     * wall; the wall stands at v = 0, and the reflected ray runs there. */
    block_directions d = {.mask = UINT64_MAX};
    for (int k = 0; k < 64; k++) d.s[k] = 0.5f, d.t[k] = 0.9f;
    bend.bend(bend.context, 2, row / 8, &d);
    const double away = 3.0 * (row + 0.5) / TEXELS;
    const double u = 2 * d.s[8 * (row % 8)] - 1, v = 2 * d.t[8 * (row % 8)] - 1;
    const double n = sqrt(1 - u * u - v * v);
    const double along_wall = -u / v * away, height = n / v * away, flat_height = 0.6 / 0.8 * away;
    moved[row] = hypot(along_wall, height - flat_height);
  }
  for (int row = 1; row < TEXELS; row++)
    assert_float_equal(moved[row] / moved[0], 2 * row + 1, 1e-3 * (2 * row + 1));
  assert_true(moved[TEXELS - 1] > 0.05);
  water_free(w);
}

static void fresnel_lets_the_bottom_through(void **state) {
  (void)state;
  water *w = make(64);
  w->fresnel = true;
  const direction_bend bend = water_begin_frame(w);
  /* Straight down, 60 degrees off, grazing; reference values: Fresnel's equations, n = 1.333. */
  static const double sine[] = {0, 0.8660254, 0.9999}, reflected[] = {0.02037, 0.0597, 0.915};
  block_directions d = {.mask = UINT64_MAX};
  for (int k = 0; k < 64; k++) d.s[k] = 0.5f, d.t[k] = (float)(0.5 + 0.5 * sine[k % 8 % 3]);
  bend.bend(bend.context, 0, 0, &d);
  static uint16_t texels[TEXELS * TEXELS * 4];
  for (int i = 0; i < 8 * 4; i++) texels[i] = HALF_ONE;
  w->bottom[0] = w->bottom[1] = w->bottom[2] = 0;
  water_finish_frame(w, texels, TEXELS * 8);
  /* The cosine is kept in 1023 parts: 0.013 of reflectance at grazing angles. */
  for (int i = 0; i < 3; i++)
    assert_float_equal(float_from_half(texels[4 * i]), reflected[i], i == 2 ? 0.03 : 1e-3);
  assert_int_equal(texels[3], HALF_ONE); /* coverage stays */
  assert_int_equal(texels[4 * 8], 0);    /* what was not made stays empty */
  /* The bottom is seen once, however many layers the water's light has. */
  for (int layer = 0; layer < 2; layer++) {
    if (layer == 0) water_begin_frame(w);
    for (int i = 0; i < 8 * 4; i++) texels[i] = i % 4 == 3 ? HALF_ONE : 0;
    w->bottom[0] = 1;
    water_finish_frame(w, texels, TEXELS * 8);
    assert_float_equal(float_from_half(texels[0]), layer == 0 ? 1 - reflected[0] : 0, 1e-3);
  }
  water_free(w);
}

static void the_split_keeps_one_half_flat(void **state) {
  (void)state;
  water *w = make(64);
  w->display = WATER_SPLIT;
  assert_true(ripple_drop(w->pond, 0.25f, 0.25f, 0.3f, 0.3f));
  assert_true(ripple_drop(w->pond, 0.75f, 0.25f, 0.3f, 0.3f));
  water_begin_frame(w);
  float left = 0, right = 0;
  for (size_t j = 0; j < TEXELS; j++)
    for (size_t i = 0; i < TEXELS; i++) {
      float *half = i < TEXELS / 2 ? &left : &right;
      *half = fmaxf(*half, fabsf(w->slope_u[j * w->stride + i]));
    }
  assert_true(left == 0 && right > 0.1f);
  water_free(w);
}

static void a_script_replays_alike_at_any_frame_rate(void **state) {
  (void)state;
  slf_error error;
  ripple_script *script = script_of("# all that happens\n"
                                    "0 speed 2\n0 damping 0.3\n0 obstacle 0.8 0.8 0.2\n"
                                    "0.1 drop 0.5 0.5 0.2 -0.1 # a drop\n\n"
                                    "0.2 stroke 0.1 0.1 0.9 0.4 0.2 0.05 0.5\n"
                                    "0.3 ball 0.2 0.8 -0.5 0.4 0.8 0.1 0.3 0.4\n"
                                    "0.35 rain 20 0.15 -0.05 3\n1 stop\n",
                                    &error);
  if (!script) fail_msg("%s", error.message);
  assert_true(ripple_script_end_s(script) == 1 && ripple_script_stops(script));
  water *a = make(64), *b = make(64);
  a->script = b->script = script;
  for (int i = 0; i < 200; i++) assert_int_equal(water_advance(a, 1 / 90.0, &error), SLF_OK);
  for (int i = 0; i < 40; i++) assert_int_equal(water_advance(b, 1 / 19.0, &error), SLF_OK);
  assert_true(a->step_index == 120 && b->step_index == 120); /* both stopped at 1 s */
  size_t stride;
  const double *x = ripple_heights(a->pond, &stride), *y = ripple_heights(b->pond, &stride);
  assert_memory_equal(x, y, 32 * stride * sizeof(float));
  assert_true(ripple_energy(a->pond) > 0);
  water_reset(a);
  assert_true(a->step_index == 0 && ripple_is_calm(a->pond));
  a->paused = true;
  assert_int_equal(water_advance(a, 1, &error), SLF_OK);
  assert_true(a->step_index == 0);
  assert_int_equal(water_step(a, &error), SLF_OK); /* a single step while paused */
  assert_true(a->step_index == 1);
  water_free(a);
  water_free(b);
  ripple_script_free(script);
}

/* What is drawn in parts, step by step, is what is drawn at once. */
static void a_scripted_stroke_is_whole(void **state) {
  (void)state;
  slf_error error;
  ripple_script *script = script_of("0.25 stroke 0.1 0.5 0.9 0.5 0.3 0.02 0.6\n", &error);
  assert_non_null(script);
  assert_float_equal(ripple_script_end_s(script), 1.85, 1e-9);
  water *w = make(64), *whole = make(64);
  for (int i = 0; i < 120; i++) /* applied, without the water moving */
    assert_int_equal(ripple_script_apply(script, w->pond, i / 120.0, (i + 1) / 120.0, &error),
                     SLF_OK);
  assert_true(ripple_stroke(whole->pond, 0.1f, 0.5f, 0.9f, 0.5f, 0.3f, 0.02f));
  size_t stride;
  const double *x = ripple_heights(w->pond, &stride), *y = ripple_heights(whole->pond, &stride);
  for (size_t j = 0; j < 32; j++)
    for (size_t i = 0; i < 64; i++) assert_float_equal(x[j * stride + i], y[j * stride + i], 1e-6);
  water_free(w);
  water_free(whole);
  ripple_script_free(script);
}

static void wrong_scripts_are_refused_with_their_line(void **state) {
  (void)state;
  static const char *const wrong[] = {"drop 0 0 1 1",
                                      "0",
                                      "0 splash 1",
                                      "0 drop 0.5 0.5 1",
                                      "0 drop 0.5 0.5 1 1 1",
                                      "0 drop nan 0.5 1 1",
                                      "-1 drop 0.5 0.5 1 1",
                                      "inf stop",
                                      "0 stroke 0 0 1 1 1 1 -1",
                                      "0 speed fast"};
  for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
    char text[128];
    slf_error error = {""};
    snprintf(text, sizeof text, "# first\n%s\n", wrong[i]);
    assert_null(script_of(text, &error));
    if (!strstr(error.message, ":2: ")) fail_msg("%s: %s", wrong[i], error.message);
  }
  slf_error error = {""};
  ripple_script *script;
  assert_int_equal(ripple_script_read("/nonexistent/x.ripples", &script, &error), SLF_ERROR_IO);
  /* Well-formed, but the pond refuses it. */
  script = script_of("0 drop 0.5 0.5 -1 1\n", &error);
  assert_non_null(script);
  water *w = make(64);
  w->script = script;
  assert_int_equal(water_step(w, &error), SLF_ERROR_ARGUMENT);
  assert_non_null(strstr(error.message, ":1: "));
  water_free(w);
  ripple_script_free(script);
}

static void the_mouse_finds_water_and_what_hides_it(void **state) {
  (void)state;
  /* From above, looking straight down at the water's middle, (0.5, 1, 1), where the column stands.
   */
  slf_view view = {"", {0.5f, 9, 1}, {0.5f, 1, 1}, 60};
  camera c = camera_of_view(&view, 200, 100);
  pick_hit hit;
  assert_true(pick_surface(file, &c, 100, 50, 200, 100, &hit));
  assert_int_equal(hit.surface_index,
                   0); /* the column is open at its top: its inside is not drawn */
  assert_float_equal(hit.u, 0.5, 0.01);
  assert_float_equal(hit.v, 0.5, 0.01);
  view = (slf_view){"", {1.4f, 9, -1}, {1.4f, 1, -1}, 60};
  c = camera_of_view(&view, 200, 100);
  assert_true(pick_surface(file, &c, 100, 50, 200, 100, &hit));
  assert_int_equal(hit.surface_index, 3); /* the ball */
  /* A pixel aside: x and y as the picture has them. */
  view = (slf_view){"", {0.5f, 5, 1}, {0.5f, 1, 1}, 90};
  c = camera_of_view(&view, 200, 200);
  assert_true(pick_surface(file, &c, 120, 110, 200, 200, &hit));
  const double right = 0.2 * 4, down = 0.1 * 4; /* tan 45 = 1 at distance 4 */
  const double x = 0.5 + right * c.right[0] - down * c.up[0];
  const double z = 1 + right * c.right[2] - down * c.up[2];
  assert_int_equal(hit.surface_index, 0);
  assert_float_equal(hit.u, (4 - z) / 6, 1e-4);
  assert_float_equal(hit.v, (x + 1) / 3, 1e-4);
  view = (slf_view){"", {0.5f, 5, 1}, {0.5f, 9, 1}, 60};
  c = camera_of_view(&view, 200, 100);
  assert_false(pick_surface(file, &c, 100, 50, 200, 100, &hit));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(water_is_a_flat_rectangle),
      cmocka_unit_test(what_stands_in_the_water_is_an_obstacle),
      cmocka_unit_test(calm_water_is_the_flat_picture),
      cmocka_unit_test(texels_look_along_the_reflected_ray),
      cmocka_unit_test(reflections_near_a_wall_move_less),
      cmocka_unit_test(fresnel_lets_the_bottom_through),
      cmocka_unit_test(the_split_keeps_one_half_flat),
      cmocka_unit_test(a_script_replays_alike_at_any_frame_rate),
      cmocka_unit_test(a_scripted_stroke_is_whole),
      cmocka_unit_test(wrong_scripts_are_refused_with_their_line),
      cmocka_unit_test(the_mouse_finds_water_and_what_hides_it),
  };
  return cmocka_run_group_tests(tests, write_file, remove_file);
}
