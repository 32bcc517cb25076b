/* window.h - the window: GLFW, keys and mouse. */
#ifndef WINDOW_H
#define WINDOW_H

#include "draw.h"

/* Opens a window of that size and makes its GL 3.3 core context current; fills `gl`. */
slf_result window_open(const char *title, int width_px, int height_px, slf_error *error);
/* Shows the file until the window is closed, starting at `view`. Returns a check's failure that
 * came up meanwhile through `check`, which is called now and then; it may be NULL. */
slf_result window_run(drawing *d, const slf_view *view, slf_error *error);
void window_close(void);

#endif
