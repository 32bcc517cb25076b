/* window.h - the window: GLFW, keys and mouse, overlays. What each key does stands in one table,
 * from which the key handler, the help overlay and --list-bindings all read. */
#ifndef WINDOW_H
#define WINDOW_H

#include <stdio.h>

#include "checked_file.h"
#include "draw.h"

typedef struct {
  char *const *files; /* file_count of them, the first is shown */
  int file_count;
  drawing_options drawing;
  drawing_look look;
  const slf_view *view;  /* where to start, NULL: the first view of each file */
  const char *scene;     /* for the comparison with POV-Ray, see truth.h; may be NULL */
  const char *path_file; /* a camera path to begin with, see path.h; may be NULL */
  bool watch;            /* reload a file that was baked again, or of which more has come */
  /* Called for each drawing that is made, for what the window does not know of: water, and what
   * filter suits the driver. May be NULL. */
  slf_result (*prepare)(void *context, const slf_file *file, drawing *d, slf_error *error);
  void *context;
} window_options;

/* Opens a window of that size and makes its GL 3.3 core context current; fills `gl`. */
slf_result window_open(const char *title, int width_px, int height_px, slf_error *error);
/* Shows the files until the window is closed. `opened` is the first, and becomes the window's. What
 * goes wrong later, such as a file that cannot be reloaded or whose check fails, is shown in the
 * window and on stderr; the result then still is SLF_OK, but for a failed check of a file. */
slf_result window_run(const window_options *options, checked_file *opened, slf_error *error);
void window_close(void);

/* The table of keys, a line each. */
void window_print_bindings(FILE *out);

#endif
