/* image.h - pictures in files. */
#ifndef IMAGE_H
#define IMAGE_H

#include "slf.h"

/* Writes a PNG: height_px rows of width_px R G B A from the top, A not stored. Writes a temporary
 * file beside it and renames. */
slf_result image_write_png(const char *path, const uint8_t *rgba, int width_px, int height_px,
                           slf_error *error);

/* Box filter in linear light: each pixel of out (width_px x height_px) is the mean of samples x
 * samples pixels of rgba. */
void image_reduce(const uint8_t *rgba, int width_px, int height_px, int samples, uint8_t *out);

#endif
