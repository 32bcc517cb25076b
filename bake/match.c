/* match - whether layers pay: what a viewer would make of the probe's tests (probe.h) from layers
 * of 8 x 8 directions.
 *
 * Fogs tell how far along the mirrored ray, or the one that leaves a slab, the thing X is that a
 * texel shows in a test's direction. Of each of the four slices around that direction, the texel is
 * found whose own such ray passes X nearest: that is the place at which a viewer reads the slice.
 * Rendered, and mixed with the texel's own radiance, they give an error that is compared with that
 * of mixing slices at the texel itself (choose.c). Where heights mean nothing, as in other glass,
 * or texels are too coarse for a surface's bends, it comes out no better. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cover.h"
#include "fail.h"
#include "fog.h"
#include "probe.h"
#include "texel_frame.h"

/* About how far away what a surface reflects is taken to be, until that is measured: its own size.
 * Fogs of that distance tell those from a hundredth to five times as far. */
static double first_far(const surface *self) {
  double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
  for (size_t i = 0; i < (size_t)self->column_count * self->row_count; i++)
    for (int k = 0; k < 3; k++) {
      low[k] = fmin(low[k], self->vertices[i].position[k]);
      high[k] = fmax(high[k], self->vertices[i].position[k]);
    }
  return hypot(hypot(high[0] - low[0], high[1] - low[1]), high[2] - low[2]);
}

/* Layers are worth asking for if they may be chosen, and fewer directions of the plain way do not
 * do. */
static void print_fogs(surface *self, const char *choice) {
  FILE *file = fopen(choice, "r");
  uint32_t directions;
  if (!file || fscanf(file, "%u", &directions) != 1) fail("%s: expected a number", choice);
  fclose(file);
  fog_set fogs = fogs_of(self, first_far(self));
  for (int i = 0; i < FOG_COUNT; i++)
    if (self->auto_layers && !self->hdr && directions > MATCH_DIRECTIONS)
      printf("%d %.10g %g\n", i, fogs.fogs[i].distance, fogs.fogs[i].grey);
}

/* The tests as seen, without and through fogs. */
typedef struct {
  const surface *self;
  fog_set fogs;
  texel_grid grid;
  size_t texel_count, view_size; /* of a view of the probe's grid: texels, numbers */
  view_list views;
  float *full, *through[FOG_COUNT];
} test_set;

static test_set read_tests(const surface *self, const char *path) {
  test_set tests = {.self = self,
                    .fogs = fogs_of(self, first_far(self)),
                    .grid = probe_grid(self),
                    .views = light_views(self, 1)};
  tests.texel_count = (size_t)tests.grid.u_count * tests.grid.v_count;
  tests.view_size = 3 * tests.texel_count;
  tests.full = frame_read_means(path, self->planar, tests.grid, &tests.views, NULL);
  for (int i = 0; i < FOG_COUNT; i++) {
    char *through = format_text("%s.%d", path, i);
    tests.through[i] = frame_read_means(through, self->planar, tests.grid, &tests.views, NULL);
    free(through);
  }
  return tests;
}

static void free_tests(test_set *tests) {
  for (int i = 0; i < FOG_COUNT; i++) free(tests->through[i]);
  free(tests->full);
  free(tests->views.stn);
}

/* Distance of what texel i of a test reflects, or 0. */
static float reflected_distance(const test_set *tests, int test, size_t i) {
  size_t at = (1 + test) * tests->view_size + 3 * i;
  float own[3], reflected[3], distance;
  return fog_split(&tests->fogs, tests->full + at, tests->through, at, own, reflected, &distance)
             ? distance
             : 0;
}

static int compare_floats(const void *a, const void *b) {
  float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

/* The median over what reflects; 0 if not even a tenth does. */
static float median_distance(const test_set *tests) {
  size_t count = PROBE_TEST_COUNT * tests->texel_count, found = 0;
  float *distances = allocate(count, sizeof *distances, "distances");
  for (int test = 0; test < PROBE_TEST_COUNT; test++)
    for (size_t i = 0; i < tests->texel_count; i++) {
      float distance = reflected_distance(tests, test, i);
      if (distance > 0) distances[found++] = distance;
    }
  qsort(distances, found, sizeof *distances, compare_floats);
  float median = 10 * found >= count ? distances[found / 2] : 0;
  free(distances);
  return median;
}

typedef struct {
  double origin[3], direction[3];
  int sides[2]; /* of a slab that are passed on the way through it, along u and along v */
} ray;

/* How often a slab's sides are passed by what leaves it at `point`: what they mirror is seen on
 * past them as if they were not there. */
static int sides_passed(const double corner[3], const double edge[3], const double point[3]) {
  double along = 0, square = 0;
  for (int k = 0; k < 3; k++)
    along += (point[k] - corner[k]) * edge[k], square += edge[k] * edge[k];
  return (int)floor(along / square);
}

/* The ray along which a viewer in direction stn sees further by way of the texel's centre: mirrored
 * there, or through a slab (slf.h) from where it leaves that on. */
static ray beyond(const surface *self, const texel_frame *at, const double stn[3]) {
  const slf_slab *slab = &self->slab;
  bool mirror = !(slab->thickness > 0);
  const double on[3] = {-stn[0], -stn[1], mirror ? stn[2] : -stn[2]};
  ray out = {.sides = {0, 0}};
  memcpy(out.origin, at->position, sizeof out.origin);
  texel_frame_to_scene(at, on, out.direction);
  if (mirror) return out;
  double depth = sqrt(slab->ior * slab->ior - stn[0] * stn[0] - stn[1] * stn[1]), through[3];
  texel_frame_to_scene(at, (const double[3]){on[0], on[1], -depth}, through);
  for (int k = 0; k < 3; k++) out.origin[k] += slab->thickness / depth * through[k];
  out.sides[0] = sides_passed(self->corner, self->edge_u, out.origin);
  out.sides[1] = sides_passed(self->corner, self->edge_v, out.origin);
  return out;
}

/* The square of the distance at which a ray passes the point that another shows; infinite if that
 * lies behind it, or is seen past other sides. */
static double miss(const ray *from, const ray *shown, const double point[3]) {
  if (memcmp(from->sides, shown->sides, sizeof from->sides)) return INFINITY;
  double along = 0, square = 0;
  for (int k = 0; k < 3; k++) {
    double x = point[k] - from->origin[k];
    along += x * from->direction[k], square += x * x;
  }
  return along > 0 ? square - along * along : INFINITY;
}

/* `own` if none shows it. */
static uint32_t nearest_ray(const ray *rays, size_t count, const ray *shown, float distance,
                            uint32_t own) {
  uint32_t nearest = own;
  double least = INFINITY, point[3];
  for (int k = 0; k < 3; k++) point[k] = shown->origin[k] + distance * shown->direction[k];
  for (size_t i = 0; i < count; i++) {
    double next = miss(&rays[i], shown, point);
    if (next < least) least = next, nearest = (uint32_t)i;
  }
  return nearest;
}

static uint32_t grid_texel(const test_set *tests, size_t i) {
  const texel_grid *grid = &tests->grid;
  uint32_t u = grid->u_first + (uint32_t)i % grid->u_count * grid->u_step;
  uint32_t v = grid->v_first + (uint32_t)i / grid->u_count * grid->v_step;
  return v * tests->self->u_count + u;
}

/* Of each view of match_views the texels. */
static void print_places(const test_set *tests, const texel_frame *frames) {
  size_t texel_count = (size_t)tests->self->u_count * tests->self->v_count;
  view_list views = match_views();
  ray *rays = allocate(texel_count, sizeof *rays, "rays");
  for (int view = 0; view < MATCH_COUNT; view++)
    for (size_t i = 0; i < tests->texel_count; i++) printf("%u\n", grid_texel(tests, i));
  for (int view = 0; view < MATCH_COUNT; view++) {
    int test = view / 4;
    for (size_t i = 0; i < texel_count; i++)
      rays[i] = beyond(tests->self, &frames[i], views.stn[MATCH_COUNT + view]);
    for (size_t i = 0; i < tests->texel_count; i++) {
      uint32_t texel = grid_texel(tests, i);
      float distance = reflected_distance(tests, test, i);
      ray seen = beyond(tests->self, &frames[texel], tests->views.stn[1 + test]);
      printf("%u\n", distance > 0 ? nearest_ray(rays, texel_count, &seen, distance, texel) : texel);
    }
  }
  free(rays);
  free(views.stn);
}

/* Own and reflected radiance of all numbers of the views, by the near black fog alone. */
static void split_views(const fog_set *fogs, size_t count, const float *full, float *own,
                        float *reflected) {
  for (size_t i = 0; i < count; i++) {
    own[i] = fminf(own[i] * (1 / fogs->t_near_start), full[i]);
    reflected[i] = full[i] - own[i];
  }
}

/* The worst test's error. */
static double layered_error(const test_set *tests, const char *full_path, const char *near_path) {
  view_list views = match_views();
  size_t size = tests->view_size, count = 2 * MATCH_COUNT * size;
  float *full = frame_read_means(full_path, false, tests->grid, &views, NULL);
  float *own = frame_read_means(near_path, false, tests->grid, &views, NULL);
  float *reflected = allocate(count, sizeof *reflected, "reflected");
  split_views(&tests->fogs, count, full, own, reflected);
  double worst = 0;
  for (int test = 0; test < PROBE_TEST_COUNT; test++) {
    slice slices[4];
    const float *mixed[8];
    double weights[8];
    probe_mix(MATCH_DIRECTIONS, (uint32_t)test, slices, weights);
    memcpy(weights + 4, weights, 4 * sizeof *weights);
    for (size_t k = 0; k < 4; k++) {
      mixed[k] = own + (4 * (size_t)test + k) * size;
      mixed[4 + k] = reflected + (MATCH_COUNT + 4 * (size_t)test + k) * size;
    }
    const float *truth = tests->full + (1 + (size_t)test) * size;
    worst = fmax(worst, probe_error(truth, size, mixed, weights, 8));
  }
  free(reflected);
  free(own);
  free(full);
  free(views.stn);
  return worst;
}

int main(int argc, char **argv) {
  bool fogs = argc == 5 && !strcmp(argv[1], "fogs"),
       places = argc == 6 && !strcmp(argv[1], "places");
  if (!fogs && !places && !(argc == 6 && !strcmp(argv[1], "error"))) {
    fputs(
        "usage: match fogs FOLDER SURFACE CHOICE > FOGS          none if layers are out of "
        "question\n"
        "       match places FOLDER SURFACE RAYS TESTS > PLACES  none if it hardly reflects\n"
        "       match error FOLDER SURFACE TESTS MATCH           prints the error and a distance\n"
        "TESTS.N and MATCH.N are seen through fog N\n",
        stderr);
    return 2;
  }
  surface *self = surface_read(argv[2], argv[3]);
  if (fogs) {
    print_fogs(self, argv[4]);
  } else {
    test_set tests = read_tests(self, argv[places ? 5 : 4]);
    float distance = median_distance(&tests);
    bool seen = fog_is_seen(&tests.fogs, tests.through, tests.view_size * tests.views.view_count);
    if (places && seen && distance > 0) {
      uint32_t table_rays = (uint32_t)atoi(argv[4]);
      size_t texel_count = (size_t)self->u_count * self->v_count;
      float *table = texel_frames_read(argv[2], self, table_rays);
      texel_frame *frames = allocate(texel_count, sizeof *frames, self->name);
      for (size_t i = 0; i < texel_count; i++)
        frames[i] = texel_frame_of_centre(self, table, table_rays, i);
      print_places(&tests, frames);
      free(frames);
      free(table);
    }
    if (!places) {
      char *near_path = format_text("%s.%d", argv[5], NEAR_BLACK);
      printf("%.4f %.4g\n", layered_error(&tests, argv[5], near_path), distance);
      free(near_path);
    }
    free_tests(&tests);
  }
  surface_free(self);
  if (fflush(stdout) || ferror(stdout)) fail("surface '%s': its match cannot be written", argv[3]);
  return 0;
}
