/* probe.h - the views that tell how many directions a surface needs. A few texels are seen from
 * test directions, and for each candidate number of directions in the four slices from which a
 * viewer would mix them (bilinear, eq. 1's S and T). */
#ifndef BAKE_PROBE_H
#define BAKE_PROBE_H

#include <stddef.h>
#include <stdint.h>

#include "frame.h"

enum { PROBE_TEST_COUNT = 12, PROBE_CANDIDATE_COUNT = 5, PROBE_MAX_TEXELS = 12 };
extern const uint32_t probe_candidates[PROBE_CANDIDATE_COUNT]; /* 4 8 16 32 64 */

/* At most 12 x 12 of the surface's texels, spread over it. */
texel_grid probe_grid(const surface *);

/* The first view is along the normal; the next PROBE_TEST_COUNT from the test directions; then, for
 * each candidate, for each test, four slices. The caller frees stn. */
view_list probe_views(uint32_t rays);

/* What the light pass looks at, for radiosity to know it: at most 48 x 48 texels, along the normal
 * and, unless the surface is matte, from the test directions. The caller frees stn. */
texel_grid light_grid(const surface *);
view_list light_views(const surface *, uint32_t rays);

/* What a chunk's rays cost is measured on: light_views of at most 8 x 8 texels. */
texel_grid cost_grid(const surface *);

/* Place of a test direction among the slices of N x N: the four slices' weights. Slice k of four is
 * (s + k % 2, t + k / 2); indices are clamped to the edge. */
void probe_mix(uint32_t n, uint32_t test, slice slices[4], double weights[4]);

/* Root mean square, over `size` numbers, of the difference between truth and the weighted sum of
 * `count` views, both linear, as displayed (sRGB, 0 to 1). */
double probe_error(const float *truth, size_t size, const float *const *views,
                   const double *weights, int count);

/* Whether layers pay is tried with so many directions, each way. */
enum { MATCH_DIRECTIONS = 8, MATCH_COUNT = 4 * PROBE_TEST_COUNT };

/* For each test the four of 8 x 8 slices around it, one ray a texel: MATCH_COUNT views of the
 * probe's own texels; and as many of others that see in that slice what the probe's texel sees from
 * the test direction. The caller frees stn. */
view_list match_views(void);

/* Which texels those 2 MATCH_COUNT views are of, from FOLDER/NAME/places, which `match` wrote:
 * texels of the probe's grid x views, for the caller to free. */
uint32_t *match_places_read(const char *folder, const surface *);

#endif
