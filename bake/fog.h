/* fog.h - tells what a surface reflects from what it sends out itself, and how far away that is, by
 * what fogs do to a picture.
 *
 * A fog of distance d and grey C turns the radiance L of a path of length h into T L + (1 - T) C
 * with T = exp(-h / d). From the surface to the ray's start, a distance e, T_e is known. A surface
 * of own radiance O and reflectance r is seen through it as I(C) = T_e (O + r (T L + (1 - T) C)) +
 * (1 - T_e) C. A near fog lets nothing through from what is reflected (T = 0): I(0) = T_e O and
 * I(1) - I(0) = T_e r + 1 - T_e. What is left of the picture without fog is r L. A far fog of any
 * one C then gives T, so h, the more surely the brighter it is. Nothing of this asks what the scene
 * is made of. Where r varies along the path, as with reflections of reflections, the fogs weigh its
 * segments: h is a weighted mean. */
#ifndef BAKE_FOG_H
#define BAKE_FOG_H

#include "surface.h"

typedef struct {
  double distance;
  float grey;
} fog;

/* The pictures through fogs, beside the one without. */
enum { NEAR_BLACK, NEAR_WHITE, FAR_BRIGHT, FOG_COUNT };

/* What a surface is seen through; `far` is about how far away what it reflects is, in scene units.
 */
typedef struct {
  fog fogs[FOG_COUNT];
  float t_near_start, t_far_start; /* what fogs let through of the way to the ray's start */
} fog_set;
fog_set fogs_of(const surface *, double far);

/* One pixel: its linear radiance without fog, and pixel `at` of the pictures through the fogs. Own
 * and reflected radiance add up to `full`; *distance is that of what is reflected, in scene units,
 * infinite at most in name (14 far). Returns whether it reflects at all. */
bool fog_split(const fog_set *, const float full[3], float *const through[FOG_COUNT], size_t at,
               float own[3], float reflected[3], float *distance);

/* The parts of that. Reflectance: the sum over the channels, 0 where it reflects nothing. */
float fog_reflectance(const fog_set *, const float near_black[3], const float near_white[3]);
float fog_distance(const fog_set *, float reflectance, const float own[3], const float reflected[3],
                   const float far_bright[3]);

/* A white fog brightens the way to the ray's start, whatever is seen. Where it does not in most of
 * `count` numbers, POV-Ray takes the rays to start inside an object, and there is nothing to learn.
 */
bool fog_is_seen(const fog_set *, float *const through[FOG_COUNT], size_t count);

#endif
