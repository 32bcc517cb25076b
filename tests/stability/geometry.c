/* Hard geometry: cameras on the surface, inside it, very near and very far; poles, silhouettes and
 * seams; polygons without area; dicing to nothing and not at all; surfaces of any size in texels.
 */
#include "viewer/texture.h"

#include <float.h>

#include "slf.h"
#include "tests/stability/closed_form.h"

/* ---- Meshes ------------------------------------------------------------------------------------
 */

/* The unit sphere: U from +x to +z, V from the pole at +y to the one at -y. dP/dU vanishes at the
 * poles; its direction does not, seen along a meridian. */
static slf_vertex sphere_at(float u, float v) {
  slf_vertex x;
  const double longitude = 2 * M_PI * u, angle = M_PI * v;
  const double n[3] = {sin(angle) * cos(longitude), cos(angle), sin(angle) * sin(longitude)};
  const double tu[3] = {-sin(longitude), 0, cos(longitude)};
  const double tv[3] = {cos(angle) * cos(longitude), -sin(angle), cos(angle) * sin(longitude)};
  for (int k = 0; k < 3; k++) {
    x.position[k] = x.normal[k] = (float)n[k];
    x.tangent_u[k] = (float)tu[k];
    x.tangent_v[k] = (float)tv[k];
  }
  return x;
}

enum { SPHERE_COLUMNS = 64, SPHERE_ROWS = 32 }; /* as slf.inc has them */

static camera looking(const float eye[3], const float at[3]) {
  slf_view view = {.angle_deg = 120};
  memcpy(view.location, eye, sizeof view.location);
  memcpy(view.look_at, at, sizeof view.look_at);
  return camera_of_view(&view, 1, 1);
}

static double largest_error(const uint16_t *texel, double u, double v, double s, double t) {
  double worst = 0;
  for (int c = 0; c < 3; c++)
    worst = fmax(worst, fabs(float_from_half(texel[c]) - radiance(u, v, s, t, c)));
  return worst;
}

/* No value of the field is further from another than this. */
static const double field_range = 2 * 0.2 + 0.01;

typedef struct {
  double worst, rms;
} square_errors;

/* Errors over the unit square seen from `eye`, each texel against its own bound: the mix, plus
 * (s,t) taken as linear over a right triangle with legs of `leg`, that is leg^2 / 4 times the
 * second derivative of a unit vector, 2 / r^2, on each axis, r the least distance of the triangle
 * to the eye. Where the eye is nearer than the triangle is long, nothing better than the field's
 * range holds. */
static square_errors check_square(shiny *x, const float eye[3], double leg) {
  const float at[3] = {0.5f, 0, 0.5f};
  const camera c = looking(eye, at);
  const uint32_t u_count = x->field.u_count, v_count = x->field.v_count;
  texture_update(&x->texture, &c, (direction_bend){0});
  square_errors e = {0, 0};
  for (uint32_t row = 0; row < v_count; row++)
    for (uint32_t column = 0; column < u_count; column++) {
      const double u = (column + 0.5) / u_count, v = (row + 0.5) / v_count;
      const double d[3] = {eye[0] - u, eye[1], eye[2] - v};
      const double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
      const double s = d[0] / length, t = d[2] / length;
      const uint16_t *texel = texel_at(x, column, row);
      if (texel[3] == 0) continue; /* not in the view's pyramid */
      const double error = largest_error(texel, u, v, s, t);
      const double nearest = fmax(length - leg * sqrt(2), 0);
      const double dicing = leg * leg / 4 * 2 / (nearest * nearest) * 2 * amplitude * wave;
      const double bound = fmin(mix_error(&x->field, s, t) + dicing + 1e-3, field_range);
      if (!(error <= bound))
        fail_msg("eye %g %g %g, texel %u,%u: error %g, bound %g", (double)eye[0], (double)eye[1],
                 (double)eye[2], column, row, error, bound);
      e.worst = fmax(e.worst, error);
      e.rms += error * error;
    }
  e.rms = sqrt(e.rms / (u_count * v_count));
  return e;
}

/* ---- Where the camera is -----------------------------------------------------------------------
 */

/* Down onto the plane, over the middle of the surface and beside it. */
static void camera_sinks_to_the_plane(void **state) {
  (void)state;
  grid g = make_grid(1, 1, square_at);
  shiny x;
  make_shiny(&x, &g.mesh, 64, 64, 32, UV_DICE_PX);
  static const float heights[] = {1, 0.1f, 1e-2f, 1e-3f, 1e-6f, 1e-20f, 1e-38f, 0x1p-149f, 0};
  for (size_t i = 0; i < sizeof heights / sizeof *heights; i++) {
    const square_errors over = check_square(&x, (float[]){0.437f, heights[i], 0.511f}, 1.0 / 8);
    const square_errors beside = check_square(&x, (float[]){-1, heights[i], 0.511f}, 1.0 / 8);
    assert_true(x.texture.made_count > 0); /* on the plane itself a surface still shows */
    if (heights[i] >= 1e-6f || heights[i] == 0) {
      print_message("# figure: height_over_plane_rms %g %.5f\n", (double)heights[i], over.rms);
      print_message("# figure: height_beside_plane %g %.5f\n", (double)heights[i], beside.worst);
    }
  }
  /* Below it the surface costs nothing. */
  const camera below = looking((float[]){0.5f, -1e-3f, 0.5f}, (float[]){0.5f, 1, 0.5f});
  texture_update(&x.texture, &below, (direction_bend){0});
  assert_int_equal(x.texture.made_count, 0);
  free_shiny(&x);
  free_grid(&g);
}

/* From a millionth of the surface's size away to as far as a camera may be. */
static void camera_goes_far_away(void **state) {
  (void)state;
  grid g = make_grid(1, 1, square_at);
  shiny x;
  make_shiny(&x, &g.mesh, 64, 64, 32, UV_DICE_PX);
  for (double distance = 1e-6; distance < 2e9; distance *= 1000) {
    const float eye[3] = {(float)(0.5 + 0.48 * distance), (float)(0.6 * distance),
                          (float)(0.5 - 0.64 * distance)};
    const square_errors e = check_square(&x, eye, 1.0 / 8);
    print_message("# figure: camera_distance_rms %.0e %.5f\n", distance, e.rms);
  }
  free_shiny(&x);
  free_grid(&g);
}

/* A scene's unit is its author's: from 2^-20 to 2^20 times the size (1e-6 .. 1e6) every byte is the
 * same, because scaling by a power of two is exact. */
static void any_unit_of_length(void **state) {
  (void)state;
  static const int exponents[] = {0, -20, 20};
  uint8_t *first = NULL;
  for (int i = 0; i < 3; i++) {
    grid g = make_grid(SPHERE_COLUMNS, SPHERE_ROWS, sphere_at);
    for (uint32_t k = 0; k < g.mesh.vertex_count; k++)
      for (int axis = 0; axis < 3; axis++)
        g.vertices[k].position[axis] = ldexpf(g.vertices[k].position[axis], exponents[i]);
    shiny x;
    make_shiny(&x, &g.mesh, 128, 64, 16, UV_DICE_PX);
    float eye[3] = {0.3f, 1.7f, -2.2f};
    for (int axis = 0; axis < 3; axis++) eye[axis] = ldexpf(eye[axis], exponents[i]);
    const camera c = looking(eye, (float[3]){0});
    texture_update(&x.texture, &c, (direction_bend){0});
    const size_t nbytes = x.texture.levels[0].row_nbytes * 64;
    if (i == 0) {
      first = malloc(nbytes);
      assert_non_null(first);
      memcpy(first, x.texture.levels[0].texels, nbytes);
      assert_true(x.texture.made_count > 32); /* of 128 blocks */
    } else {
      assert_memory_equal(x.texture.levels[0].texels, first, nbytes);
    }
    free_shiny(&x);
    free_grid(&g);
  }
  free(first);
}

/* From inside, every triangle shows its back: nothing is made. A chord of 2 pi / 64 lies at most
 * 0.0025 below the sphere. */
static void camera_inside_the_object(void **state) {
  (void)state;
  grid g = make_grid(SPHERE_COLUMNS, SPHERE_ROWS, sphere_at);
  shiny x;
  make_shiny(&x, &g.mesh, 128, 64, 16, UV_DICE_PX);
  static const float eyes[][3] = {
      {0, 0, 0}, {1e-6f, 0, -1e-6f}, {0.9f, 0, 0}, {0.57f, 0.57f, 0.57f}};
  for (int i = 0; i < 8; i++) {
    const float *eye = eyes[i / 2];
    const camera c = looking(eye, (float[]){eye[0], eye[1] + (float)(i % 2), eye[2] + 0.5f});
    texture_update(&x.texture, &c, (direction_bend){0});
    /* The polygons at the poles have an edge of no length; either side of them may count. */
    uint32_t at_poles = 0;
    for (uint32_t b = 0; b < 128; b++)
      if (b / 16 == 0 || b / 16 == 7) at_poles += x.texture.made[b];
    assert_int_equal(x.texture.made_count, at_poles);
    if (i % 2 == 0) assert_int_equal(at_poles, 0); /* out of the picture */
  }
  free_shiny(&x);
  free_grid(&g);
}

static float any_float(void) {
  uint32_t bits = (uint32_t)rand() << 16 ^ (uint32_t)rand();
  float x;
  memcpy(&x, &bits, sizeof x);
  return x;
}

/* Any bits at all give a camera with finite, orthonormal axes, and a texture of finite directions.
 */
static void any_camera(void **state) {
  (void)state;
  grid g = make_grid(2, 2, square_at);
  shiny x;
  make_shiny(&x, &g.mesh, 24, 24, 8, UV_DICE_PX);
  srand(8);
  for (int round = 0; round < 20000; round++) {
    slf_view view = {.angle_deg = any_float()};
    for (int k = 0; k < 3; k++) view.location[k] = any_float(), view.look_at[k] = any_float();
    if (round % 4 == 0) memcpy(view.look_at, view.location, sizeof view.look_at);
    if (round % 4 == 1) /* along the sky */
      view.look_at[0] = view.location[0], view.look_at[2] = view.location[2];
    const camera c = camera_of_view(&view, 1 + rand() % 3000, 1 + rand() % 3000);
    const float *axes[3] = {c.right, c.up, c.forward};
    for (int i = 0; i < 3; i++)
      for (int k = 0; k <= i; k++) {
        const float dot =
            axes[i][0] * axes[k][0] + axes[i][1] * axes[k][1] + axes[i][2] * axes[k][2];
        /* right is taken as +x where forward is the sky to within 1e-6; a few roundings besides. */
        assert_true(fabsf(dot - (i == k ? 1 : 0)) < 3e-6f);
      }
    assert_true(isfinite(c.tan_x) && c.tan_x > 0 && isfinite(c.tan_y) && c.tan_y > 0);
    float matrix[16];
    camera_clip_matrix(&c, 0.01f, 1000, matrix);
    for (int i = 0; i < 16; i++) assert_true(isfinite(matrix[i]));
    if (round % 40) continue;
    texture_update(&x.texture, &c, (direction_bend){0});
    for (uint32_t i = 0; i < x.texture.mesh.vertex_count; i++)
      assert_true(isfinite(x.texture.s[i]) && isfinite(x.texture.t[i]));
  }
  free_shiny(&x);
  free_grid(&g);
}

/* ---- Curved surfaces ---------------------------------------------------------------------------
 */

typedef struct {
  double s, t, n; /* the direction to the eye in the frame at a texel */
} seen_direction;

static seen_direction seen_on_sphere(double u, double v, const float eye[3]) {
  const double longitude = 2 * M_PI * u, angle = M_PI * v;
  const double n[3] = {sin(angle) * cos(longitude), cos(angle), sin(angle) * sin(longitude)};
  const double tu[3] = {-sin(longitude), 0, cos(longitude)};
  const double tv[3] = {cos(angle) * cos(longitude), -sin(angle), cos(angle) * sin(longitude)};
  const double d[3] = {eye[0] - n[0], eye[1] - n[1], eye[2] - n[2]};
  const double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
  seen_direction x = {0, 0, 0};
  for (int k = 0; k < 3; k++) {
    x.s += d[k] * tu[k] / length;
    x.t += d[k] * tv[k] / length;
    x.n += d[k] * n[k] / length;
  }
  return x;
}

/* What a mesh and dicing cost on the unit sphere at distance r from the eye: frames turn by b = 2
 * pi / 64 over a side; a second derivative of (s,t) over a side is at most (b + b / r)^2, on each
 * of two sides and axes, an eighth of it is the error; near a pole the longitude of the frame does
 * it all, and the same holds, because it turns by b there too. The vertices of a diced triangle lie
 * on chords, up to b^2 / 8 too low, which turns the direction by b^2 / 8 / r. */
static double sphere_bound(const closed_form *f, seen_direction d, double r) {
  const double b = 2 * M_PI / SPHERE_COLUMNS, bend = b + b / r;
  return mix_error(f, d.s, d.t) + (2 * 2 * bend * bend / 8 + 2 * b * b / 8 / r) * amplitude * wave;
}

/* Poles, seam and silhouette of a sphere, by how near to the silhouette a texel is. */
static void sphere_to_its_silhouette(void **state) {
  (void)state;
  enum { U = 256, V = 128 };
  grid g = make_grid(SPHERE_COLUMNS, SPHERE_ROWS, sphere_at);
  shiny x;
  make_shiny(&x, &g.mesh, U, V, 32, UV_DICE_PX);
  /* Over the pole, beside it, level, across the seam. */
  static const float eyes[][3] = {
      {0, 3, 0}, {0.05f, -3, 0.02f}, {0, 0, 3}, {3, 0.2f, 1e-3f}, {1, 1, -1}};
  static const double edges[] = {0.5, 0.2, 0.1, 0.05, 0.02, 0};
  enum { BINS = sizeof edges / sizeof *edges };
  double by_n[BINS] = {0}, at_pole = 0, at_seam = 0;
  for (size_t i = 0; i < sizeof eyes / sizeof *eyes; i++) {
    const float *eye = eyes[i];
    const camera c = looking(eye, (float[3]){0});
    texture_update(&x.texture, &c, (direction_bend){0});
    for (uint32_t row = 0; row < V; row++)
      for (uint32_t column = 0; column < U; column++) {
        const double u = (column + 0.5) / U, v = (row + 0.5) / V;
        const seen_direction d = seen_on_sphere(u, v, eye);
        const uint16_t *texel = texel_at(&x, column, row);
        /* A chord's plane turns by half of 2 pi / 64: what faces the eye by more is there. */
        if (d.n > M_PI / SPHERE_COLUMNS) assert_int_equal(texel[3], HALF_ONE);
        if (d.n < 0 || texel[3] == 0) continue;
        const double error = largest_error(texel, u, v, d.s, d.t);
        const double r = hypot(hypot(eye[0], eye[1]), eye[2]) - 1;
        const double bound = sphere_bound(&x.field, d, r);
        if (!(error <= bound))
          fail_msg("eye %g %g %g, texel %u,%u, n = %g: error %g, bound %g", (double)eye[0],
                   (double)eye[1], (double)eye[2], column, row, d.n, error, bound);
        int bin = 0;
        while (d.n < edges[bin]) bin++;
        by_n[bin] = fmax(by_n[bin], error);
        if (row == 0 || row == V - 1) at_pole = fmax(at_pole, error);
        if (column == 0 || column == U - 1) at_seam = fmax(at_seam, error);
      }
  }
  for (int bin = 0; bin < BINS; bin++)
    print_message("# figure: silhouette_n %g %.5f\n", edges[bin], by_n[bin]);
  print_message("sphere: error %.5f at the poles, %.5f at the seam\n", at_pole, at_seam);
  free_shiny(&x);
  free_grid(&g);
}

/* An octahedron of eight polygons with a sphere's normals: each crosses the silhouette from almost
 * everywhere, and frames of its corners are 90 degrees apart, or opposite at the poles. No closed
 * form bounds that; what is promised is that texels which face the eye are there and are radiance
 * of the field, not of a slice that does not exist. */
static void few_polygons_across_the_silhouette(void **state) {
  (void)state;
  grid g = make_grid(4, 2, sphere_at);
  shiny x;
  make_shiny(&x, &g.mesh, 96, 48, 16, UV_DICE_PX);
  srand(9);
  for (int round = 0; round < 200; round++) {
    float eye[3];
    for (int k = 0; k < 3; k++) eye[k] = 4 * (float)rand() / (float)RAND_MAX - 2;
    const camera c = looking(eye, (float[3]){0});
    texture_update(&x.texture, &c, (direction_bend){0});
    for (uint32_t b = 0; b < x.texture.mesh.block_u_count * x.texture.mesh.block_v_count; b++)
      for (uint32_t k = 0; k < 64; k++) {
        const uint16_t *texel = texel_at(&x, b % 12 * 8 + k % 8, b / 12 * 8 + k / 8);
        assert_int_equal(texel[3], x.texture.made[b] ? HALF_ONE : 0);
        if (!texel[3]) continue;
        const double light = float_from_half(texel[0]);
        assert_true(fabs(light - 0.5) <= amplitude + code_error);
      }
  }
  free_shiny(&x);
  free_grid(&g);
}

/* ---- Polygons in (U,V) -------------------------------------------------------------------------
 */

/* Columns of quads that are 2^-k wide, down to less than a 256th of a texel, or nothing at all:
 * every texel is still covered once, and by interpolation that holds. */
static float sliver_u(float u) {
  const int column = (int)lroundf(u * 24);
  return column == 0 ? 0 : column >= 22 ? 1 : ldexpf(1, column - 21);
}

static slf_vertex slivers_at(float u, float v) {
  return square_at(sliver_u(u), v);
}

static void slivers_and_polygons_without_area(void **state) {
  (void)state;
  grid g = make_grid(24, 3, slivers_at);
  for (uint32_t i = 0; i < g.mesh.vertex_count; i++) g.vertices[i].u = sliver_u(g.vertices[i].u);
  static const uint32_t limits[] = {1, 8, UINT32_MAX};
  for (int i = 0; i < 3; i++) {
    shiny x;
    make_shiny(&x, &g.mesh, 40, 56, 16, limits[i]);
    const uv_mesh *mesh = &x.texture.mesh;
    for (uint32_t b = 0; b < mesh->block_u_count * mesh->block_v_count; b++) {
      uint64_t all = 0;
      for (uint32_t k = mesh->cover_start[b]; k < mesh->cover_start[b + 1]; k++) {
        assert_true((all & mesh->covers[k].mask) == 0);
        all |= mesh->covers[k].mask;
      }
      assert_true(all == ~(uint64_t)0);
    }
    for (uint32_t k = 0; k < mesh->triangle_count; k++)
      for (int m = 0; m < 4; m++) assert_true(isfinite(mesh->triangles[k].m[m]));
    /* A sliver's corners are snapped to 1/256 texel, so its (s,t) may be off by a 1/256 of what
     * they change over its own length: less than dicing of legs of half the square. */
    const square_errors e = check_square(&x, (float[]){0.4f, 1.3f, -0.2f}, i == 2 ? 0.5 : 0.2);
    print_message("slivers, diced to %u: error %.5f\n", limits[i], e.worst);
    free_shiny(&x);
  }
  free_grid(&g);
}

/* (U,V) that a damaged file may hold: outside [0,1], not finite, all in one point. */
static void any_parametrisation(void **state) {
  (void)state;
  static const float odd[] = {0, 1, -1, 2, NAN, INFINITY, -INFINITY, FLT_MAX, 0x1p-149f, 0.5f};
  srand(10);
  for (int round = 0; round < 500; round++) {
    grid g = make_grid(3, 3, square_at);
    for (uint32_t k = 0; k < g.mesh.vertex_count; k++) {
      g.vertices[k].u = round == 0 ? 0.5f : odd[rand() % 10];
      g.vertices[k].v = round == 0 ? 0.5f : odd[rand() % 10];
      if (round % 2) g.vertices[k].position[rand() % 3] = odd[rand() % 10];
      if (round % 3 == 0) g.vertices[k].normal[rand() % 3] = odd[rand() % 10];
      if (round % 5 == 0) memset(g.vertices[k].tangent_u, 0, sizeof g.vertices[k].tangent_u);
    }
    shiny x;
    make_shiny(&x, &g.mesh, 17, 9, 6, 1 + (uint32_t)rand() % 20);
    const camera c = looking((float[]){0.5f, 1, 0.3f}, (float[]){0.5f, 0, 0.5f});
    texture_update(&x.texture, &c, (direction_bend){0});
    for (uint32_t row = 0; row < 9; row++)
      for (uint32_t column = 0; column < 17; column++) {
        const uint16_t alpha = texel_at(&x, column, row)[3];
        assert_true(alpha == 0 || alpha == HALF_ONE);
      }
    free_shiny(&x);
    free_grid(&g);
  }
}

/* From every texel a polygon to two polygons for all: the error of dicing falls with its square. */
static void dicing_from_one_texel_to_never(void **state) {
  (void)state;
  grid g = make_grid(1, 1, square_at);
  static const uint32_t limits[] = {1, 2, 4, 8, 16, 32, 64, UINT32_MAX};
  double previous = 0;
  for (size_t i = 0; i < sizeof limits / sizeof *limits; i++) {
    shiny x;
    make_shiny(&x, &g.mesh, 64, 64, 64, limits[i]);
    const square_errors e =
        check_square(&x, (float[]){0.2f, 0.5f, 0.3f}, limits[i] < 64 ? limits[i] / 64.0 : 1);
    print_message("# figure: dicing_px_rms %u %.5f\n", limits[i] < 64 ? limits[i] : 64, e.rms);
    /* 3 % for rounding to codes, which is all that is left below 4 texels. */
    assert_true(e.rms > 0.97 * previous);
    previous = e.rms;
    /* The square is 64 texels, so no limit beyond that changes anything. */
    if (limits[i] >= 64) assert_int_equal(x.texture.mesh.triangle_count, 2);
    if (limits[i] == 1) assert_int_equal(x.texture.mesh.triangle_count, 2 * 64 * 64);
    free_shiny(&x);
  }
  free_grid(&g);
}

/* One texel, and sizes that blocks of eight do not divide. */
static void surfaces_of_any_size(void **state) {
  (void)state;
  static const uint32_t sizes[] = {1, 2, 7, 8, 9, 17, 63};
  enum { SIZES = sizeof sizes / sizeof *sizes };
  grid g = make_grid(1, 1, square_at);
  double one = 0;
  for (int i = 0; i < SIZES * SIZES; i++) {
    const uint32_t u_count = sizes[i % SIZES], v_count = sizes[i / SIZES];
    shiny x;
    make_shiny(&x, &g.mesh, u_count, v_count, 16, UV_DICE_PX);
    /* A leg of 8 texels, or the whole side. */
    const double leg = fmin(1, 8.0 / (u_count < v_count ? u_count : v_count));
    const square_errors e = check_square(&x, (float[]){0.3f, 1.5f, 0.8f}, leg);
    if (i == 0) one = e.worst;
    for (uint32_t row = 0; row < v_count; row++)
      for (uint32_t column = 0; column < u_count; column++)
        assert_int_equal(texel_at(&x, column, row)[3], HALF_ONE);
    free_shiny(&x);
  }
  print_message("a surface of one texel: error %.5f\n", one);
  free_grid(&g);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(camera_sinks_to_the_plane),
      cmocka_unit_test(camera_goes_far_away),
      cmocka_unit_test(any_unit_of_length),
      cmocka_unit_test(camera_inside_the_object),
      cmocka_unit_test(any_camera),
      cmocka_unit_test(sphere_to_its_silhouette),
      cmocka_unit_test(few_polygons_across_the_silhouette),
      cmocka_unit_test(slivers_and_polygons_without_area),
      cmocka_unit_test(any_parametrisation),
      cmocka_unit_test(dicing_from_one_texel_to_never),
      cmocka_unit_test(surfaces_of_any_size),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
