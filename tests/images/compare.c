/* compare [--shift] A.png B.png MASK.png - how two pictures differ where the mask is white, one
 * pixel in from its edge. Prints one line: PSNR in dB of the 8-bit colours and the number of pixels
 * compared; with --shift, which takes seconds, also the shift of B against A in pixels and the
 * standard deviation in pixels of the Gaussian that makes A as blurred as B. The shift is the peak
 * of the normalised cross-correlation of B's luma with A's, A blurred so that the peak is highest:
 * against a sharp A, what lies beyond the blur's reach would pull it. */
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

static double *luma(const picture *p) {
  double *luma = malloc(sizeof *luma * (size_t)(p->width * p->height));
  for (int i = 0; luma && i < p->width * p->height; i++)
    luma[i] = 0.299 * p->rgb[3 * i] + 0.587 * p->rgb[3 * i + 1] + 0.114 * p->rgb[3 * i + 2];
  return luma;
}

/* Blurs along x (step 1) or y (step width) with a Gaussian, taking only what the mask shows. */
static void blur_along(const picture *mask, const double *from, double *to, double sigma_px, int dx,
                       int dy) {
  int reach = (int)ceil(3 * sigma_px);
  for (int y = 0; y < mask->height; y++)
    for (int x = 0; x < mask->width; x++) {
      double sum = 0, weights = 0;
      for (int k = -reach; k <= reach; k++)
        if (inside(mask, x + k * dx, y + k * dy, 0)) {
          double w = sigma_px > 0 ? exp(-k * k / (2 * sigma_px * sigma_px)) : 1;
          sum += w * from[(y + k * dy) * mask->width + x + k * dx], weights += w;
        }
      to[y * mask->width + x] = weights > 0 ? sum / weights : 0;
    }
}

static double correlation(const double *a, const double *b, const picture *mask, int dx, int dy) {
  double n = 0, sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  for (int y = 0; y < mask->height; y++)
    for (int x = 0; x < mask->width; x++)
      if (inside(mask, x, y, RADIUS + 1)) {
        double la = a[y * mask->width + x], lb = b[(y + dy) * mask->width + x + dx];
        n++, sa += la, sb += lb, saa += la * la, sbb += lb * lb, sab += la * lb;
      }
  return (n * sab - sa * sb) / sqrt((n * saa - sa * sa) * (n * sbb - sb * sb));
}

static double peak(double before, double at, double after) {
  return 0.5 * (before - after) / (before - 2 * at + after);
}

/* Prints shift and blur of b against a. */
static int print_shift(const picture *a, const picture *b, const picture *mask) {
  double *la = luma(a), *lb = luma(b), *row = luma(a), *blurred = luma(a);
  if (!la || !lb || !row || !blurred) return fprintf(stderr, "compare: out of memory\n"), 1;
  double best = -2, best_sigma = 0, shift_x = 0, shift_y = 0;
  for (double sigma_px = 0; sigma_px <= 12; sigma_px += 0.5) {
    blur_along(mask, la, row, sigma_px, 1, 0), blur_along(mask, row, blurred, sigma_px, 0, 1);
    for (int y = -RADIUS + 1; y < RADIUS; y++)
      for (int x = -RADIUS + 1; x < RADIUS; x++) {
        double at = correlation(blurred, lb, mask, x, y);
        if (at <= best) continue;
        best = at, best_sigma = sigma_px;
        shift_x = x + peak(correlation(blurred, lb, mask, x - 1, y), at,
                           correlation(blurred, lb, mask, x + 1, y));
        shift_y = y + peak(correlation(blurred, lb, mask, x, y - 1), at,
                           correlation(blurred, lb, mask, x, y + 1));
      }
  }
  printf(" %.3f %.3f %.1f", shift_x, shift_y, best_sigma);
  free(la), free(lb), free(row), free(blurred);
  return 0;
}

int main(int argc, char **argv) {
  int shift = argc > 1 && !strcmp(argv[1], "--shift");
  argc -= shift, argv += shift;
  if (argc != 4) return fprintf(stderr, "compare: expected [--shift] A.png B.png MASK.png\n"), 2;
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

  printf("%.2f %ld", 10 * log10(255.0 * 255.0 * 3 * (double)count / squares), count);
  int failed = shift && print_shift(&a, &b, &mask);
  putchar('\n');
  free(a.rgb), free(b.rgb), free(mask.rgb);
  return failed;
}
