/* image.h - OpenEXR images by rows, through OpenEXR's C core: POV-Ray's frames in, means out.
 *
 * A file that is not as expected ends the program (fail.h). */
#ifndef BAKE_IMAGE_H
#define BAKE_IMAGE_H

#include <stdint.h>

typedef struct image image;

/* Opens an image of scan lines with the channels R G B and perhaps A. Never NULL. */
image *image_open(const char *path);
uint32_t image_width(const image *);
uint32_t image_height(const image *);
/* Reads row_count rows from first_row of the channels named, "RGB" or "A": width x channels floats
 * a row. */
void image_read_rows(image *, const char *channels, uint32_t first_row, uint32_t row_count,
                     float *values);
void image_close(image *);

/* Writes half-float R G B, not compressed: rows are read at random, and the C core of OpenEXR 3.1.5
 * writes rows that do not shrink wrongly. The file is complete, or the program has ended. */
void image_write(const char *path, uint32_t width, uint32_t height, const float *rgb);

#endif
