/* decode.h - from a block's address to its levels or channels. */
#ifndef SLF_DECODE_H
#define SLF_DECODE_H

#include "codec/kernel.h"

/* Fine levels of a base block, of a group's key. */
void decode_base(const layer_state *layer, uint64_t place, int16_t fine[3][COEFFICIENTS]);
void decode_key(const layer_state *layer, uint32_t group, uint64_t place,
                int16_t fine[3][COEFFICIENTS]);
/* The keys around slice (s, t), mixed. */
void decode_keys(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                 int16_t fine[3][COEFFICIENTS]);

/* key - base over 3x3 places around a place, as channels, edge repeated: 24 rows of 24. Only what a
 * shift of (du, dv) reads is made. */
void decode_shifted(const layer_state *layer, uint32_t group, uint64_t place, int du, int dv,
                    float channels[3][COEFFICIENTS]);
/* The same with replicated edges, for the motion scheme. */
void shift_channels(float from[3][COEFFICIENTS], int du, int dv, float to[3][COEFFICIENTS]);

/* A block of an existing slice, before colours. */
void decode_channels(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                     float channels[3][COEFFICIENTS]);

#endif
