/* jpeg_slice.h - a slice as an ordinary JPEG file. */
#ifndef SLF_JPEG_SLICE_H
#define SLF_JPEG_SLICE_H

#include "codec/slf.h"

/* Writes slice (s_index, t_index) of a layer with SLF_ANGULAR_NONE and SLF_CURVE_SRGB as a baseline
 * JPEG, 4:4:4, with the very same quantised coefficients. */
slf_result write_jpeg_slice(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                            uint32_t s_index, uint32_t t_index, const char *path, slf_error *error);

#endif
