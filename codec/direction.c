/* Directions and the display curve: the numbers that baker, codec and viewer agree on. */
#include "codec/slf.h"

#include <math.h>

/* Centre of cell i of count, in twice the distance from the middle: -1..1. */
static double signed_centre(uint32_t count, uint32_t i) {
  return (2.0 * i + 1.0) / count - 1.0;
}

bool slf_slice_exists(uint32_t s_count, uint32_t t_count, uint32_t s_index, uint32_t t_index) {
  if (s_index >= s_count || t_index >= t_count) return false;
  if (s_count == 1 && t_count == 1) return true;
  /* The tap is read by every (S,T) closer than one cell on each axis; in s and t a cell is 2 / N.
   * The nearest such point to the axis of the hemisphere decides. An axis of one slice is read by
   * all. */
  double s = s_count == 1 ? 0 : fabs(signed_centre(s_count, s_index)) - 2.0 / s_count;
  double t = t_count == 1 ? 0 : fabs(signed_centre(t_count, t_index)) - 2.0 / t_count;
  s = s > 0 ? s : 0;
  t = t > 0 ? t : 0;
  return s * s + t * t <= 1.0;
}

void slf_direction(double S, double T, double n_min, double direction[3]) {
  /* Far outside the circle only the angle matters; the scale keeps the squares finite. */
  double s = S - 0.5, t = T - 0.5, largest = fmax(fabs(s), fabs(t));
  double scale_down = largest > 1e6 ? 1e6 / largest : 1;
  s *= 2 * scale_down;
  t *= 2 * scale_down;
  double longest_squared = 1 - n_min * n_min;
  double length_squared = s * s + t * t;
  if (length_squared > longest_squared) {
    double scale = sqrt(longest_squared) / hypot(s, t);
    direction[0] = s * scale;
    direction[1] = t * scale;
    direction[2] = n_min;
    return;
  }
  direction[0] = s;
  direction[1] = t;
  direction[2] = sqrt(1 - length_squared);
}

uint8_t slf_srgb_from_linear(float radiance) {
  if (!(radiance > 0)) return 0;
  if (radiance >= 1) return 255;
  double x = radiance;
  double code = x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1 / 2.4) - 0.055;
  return (uint8_t)(code * 255 + 0.5);
}

float slf_linear_from_srgb(uint8_t code) {
  double x = code / 255.0;
  return (float)(x <= 0.04045 ? x / 12.92 : pow((x + 0.055) / 1.055, 2.4));
}

uint8_t slf_code_from_height(float height, float height_unit) {
  float code = 256 * height / (height + height_unit);
  if (isinf(height)) code = 256;
  if (!(code > 0)) return 0;
  return (uint8_t)fminf(code + 0.5f, 255);
}

float slf_height_from_code(uint8_t code, float height_unit) {
  return height_unit * (float)code / (float)(256 - code);
}
