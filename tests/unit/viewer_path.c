/* Camera paths: through their keys, smooth in between, there and back through files, and the same
 * camera for POV-Ray. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "viewer/camera.h"
#include "viewer/path.h"

static slf_view view_of(float a, float b, float angle_deg) {
  return (slf_view){.location = {a, b, a * b}, .look_at = {b, 1, -a}, .angle_deg = angle_deg};
}

static camera_path example(void) {
  camera_path p = {0};
  static const double times[] = {0, 1, 1.5, 4, 7};
  for (int i = 0; i < 5; i++) {
    slf_view v = view_of((float)(i * i) * 0.3f, 2 - (float)i, 40 + 10 * (float)(i % 3));
    assert_true(path_add(&p, times[i], &v));
  }
  return p;
}

static void test_passes_through_its_keys(void **state) {
  (void)state;
  camera_path p = example();
  for (size_t i = 0; i < p.count; i++) {
    slf_view v = path_at(&p, p.keys[i].time_s);
    for (int k = 0; k < 3; k++) {
      /* Doubles, rounded to float once. */
      assert_true(fabsf(v.location[k] - p.keys[i].view.location[k]) < 1e-6f);
      assert_true(fabsf(v.look_at[k] - p.keys[i].view.look_at[k]) < 1e-6f);
    }
    assert_true(fabsf(v.angle_deg - p.keys[i].view.angle_deg) < 1e-4f);
  }
  /* Held at both ends, NaN at the first. */
  assert_float_equal(path_at(&p, -5).location[1], p.keys[0].view.location[1], 0);
  assert_float_equal(path_at(&p, NAN).location[1], p.keys[0].view.location[1], 0);
  assert_float_equal(path_at(&p, 99).location[1], p.keys[4].view.location[1], 0);
  path_clear(&p);
}

static void test_is_smooth(void **state) {
  (void)state;
  camera_path p = example();
  /* The speed is continuous: across any 2 ms it changes by at most the largest acceleration times
   * that. The keys' slopes are below 5 a second and stretches last 0.5 s or more, so acceleration
   * stays below 6 x 5 / 0.5 + 4 x 5 / 0.5 = 100, and a step of speed at a key would be of order 1.
   */
  double step = 0.002, last = 0;
  for (double t = 2 * step; t < 7 - step; t += step) {
    double speed =
        (path_at(&p, t + step).location[2] - path_at(&p, t - step).location[2]) / (2 * step);
    if (t > 3 * step) assert_true(fabs(speed - last) < 100 * step + 0.01);
    last = speed;
  }
  path_clear(&p);
}

static void test_refuses_what_is_no_path(void **state) {
  (void)state;
  camera_path p = {0};
  slf_view v = view_of(1, 2, 60);
  assert_true(path_add(&p, 1, &v));
  assert_false(path_add(&p, 1, &v));
  assert_false(path_add(&p, 0.5, &v));
  assert_false(path_add(&p, NAN, &v));
  path_clear(&p);
  char name[] = "/tmp/slf_viewer_path_XXXXXX";
  int descriptor = mkstemp(name);
  assert_true(descriptor >= 0);
  close(descriptor);
  static const char *const bad[] = {"",
                                    "# nothing\n",
                                    "0 1 2 3 4 5 6\n",
                                    "0 1 2 3 4 5 6 180\n",
                                    "0 1 2 3 4 5 6 60\n0 1 2 3 4 5 6 60\n",
                                    "0 1 2 nan 4 5 6 60\n",
                                    "0 1 2 3 4 5 6 60 7\n"};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    FILE *out = fopen(name, "w");
    fputs(bad[i], out);
    fclose(out);
    slf_error error = {{0}};
    assert_int_equal(path_read(name, &p, &error), SLF_ERROR_FORMAT);
    assert_non_null(strstr(error.message, name));
    assert_non_null(strstr(error.message, "line"));
    path_clear(&p);
  }
  slf_error error = {{0}};
  unlink(name);
  assert_int_equal(path_read(name, &p, &error), SLF_ERROR_IO);
}

static void test_files(void **state) {
  (void)state;
  char folder[] = "/tmp/slf_viewer_path_XXXXXX", name[64];
  slf_error error;
  assert_non_null(mkdtemp(folder));
  snprintf(name, sizeof name, "%s/a.path", folder);
  camera_path p = example(), back = {0};
  assert_int_equal(path_write(name, &p, &error), SLF_OK);
  assert_int_equal(path_read(name, &back, &error), SLF_OK);
  assert_int_equal(back.count, p.count);
  for (size_t i = 0; i < p.count; i++) {
    assert_true(fabs(back.keys[i].time_s - p.keys[i].time_s) < 1e-4);
    for (int k = 0; k < 3; k++)
      assert_float_equal(back.keys[i].view.location[k], p.keys[i].view.location[k], 1e-6f);
  }
  unlink(name);
  /* 7 s at 10 a second, both ends: 71 cameras. */
  snprintf(name, sizeof name, "%s/b", folder);
  assert_int_equal(path_export_pov(name, &p, 10, 640, 480, &error), SLF_OK);
  snprintf(name, sizeof name, "%s/b.inc", folder);
  FILE *in = fopen(name, "r");
  assert_non_null(in);
  char line[256];
  int vectors = 0;
  while (fgets(line, sizeof line, in)) vectors += line[2] == '<';
  fclose(in);
  assert_int_equal(vectors, 2 * 71);
  unlink(name);
  snprintf(name, sizeof name, "%s/b.ini", folder);
  assert_int_equal(unlink(name), 0);
  assert_int_equal(rmdir(folder), 0);
  path_clear(&p);
  path_clear(&back);
}

/* The image of a point in POV-Ray's perspective camera, from its documentation: x / z and y / z in
 * the camera's left-handed frame, `angle` across the width. */
static void test_camera_is_pov_rays(void **state) {
  (void)state;
  slf_view v = {.location = {1, 2, -3}, .look_at = {0.5f, 0.2f, 1}, .angle_deg = 65};
  camera c = camera_of_view(&v, 640, 400);
  float clip[16], look_at[4] = {0.5f, 0.2f, 1, 1}, image[4];
  camera_clip_matrix(&c, 0.1f, 100, clip);
  for (int row = 0; row < 4; row++)
    image[row] = clip[row] * look_at[0] + clip[4 + row] * look_at[1] + clip[8 + row] * look_at[2] +
                 clip[12 + row];
  assert_true(fabsf(image[0] / image[3]) < 1e-5f && fabsf(image[1] / image[3]) < 1e-5f);
  /* +x is to the right and +y up when looking along +z. */
  v = (slf_view){.location = {0, 0, 0}, .look_at = {0, 0, 1}, .angle_deg = 90};
  c = camera_of_view(&v, 640, 320);
  assert_int_equal(camera_outside(&c, (float[3]){0.99f, 0, 1}), 0);
  assert_int_not_equal(camera_outside(&c, (float[3]){1.01f, 0, 1}), 0);
  assert_int_equal(camera_outside(&c, (float[3]){0, 0.49f, 1}), 0);
  assert_int_not_equal(camera_outside(&c, (float[3]){0, 0.51f, 1}), 0);
  assert_int_not_equal(camera_outside(&c, (float[3]){0, 0, -1}), 0);
  assert_true(c.right[0] == 1 && c.up[1] == 1);
  /* Whatever the view, an orthonormal frame: along the sky, onto itself, not finite. */
  static const slf_view hard[] = {{"", {0, 5, 0}, {0, 0, 0}, 60},
                                  {"", {1, 1, 1}, {1, 1, 1}, 60},
                                  {"", {1e6f, 1e6f, 1e6f}, {0, 0, 0}, 60},
                                  {"", {NAN, 0, INFINITY}, {0, -INFINITY, 0}, NAN}};
  for (size_t i = 0; i < sizeof hard / sizeof *hard; i++) {
    c = camera_of_view(&hard[i], 3, 2);
    const float *axes[3] = {c.right, c.up, c.forward};
    for (int a = 0; a < 3; a++)
      for (int b = 0; b < 3; b++) {
        float product = 0;
        for (int k = 0; k < 3; k++) product += axes[a][k] * axes[b][k];
        assert_true(fabsf(product - (a == b ? 1.0f : 0.0f)) < 1e-5f);
      }
  }
}

static float distance(const float a[3], const float b[3]) {
  return hypotf(hypotf(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);
}

static void test_goes_on_as_it_does(void **state) {
  (void)state;
  const slf_view before = {.location = {3, 1, -4}, .look_at = {0, 1, 0}, .angle_deg = 50};
  slf_view view = before, next;
  view_walk(&view, 0.1f, 0, 0.2f);
  next = view;
  view_walk(&next, 0.1f, 0, 0.2f);
  slf_view ahead = view_ahead(&view, &before);
  /* A few roundings of numbers up to 4. */
  assert_true(distance(ahead.location, next.location) < 4e-6f);
  assert_true(distance(ahead.look_at, next.look_at) < 4e-6f);
  /* On a circle of radius 5 the second difference is 5 step^2. */
  const float step_rad = 0.01f;
  view = next = before;
  view_orbit(&view, step_rad, 0);
  view_orbit(&next, 2 * step_rad, 0);
  ahead = view_ahead(&view, &before);
  assert_true(distance(ahead.location, next.location) < 5 * step_rad * step_rad + 4e-6f);
  view.location[0] = 3e38f;
  view.look_at[1] = NAN;
  ahead = view_ahead(&view, &before);
  for (int k = 0; k < 3; k++) {
    assert_true(fabsf(ahead.location[k]) <= CAMERA_FAR);
    assert_true(fabsf(ahead.look_at[k]) <= CAMERA_FAR);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_passes_through_its_keys), cmocka_unit_test(test_is_smooth),
      cmocka_unit_test(test_refuses_what_is_no_path), cmocka_unit_test(test_files),
      cmocka_unit_test(test_camera_is_pov_rays),      cmocka_unit_test(test_goes_on_as_it_does),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
