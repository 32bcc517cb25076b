/* The resampler against a light field with a closed form: what is left is interpolation over
 * directions (h^2 / 8 times the second derivative), over texels, and 8-bit codes. */
#include "tests/stability/closed_form.h"
#include "viewer/texture.h"

/* ---- Meshes -----------------------------------------------------------------------------------
 */

enum { SIDES = 48, RINGS = 6 };

/* A cylinder about y of radius 1 and height 1, u around it with a seam, v down it. */
static slf_vertex cylinder_at(float u, float v) {
  float angle = u * (float)(2 * M_PI);
  return (slf_vertex){.position = {cosf(angle), 1 - v, sinf(angle)},
                      .normal = {cosf(angle), 0, sinf(angle)},
                      .tangent_u = {-sinf(angle), 0, cosf(angle)},
                      .tangent_v = {0, -1, 0}};
}

static camera looking(float x, float y, float z, float ax, float ay, float az) {
  slf_view view = {.location = {x, y, z}, .look_at = {ax, ay, az}, .angle_deg = 100};
  return camera_of_view(&view, 1, 1);
}

/* ---- Tests -------------------------------------------------------------------------------------
 */

/* Largest error over the square's texels, in linear radiance, seen from `eye`. */
static double square_error(uint32_t directions, uint32_t dice_px, const float eye[3],
                           double *least_n, double *rms) {
  grid square = make_grid(1, 1, square_at);
  shiny x;
  make_shiny(&x, &square.mesh, 64, 64, directions, dice_px);
  camera c = looking(eye[0], eye[1], eye[2], 0.5f, 0, 0.5f);
  texture_update(&x.texture, &c, (direction_bend){0});
  assert_int_equal(x.texture.made_count, 64);
  assert_int_equal(x.field.fetches, 64); /* each block of texels asks once */
  double worst = 0, sum = 0;
  *least_n = 1;
  for (uint32_t row = 0; row < 64; row++)
    for (uint32_t column = 0; column < 64; column++) {
      double u = (column + 0.5) / 64, v = (row + 0.5) / 64;
      double d[3] = {eye[0] - u, eye[1], eye[2] - v};
      double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
      *least_n = fmin(*least_n, d[1] / length);
      const uint16_t *texel = texel_at(&x, column, row);
      assert_int_equal(texel[3], HALF_ONE);
      for (int k = 0; k < 3; k++) {
        double exact = radiance(u, v, d[0] / length, d[2] / length, k);
        double error = fabs(float_from_half(texel[k]) - exact);
        worst = fmax(worst, error);
        sum += error * error;
      }
    }
  *rms = sqrt(sum / (64 * 64 * 3));
  free_shiny(&x);
  free_grid(&square);
  return worst;
}

/* The bound, term by term, in linear radiance. */
static double error_bound(uint32_t directions, uint32_t dice_px, double nearest, double least_n) {
  double h = 2.0 / directions; /* in s */
  /* The outermost samples sit h / 2 inside the circle's box; beyond them the mix stays constant. */
  double reach = fmax(0, sqrt(1 - least_n * least_n) - (1 - h / 2));
  double mixing = h * h / 8 * 2 * amplitude * wave * wave;
  /* (s,t) is linear over a right triangle with legs of dice_px texels: hypotenuse^2 / 8 times the
   * second derivative of a unit vector, at most 2 / r^2, in s and in t. */
  double leg = dice_px / 64.0;
  double dicing = 2 * leg * leg / 8 * 2 / (nearest * nearest) * 2 * amplitude * wave;
  /* A tap's code is half a code off, 2.28/255 a code at white and less below; at radiance 0.7 the
   * slope is 1.9. The curve is within 0.3 of a code, a half float within 2^-12 of its value. */
  double codes = (0.5 + 0.3) * 1.9 / 255 + 0.7 / 4096;
  return mixing + dicing + codes + reach * amplitude * wave;
}

static void test_square_is_within_its_bound(void **state) {
  (void)state;
  /* From overhead to grazing: seen from (-1, 0.11, 0.5) the far corners have n = 0.05. */
  static const float eyes[][3] = {
      {0.5f, 1.5f, 0.5f}, {-1, 1, 0.2f}, {-1, 0.3f, 0.5f}, {-1, 0.11f, 0.5f}};
  for (uint32_t directions = 8; directions <= 64; directions *= 2)
    for (size_t i = 0; i < sizeof eyes / sizeof *eyes; i++) {
      double nearest = i == 0 ? 1.5 : 1, least_n, rms;
      double worst = square_error(directions, 8, eyes[i], &least_n, &rms);
      double bound = error_bound(directions, 8, nearest, least_n);
      print_message("%2u directions, n >= %.3f: error %.5f (rms %.5f), bound %.5f\n", directions,
                    least_n, worst, rms, bound);
      assert_true(worst <= bound);
      if (i == 3) assert_true(least_n < 0.056);
    }
}

static void test_finer_directions_and_dicing_help(void **state) {
  (void)state;
  const float eye[3] = {-1, 0.3f, 0.5f};
  double n, coarse, fine;
  square_error(8, 8, eye, &n, &coarse);
  square_error(16, 8, eye, &n, &fine);
  /* Halving h divides the mixing error by four; 2.5 leaves room for the codes' share. */
  assert_true(fine * 2.5 < coarse);
  square_error(64, 64, eye, &n, &coarse);
  square_error(64, 8, eye, &n, &fine);
  /* 64 texels instead of 8: the dicing error is 64 times larger and dominates. */
  assert_true(fine * 4 < coarse);
}

static void test_vector_kernel_equals_plain_c(void **state) {
  (void)state;
  closed_form f = closed_form_make(8, 8, 13, 32);
  uint16_t texels[2][256];
  srand(1);
  for (int round = 0; round < 2000; round++) {
    block_directions d;
    /* From directions that agree to ones spread over all of the circle and beyond. */
    float spread = powf(10, (float)(round % 8) - 6),
          s = (float)rand() / (float)RAND_MAX * 1.4f - 0.2f,
          t = (float)rand() / (float)RAND_MAX * 1.4f - 0.2f;
    d.mask = round % 3 ? ((uint64_t)rand() << 33) ^ ((uint64_t)rand() << 11) ^ (uint64_t)rand()
                       : ~(uint64_t)0;
    for (int k = 0; k < 64; k++) {
      d.s[k] = s + spread * ((float)rand() / (float)RAND_MAX - 0.5f);
      d.t[k] = t + spread * ((float)rand() / (float)RAND_MAX - 0.5f);
    }
    if (round % 5 == 0) d.s[round % 64] = NAN, d.t[(round + 7) % 64] = INFINITY;
    for (int kernel = 0; kernel < 2; kernel++) {
      resampler *r = resampler_create(13, 32, closed_form_source(&f));
      resampler_use_kernel(r, kernel ? RESAMPLE_PLAIN_C : RESAMPLE_BEST);
      resample_block(r, 0, 0, &d, texels[kernel], 64);
      resample_flush(r);
      resampler_free(r);
    }
    assert_memory_equal(texels[0], texels[1], 512);
    for (int k = 0; k < 64; k++)
      assert_int_equal(texels[0][4 * k + 3], d.mask >> k & 1 ? HALF_ONE : 0);
  }
  closed_form_free(&f);
}

static void fetch_flat(void *context, uint32_t block_u, uint32_t block_v, const slice_index *slices,
                       size_t count, const uint8_t **u_blocks) {
  (void)block_u, (void)block_v, (void)slices;
  for (size_t i = 0; i < count; i++) u_blocks[i] = context;
}

static void test_equal_taps_keep_their_code(void **state) {
  (void)state;
  block_directions d = {.mask = ~(uint64_t)0};
  for (int k = 0; k < 64; k++)
    d.s[k] = 0.3f + 0.006f * (float)k, d.t[k] = 0.71f - 0.004f * (float)k;
  for (int code = 0; code < 256; code++)
    for (int kernel = 0; kernel < 2; kernel++) {
      uint8_t flat[256];
      uint16_t out[256];
      memset(flat, code, sizeof flat);
      resampler *r = resampler_create(16, 16, (block_source){.fetch = fetch_flat, .context = flat});
      resampler_use_kernel(r, kernel ? RESAMPLE_PLAIN_C : RESAMPLE_BEST);
      resample_block(r, 0, 0, &d, out, 64);
      resample_flush(r);
      resampler_free(r);
      for (int k = 0; k < 256; k++)
        if (k % 4 != 3) assert_int_equal(slf_srgb_from_linear(float_from_half(out[k])), code);
    }
}

/* Random triangulations of a grid, diced or not: every texel's centre is in exactly one triangle.
 */
static void test_scan_conversion_is_watertight(void **state) {
  (void)state;
  enum { SIDE = 5 };
  slf_vertex vertices[(SIDE + 1) * (SIDE + 1)];
  uint32_t triangles[6 * SIDE * SIDE];
  srand(2);
  for (int round = 0; round < 200; round++) {
    uint32_t *triangle = triangles, u_count = 1 + (uint32_t)rand() % 90,
             v_count = 1 + (uint32_t)rand() % 90, dice_px = 1 + (uint32_t)rand() % 20;
    for (int j = 0; j <= SIDE; j++)
      for (int i = 0; i <= SIDE; i++) {
        /* Borders stay on the square; inner points move, some of them onto texel centres where a
         * step is at least 8 texels: less than a quarter of a step in all, so that no quad folds.
         */
        bool inner = i > 0 && j > 0 && i < SIDE && j < SIDE;
        float u =
            ((float)i + (inner ? 0.36f * ((float)rand() / (float)RAND_MAX - 0.5f) : 0)) / SIDE;
        float v =
            ((float)j + (inner ? 0.36f * ((float)rand() / (float)RAND_MAX - 0.5f) : 0)) / SIDE;
        if (inner && u_count >= 8 * SIDE && rand() % 2)
          u = (floorf(u * (float)u_count) + 0.5f) / (float)u_count;
        vertices[j * (SIDE + 1) + i] = (slf_vertex){.position = {u, 0, v},
                                                    .normal = {0, 1, 0},
                                                    .tangent_u = {1, 0, 0},
                                                    .tangent_v = {0, 0, 1},
                                                    .u = u,
                                                    .v = v};
        if (i == SIDE || j == SIDE) continue;
        uint32_t a = (uint32_t)(j * (SIDE + 1) + i), b = a + 1, c = a + SIDE + 1, d = c + 1;
        bool turn = rand() % 2;
        memcpy(triangle, turn ? (uint32_t[]){a, c, b, c, b, d} : (uint32_t[]){a, b, d, d, a, c},
               24);
        triangle += 6;
      }
    slf_mesh mesh = {.vertices = vertices,
                     .triangles = triangles,
                     .vertex_count = (SIDE + 1) * (SIDE + 1),
                     .triangle_count = 2 * SIDE * SIDE};
    uv_mesh diced;
    assert_true(uv_mesh_create(&diced, &mesh, u_count, v_count, dice_px));
    size_t block_count = (size_t)diced.block_u_count * diced.block_v_count;
    uint64_t texels = 0;
    for (size_t b = 0; b < block_count; b++) {
      uint64_t all = 0;
      for (uint32_t i = diced.cover_start[b]; i < diced.cover_start[b + 1]; i++) {
        assert_true((all & diced.covers[i].mask) == 0);
        all |= diced.covers[i].mask;
      }
      texels += (uint64_t)__builtin_popcountll(all);
    }
    assert_int_equal(texels, (uint64_t)u_count * v_count);
    /* Dicing kept its promise, 1.0001 for rounding. */
    for (uint32_t i = 0; i < diced.triangle_count; i++)
      for (int k = 0; k < 3; k++) {
        const slf_vertex *a = &diced.vertices[diced.triangles[i].vertex[k]];
        const slf_vertex *b = &diced.vertices[diced.triangles[i].vertex[(k + 1) % 3]];
        assert_true(fabsf(a->u - b->u) * (float)u_count <= (float)dice_px * 1.0002f);
        assert_true(fabsf(a->v - b->v) * (float)v_count <= (float)dice_px * 1.0002f);
      }
    uv_mesh_free(&diced);
  }
}

/* The first and the last column of a cylinder's texture are neighbours across the seam. */
static void test_seam_and_silhouette(void **state) {
  (void)state;
  grid cylinder = make_grid(SIDES, RINGS, cylinder_at);
  shiny x;
  make_shiny(&x, &cylinder.mesh, 192, 32, 32, 8);
  const float eye[3] = {3, 0.5f, 0.4f};
  camera c = looking(eye[0], eye[1], eye[2], 0, 0.5f, 0);
  texture_update(&x.texture, &c, (direction_bend){0});
  int seen = 0, behind = 0;
  double worst = 0;
  for (uint32_t row = 0; row < 32; row++)
    for (uint32_t column = 0; column < 192; column++) {
      double u = (column + 0.5) / 192, v = (row + 0.5) / 32, angle = u * 2 * M_PI;
      double d[3] = {eye[0] - cos(angle), eye[1] - (1 - v), eye[2] - sin(angle)};
      double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
      double n = (d[0] * cos(angle) + d[2] * sin(angle)) / length;
      const uint16_t *texel = texel_at(&x, column, row);
      /* What faces the eye is there; a side of the polygon turns by half of 2 pi / 48. */
      if (n > M_PI / SIDES) assert_int_equal(texel[3], HALF_ONE);
      if (n < -0.5) assert_int_equal(texel[3], 0); /* what does not costs nothing */
      seen += n > 0;
      behind += n < -0.5;
      if (n < 0.05) continue;
      double s = (-d[0] * sin(angle) + d[2] * cos(angle)) / length, t = -d[1] / length;
      for (int k = 0; k < 3; k++)
        worst = fmax(worst, fabs(float_from_half(texel[k]) - radiance(u, v, s, t, k)));
    }
  assert_true(seen > 1000 && behind > 1000);
  /* As error_bound, but that s turns with the surface: a side spans 2 pi / 48 radians, over which
   * s = sin(angle) bends by at most (2 pi / 48)^2 / 8 in each of s and t. */
  double bend = 2 * M_PI / SIDES;
  double bound = error_bound(32, 8, 2, 0.05) + bend * bend / 8 * 2 * amplitude * wave;
  print_message("cylinder: error %.5f, bound %.5f, %d texels face the eye\n", worst, bound, seen);
  assert_true(worst <= bound);
  /* The same picture by plain C. */
  size_t nbytes = x.texture.levels[0].row_nbytes * 32;
  uint8_t *picture = malloc(nbytes);
  memcpy(picture, x.texture.levels[0].texels, nbytes);
  texture_use_kernel(&x.texture, RESAMPLE_PLAIN_C);
  texture_update(&x.texture, &c, (direction_bend){0});
  assert_memory_equal(picture, x.texture.levels[0].texels, nbytes);
  free(picture);
  free_shiny(&x);
  free_grid(&cylinder);
}

/* Of one large quad only the blocks near the view are made, and every texel in view is among them.
 */
static void test_what_is_outside_the_view_costs_nothing(void **state) {
  (void)state;
  grid square = make_grid(1, 1, square_at);
  shiny x;
  make_shiny(&x, &square.mesh, 64, 64, 8, 8);
  /* From straight above, 10 degrees wide: 0.17 x 0.17 of the square, 3 x 3 blocks of 1/8 at most,
   * and as a piece of 8 texels is made or left out as a whole, one more on each side. */
  slf_view view = {.location = {0.3f, 1, 0.4f}, .look_at = {0.3f, 0, 0.4f}, .angle_deg = 10};
  camera c = camera_of_view(&view, 1, 1);
  texture_update(&x.texture, &c, (direction_bend){0});
  assert_in_range(x.texture.made_count, 4, 25);
  srand(8);
  size_t seen = 0, unmade = 0;
  for (int i = 0; i < 300; i++) {
    for (int k = 0; k < 3; k++) {
      view.location[k] = 3 * ((float)rand() / (float)RAND_MAX - 0.5f);
      view.look_at[k] = (float)rand() / (float)RAND_MAX;
    }
    view.location[1] = fabsf(view.location[1]) + 0.01f;
    view.angle_deg = 5 + 100 * (float)rand() / (float)RAND_MAX;
    c = camera_of_view(&view, 4, 3);
    texture_update(&x.texture, &c, (direction_bend){0});
    for (uint32_t row = 0; row < 64; row++)
      for (uint32_t column = 0; column < 64; column++) {
        float point[3] = {((float)column + 0.5f) / 64, 0, ((float)row + 0.5f) / 64};
        bool made = texel_at(&x, column, row)[3] == HALF_ONE, in_view = !camera_outside(&c, point);
        assert_true(made || !in_view);
        seen += in_view;
        unmade += !made;
      }
  }
  assert_true(seen > 100000 && unmade > 100000);
  free_shiny(&x);
  free_grid(&square);
}

/* Below the horizon (S,T) goes on outwards at the same azimuth, so that half way between two eyes
 * as far above as below it lies on the horizon, radius 1, and not inside. */
static void test_directions_continue_below_the_horizon(void **state) {
  (void)state;
  const slf_vertex vertex = {
      .position = {1, 2, 3}, .normal = {0, 1, 0}, .tangent_u = {1, 0, 0}, .tangent_v = {0, 0, 1}};
  for (int i = 0; i < 16; i++)
    for (float n = 0.05f; n < 0.99f; n += 0.1f) {
      float angle = (float)i * 0.4f, r = sqrtf(1 - n * n);
      float along[2] = {r * cosf(angle), r * sinf(angle)}, s[2], t[2];
      for (int below = 0; below < 2; below++) {
        float eye[3] = {1 + 5 * along[0], 2 + (below ? -5 : 5) * n, 3 + 5 * along[1]};
        view_direction(&vertex, eye, &s[below], &t[below]);
      }
      /* Positions and S, T are of order 1 to 8, a few roundings of 2^-24 of that each. */
      assert_true(fabsf(2 * s[0] - 1 - along[0]) < 2e-6f);
      assert_true(fabsf(2 * t[0] - 1 - along[1]) < 2e-6f);
      assert_true(fabsf(0.5f * (s[0] + s[1]) - 0.5f - 0.5f * cosf(angle)) < 4e-6f);
      assert_true(fabsf(0.5f * (t[0] + t[1]) - 0.5f - 0.5f * sinf(angle)) < 4e-6f);
    }
  float s, t;
  view_direction(&vertex, (float[3]){1, 2, 3}, &s, &t); /* on the vertex: from above */
  assert_true(s == 0.5f && t == 0.5f);
  view_direction(&vertex, (float[3]){1, -7, 3}, &s, &t); /* straight below: twice the radius */
  assert_true(hypotf(2 * s - 1, 2 * t - 1) == 2);
}

/* An eye anywhere, on the surface too: some bytes, no NaN on the way (that would trap below), every
 * texel that is made opaque. */
static void test_any_eye(void **state) {
  (void)state;
  grid square = make_grid(1, 1, square_at);
  shiny x;
  make_shiny(&x, &square.mesh, 20, 28, 8, 8);
  static const float eyes[][3] = {{0, 0, 0},
                                  {0.5f, 0, 0.5f},
                                  {1, 0, 1},
                                  {0.3f, -1, 0.2f},
                                  {1e6f, 0, 0},
                                  {0, 1e30f, 0},
                                  {NAN, 1, 0},
                                  {INFINITY, 0, 1},
                                  {0.5f, 1e-30f, 0.5f},
                                  {-3e38f, 3e38f, -3e38f}};
  for (size_t i = 0; i < sizeof eyes / sizeof *eyes; i++) {
    camera c = looking(eyes[i][0], eyes[i][1], eyes[i][2], 0.5f, 0, 0.5f);
    texture_update(&x.texture, &c, (direction_bend){0});
    for (uint32_t b = 0; b < x.texture.mesh.vertex_count; b++)
      assert_true(isfinite(x.texture.s[b]) && isfinite(x.texture.t[b]));
    for (uint32_t row = 0; row < 28; row++)
      for (uint32_t column = 0; column < 20; column++) {
        uint16_t alpha = texel_at(&x, column, row)[3];
        assert_true(alpha == 0 || alpha == HALF_ONE);
      }
  }
  free_shiny(&x);
  free_grid(&square);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_square_is_within_its_bound),
      cmocka_unit_test(test_finer_directions_and_dicing_help),
      cmocka_unit_test(test_vector_kernel_equals_plain_c),
      cmocka_unit_test(test_equal_taps_keep_their_code),
      cmocka_unit_test(test_scan_conversion_is_watertight),
      cmocka_unit_test(test_seam_and_silhouette),
      cmocka_unit_test(test_what_is_outside_the_view_costs_nothing),
      cmocka_unit_test(test_directions_continue_below_the_horizon),
      cmocka_unit_test(test_any_eye),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
