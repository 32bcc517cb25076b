/* sample.h - where in a texel and in a cell of directions the rays of one sample start and go.
 *
 * The rays of a sample are the rows of an orthogonal array of strength 2 over p levels, p prime:
 * for a, b in 0 .. p-1 the strata are U = a, V = b, S = (a + b) mod p, T = (a + 2b) mod p. For p >=
 * 3 every pair of the four axes meets each of its p x p strata once (Bush 1952; Owen 1992). Each
 * ray has a random offset within its strata, from a generator that depends on the arguments only.
 */
#ifndef BAKE_SAMPLE_H
#define BAKE_SAMPLE_H

#include <stdbool.h>
#include <stdint.h>

enum { SAMPLE_MAX_RAYS = 121 };

/* Whether `rays` is 1 or the square of a prime from 3 to 11. */
bool sample_count_is_valid(uint32_t rays);

/* Offsets of the rays within the texel, in (0,1) of a texel: the same for all texels, slices and
 * surfaces, so that what does not depend on direction comes out equal in every slice. The middle
 * one, number rays / 2, starts from the centre. uv has room for `rays` pairs. */
void sample_texel_offsets(uint32_t rays, double (*uv)[2]);

/* How much each of them counts where a picture is to have no steps: a tent over the texel. The sum
 * is 1. */
void sample_texel_weights(uint32_t rays, double *weights);

/* Offsets of the same rays within the cell of directions (s_index, t_index), in (0,1) of a cell.
 * They differ from cell to cell: a mix of four slices then averages 4 `rays` directions. */
void sample_cell_offsets(uint32_t rays, uint32_t s_index, uint32_t t_index, double (*st)[2]);

#endif
