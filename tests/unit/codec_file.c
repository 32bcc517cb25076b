/* A file comes back as it was written, and only as it was written. */
#include "codec/slf.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

/* ---- A light field with a closed form ------------------------------------------------------ */

/* A texture that every direction sees, and a highlight that moves with the direction. */
typedef struct {
  uint32_t u_count, v_count, s_count, t_count;
} analytic;

static void radiance(const analytic *a, uint32_t u, uint32_t v, uint32_t s, uint32_t t,
                     float rgb[3]) {
  double U = (u + 0.5) / a->u_count, V = (v + 0.5) / a->v_count;
  double S = (s + 0.5) / a->s_count, T = (t + 0.5) / a->t_count;
  double grain = 0.5 + 0.5 * sin(40 * U + 6 * sin(9 * V));
  double du = U - S, dv = V - T, lobe = exp(-(du * du + dv * dv) * 30);
  rgb[0] = (float)(0.05 + 0.25 * grain + 0.6 * lobe);
  rgb[1] = (float)(0.04 + 0.15 * grain + 0.6 * lobe);
  rgb[2] = (float)(0.03 + 0.05 * grain + 0.5 * lobe);
}

static slf_result read_slice(void *context, uint32_t s, uint32_t t, float *rgb, slf_error *error) {
  const analytic *a = context;
  (void)error;
  for (uint32_t v = 0; v < a->v_count; v++)
    for (uint32_t u = 0; u < a->u_count; u++, rgb += 3) radiance(a, u, v, s, t, rgb);
  return SLF_OK;
}

static const slf_vertex square[4] = {{{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {0, 0, 1}, 0, 0},
                                     {{1, 0, 0}, {0, 1, 0}, {1, 0, 0}, {0, 0, 1}, 1, 0},
                                     {{1, 0, 1}, {0, 1, 0}, {1, 0, 0}, {0, 0, 1}, 1, 1},
                                     {{0, 0, 1}, {0, 1, 0}, {1, 0, 0}, {0, 0, 1}, 0, 1}};
static const uint32_t two_triangles[6] = {0, 1, 2, 0, 2, 3};

static char path[64];

static int make_path(void **state) {
  (void)state;
  snprintf(path, sizeof path, "/tmp/slf_codec_file.%ld.slf", (long)getpid());
  return 0;
}

static int remove_path(void **state) {
  (void)state;
  unlink(path);
  return 0;
}

#define MUST(call)                                                                                 \
  do {                                                                                             \
    if ((call) != SLF_OK) fail_msg("%s", error.message);                                           \
  } while (0)

/* Two surfaces: a light field and a matte. */
static void write_file(const analytic *field, float quality, slf_angular angular) {
  slf_error error;
  slf_writer *writer;
  MUST(slf_writer_create(path, &writer, &error));
  slf_writer_set_background(writer, (float[]){0.25f, 0.5f, 1.0f});
  slf_view view = {"front", {0, 1, -2}, {0.5f, 0, 0.5f}, 60};
  MUST(slf_writer_add_view(writer, &view, &error));
  slf_surface surface = {
      .name = "floor", .flags = SLF_SURFACE_WATER, .mesh = {square, two_triangles, 4, 2}};
  MUST(slf_writer_add_surface(writer, &surface, &error));
  slf_layer_options options = {.angular = angular,
                               .u_count = field->u_count,
                               .v_count = field->v_count,
                               .s_count = field->s_count,
                               .t_count = field->t_count,
                               .quality = quality};
  analytic copy = *field;
  slf_source source = {read_slice, &copy, NULL};
  MUST(slf_writer_add_layer(writer, &options, &source, &error));
  surface = (slf_surface){.name = "wall", .mesh = {square, two_triangles, 4, 2}};
  MUST(slf_writer_add_surface(writer, &surface, &error));
  copy.s_count = copy.t_count = options.s_count = options.t_count = 1;
  MUST(slf_writer_add_layer(writer, &options, &source, &error));
  MUST(slf_writer_finish(writer, &error));
}

static uint8_t *read_bytes(size_t *nbytes) {
  FILE *f = fopen(path, "rb");
  assert_non_null(f);
  fseek(f, 0, SEEK_END);
  *nbytes = (size_t)ftell(f);
  rewind(f);
  uint8_t *bytes = malloc(*nbytes);
  assert_int_equal(fread(bytes, 1, *nbytes, f), *nbytes);
  fclose(f);
  return bytes;
}

/* PSNR of the 8-bit codes of all slices of the first surface. */
static double psnr(const slf_file *file, const analytic *field) {
  double sum = 0, count = 0;
  float *rgb = malloc((size_t)field->u_count * field->v_count * 3 * sizeof *rgb);
  for (uint32_t t = 0; t < field->t_count; t++)
    for (uint32_t s = 0; s < field->s_count; s++) {
      if (!slf_slice_exists(field->s_count, field->t_count, s, t)) continue;
      assert_int_equal(slf_decode_slice(file, 0, 0, s, t, rgb, NULL), SLF_OK);
      for (uint32_t v = 0; v < field->v_count; v++)
        for (uint32_t u = 0; u < field->u_count; u++) {
          float truth[3];
          radiance(field, u, v, s, t, truth);
          for (int c = 0; c < 3; c++, count++) {
            double d = slf_srgb_from_linear(rgb[3 * (v * field->u_count + u) + c]) -
                       (double)slf_srgb_from_linear(truth[c]);
            sum += d * d;
          }
        }
    }
  free(rgb);
  return 10 * log10(255 * 255 / (sum / count));
}

/* ---- Tests --------------------------------------------------------------------------------- */

static void what_was_written_is_read(void **state) {
  (void)state;
  analytic field = {36, 20, 5, 4};
  write_file(&field, 80, SLF_ANGULAR_NONE);
  slf_error error;
  slf_file *file;
  MUST(slf_open(path, &file, &error));
  MUST(slf_verify(file, &error));
  assert_int_equal(slf_surface_count(file), 2);
  assert_int_equal(slf_view_count(file), 1);
  assert_null(slf_get_surface(file, 2));
  assert_null(slf_get_view(file, 1));
  const slf_view *view = slf_get_view(file, 0);
  assert_string_equal(view->name, "front");
  assert_true(view->location[2] == -2 && view->look_at[0] == 0.5f && view->angle_deg == 60);
  float background[3];
  slf_get_background(file, background);
  assert_true(background[0] == 0.25f && background[1] == 0.5f && background[2] == 1.0f);
  const slf_surface *surface = slf_get_surface(file, 0);
  assert_string_equal(surface->name, "floor");
  assert_int_equal(surface->flags, SLF_SURFACE_WATER);
  assert_int_equal(surface->mesh.vertex_count, 4);
  assert_memory_equal(surface->mesh.vertices, square, sizeof square);
  assert_memory_equal(surface->mesh.triangles, two_triangles, sizeof two_triangles);
  const slf_layer *layer = &surface->layers[0];
  assert_int_equal(layer->block_u_count, 5);
  assert_int_equal(layer->block_v_count, 3);
  uint32_t slices = 0;
  for (uint32_t t = 0; t < 4; t++)
    for (uint32_t s = 0; s < 5; s++) slices += slf_slice_exists(5, 4, s, t);
  assert_int_equal(layer->slice_count, slices);
  assert_int_equal(slf_get_surface(file, 1)->layers[0].slice_count, 1);
  slf_close(file);
}

static void error_falls_as_quality_rises(void **state) {
  (void)state;
  analytic field = {64, 48, 6, 6};
  /* A uniform quantiser of step q leaves at most q * q / 12 of error in each coefficient, and no
   * more in the texels, for the transform is orthonormal; levels that are rounded down double it at
   * worst. Luma's share of an RGB error is one, chroma's together (1.77^2 + 0.34^2 + ...) / 3
   * = 1.9, so three channels of such error are 2.9 of it. 60 gives a step of 32, and so on. */
  double previous = 0;
  float qualities[] = {60, 75, 90, 100};
  for (int i = 0; i < 4; i++) {
    write_file(&field, qualities[i], SLF_ANGULAR_NONE);
    slf_error error;
    slf_file *file;
    MUST(slf_open(path, &file, &error));
    double found = psnr(file, &field), step = exp2((100 - qualities[i]) / 8) * 1.06;
    double least = 10 * log10(255 * 255 / (2 * 2.9 * step * step / 12 + 1 / 12.0));
    print_message("  quality %g: %.2f dB (at least %.2f), %.1f : 1\n", qualities[i], found, least,
                  (double)slf_get_surface(file, 0)->layers[0].raw_nbytes /
                      (double)slf_get_surface(file, 0)->layers[0].payload_nbytes);
    assert_true(found > least);
    assert_true(found > previous);
    previous = found;
    slf_close(file);
  }
}

static void blocks_agree_with_slices(void **state) {
  (void)state;
  analytic field = {20, 12, 4, 4};
  write_file(&field, 85, SLF_ANGULAR_NONE);
  slf_error error;
  slf_file *file;
  MUST(slf_open(path, &file, &error));
  float rgb[20 * 12 * 3];
  for (uint16_t t = 0; t < 4; t++)
    for (uint16_t s = 0; s < 4; s++) {
      if (!slf_slice_exists(4, 4, s, t)) continue;
      MUST(slf_decode_slice(file, 0, 0, s, t, rgb, &error));
      for (uint16_t v = 0; v < 12; v++)
        for (uint16_t u = 0; u < 20; u++) {
          uint8_t *block = malloc(SLF_BLOCK_NBYTES);
          slf_decode_block(file, 0, 0, (slf_block_address){s, t, u / 8, v / 8}, block);
          const uint8_t *texel = block + 32 * (v % 8) + 4 * (u % 8);
          for (int c = 0; c < 3; c++)
            assert_true(slf_linear_from_srgb(texel[c]) == rgb[3 * (20 * v + u) + c]);
          assert_int_equal(texel[3], 255);
          free(block);
        }
    }
  uint8_t none[SLF_BLOCK_NBYTES], zeros[SLF_BLOCK_NBYTES] = {0};
  slf_block_address beyond[] = {{4, 0, 0, 0}, {0, 4, 0, 0}, {0, 0, 3, 0}, {0, 0, 0, 2}};
  for (int i = 0; i < 4; i++) {
    memset(none, 1, sizeof none);
    slf_decode_block(file, 0, 0, beyond[i], none);
    assert_memory_equal(none, zeros, sizeof none);
  }
  assert_int_equal(slf_decode_slice(file, 0, 0, 9, 0, rgb, &error), SLF_ERROR_ARGUMENT);
  slf_close(file);
}

/* Opens a copy that is exactly as long as it says, and reads all of it. */
static slf_result open_and_read(const uint8_t *bytes, size_t nbytes) {
  uint8_t *exact = malloc(nbytes ? nbytes : 1);
  memcpy(exact, bytes, nbytes);
  slf_file *file;
  slf_result result = slf_open_memory(exact, nbytes, "copy", &file, NULL);
  if (result == SLF_OK) {
    result = slf_verify(file, NULL);
    const slf_layer *layer = &slf_get_surface(file, 0)->layers[0];
    for (uint16_t s = 0; s < layer->s_count; s++)
      for (uint16_t v = 0; v < layer->block_v_count; v++) {
        uint8_t block[SLF_BLOCK_NBYTES];
        slf_decode_block(file, 0, 0, (slf_block_address){s, s, v, v}, block);
      }
  } else {
    assert_null(file);
  }
  slf_close(file);
  free(exact);
  return result;
}

static void every_truncation_is_refused(void **state) {
  (void)state;
  analytic field = {17, 9, 3, 3};
  write_file(&field, 70, SLF_ANGULAR_NONE);
  size_t nbytes;
  uint8_t *bytes = read_bytes(&nbytes);
  assert_int_equal(open_and_read(bytes, nbytes), SLF_OK);
  for (size_t n = 0; n < nbytes; n++) assert_int_not_equal(open_and_read(bytes, n), SLF_OK);
  free(bytes);
}

/* CRC-32 finds every change within 32 bits, so verify refuses each; decoding must stay in bounds.
 */
static void every_flipped_byte_is_found(void **state) {
  (void)state;
  analytic field = {17, 9, 3, 3};
  write_file(&field, 70, SLF_ANGULAR_NONE);
  size_t nbytes;
  uint8_t *bytes = read_bytes(&nbytes);
  for (size_t i = 0; i < nbytes; i++)
    for (int flip = 1; flip < 256; flip = flip * 2 + 1) {
      bytes[i] ^= (uint8_t)flip;
      assert_int_not_equal(open_and_read(bytes, nbytes), SLF_OK);
      bytes[i] ^= (uint8_t)flip;
    }
  free(bytes);
}

static void nothing_is_seen_before_the_end(void **state) {
  (void)state;
  unlink(path);
  slf_error error;
  slf_writer *writer;
  MUST(slf_writer_create(path, &writer, &error));
  assert_int_not_equal(access(path, F_OK), 0);
  slf_writer_abort(writer);
  assert_int_not_equal(access(path, F_OK), 0);
  assert_int_equal(slf_writer_create("/nowhere/at/all.slf", &writer, &error), SLF_ERROR_IO);
  assert_null(writer);
  slf_file *file;
  assert_int_equal(slf_open(path, &file, &error), SLF_ERROR_IO);
  assert_null(file);
  slf_writer_abort(NULL);
  slf_close(NULL);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(what_was_written_is_read),
                                     cmocka_unit_test(error_falls_as_quality_rises),
                                     cmocka_unit_test(blocks_agree_with_slices),
                                     cmocka_unit_test(every_truncation_is_refused),
                                     cmocka_unit_test(every_flipped_byte_is_found),
                                     cmocka_unit_test(nothing_is_seen_before_the_end)};
  return cmocka_run_group_tests_name("codec_file", tests, make_path, remove_path);
}
