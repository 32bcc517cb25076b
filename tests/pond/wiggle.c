/* wiggle FILE.slf VIEW SURFACE CALM.png RIPPLED.png - how far ripples move the reflection of a wall
 * in a picture, by the height over the wall's foot (v = 0) of what the calm water shows there: a
 * line for each quarter of the wall, its pixels and the root mean square of their movement along
 * the row, px.
 *
 * Where the calm water reflects what is told by geometry: the mirrored camera sees it directly. How
 * far it has moved is found in the pictures alone: the shift of the calm row that fits the rippled
 * one best over a window, so for vertical lines on the wall. */
#include <math.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "viewer/pick.h"
#include "viewer/water.h"

enum { BANDS = 4, HALF_WINDOW = 6, REACH = 6, ROW_STEP = 5 }; /* px */
/* Sum of squares over a window below which it shows no line: a twentieth of the range at two edges.
 */
enum { LEAST_CONTRAST = 2 * 3 * 12 * 12 };

typedef struct {
  int width, height;
  uint8_t *rgb;
} picture;

static void fail(const char *what) {
  fprintf(stderr, "wiggle: %s\n", what);
  exit(1);
}

static picture read_picture(const char *path) {
  png_image png = {.version = PNG_IMAGE_VERSION, .format = PNG_FORMAT_RGB};
  if (!png_image_begin_read_from_file(&png, path)) fail(png.message);
  png.format = PNG_FORMAT_RGB;
  picture p = {(int)png.width, (int)png.height, malloc(PNG_IMAGE_SIZE(png))};
  if (!p.rgb || !png_image_finish_read(&png, NULL, p.rgb, 0, NULL)) fail(png.message);
  return p;
}

/* The camera as the water at y = 0 mirrors it: it sees at (x, height - y) what the other sees
 * reflected at (x, y). */
static camera mirrored(slf_view view, int width_px, int height_px) {
  view.location[1] = -view.location[1];
  view.look_at[1] = -view.look_at[1];
  return camera_of_view(&view, width_px, height_px);
}

static double row_difference(const picture *a, const picture *b, int x, int y, int shift) {
  double sum = 0;
  for (int k = -HALF_WINDOW; k <= HALF_WINDOW; k++)
    for (int c = 0; c < 3; c++) {
      const double d = (double)a->rgb[3 * (y * a->width + x + k) + c] -
                       b->rgb[3 * (y * b->width + x + k + shift) + c];
      sum += d * d;
    }
  return sum;
}

/* Shift of least difference, with a parabola through its neighbours. */
static double movement_px(const picture *calm, const picture *rippled, int x, int y) {
  double difference[2 * REACH + 1];
  int best = 0;
  for (int s = 0; s <= 2 * REACH; s++) {
    difference[s] = row_difference(rippled, calm, x, y, s - REACH);
    if (difference[s] < difference[best]) best = s;
  }
  if (best == 0 || best == 2 * REACH) return best - REACH;
  const double before = difference[best - 1], here = difference[best], after = difference[best + 1];
  const double bend = before - 2 * here + after;
  return best - REACH + (bend > 0 ? 0.5 * (before - after) / bend : 0);
}

static bool shows_lines(const picture *p, int x, int y) {
  double sum = 0;
  for (int k = -HALF_WINDOW; k < HALF_WINDOW; k++)
    for (int c = 0; c < 3; c++) {
      const uint8_t *at = p->rgb + 3 * (y * p->width + x + k) + c;
      sum += (at[3] - at[0]) * (at[3] - at[0]);
    }
  return sum >= LEAST_CONTRAST;
}

int main(int argc, char **argv) {
  slf_file *file;
  slf_error error;
  if (argc != 6)
    return fputs("usage: wiggle FILE.slf VIEW SURFACE CALM.png RIPPLED.png\n", stderr), 2;
  if (slf_open(argv[1], &file, &error) != SLF_OK) fail(error.message);
  const slf_view *view = NULL;
  for (uint32_t i = 0; i < slf_view_count(file); i++)
    if (strcmp(slf_get_view(file, i)->name, argv[2]) == 0) view = slf_get_view(file, i);
  if (!view) fail("no such view");
  const picture calm = read_picture(argv[4]), rippled = read_picture(argv[5]);
  const int width = calm.width, height = calm.height;
  if (rippled.width != width || rippled.height != height) fail("pictures of two sizes");
  const camera eye = camera_of_view(view, width, height), image = mirrored(*view, width, height);

  double sums[BANDS] = {0};
  int counts[BANDS] = {0};
  for (int y = 0; y < height; y += ROW_STEP)
    for (int x = HALF_WINDOW + REACH; x < width - HALF_WINDOW - REACH; x++) {
      pick_hit water_hit, wall_hit;
      if (!shows_lines(&calm, x, y) ||
          !pick_surface(file, &eye, x + 0.5, y + 0.5, width, height, &water_hit) ||
          !(slf_get_surface(file, water_hit.surface_index)->flags & SLF_SURFACE_WATER) ||
          !pick_surface(file, &image, x + 0.5, height - y - 0.5, width, height, &wall_hit) ||
          strcmp(slf_get_surface(file, wall_hit.surface_index)->name, argv[3]) != 0)
        continue;
      const int band = (int)fmin(floor(wall_hit.v * BANDS), BANDS - 1);
      const double moved = movement_px(&calm, &rippled, x, y);
      sums[band] += moved * moved;
      counts[band]++;
    }
  for (int i = 0; i < BANDS; i++) printf("%d %.3f\n", counts[i], sqrt(sums[i] / counts[i]));
  slf_close(file);
  return 0;
}
