/* slice_image.h - slices as pictures: OpenEXR, linear; PNG, in the sRGB curve. By the path's
 * ending. */
#ifndef SLF_SLICE_IMAGE_H
#define SLF_SLICE_IMAGE_H

#include "codec/slf.h"

/* rgb: v_count rows of u_count x 3 floats, linear. EXR gets halves. Written beside and renamed. */
slf_result slice_image_write(const char *path, const float *rgb, uint32_t u_count, uint32_t v_count,
                             slf_error *error);

/* *rgb (malloc) becomes the caller's. Of an EXR the channels R, G and B are read. */
slf_result slice_image_read(const char *path, float **rgb, uint32_t *u_count, uint32_t *v_count,
                            slf_error *error);

#endif
