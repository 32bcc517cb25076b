#include "fog.h"

#include <math.h>

/* The near fog's distance, in distances from the surface to the ray's start: what is reflected from
 * five of these away or less counts in part as the surface's own. */
static const double near_starts = 10;

/* Less than this is no reflection: a display shows nothing of it. */
static const float least_reflectance = 1.0f / 512;

/* Of the far fog: beside it what is seen through it hardly counts, so that it need not be known
 * well.
 */
static const float bright = 256;

fog_set fogs_of(const surface *self, double far) {
  double start = surface_ray_start(self), near = near_starts * start;
  return (fog_set){
      .fogs = {[NEAR_BLACK] = {near, 0}, [NEAR_WHITE] = {near, 1}, [FAR_BRIGHT] = {far, bright}},
      .t_near_start = (float)exp(-start / near),
      .t_far_start = (float)exp(-start / far)};
}

/* What a near fog adds to paths beyond the ray's start. */
float fog_reflectance(const fog_set *by, const float near_black[3], const float near_white[3]) {
  float sum = 0;
  for (int k = 0; k < 3; k++)
    sum += (near_white[k] - near_black[k] - 1 + by->t_near_start) / by->t_near_start;
  return sum > 3 * least_reflectance ? sum : 0;
}

/* T of what is reflected and 1 - T of the fog add up to what is seen. */
float fog_distance(const fog_set *by, float reflectance, const float own[3],
                   const float reflected[3], const float far_bright[3]) {
  float light = 0, sum = 0, start = (1 - by->t_far_start) * bright;
  for (int k = 0; k < 3; k++) {
    light += reflected[k];
    sum += (far_bright[k] - start) / by->t_far_start - own[k];
  }
  float opaque = reflectance > 0 ? (sum - light) / (reflectance * bright - light) : 1;
  return -(float)by->fogs[FAR_BRIGHT].distance * logf(fminf(fmaxf(1 - opaque, 1e-6f), 1));
}

bool fog_split(const fog_set *by, const float full[3], float *const through[FOG_COUNT], size_t at,
               float own[3], float reflected[3], float *distance) {
  const float *near_black = through[NEAR_BLACK] + at;
  float reflectance = fog_reflectance(by, near_black, through[NEAR_WHITE] + at);
  for (int k = 0; k < 3; k++) {
    own[k] = reflectance > 0 ? fminf(near_black[k] * (1 / by->t_near_start), full[k]) : full[k];
    reflected[k] = full[k] - own[k];
  }
  *distance = fog_distance(by, reflectance, own, reflected, through[FAR_BRIGHT] + at);
  return reflectance > 0;
}

bool fog_is_seen(const fog_set *by, float *const through[FOG_COUNT], size_t count) {
  size_t without = 0;
  for (size_t i = 0; i < count; i++)
    without += through[NEAR_WHITE][i] - through[NEAR_BLACK][i] < 0.5f * (1 - by->t_near_start);
  return without <= count / 2;
}
