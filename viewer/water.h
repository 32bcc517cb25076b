/* water.h - a flat mirror that ripples (paper, section 4).
 *
 * The light field of a flat mirror knows what any mirror in its place reflects. Where the flat
 * surface is seen along d (from the texel to the eye, in its tangent frame) and ripples tilt the
 * normal to m, the eye sees what comes along the reflected ray r = 2 (m.d) m - d; the flat surface
 * shows that to an eye along d' = (-r_u, -r_v, r_n). So the texel is mixed at the (S,T) of d'. It
 * is exact as long as nothing that the ray meets shows the water in its turn.
 *
 * A ray with r_n < 0 would go below the horizon: it meets the next ripple and is thrown up again.
 * It is taken as mirrored once more by the level surface, (r_u, r_v, -r_n), as POV-Ray does: d' has
 * then the same (S,T). Such rays are counted.
 *
 * Looks: the paper's pure mirror, or water over a tinted bottom, with Fresnel's equations for
 * unpolarised light from air into water: F of what is reflected, and 1 - F of the bottom's colour,
 * darkened along the refracted ray's longer way. */
#ifndef SLF_WATER_H
#define SLF_WATER_H

#include "viewer/ripple.h"
#include "viewer/ripple_script.h"
#include "viewer/texture.h"

typedef enum {
  WATER_RIPPLED,
  WATER_SPLIT,  /* the half with u < 0.5 stays flat, to be compared */
  WATER_NORMALS /* red and green are the slopes along u and v, 0.5 for none, 1 for +0.5 */
} water_display;

enum { WATER_DISPLAY_COUNT = 3, WATER_FACINGS = 1024 };

extern const char *const water_display_names[WATER_DISPLAY_COUNT]; /* as above, in small letters */

typedef struct {
  uint64_t ray_count;   /* texels that were bent in the last frame */
  uint64_t below_count; /* of them, rays that would have gone below the horizon */
} water_counts;

/* P(u,v) = corner + u u_length along_u + v v_length along_v; along_u, along_v and normal are
 * orthonormal. */
typedef struct {
  float corner[3], along_u[3], along_v[3], normal[3];
  float u_length, v_length;
} water_rectangle;

typedef struct {
  ripple *pond;
  water_rectangle rectangle;
  uint32_t u_count, v_count; /* texels */
  size_t stride;             /* floats from row to row of the planes below; rows are padded to 8 */
  float *slope_u, *slope_v;
  uint16_t *facing; /* cosine between normal and eye, in WATER_FACINGS - 1 parts */

  /* For the user to set. */
  bool paused, fresnel;
  water_display display;
  float bottom[3]; /* linear R G B of the bottom seen from straight above */

  const ripple_script *script; /* replayed from time 0; may be NULL, not owned */
  uint64_t step_index;         /* steps since the water was last at rest: its time */

  bool bending;               /* this frame */
  uint8_t (*counts)[2];       /* of each block of texels: see water_counts */
  uint32_t finished_count;    /* layers of this frame */
  uint16_t half_of_code[256]; /* linear light of a display code */
} water;

/* For a surface that is a flat rectangle, and u_count x v_count texels. Other surfaces of the file
 * that stand in the water become obstacles: their cross-section with its plane is closed. `cells`
 * is the pond's grid along its longer side, 0 for one a texel, within 64 .. 256.
 * *out is NULL on failure: SLF_ERROR_ARGUMENT for a surface that is not a flat rectangle. */
slf_result water_create(const slf_file *file, uint32_t surface_index, uint32_t u_count,
                        uint32_t v_count, uint32_t cells, water **out, slf_error *error);
void water_free(water *w); /* accepts NULL */

/* Moves the water by the time passed (not while paused, nor beyond a script's stop), or by one
 * step. A failure is the script's: an event the pond refuses. */
slf_result water_advance(water *w, double elapsed_s, slf_error *error);
slf_result water_step(water *w, slf_error *error);
double water_time_s(const water *w);

/* Level water at time 0; a script begins again. */
void water_reset(water *w);

/* Before a frame: what to give texture_update, by any number of threads; {NULL, NULL} where the
 * flat picture is the right one; and after it, before texture_make_levels, for looks that colour
 * texels: v_count rows of half floats as in texture.h, row_nbytes apart. Of a surface with several
 * layers, whose sum is seen, each in turn: what is added is added to the first. */
direction_bend water_begin_frame(water *w);
void water_finish_frame(water *w, uint16_t *texels, size_t row_nbytes);

water_counts water_get_counts(const water *w);

#endif
