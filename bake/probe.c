#include "probe.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fail.h"

const uint32_t probe_candidates[PROBE_CANDIDATE_COUNT] = {4, 8, 16, 32, 64};

static void spread(uint32_t count, uint32_t most, uint32_t *first, uint32_t *step,
                   uint32_t *chosen) {
  *step = count > most ? count / most : 1;
  *chosen = count > most ? most : count;
  *first = *step / 2;
}

static texel_grid spread_grid(const surface *self, uint32_t most) {
  texel_grid grid;
  spread(self->u_count, most, &grid.u_first, &grid.u_step, &grid.u_count);
  spread(self->v_count, most, &grid.v_first, &grid.v_step, &grid.v_count);
  return grid;
}

texel_grid probe_grid(const surface *self) {
  return spread_grid(self, PROBE_MAX_TEXELS);
}

texel_grid light_grid(const surface *self) {
  return spread_grid(self, 4 * PROBE_MAX_TEXELS);
}

texel_grid cost_grid(const surface *self) {
  return spread_grid(self, 8);
}

/* S and T of a test: Vogel's spiral over the disc of directions up to n = 0.3, even in area. */
static void test_place(uint32_t test, double *S, double *T) {
  double radius = sqrt((test + 0.5) / PROBE_TEST_COUNT) * sqrt(1 - 0.3 * 0.3);
  double angle = test * 2.39996322972865332; /* the golden angle */
  *S = 0.5 + 0.5 * radius * cos(angle);
  *T = 0.5 + 0.5 * radius * sin(angle);
}

static uint16_t clamp_index(double index, uint32_t n) {
  return (uint16_t)(index < 0 ? 0 : index > n - 1 ? n - 1 : index);
}

void probe_mix(uint32_t n, uint32_t test, slice slices[4], double weights[4]) {
  double S, T;
  test_place(test, &S, &T);
  double s = S * n - 0.5, t = T * n - 0.5;
  double s_part = s - floor(s), t_part = t - floor(t);
  for (int k = 0; k < 4; k++) {
    slices[k] = (slice){clamp_index(floor(s) + k % 2, n), clamp_index(floor(t) + k / 2, n)};
    weights[k] = (k % 2 ? s_part : 1 - s_part) * (k / 2 ? t_part : 1 - t_part);
  }
}

/* The view along the normal and those from the test directions; returns what comes after. */
static double (*write_tests(uint32_t test_count, uint32_t rays, double (*next)[3]))[3] {
  view_of_slice(1, 1, (slice){0, 0}, rays, next);
  next += rays;
  for (uint32_t test = 0; test < test_count; test++, next += rays) {
    double S, T;
    test_place(test, &S, &T);
    for (uint32_t m = 0; m < rays; m++) slf_direction(S, T, SLF_BAKED_N_MIN, next[m]);
  }
  return next;
}

view_list light_views(const surface *self, uint32_t rays) {
  bool matte = self->s_count == 1 && self->t_count == 1 && !self->auto_error;
  uint32_t test_count = matte ? 0 : PROBE_TEST_COUNT;
  view_list views = {1 + test_count, rays,
                     allocate((size_t)(1 + test_count) * rays, sizeof *views.stn, "light")};
  write_tests(test_count, rays, views.stn);
  return views;
}

view_list probe_views(uint32_t rays) {
  uint32_t count = 1 + PROBE_TEST_COUNT + 4 * PROBE_CANDIDATE_COUNT * PROBE_TEST_COUNT;
  view_list views = {count, rays, allocate((size_t)count * rays, sizeof *views.stn, "probe")};
  double(*next)[3] = write_tests(PROBE_TEST_COUNT, rays, views.stn);
  for (int candidate = 0; candidate < PROBE_CANDIDATE_COUNT; candidate++) {
    uint32_t n = probe_candidates[candidate];
    for (uint32_t test = 0; test < PROBE_TEST_COUNT; test++) {
      slice slices[4];
      double weights[4];
      probe_mix(n, test, slices, weights);
      for (int k = 0; k < 4; k++, next += rays) view_of_slice(n, n, slices[k], rays, next);
    }
  }
  return views;
}

static double displayed(double linear) {
  if (linear <= 0.0031308) return linear <= 0 ? 0 : 12.92 * linear;
  return linear >= 1 ? 1 : 1.055 * pow(linear, 1 / 2.4) - 0.055;
}

double probe_error(const float *truth, size_t size, const float *const *views,
                   const double *weights, int count) {
  double sum = 0;
  for (size_t i = 0; i < size; i++) {
    double mix = 0;
    for (int k = 0; k < count; k++) mix += weights[k] * views[k][i];
    double difference = displayed(mix) - displayed(truth[i]);
    sum += difference * difference;
  }
  return sqrt(sum / (double)size);
}

view_list match_views(void) {
  view_list views = {2 * MATCH_COUNT, 1, allocate(2 * MATCH_COUNT, sizeof *views.stn, "match")};
  for (uint32_t i = 0; i < 2 * MATCH_COUNT; i++) {
    slice slices[4];
    double weights[4];
    probe_mix(MATCH_DIRECTIONS, i % MATCH_COUNT / 4, slices, weights);
    slf_direction((slices[i % 4].s + 0.5) / MATCH_DIRECTIONS,
                  (slices[i % 4].t + 0.5) / MATCH_DIRECTIONS, SLF_BAKED_N_MIN, views.stn[i]);
  }
  return views;
}

uint32_t *match_places_read(const char *folder, const surface *self) {
  char *path = format_text("%s/%s/places", folder, self->name);
  texel_grid grid = probe_grid(self);
  size_t count = (size_t)grid.u_count * grid.v_count * 2 * MATCH_COUNT;
  uint32_t *places = allocate(count, sizeof *places, path);
  FILE *file = fopen(path, "r");
  if (!file) fail("%s: cannot be read", path);
  for (size_t i = 0; i < count; i++)
    if (fscanf(file, "%u", &places[i]) != 1 || places[i] >= self->u_count * self->v_count)
      fail("%s: expected %zu texels of %u", path, count, self->u_count * self->v_count);
  fclose(file);
  free(path);
  return places;
}
