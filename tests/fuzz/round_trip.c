/* Any texels of any size in any scheme: written, read, and as near as the quality promises. */
#include "codec/slf.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

typedef struct {
  const uint8_t *bytes;
  size_t nbytes;
  uint32_t u_count, v_count;
} texels;

static slf_result read_slice(void *context, uint32_t s, uint32_t t, float *rgb, slf_error *error) {
  const texels *from = context;
  (void)error;
  for (uint32_t i = 0; i < from->u_count * from->v_count * 3; i++)
    rgb[i] = slf_linear_from_srgb(from->bytes[(i + s * 61 + t * 127) % from->nbytes]);
  return SLF_OK;
}

static void check(slf_result result, const slf_error *error) {
  if (result == SLF_OK) return;
  fprintf(stderr, "%s\n", error->message);
  abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t nbytes);
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t nbytes) {
  if (nbytes < 8) return 0;
  slf_layer_options o = {.angular = bytes[0] % 4,
                         .curve = bytes[0] >> 2 & 1,
                         .u_count = 1 + bytes[1] % 20,
                         .v_count = 1 + bytes[2] % 20,
                         .s_count = 1 + bytes[3] % 9,
                         .t_count = 1 + bytes[4] % 9,
                         .quality = 1 + bytes[5] % 100,
                         .thread_count = 1};
  texels from = {bytes + 6, nbytes - 6, o.u_count, o.v_count};
  slf_source source = {read_slice, &from, NULL};
  slf_surface surface = {.name = "fuzz"};
  slf_writer *writer;
  slf_file *file;
  slf_error error;
  char path[64];
  snprintf(path, sizeof path, "/tmp/slf_round_trip.%ld.slf", (long)getpid());
  check(slf_writer_create(path, &writer, &error), &error);
  check(slf_writer_add_surface(writer, &surface, &error), &error);
  check(slf_writer_add_layer(writer, &o, &source, &error), &error);
  check(slf_writer_finish(writer, &error), &error);
  check(slf_open(path, &file, &error), &error);
  check(slf_verify(file, &error), &error);
  const slf_layer *layer = &slf_get_surface(file, 0)->layers[0];
  float *rgb = malloc(o.u_count * o.v_count * 3 * sizeof *rgb);
  float *truth = malloc(o.u_count * o.v_count * 3 * sizeof *truth);
  double sum = 0, count = 0;
  for (uint32_t t = 0; t < o.t_count; t++)
    for (uint32_t s = 0; s < o.s_count; s++) {
      if (!slf_slice_exists(o.s_count, o.t_count, s, t)) continue;
      check(slf_decode_slice(file, 0, 0, s, t, rgb, &error), &error);
      read_slice(&from, s, t, truth, &error);
      for (uint32_t i = 0; i < o.u_count * o.v_count * 3; i++, count++) {
        double d = slf_srgb_from_linear(rgb[i]) - (double)slf_srgb_from_linear(truth[i]);
        sum += d * d;
      }
    }
  /* The encoder's own figure, which counts the same codes, and 0.05 dB for sums that end on a half.
   */
  double psnr = 10 * log10(255 * 255 / fmax(sum / count, 1e-9));
  if (o.curve == SLF_CURVE_SRGB && fabs(psnr - layer->psnr) > 0.05 && psnr < 80) {
    fprintf(stderr, "PSNR %g, the encoder says %g\n", psnr, layer->psnr);
    abort();
  }
  free(rgb);
  free(truth);
  slf_close(file);
  unlink(path);
  return 0;
}
