/* compare A.png B.png MASK.png - how two pictures differ where the mask is white, one pixel in from
 * its edge. Prints one line: PSNR in dB of the 8-bit colours, the shift of B against A in pixels
 * (peak of the normalised cross-correlation of luma, parabola through its neighbours), and the
 * number of pixels compared. */
#include <math.h>
#include <png.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { RADIUS = 3 }; /* shifts looked at, px */

typedef struct {
  int width, height;
  uint8_t *rgb;
} picture;

static picture read_picture(const char *path) {
  png_image png = {.version = PNG_IMAGE_VERSION};
  picture p = {0};
  if (png_image_begin_read_from_file(&png, path)) {
    png.format = PNG_FORMAT_RGB;
    p = (picture){(int)png.width, (int)png.height, malloc(PNG_IMAGE_SIZE(png))};
    if (p.rgb && png_image_finish_read(&png, NULL, p.rgb, 0, NULL)) return p;
  }
  fprintf(stderr, "compare: %s: %s\n", path, png.message);
  exit(1);
}

/* Whether the mask is white at (x, y) and all around it: no pixel that mixes two surfaces. */
static int inside(const picture *mask, int x, int y, int margin) {
  for (int j = y - margin; j <= y + margin; j++)
    for (int i = x - margin; i <= x + margin; i++)
      if (i < 0 || j < 0 || i >= mask->width || j >= mask->height ||
          mask->rgb[3 * (j * mask->width + i)] < 255)
        return 0;
  return 1;
}

static double luma(const picture *p, int x, int y) {
  const uint8_t *c = p->rgb + 3 * (y * p->width + x);
  return 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2];
}

static double correlation(const picture *a, const picture *b, const picture *mask, int dx, int dy) {
  double n = 0, sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  for (int y = 0; y < mask->height; y++)
    for (int x = 0; x < mask->width; x++)
      if (inside(mask, x, y, RADIUS + 1)) {
        double la = luma(a, x, y), lb = luma(b, x + dx, y + dy);
        n++, sa += la, sb += lb, saa += la * la, sbb += lb * lb, sab += la * lb;
      }
  return (n * sab - sa * sb) / sqrt((n * saa - sa * sa) * (n * sbb - sb * sb));
}

static double peak(double before, double at, double after) {
  return 0.5 * (before - after) / (before - 2 * at + after);
}

int main(int argc, char **argv) {
  if (argc != 4) return fprintf(stderr, "compare: expected A.png B.png MASK.png\n"), 2;
  picture a = read_picture(argv[1]), b = read_picture(argv[2]), mask = read_picture(argv[3]);
  if (a.width != b.width || a.width != mask.width || a.height != b.height ||
      a.height != mask.height)
    return fprintf(stderr, "compare: sizes differ: %dx%d, %dx%d, %dx%d\n", a.width, a.height,
                   b.width, b.height, mask.width, mask.height),
           1;

  double squares = 0;
  long count = 0;
  for (int y = 0; y < a.height; y++)
    for (int x = 0; x < a.width; x++)
      if (inside(&mask, x, y, 1)) {
        for (int c = 0; c < 3; c++) {
          double d = a.rgb[3 * (y * a.width + x) + c] - b.rgb[3 * (y * a.width + x) + c];
          squares += d * d;
        }
        count++;
      }
  if (!count) return fprintf(stderr, "compare: %s: nothing is white\n", argv[3]), 1;

  int bx = 0, by = 0;
  double best = -2;
  for (int dy = -RADIUS; dy <= RADIUS; dy++)
    for (int dx = -RADIUS; dx <= RADIUS; dx++) {
      double r = correlation(&a, &b, &mask, dx, dy);
      if (r > best) best = r, bx = dx, by = dy;
    }
  if (abs(bx) == RADIUS || abs(by) == RADIUS)
    return fprintf(stderr, "compare: no correlation peak within %d px\n", RADIUS - 1), 1;
  double shift_x = bx + peak(correlation(&a, &b, &mask, bx - 1, by), best,
                             correlation(&a, &b, &mask, bx + 1, by));
  double shift_y = by + peak(correlation(&a, &b, &mask, bx, by - 1), best,
                             correlation(&a, &b, &mask, bx, by + 1));
  printf("%.2f %.3f %.3f %ld\n", 10 * log10(255.0 * 255.0 * 3 * (double)count / squares), shift_x,
         shift_y, count);
  free(a.rgb), free(b.rgb), free(mask.rgb);
  return 0;
}
