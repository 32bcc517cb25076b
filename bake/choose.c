/* choose - how many directions a surface needs, from a frame of probe.h's views.
 *
 * The error of N directions is that of mixing four of N x N slices instead of looking from the
 * direction asked for: the root mean square over texels and channels of displayed (sRGB) values,
 * the worst of the test directions. One texture's error is that of the view along the normal. One
 * texture is chosen where it does not vary, that is, by less than two codes of 255; else the
 * smallest number of directions whose error is at most the one asked for; else the largest.
 *
 * Layers are chosen where their error (match.c) is less than that of as many samples of the plain
 * way, which means twice as many directions each way: layers hold three for each of one, and take
 * five renders of one ray. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "fail.h"
#include "probe.h"

static const double one_texture_error = 2.0 / 255;

static double texture_error(const float *means, size_t view_size) {
  double worst = 0, one = 1;
  for (size_t test = 0; test < PROBE_TEST_COUNT; test++)
    worst = fmax(worst, probe_error(means + (1 + test) * view_size, view_size, &means, &one, 1));
  return worst;
}

static double candidate_error(const float *means, size_t view_size, size_t candidate) {
  double worst = 0;
  for (size_t test = 0; test < PROBE_TEST_COUNT; test++) {
    size_t first = 1 + PROBE_TEST_COUNT + 4 * (candidate * PROBE_TEST_COUNT + test);
    slice slices[4];
    double weights[4];
    const float *views[4];
    probe_mix(probe_candidates[candidate], (uint32_t)test, slices, weights);
    for (size_t k = 0; k < 4; k++) views[k] = means + (first + k) * view_size;
    worst = fmax(worst, probe_error(means + (1 + test) * view_size, view_size, views, weights, 4));
  }
  return worst;
}

static double read_number(const char *text) {
  char *end;
  double number = strtod(text, &end);
  if (end == text || *end || !(number >= 0)) fail("choose: '%s': expected a number", text);
  return number;
}

int main(int argc, char **argv) {
  if (argc != 5 && argc != 7) {
    fputs("usage: choose FOLDER SURFACE RAYS FRAME.exr [LAYERED_ERROR DISTANCE] > CHOICE\n",
          stderr);
    return 2;
  }
  surface *self = surface_read(argv[1], argv[2]);
  uint32_t rays = (uint32_t)atoi(argv[3]);
  texel_grid grid = probe_grid(self);
  view_list views = probe_views(rays);
  float *means = frame_read_means(argv[4], self->planar, grid, &views, NULL);
  size_t view_size = (size_t)grid.u_count * grid.v_count * 3;
  for (size_t i = 0; i < view_size * views.view_count; i++)
    if (!isfinite(means[i]))
      fail("surface '%s': its probe has a radiance of %f", self->name, means[i]);

  double error = texture_error(means, view_size), same_samples_error = 0, distance = 0;
  uint32_t chosen = 1;
  char *figures = format_text("one texture %.4f", error);
  for (size_t i = 0; i < PROBE_CANDIDATE_COUNT; i++) {
    double next_error = candidate_error(means, view_size, i);
    char *longer = format_text("%s, %ux%u %.4f", figures, probe_candidates[i], probe_candidates[i],
                               next_error);
    free(figures);
    figures = longer;
    if (probe_candidates[i] == 2 * MATCH_DIRECTIONS) same_samples_error = next_error;
    if (error > (chosen == 1 ? one_texture_error : self->auto_error))
      chosen = probe_candidates[i], error = next_error;
  }
  if (argc == 7) {
    double layered_error = read_number(argv[5]);
    char *longer = format_text("%s, %dx%d as layers %.4f", figures, MATCH_DIRECTIONS,
                               MATCH_DIRECTIONS, layered_error);
    free(figures);
    figures = longer;
    if (layered_error < same_samples_error)
      chosen = MATCH_DIRECTIONS, error = layered_error, distance = read_number(argv[6]);
  }
  fprintf(stderr, "bake: surface '%s': %s; %.4f asked: ", self->name, figures, self->auto_error);
  if (chosen == 1)
    fprintf(stderr, "one texture\n");
  else
    fprintf(stderr, "%ux%u directions%s%s\n", chosen, chosen, distance > 0 ? " as layers" : "",
            error > self->auto_error ? ", which are still too few" : "");
  if (printf("%u %u %g\nerror %.4f, asked %.4f: %s\n", chosen, chosen, distance, error,
             self->auto_error, figures) < 0 ||
      fflush(stdout))
    fail("surface '%s': its choice cannot be written", self->name);
  free(figures);
  free(means);
  free(views.stn);
  surface_free(self);
  return 0;
}
