/* choose - how many directions a surface needs, from a frame of probe.h's views.
 *
 * The error of N directions is that of mixing four of N x N slices instead of looking from the
 * direction asked for: the root mean square over texels and channels of displayed (sRGB) values,
 * the worst of the test directions. One texture's error is that of the view along the normal. One
 * texture is chosen where it does not vary, that is, by less than two codes of 255; else the
 * smallest number of directions whose error is at most the one asked for; else the largest. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "fail.h"
#include "probe.h"

static const double one_texture_error = 2.0 / 255;

static double displayed(double linear) {
  if (linear <= 0.0031308) return linear <= 0 ? 0 : 12.92 * linear;
  return linear >= 1 ? 1 : 1.055 * pow(linear, 1 / 2.4) - 0.055;
}

/* Root mean square of the difference between `truth` and the weighted sum of views. */
static double mix_error(const float *truth, const float *views, size_t view_size, int view_count,
                        const double *weights) {
  double sum = 0;
  for (size_t i = 0; i < view_size; i++) {
    double mix = 0;
    for (int k = 0; k < view_count; k++) mix += weights[k] * views[(size_t)k * view_size + i];
    double difference = displayed(mix) - displayed(truth[i]);
    sum += difference * difference;
  }
  return sqrt(sum / (double)view_size);
}

static double texture_error(const float *means, size_t view_size) {
  double worst = 0, one = 1;
  for (size_t test = 0; test < PROBE_TEST_COUNT; test++)
    worst = fmax(worst, mix_error(means + (1 + test) * view_size, means, view_size, 1, &one));
  return worst;
}

static double candidate_error(const float *means, size_t view_size, size_t candidate) {
  double worst = 0;
  for (size_t test = 0; test < PROBE_TEST_COUNT; test++) {
    size_t first = 1 + PROBE_TEST_COUNT + 4 * (candidate * PROBE_TEST_COUNT + test);
    slice slices[4];
    double weights[4];
    probe_mix(probe_candidates[candidate], (uint32_t)test, slices, weights);
    worst = fmax(worst, mix_error(means + (1 + test) * view_size, means + first * view_size,
                                  view_size, 4, weights));
  }
  return worst;
}

int main(int argc, char **argv) {
  if (argc != 5) {
    fputs("usage: choose FOLDER SURFACE RAYS FRAME.exr > CHOICE\n", stderr);
    return 2;
  }
  surface *self = surface_read(argv[1], argv[2]);
  uint32_t rays = surface_rays(self, (uint32_t)atoi(argv[3]));
  texel_grid grid = probe_grid(self);
  view_list views = probe_views(rays);
  float *means = frame_read_means(argv[4], self, grid, &views, NULL);
  size_t view_size = (size_t)grid.u_count * grid.v_count * 3;
  for (size_t i = 0; i < view_size * views.view_count; i++)
    if (!isfinite(means[i]))
      fail("surface '%s': its probe has a radiance of %f", self->name, means[i]);

  double error = texture_error(means, view_size);
  uint32_t chosen = 1;
  char *figures = format_text("one texture %.4f", error);
  for (size_t i = 0; i < PROBE_CANDIDATE_COUNT; i++) {
    double next_error = candidate_error(means, view_size, i);
    char *longer = format_text("%s, %ux%u %.4f", figures, probe_candidates[i], probe_candidates[i],
                               next_error);
    free(figures);
    figures = longer;
    if (error > (chosen == 1 ? one_texture_error : self->auto_error))
      chosen = probe_candidates[i], error = next_error;
  }
  fprintf(stderr, "bake: surface '%s': %s; %.4f asked: ", self->name, figures, self->auto_error);
  if (chosen == 1)
    fprintf(stderr, "one texture\n");
  else
    fprintf(stderr, "%ux%u directions%s\n", chosen, chosen,
            error > self->auto_error ? ", which are still too few" : "");
  if (printf("%u %u\nerror %.4f, asked %.4f: %s\n", chosen, chosen, error, self->auto_error,
             figures) < 0 ||
      fflush(stdout))
    fail("surface '%s': its choice cannot be written", self->name);
  free(figures);
  free(means);
  free(views.stn);
  surface_free(self);
  return 0;
}
