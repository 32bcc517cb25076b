/* kernel.h - the transform and the colours: what a C-Block costs beside its bits. */
#ifndef SLF_KERNEL_H
#define SLF_KERNEL_H

#include "codec/layer.h"

/* Inverse transform of one channel in natural order, in place: orthonormal coefficients times AAN's
 * factors / 8. Float without contraction, so that every processor gives the same bits. */
void inverse_dct(float block[COEFFICIENTS]);

/* The same from plain orthonormal coefficients. */
void plain_inverse_dct(float block[COEFFICIENTS]);

/* Orthonormal coefficients of 8x8 texels. */
void forward_dct(const float texels[COEFFICIENTS], float coefficients[COEFFICIENTS]);

/* Fine levels to channels. */
void levels_to_channels(const layer_state *layer, int16_t fine[3][COEFFICIENTS],
                        float channels[3][COEFFICIENTS]);

/* Channels (luma without its level shift, Cb, Cr) to R G B X. */
void channels_to_codes(float channels[3][COEFFICIENTS], uint8_t *u_block);

#endif
