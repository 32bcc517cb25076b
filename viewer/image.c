#include "image.h"

#include <errno.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

slf_result image_write_png(const char *path, const uint8_t *rgba, int width_px, int height_px,
                           slf_error *error) {
  slf_result result = SLF_ERROR_IO;
  size_t path_nbytes = strlen(path);
  size_t pixel_count = (size_t)width_px * (size_t)height_px;
  char *part = malloc(path_nbytes + sizeof ".part");
  uint8_t *rgb = malloc(3 * pixel_count);
  if (!part || !rgb) {
    snprintf(error->message, sizeof error->message, "%s: out of memory", path);
    result = SLF_ERROR_MEMORY;
    goto done;
  }
  for (size_t i = 0; i < pixel_count; i++) memcpy(rgb + 3 * i, rgba + 4 * i, 3);
  memcpy(part, path, path_nbytes);
  memcpy(part + path_nbytes, ".part", sizeof ".part");
  png_image png = {.version = PNG_IMAGE_VERSION,
                   .width = (png_uint_32)width_px,
                   .height = (png_uint_32)height_px,
                   .format = PNG_FORMAT_RGB};
  if (!png_image_write_to_file(&png, part, 0, rgb, 0, NULL)) {
    snprintf(error->message, sizeof error->message, "%s: %s", path,
             errno ? strerror(errno) : png.message);
    unlink(part);
  } else if (rename(part, path) != 0) {
    snprintf(error->message, sizeof error->message, "%s: %s", path, strerror(errno));
    unlink(part);
  } else {
    result = SLF_OK;
  }
done:
  free(part);
  free(rgb);
  return result;
}

void image_reduce(const uint8_t *rgba, int width_px, int height_px, int samples, uint8_t *out) {
  float linear[256];
  for (int code = 0; code < 256; code++) linear[code] = slf_linear_from_srgb((uint8_t)code);
  size_t row_nbytes = (size_t)width_px * (size_t)samples * 4;
  float scale = 1.0f / (float)(samples * samples);
  for (int y = 0; y < height_px; y++)
    for (int x = 0; x < width_px; x++) {
      float sum[3] = {0, 0, 0};
      for (int j = 0; j < samples; j++) {
        const uint8_t *p = rgba + (size_t)(y * samples + j) * row_nbytes + (size_t)x * samples * 4;
        for (int i = 0; i < samples; i++, p += 4)
          for (int k = 0; k < 3; k++) sum[k] += linear[p[k]];
      }
      uint8_t *pixel = out + 4 * ((size_t)y * width_px + x);
      for (int k = 0; k < 3; k++) pixel[k] = slf_srgb_from_linear(sum[k] * scale);
      pixel[3] = 255;
    }
}
