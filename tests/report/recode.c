/* recode IN.slf none|identical|motion|layered QUALITY OUT.slf [half] - the light fields of a file,
 * encoded again: the report's rate and distortion, without another bake. Matte surfaces too. With
 * `half`, light fields of an even number of texels have half as many each way, each the mean of
 * four.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "slf.h"

static slf_error error;
static slf_writer *writer;

static void check(slf_result result) {
  if (result == SLF_OK) return;
  fprintf(stderr, "recode: %s\n", error.message);
  slf_writer_abort(writer);
  exit(1);
}

typedef struct {
  const slf_file *file;
  uint32_t surface, layer;
  bool halved;
  float *whole; /* a slice with all texels, where halved */
} layer_of_file;

static void halve(const float *whole, uint32_t u_count, uint32_t v_count, float *rgb) {
  const size_t row = 3 * (size_t)u_count;
  for (size_t j = 0; j < v_count; j += 2)
    for (size_t i = 0; i < row; i += 6)
      for (size_t c = i; c < i + 3; c++) {
        const float *from = whole + j * row + c;
        *rgb++ = 0.25f * (from[0] + from[3] + from[row] + from[row + 3]);
      }
}

static slf_result read_slice(void *context, uint32_t s_index, uint32_t t_index, float *rgb,
                             slf_error *e) {
  const layer_of_file *from = context;
  const slf_layer *layer = &slf_get_surface(from->file, from->surface)->layers[from->layer];
  if (!from->halved)
    return slf_decode_slice(from->file, from->surface, from->layer, s_index, t_index, rgb, e);
  const slf_result result =
      slf_decode_slice(from->file, from->surface, from->layer, s_index, t_index, from->whole, e);
  if (result == SLF_OK) halve(from->whole, layer->u_count, layer->v_count, rgb);
  return result;
}

static void recode_layer(const slf_file *file, uint32_t surface, uint32_t index,
                         slf_angular angular, float quality, bool half) {
  const slf_layer *layer = &slf_get_surface(file, surface)->layers[index];
  half = half && layer->slice_count > 1 && layer->u_count % 2 == 0 && layer->v_count % 2 == 0;
  layer_of_file from = {file, surface, index, half,
                        half ? malloc((size_t)layer->u_count * layer->v_count * 3 * sizeof(float))
                             : NULL};
  const slf_source source = {read_slice, &from, NULL};
  const slf_layer_options options = {.role = layer->role,
                                     .curve = layer->curve,
                                     .angular = angular,
                                     .u_count = layer->u_count / (half ? 2 : 1),
                                     .v_count = layer->v_count / (half ? 2 : 1),
                                     .s_count = layer->s_count,
                                     .t_count = layer->t_count,
                                     .quality = quality};
  check(slf_writer_add_layer(writer, &options, &source, &error));
  free(from.whole);
}

int main(int argc, char **argv) {
  static const char *const names[] = {"none", "identical", "motion", "layered"};
  int angular = 0;
  const bool half = argc == 6 && !strcmp(argv[5], "half");
  while ((argc == 5 || half) && angular < 4 && strcmp(argv[2], names[angular])) angular++;
  if ((argc != 5 && !half) || angular == 4) {
    fputs("usage: recode IN.slf none|identical|motion|layered QUALITY OUT.slf [half]\n", stderr);
    return 2;
  }
  slf_file *file;
  check(slf_open(argv[1], &file, &error));
  check(slf_writer_create(argv[4], &writer, &error));
  float background[3];
  slf_get_background(file, background);
  slf_writer_set_background(writer, background);
  for (uint32_t i = 0; i < slf_view_count(file); i++)
    check(slf_writer_add_view(writer, slf_get_view(file, i), &error));
  for (uint32_t i = 0; i < slf_surface_count(file); i++) {
    check(slf_writer_add_surface(writer, slf_get_surface(file, i), &error));
    for (uint32_t k = 0; k < slf_get_surface(file, i)->layer_count; k++)
      recode_layer(file, i, k, (slf_angular)angular, (float)atof(argv[3]), half);
  }
  const slf_result result = slf_writer_finish(writer, &error);
  writer = NULL; /* freed either way */
  check(result);
  slf_close(file);
  return 0;
}
