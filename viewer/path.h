/* path.h - camera paths: what was flown, or keys with a smooth flight through them.
 *
 * A text file, a camera a line: time_s lx ly lz ax ay az angle_deg; # begins a comment. Between two
 * lines location, look_at and the logarithm of the angle follow a Catmull-Rom spline with the
 * lines' own times (finite differences, no overshoot in time), so that a path passes through its
 * keys. */
#ifndef PATH_H
#define PATH_H

#include <stdio.h>

#include "slf.h"

typedef struct {
  double time_s;
  slf_view view;
} path_key;

typedef struct {
  path_key *keys; /* times rise strictly */
  size_t count, capacity;
} camera_path;

/* Adds a key later than the last one. False if it is not later, or memory ran out. */
bool path_add(camera_path *p, double time_s, const slf_view *view);
void path_clear(camera_path *p); /* frees the keys too */

double path_end_s(const camera_path *p); /* 0 for an empty path */
/* The camera at a time, held at both ends. The path has at least one key. */
slf_view path_at(const camera_path *p, double time_s);

slf_result path_read(const char *file_name, camera_path *p, slf_error *error);
slf_result path_write(const char *file_name, const camera_path *p, slf_error *error);

/* The view as POV-Ray reads it: camera { perspective ... }, for a picture of that aspect ratio. */
void view_print_pov(FILE *out, const slf_view *view, int width_px, int height_px);

/* For POV-Ray: base_name.inc, a camera along the path by `clock` from 0 to 1, to be included after
 * a scene's own camera, and base_name.ini, which renders it at frames_per_s. */
slf_result path_export_pov(const char *base_name, const camera_path *p, double frames_per_s,
                           int width_px, int height_px, slf_error *error);

#endif
