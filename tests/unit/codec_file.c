/* A file comes back as it was written, and only as it was written. */
#include "codec/file.h"
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
  float highlight; /* radiance of the highlight, 0 means 1 */
} analytic;

static void radiance(const analytic *a, uint32_t u, uint32_t v, uint32_t s, uint32_t t,
                     float rgb[3]) {
  double U = (u + 0.5) / a->u_count, V = (v + 0.5) / a->v_count;
  double S = (s + 0.5) / a->s_count, T = (t + 0.5) / a->t_count;
  double grain = 0.5 + 0.5 * sin(40 * U + 6 * sin(9 * V));
  double du = U - S, dv = V - T, lobe = exp(-(du * du + dv * dv) * 30);
  double gain = a->highlight > 0 ? a->highlight : 1;
  rgb[0] = (float)(0.05 + 0.25 * grain + 0.6 * lobe * gain);
  rgb[1] = (float)(0.04 + 0.15 * grain + 0.6 * lobe * gain);
  rgb[2] = (float)(0.03 + 0.05 * grain + 0.5 * lobe * gain);
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

static slf_curve curve = SLF_CURVE_SRGB;
static uint32_t thread_count = 2;

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
                               .curve = curve,
                               .thread_count = thread_count,
                               .u_count = field->u_count,
                               .v_count = field->v_count,
                               .s_count = field->s_count,
                               .t_count = field->t_count,
                               .quality = quality};
  analytic copy = *field;
  slf_source source = {read_slice, &copy, NULL};
  MUST(slf_writer_add_layer(writer, &options, &source, &error));
  surface = (slf_surface){
      .name = "wall", .mesh = {square, two_triangles, 4, 2}, .slab = {.thickness = 2, .ior = 1.5f}};
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

/* A sanitized build looks for bad memory, at a tenth of the speed: what the plain one finds out
 * about numbers and bytes it need not find out again. */
#if defined(__SANITIZE_ADDRESS__)
enum { SLOWER = 2 };
#else
enum { SLOWER = 1 };
#endif

/* ---- Tests --------------------------------------------------------------------------------- */

static void what_was_written_is_read(void **state) {
  (void)state;
  analytic field = {36, 20, 5, 4, 1};
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
  assert_true(surface->slab.thickness == 0);
  const slf_slab *slab = &slf_get_surface(file, 1)->slab;
  assert_true(slab->thickness == 2 && slab->ior == 1.5f);
  slf_close(file);
}

static void slabs_bend_light_or_are_refused(void **state) {
  (void)state;
  slf_error error;
  slf_writer *writer;
  const slf_slab none[] = {{-1, 1.5f}, {NAN, 1.5f}, {INFINITY, 1.5f},
                           {1, 1},     {1, NAN},    {1, INFINITY}};
  MUST(slf_writer_create(path, &writer, &error));
  for (size_t i = 0; i < sizeof none / sizeof *none; i++) {
    slf_surface surface = {.name = "pane", .mesh = {square, two_triangles, 4, 2}, .slab = none[i]};
    assert_int_equal(slf_writer_add_surface(writer, &surface, &error), SLF_ERROR_ARGUMENT);
  }
  slf_writer_abort(writer);
}

static void error_falls_as_quality_rises(void **state) {
  (void)state;
  analytic field = {64, 48, 6, 6, 1};
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

/* Each block of the first surface, decoded alone, has the codes of its slice. */
static void assert_blocks_agree_with_slices(const slf_file *file, const analytic *field) {
  const uint32_t u_count = field->u_count, v_count = field->v_count;
  float *rgb = malloc((size_t)u_count * v_count * 3 * sizeof *rgb);
  for (uint16_t t = 0; t < field->t_count; t++)
    for (uint16_t s = 0; s < field->s_count; s++) {
      if (!slf_slice_exists(field->s_count, field->t_count, s, t)) continue;
      assert_int_equal(slf_decode_slice(file, 0, 0, s, t, rgb, NULL), SLF_OK);
      for (uint16_t v0 = 0; v0 < v_count; v0 += 8)
        for (uint16_t u0 = 0; u0 < u_count; u0 += 8) {
          uint8_t block[SLF_BLOCK_NBYTES];
          slf_decode_block(file, 0, 0, (slf_block_address){s, t, u0 / 8, v0 / 8}, block);
          for (uint32_t v = v0; v < v0 + 8u && v < v_count; v++)
            for (uint32_t u = u0; u < u0 + 8u && u < u_count; u++) {
              const uint8_t *texel = block + 32 * (v % 8) + 4 * (u % 8);
              for (int c = 0; c < 3; c++)
                assert_true(slf_linear_from_srgb(texel[c]) == rgb[3 * (u_count * v + u) + c]);
              assert_int_equal(texel[3], 255);
            }
        }
    }
  free(rgb);
}

/* Heads coded whole, which only larger files have: slices, and blocks alone, decode to what the
 * encoder chose their levels for. */
static void whole_heads_come_back(void **state) {
  (void)state;
  analytic field = {128, 128, 6, 6, 1};
  const slf_angular angular[] = {SLF_ANGULAR_NONE, SLF_ANGULAR_LAYERED};
  for (int i = SLOWER - 1; i < 2; i++) {
    write_file(&field, 75, angular[i]);
    slf_error error;
    slf_file *file;
    MUST(slf_open(path, &file, &error));
    const huffman_code *code =
        &file->surfaces[0].layers[0].streams[STREAM_REST].codes.codes[CODE_WHOLE_HEAD];
    double found = psnr(file, &field), chosen = slf_get_surface(file, 0)->layers[0].psnr;
    print_message("  %d whole heads, %.3f dB, chosen for %.3f\n", code->symbol_count, found,
                  chosen);
    assert_true(code->symbol_count > 0);
    assert_true(fabs(found - chosen) < 0.05); /* as kept_files_are_read */
    assert_blocks_agree_with_slices(file, &field);
    slf_close(file);
  }
}

static void blocks_agree_with_slices(void **state) {
  (void)state;
  analytic field = {20, 12, 4, 4, 1};
  write_file(&field, 85, SLF_ANGULAR_NONE);
  slf_error error;
  slf_file *file;
  MUST(slf_open(path, &file, &error));
  assert_blocks_agree_with_slices(file, &field);
  float rgb[20 * 12 * 3];
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

static const slf_angular schemes[] = {SLF_ANGULAR_NONE, SLF_ANGULAR_IDENTICAL, SLF_ANGULAR_MOTION,
                                      SLF_ANGULAR_LAYERED};
enum { SCHEMES = 4 };

/* Written by this suite's write_file when the version was new: a library that reads them
 * otherwise reads another format. */
static void kept_files_are_read(void **state) {
  (void)state;
  static const char *const names[] = {"tests/unit/kept/layered-4.0.slf",
                                      "tests/unit/kept/none-4.0.slf"};
  analytic field = {20, 12, 6, 5, 1};
  for (int i = 0; i < 2; i++) {
    slf_error error;
    slf_file *file;
    MUST(slf_open(names[i], &file, &error));
    MUST(slf_verify(file, &error));
    /* The encoder measures what it decodes to, but for its transform's rounding. */
    assert_true(fabs(psnr(file, &field) - slf_get_surface(file, 0)->layers[0].psnr) < 0.05);
    slf_close(file);
  }
}

static void every_truncation_is_refused(void **state) {
  (void)state;
  analytic field = {9, 9, 3, 3, 1};
  for (int scheme = 0; scheme < SCHEMES; scheme++) {
    write_file(&field, 70, schemes[scheme]);
    size_t nbytes;
    uint8_t *bytes = read_bytes(&nbytes);
    assert_int_equal(open_and_read(bytes, nbytes), SLF_OK);
    for (size_t n = 0; n < nbytes; n++) assert_int_not_equal(open_and_read(bytes, n), SLF_OK);
    free(bytes);
  }
}

/* CRC-32 finds every change within 32 bits, so verify refuses each; decoding must stay in bounds.
 * A sanitized build takes every other byte, one flip of each. */
static void every_flipped_byte_is_found(void **state) {
  (void)state;
  analytic field = {9, 9, 3, 3, 1};
  for (int scheme = 0; scheme < SCHEMES; scheme += 3) {
    write_file(&field, 70, schemes[scheme]);
    size_t nbytes;
    uint8_t *bytes = read_bytes(&nbytes);
    static const uint8_t flips[] = {0x04, 0xff};
    for (size_t i = 0; i < nbytes; i += SLOWER)
      for (size_t flip = i / SLOWER % SLOWER; flip < 2; flip += SLOWER) {
        bytes[i] ^= flips[flip];
        assert_int_not_equal(open_and_read(bytes, nbytes), SLF_OK);
        bytes[i] ^= flips[flip];
      }
    free(bytes);
  }
}

/* The schemes differ in what they predict, not in what a step does to a coefficient: at one quality
 * they come out within a few dB, the predicted ones better for their finer base. */
static void schemes_agree_on_quality(void **state) {
  (void)state;
  analytic field = {40, 32, 9, 8, 1};
  double found[SCHEMES];
  for (int scheme = 0; scheme < SCHEMES; scheme++) {
    write_file(&field, 80, schemes[scheme]);
    slf_error error;
    slf_file *file;
    MUST(slf_open(path, &file, &error));
    MUST(slf_verify(file, &error));
    const slf_layer *layer = &slf_get_surface(file, 0)->layers[0];
    assert_int_equal(layer->angular, schemes[scheme]);
    found[scheme] = psnr(file, &field);
    print_message("  scheme %d: %.2f dB, %.1f : 1\n", scheme, found[scheme],
                  (double)layer->raw_nbytes / (double)layer->payload_nbytes);
    /* What the encoder says it did is what the decoder does: the same codes but for float sums that
     * end on a half, one in thousands. */
    assert_true(fabs(found[scheme] - layer->psnr) < 0.01);
    assert_true(found[scheme] > found[0] - 1);
    slf_close(file);
  }
}

static void threads_change_nothing(void **state) {
  (void)state;
  analytic field = {40, 32, 9, 8, 1};
  for (int scheme = 0; scheme < SCHEMES; scheme++) {
    uint8_t *first = NULL;
    size_t first_nbytes = 0;
    for (thread_count = 1; thread_count <= 5; thread_count += 2 * SLOWER) {
      size_t nbytes;
      write_file(&field, 75, schemes[scheme]);
      uint8_t *bytes = read_bytes(&nbytes);
      if (first) {
        assert_int_equal(nbytes, first_nbytes);
        assert_memory_equal(bytes, first, nbytes);
        free(bytes);
      } else {
        first = bytes;
        first_nbytes = nbytes;
      }
    }
    free(first);
  }
  thread_count = 2;
}

/* Batches in any order give what single blocks give, to the bit. */
static void batches_agree_with_blocks(void **state) {
  (void)state;
  analytic field = {40, 32, 9, 8, 1};
  for (int scheme = 0; scheme < SCHEMES; scheme++) {
    write_file(&field, 80, schemes[scheme]);
    slf_error error;
    slf_file *file;
    MUST(slf_open(path, &file, &error));
    enum { COUNT = 999 };
    static uint8_t blocks[COUNT][SLF_BLOCK_NBYTES];
    slf_block_address addresses[COUNT];
    uint8_t *pointers[COUNT], single[SLF_BLOCK_NBYTES];
    uint32_t x = 1;
    for (int i = 0; i < COUNT; i++) {
      x = x * 1664525 + 1013904223;
      /* Some beyond the edges; every third the right neighbour of the one before. */
      addresses[i] = (slf_block_address){(uint16_t)(x >> 8 & 15) % 10, (uint16_t)(x >> 12 & 15) % 9,
                                         (uint16_t)(x >> 16 & 7) % 6, (uint16_t)(x >> 20 & 7) % 5};
      if (i % 3 == 2) {
        addresses[i] = addresses[i - 1];
        addresses[i].s ^= 1;
      }
      pointers[i] = blocks[i];
    }
    slf_decode_blocks(file, 0, 0, addresses, COUNT, pointers);
    for (int i = 0; i < COUNT; i++) {
      slf_decode_block(file, 0, 0, addresses[i], single);
      assert_memory_equal(single, blocks[i], SLF_BLOCK_NBYTES);
    }
    slf_close(file);
  }
}

/* Radiance beyond 1 comes back within the curve's own steps, and the sRGB view of it is clamped. */
static void hdr_comes_back(void **state) {
  (void)state;
  analytic field = {24, 24, 8, 8, 50};
  curve = SLF_CURVE_DWA;
  for (int scheme = 0; scheme < SCHEMES; scheme++) {
    write_file(&field, 88, schemes[scheme]);
    slf_error error;
    slf_file *file;
    MUST(slf_open(path, &file, &error));
    MUST(slf_verify(file, &error));
    const slf_layer *layer = &slf_get_surface(file, 0)->layers[0];
    print_message("  scheme %d: %.2f dB, %.1f : 1\n", scheme, layer->psnr,
                  (double)layer->raw_nbytes / (double)layer->payload_nbytes);
    float rgb[24 * 24 * 3], truth[3], largest = 0;
    double squares = 0, bright_count = 0;
    for (uint32_t t = 0; t < 8; t++)
      for (uint32_t s = 0; s < 8; s++) {
        if (!slf_slice_exists(8, 8, s, t)) continue;
        MUST(slf_decode_slice(file, 0, 0, s, t, rgb, &error));
        for (uint32_t i = 0; i < 24 * 24; i++) {
          radiance(&field, i % 24, i / 24, s, t, truth);
          for (int c = 0; c < 3; c++) {
            largest = fmaxf(largest, truth[c]);
            if (truth[c] < 1) continue;
            double relative = (rgb[3 * i + c] - truth[c]) / truth[c];
            squares += relative * relative;
            bright_count++;
          }
        }
      }
    assert_true(largest > 20);
    /* Steps of 2^(12/8) * 677/255 = 7.5 codes leave an error of at most 7.5 * sqrt(2.9 * 2 / 12)
     * = 5.2; in the curve's logarithm a code is 2.2 / 677 of the value. */
    assert_true(sqrt(squares / bright_count) < 5.2 * 2.2 / 677 * 2);
    uint8_t codes[SLF_BLOCK_NBYTES];
    float linear[192];
    slf_block_address a = {4, 4, 1, 1};
    slf_decode_block(file, 0, 0, a, codes);
    slf_decode_block_linear(file, 0, 0, a, linear);
    for (int i = 0; i < 64; i++)
      for (int c = 0; c < 3; c++)
        assert_int_equal(codes[4 * i + c], slf_srgb_from_linear(linear[3 * i + c]));
    slf_close(file);
  }
  curve = SLF_CURVE_SRGB;
}

/* A flat block comes back exactly while DC's step is small: 8 levels of it are a code. */
static slf_result read_flat(void *context, uint32_t s, uint32_t t, float *rgb, slf_error *error) {
  (void)error;
  const analytic *a = context;
  for (uint32_t i = 0; i < a->u_count * a->v_count; i++) {
    uint32_t block = i / a->u_count / 8 * ((a->u_count + 7) / 8) + i % a->u_count / 8;
    for (uint32_t c = 0; c < 3; c++) {
      uint32_t code = block == 0   ? 0
                      : block == 1 ? 255
                                   : (block * 97 + s * 31 + t * 57 + c * 83) & 255;
      *rgb++ = slf_linear_from_srgb((uint8_t)code);
    }
  }
  return SLF_OK;
}

static void flat_blocks_are_exact(void **state) {
  (void)state;
  analytic field = {64, 64, 4, 4, 1};
  for (int scheme = 0; scheme < SCHEMES; scheme++) {
    slf_error error;
    slf_writer *writer;
    slf_file *file;
    slf_surface surface = {.name = "flat"};
    slf_layer_options options = {.angular = schemes[scheme],
                                 .u_count = 64,
                                 .v_count = 64,
                                 .s_count = 4,
                                 .t_count = 4,
                                 .quality = 100};
    slf_source source = {read_flat, &field, NULL};
    MUST(slf_writer_create(path, &writer, &error));
    MUST(slf_writer_add_surface(writer, &surface, &error));
    MUST(slf_writer_add_layer(writer, &options, &source, &error));
    MUST(slf_writer_finish(writer, &error));
    MUST(slf_open(path, &file, &error));
    float *truth = malloc(64 * 64 * 3 * sizeof *truth), *rgb = malloc(64 * 64 * 3 * sizeof *rgb);
    for (uint32_t t = 0; t < 4; t++)
      for (uint32_t s = 0; s < 4; s++) {
        if (!slf_slice_exists(4, 4, s, t)) continue;
        read_flat(&field, s, t, truth, &error);
        MUST(slf_decode_slice(file, 0, 0, s, t, rgb, &error));
        assert_memory_equal(truth, rgb, 64 * 64 * 3 * sizeof *rgb);
      }
    free(truth);
    free(rgb);
    slf_close(file);
  }
}

/* A grain between green and purple, across JFIF's luma. */
static slf_result read_two_colours(void *context, uint32_t s, uint32_t t, float *rgb,
                                   slf_error *error) {
  (void)context, (void)error, (void)s, (void)t;
  for (int k = 0; k < 64 * 64; k++) {
    int code = (int)(40 * sin(1.3 * (k % 64) + 2 * sin(0.9 * (k / 64.0))));
    for (int c = 0; c < 3; c++)
      *rgb++ = slf_linear_from_srgb((uint8_t)(128 + (c == 1 ? -code : code)));
  }
  return SLF_OK;
}

/* Of texels that vary along one line two channels of own colours have nothing to say; JFIF's three
 * all have. */
static void own_colours_follow_the_texels(void **state) {
  (void)state;
  static const slf_angular asked[] = {SLF_ANGULAR_NONE, SLF_ANGULAR_LAYERED};
  slf_layer layers[2];
  for (int i = 0; i < 2; i++) {
    slf_error error;
    slf_writer *writer;
    slf_file *file;
    slf_surface surface = {.name = "two colours"};
    slf_layer_options options = {.angular = asked[i],
                                 .u_count = 64,
                                 .v_count = 64,
                                 .s_count = 1,
                                 .t_count = 1,
                                 .quality = 80};
    slf_source source = {read_two_colours, NULL, NULL};
    MUST(slf_writer_create(path, &writer, &error));
    MUST(slf_writer_add_surface(writer, &surface, &error));
    MUST(slf_writer_add_layer(writer, &options, &source, &error));
    MUST(slf_writer_finish(writer, &error));
    MUST(slf_open(path, &file, &error));
    MUST(slf_verify(file, &error));
    layers[i] = slf_get_surface(file, 0)->layers[0];
    print_message("  %s colours: %.2f dB, %llu bytes\n", i ? "own" : "JFIF's", layers[i].psnr,
                  (unsigned long long)layers[i].payload_nbytes);
    slf_close(file);
  }
  /* A third of the levels, more of DC and heads: half leaves room. */
  assert_true(layers[1].psnr > layers[0].psnr - 0.5);
  assert_true(layers[1].payload_nbytes * 2 < layers[0].payload_nbytes);
}

/* What was decoded, encoded again at the same quality, hardly changes any more: its coefficients
 * are levels already, but for rounding to codes (1/12 of squared error in each), which a step of 4
 * forgives. */
typedef struct {
  slf_file *file;
} decoded_source;

static slf_result read_decoded(void *context, uint32_t s, uint32_t t, float *rgb,
                               slf_error *error) {
  return slf_decode_slice(((decoded_source *)context)->file, 0, 0, s, t, rgb, error);
}

static void encoding_again_is_stable(void **state) {
  (void)state;
  analytic field = {40, 32, 6, 6, 1};
  slf_error error;
  write_file(&field, 84, SLF_ANGULAR_NONE);
  decoded_source first;
  MUST(slf_open(path, &first.file, &error));
  slf_writer *writer;
  slf_surface surface = {.name = "again"};
  slf_layer_options options = {
      .u_count = 40, .v_count = 32, .s_count = 6, .t_count = 6, .quality = 84};
  slf_source source = {read_decoded, &first, NULL};
  MUST(slf_writer_create(path, &writer, &error));
  MUST(slf_writer_add_surface(writer, &surface, &error));
  MUST(slf_writer_add_layer(writer, &options, &source, &error));
  MUST(slf_writer_finish(writer, &error));
  slf_file *again;
  MUST(slf_open(path, &again, &error));
  print_message("  first %.2f dB, again %.2f dB\n", slf_get_surface(first.file, 0)->layers[0].psnr,
                slf_get_surface(again, 0)->layers[0].psnr);
  /* Steps of 4 left 46 dB or so the first time; most of that must not be lost a second time. */
  assert_true(slf_get_surface(again, 0)->layers[0].psnr >
              slf_get_surface(first.file, 0)->layers[0].psnr + 3);
  slf_close(again);
  slf_close(first.file);
}

/* A file of an older layout must not be read as one of today's. */
static void other_versions_are_refused(void **state) {
  (void)state;
  slf_error error;
  slf_file *file;
  size_t nbytes;
  const analytic field = {8, 8, 1, 1, 0};
  write_file(&field, 75, SLF_ANGULAR_NONE);
  uint8_t *bytes = read_bytes(&nbytes);
  for (int change = -1; change <= 1; change += 2) {
    uint8_t version = bytes[8];
    bytes[8] = (uint8_t)(version + change);
    assert_int_equal(slf_open_memory(bytes, nbytes, "old", &file, &error), SLF_ERROR_FORMAT);
    assert_null(file);
    assert_non_null(strstr(error.message, "old: format version"));
    bytes[8] = version;
  }
  free(bytes);
}

/* Heights alone have a unit. */
static void layers_have_roles(void **state) {
  (void)state;
  slf_error error;
  slf_writer *writer;
  slf_file *file;
  slf_surface surface = {.name = "mirror"};
  analytic field = {8, 8, 1, 1, 0};
  slf_source source = {read_slice, &field, NULL};
  slf_layer_options options = {
      .u_count = 8, .v_count = 8, .s_count = 1, .t_count = 1, .quality = 75};
  MUST(slf_writer_create(path, &writer, &error));
  MUST(slf_writer_add_surface(writer, &surface, &error));
  for (int role = SLF_ROLE_OWN; role <= SLF_ROLE_COVERAGE; role++) {
    options.role = (slf_role)role;
    options.height_unit = role == SLF_ROLE_HEIGHT ? 2 : 0;
    MUST(slf_writer_add_layer(writer, &options, &source, &error));
  }
  MUST(slf_writer_finish(writer, &error));
  MUST(slf_open(path, &file, &error));
  for (int k = 0; k < 4; k++) {
    const slf_layer *layer = &slf_get_surface(file, 0)->layers[k];
    assert_int_equal(layer->role, SLF_ROLE_OWN + k);
    assert_true(layer->height_unit == (layer->role == SLF_ROLE_HEIGHT ? 2 : 0));
  }
  slf_close(file);
  const struct {
    int role;
    float unit;
  } wrong[] = {
      {SLF_ROLE_COVERAGE + 1, 0}, {SLF_ROLE_COVERAGE, 2}, {SLF_ROLE_HEIGHT, 0}, {SLF_ROLE_OWN, 2}};
  for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
    MUST(slf_writer_create(path, &writer, &error));
    MUST(slf_writer_add_surface(writer, &surface, &error));
    options.role = (slf_role)wrong[i].role, options.height_unit = wrong[i].unit;
    assert_int_equal(slf_writer_add_layer(writer, &options, &source, &error), SLF_ERROR_ARGUMENT);
    slf_writer_abort(writer);
  }
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
                                     cmocka_unit_test(slabs_bend_light_or_are_refused),
                                     cmocka_unit_test(error_falls_as_quality_rises),
                                     cmocka_unit_test(whole_heads_come_back),
                                     cmocka_unit_test(blocks_agree_with_slices),
                                     cmocka_unit_test(kept_files_are_read),
                                     cmocka_unit_test(every_truncation_is_refused),
                                     cmocka_unit_test(every_flipped_byte_is_found),
                                     cmocka_unit_test(schemes_agree_on_quality),
                                     cmocka_unit_test(threads_change_nothing),
                                     cmocka_unit_test(batches_agree_with_blocks),
                                     cmocka_unit_test(hdr_comes_back),
                                     cmocka_unit_test(flat_blocks_are_exact),
                                     cmocka_unit_test(own_colours_follow_the_texels),
                                     cmocka_unit_test(encoding_again_is_stable),
                                     cmocka_unit_test(other_versions_are_refused),
                                     cmocka_unit_test(layers_have_roles),
                                     cmocka_unit_test(nothing_is_seen_before_the_end)};
  return cmocka_run_group_tests_name("codec_file", tests, make_path, remove_path);
}
