/* truth.h - POV-Ray's own picture of a view, rendered in the background, and how far a picture is
 * from it. */
#ifndef TRUTH_H
#define TRUTH_H

#include "slf.h"

typedef struct truth truth;

/* Starts povray on `scene`: a .pov file and, after it, further arguments of povray, all separated
 * by spaces ("scenes/floor/floor.pov +Lbake Declare=Mirror=1"). *out is NULL on failure. */
slf_result truth_start(const char *scene, const slf_view *view, int width_px, int height_px,
                       truth **out, slf_error *error);
/* Ends povray if it still runs, and removes its files; accepts NULL. */
void truth_free(truth *t);

typedef enum { TRUTH_RUNNING, TRUTH_DONE, TRUTH_FAILED } truth_state;

/* Looks how far it is, without waiting. percent is 0 to 100; *error is filled if it failed, with
 * POV-Ray's own line where it gave one. */
truth_state truth_poll(truth *t, int *percent, slf_error *error);

/* Its picture once TRUTH_DONE: rows of R G B A from the top, of the size asked for. */
const uint8_t *truth_picture(const truth *t);

/* PSNR in dB over R, G and B of two pictures in display code, INFINITY if they are equal. */
double picture_psnr(const uint8_t *a, const uint8_t *b, size_t pixel_count);

#endif
