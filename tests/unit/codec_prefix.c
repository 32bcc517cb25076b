/* A file that is not all there: every first part of it is refused, or decodes to what is there. */
#include "codec/format.h"
#include "codec/slf.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

/* Texels enough for two segments of the rest (128 entries each) in both surfaces. */
enum { SIDE = 40, DIRECTIONS = 6, SURFACES = 2, PLACES = SIDE / 8 * SIDE / 8 };
enum { BLOCKS = PLACES * DIRECTIONS * DIRECTIONS };

/* A texture, and a highlight that moves with the direction; the surfaces differ. */
static float radiance(int surface, uint32_t s, uint32_t t, int u, int v, int c) {
  double du = (u + 0.5) / SIDE - (s + 0.5) / DIRECTIONS;
  double dv = (v + 0.5) / SIDE - (t + 0.5) / DIRECTIONS;
  double grain = sin(u * (1.1 + surface) + 3 * sin(0.7 * v)) * (c + 1);
  return (float)(0.3 + 0.06 * grain + 0.3 * exp(-12 * (du * du + dv * dv)));
}

static slf_result read_slice(void *context, uint32_t s, uint32_t t, float *rgb, slf_error *error) {
  (void)error;
  for (int k = 0; k < SIDE * SIDE * 3; k++)
    rgb[k] = radiance(*(int *)context, s, t, k / 3 % SIDE, k / 3 / SIDE, k % 3);
  return SLF_OK;
}

#define MUST(call)                                                                                 \
  do {                                                                                             \
    if ((call) != SLF_OK) fail_msg("%s", error.message);                                           \
  } while (0)

static char path[64];
static slf_error error;

static uint8_t *layered; /* the file that most tests ask for, once it was written */
static size_t layered_nbytes;

static uint8_t *copy_of_layered(size_t *nbytes) {
  uint8_t *bytes = malloc(*nbytes = layered_nbytes);
  memcpy(bytes, layered, layered_nbytes);
  return bytes;
}

static uint8_t *write_file(slf_angular angular, slf_curve curve, size_t *nbytes) {
  const bool is_layered = angular == SLF_ANGULAR_LAYERED && curve == SLF_CURVE_SRGB;
  if (is_layered && layered) return copy_of_layered(nbytes);
  slf_writer *writer;
  MUST(slf_writer_create(path, &writer, &error));
  for (int i = 0; i < SURFACES; i++) {
    slf_surface surface = {.name = "s"};
    slf_layer_options o = {.angular = angular,
                           .curve = curve,
                           .u_count = SIDE,
                           .v_count = SIDE,
                           .s_count = DIRECTIONS,
                           .t_count = DIRECTIONS,
                           .quality = 80};
    slf_source source = {read_slice, &i, NULL};
    MUST(slf_writer_add_surface(writer, &surface, &error));
    MUST(slf_writer_add_layer(writer, &o, &source, &error));
  }
  /* A matte surface, the last of all. */
  int wall = 0;
  slf_surface surface = {.name = "wall"};
  slf_layer_options o = {
      .u_count = SIDE, .v_count = SIDE, .s_count = 1, .t_count = 1, .quality = 80};
  slf_source source = {read_slice, &wall, NULL};
  MUST(slf_writer_add_surface(writer, &surface, &error));
  MUST(slf_writer_add_layer(writer, &o, &source, &error));
  MUST(slf_writer_finish(writer, &error));
  FILE *f = fopen(path, "rb");
  fseek(f, 0, SEEK_END);
  *nbytes = (size_t)ftell(f);
  rewind(f);
  uint8_t *bytes = malloc(*nbytes);
  assert_int_equal(fread(bytes, 1, *nbytes, f), *nbytes);
  fclose(f);
  unlink(path);
  if (!is_layered) return bytes;
  layered = bytes;
  layered_nbytes = *nbytes;
  return copy_of_layered(nbytes);
}

static slf_block_address address_of(uint32_t block) {
  uint32_t slice = block / PLACES, place = block % PLACES;
  return (slf_block_address){(uint16_t)(slice % DIRECTIONS), (uint16_t)(slice / DIRECTIONS),
                             (uint16_t)(place % (SIDE / 8)), (uint16_t)(place / (SIDE / 8))};
}

static bool is_of(const uint8_t *entry, uint32_t type) {
  return get_u32(entry) == type;
}

/* Where the C-Blocks begin, or the keys. */
static size_t begin_of_blocks(const uint8_t *bytes, bool keys) {
  const uint8_t *e = bytes + HEADER_NBYTES;
  while (keys ? !is_of(e, CHUNK_KEYS) : !is_of(e, CHUNK_BASE) && !is_of(e, CHUNK_REST))
    e += CHUNK_ENTRY_NBYTES;
  return (size_t)get_u64(e + 16);
}

static size_t end_of_keys(const uint8_t *bytes) {
  size_t end = 0;
  for (uint32_t i = 0; i < get_u32(bytes + 12); i++) {
    const uint8_t *e = bytes + HEADER_NBYTES + (size_t)i * CHUNK_ENTRY_NBYTES;
    if (is_of(e, CHUNK_KEYS)) end = (size_t)(get_u64(e + 16) + get_u64(e + 24));
  }
  return end;
}

/* Opens the first nbytes, in a block of just that size: a sanitizer sees what reads beyond. */
static slf_result open_first(const uint8_t *bytes, size_t nbytes, uint8_t **copy, slf_file **file) {
  *copy = malloc(nbytes ? nbytes : 1);
  memcpy(*copy, bytes, nbytes);
  return slf_open_prefix_memory(*copy, nbytes, "prefix", file, &error);
}

/* PSNR of all codes against the true ones. */
static double psnr(const slf_file *file) {
  double squares = 0, count = 0;
  for (uint32_t i = 0; i < SURFACES; i++)
    for (uint32_t b = 0; b < BLOCKS; b++) {
      slf_block_address a = address_of(b);
      uint8_t block[SLF_BLOCK_NBYTES];
      if (!slf_slice_exists(DIRECTIONS, DIRECTIONS, a.s, a.t)) continue;
      slf_decode_block(file, i, 0, a, block);
      for (int k = 0; k < 192; k++) {
        int u = a.block_u * 8 + k / 3 % 8, v = a.block_v * 8 + k / 24;
        double d = block[4 * (k / 3) + k % 3] -
                   (double)slf_srgb_from_linear(radiance((int)i, a.s, a.t, u, v, k % 3));
        squares += d * d;
        count++;
      }
    }
  return 10 * log10(255 * 255 * count / squares);
}

/* How many blocks are there; every `stride`-th is decoded, and is the whole file's if it is there.
 */
static int count_there(const slf_file *file, const slf_file *whole, uint32_t stride) {
  int there = 0;
  for (uint32_t i = 0; i < SURFACES; i++)
    for (uint32_t b = 0; b < BLOCKS; b++) {
      slf_block_address a = address_of(b);
      bool has = slf_has_block(file, i, 0, a);
      uint8_t block[SLF_BLOCK_NBYTES], same[SLF_BLOCK_NBYTES];
      there += has;
      if (b % stride) continue;
      slf_decode_block(file, i, 0, a, block);
      slf_decode_block(whole, i, 0, a, same);
      if (has) assert_memory_equal(block, same, SLF_BLOCK_NBYTES);
    }
  return there;
}

static bool matte_is_there(const slf_file *file) {
  for (uint32_t i = 0; i < PLACES; i++)
    if (!slf_has_block(file, SURFACES, 0, address_of(i))) return false;
  return true;
}

/* What a viewer sees while a file comes: gray; the means, and what is matte; the keys; all. */
static void sharpens_in_steps(void **state) {
  (void)state;
  size_t nbytes;
  uint8_t *bytes = write_file(SLF_ANGULAR_LAYERED, SLF_CURVE_SRGB, &nbytes), *copy;
  const size_t ends[4] = {begin_of_blocks(bytes, false), begin_of_blocks(bytes, true),
                          end_of_keys(bytes), nbytes};
  slf_file *whole, *file;
  MUST(slf_open_memory(bytes, nbytes, "whole", &whole, &error));
  double before = 0;
  for (int i = 0; i < 4; i++) {
    MUST(open_first(bytes, ends[i], &copy, &file));
    double now = psnr(file);
    int there = count_there(file, whole, 1);
    print_message("  %5zu of %zu bytes: %.1f dB, %d blocks\n", ends[i], nbytes, now, there);
    /* Each step must show: half a dB is seen side by side. */
    assert_true(now > before + 0.5);
    assert_int_equal(matte_is_there(file), i > 0);
    assert_int_equal(slf_verify(file, &error), i < 3 ? SLF_ERROR_PARTIAL : SLF_OK);
    assert_int_equal(slf_file_nbytes(file), ends[i]);
    before = now;
    slf_close(file);
    free(copy);
  }
  slf_close(whole);
  free(bytes);
}

/* A sanitized build looks at a third of the lengths. */
#if defined(__SANITIZE_ADDRESS__)
enum { SLOWER = 3 };
#else
enum { SLOWER = 1 };
#endif

static void every_prefix_decodes(slf_angular angular, slf_curve curve, size_t step) {
  size_t nbytes;
  uint8_t *bytes = write_file(angular, curve, &nbytes), *copy;
  slf_file *whole, *file;
  MUST(slf_open_memory(bytes, nbytes, "whole", &whole, &error));
  size_t head = begin_of_blocks(bytes, false);
  step *= SLOWER;
  int before = 0, all = count_there(whole, whole, 1);
  /* Every length at which the head is not all there; of the others one in `step`, each with other
   * blocks: to open a file takes milliseconds, for its tables. */
  for (size_t n = 0; n <= nbytes; n += n < head || n == nbytes ? 1
                                       : n + step < nbytes     ? step
                                                               : nbytes - n) {
    slf_result result = open_first(bytes, n, &copy, &file);
    assert_int_equal(result, n < head ? SLF_ERROR_PARTIAL : SLF_OK);
    int there = result == SLF_OK ? count_there(file, whole, 11 + n % 7) : 0;
    assert_true(there >= before);
    before = there;
    slf_close(file);
    free(copy);
  }
  assert_int_equal(before, all);
  slf_close(whole);
  free(bytes);
}

static void every_prefix_decodes_layered(void **state) {
  (void)state;
  every_prefix_decodes(SLF_ANGULAR_LAYERED, SLF_CURVE_SRGB, 151);
}
static void every_prefix_decodes_hdr(void **state) {
  (void)state;
  every_prefix_decodes(SLF_ANGULAR_LAYERED, SLF_CURVE_DWA, 1009);
}
static void every_prefix_decodes_motion(void **state) {
  (void)state;
  every_prefix_decodes(SLF_ANGULAR_MOTION, SLF_CURVE_SRGB, 1009);
}
static void every_prefix_decodes_identical(void **state) {
  (void)state;
  every_prefix_decodes(SLF_ANGULAR_IDENTICAL, SLF_CURVE_SRGB, 1009);
}
static void every_prefix_decodes_none(void **state) {
  (void)state;
  every_prefix_decodes(SLF_ANGULAR_NONE, SLF_CURVE_SRGB, 1009);
}

/* A whole file's checks do not loosen: a prefix is none, and more bytes than the header says are no
 * prefix. */
static void slf_open_wants_all(void **state) {
  (void)state;
  size_t nbytes;
  uint8_t *bytes = write_file(SLF_ANGULAR_LAYERED, SLF_CURVE_SRGB, &nbytes);
  slf_file *file;
  assert_int_equal(slf_open_memory(bytes, nbytes - 1, "short", &file, &error), SLF_ERROR_FORMAT);
  uint8_t *longer = calloc(1, nbytes + 1);
  memcpy(longer, bytes, nbytes);
  assert_int_equal(slf_open_prefix_memory(longer, nbytes + 1, "long", &file, &error),
                   SLF_ERROR_FORMAT);
  assert_null(file);
  free(longer);
  free(bytes);
}

static int make_path(void **state) {
  (void)state;
  snprintf(path, sizeof path, "/tmp/slf_codec_prefix.%ld.slf", (long)getpid());
  return 0;
}

static int free_layered(void **state) {
  (void)state;
  free(layered);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(sharpens_in_steps),
                                     cmocka_unit_test(every_prefix_decodes_layered),
                                     cmocka_unit_test(every_prefix_decodes_hdr),
                                     cmocka_unit_test(every_prefix_decodes_motion),
                                     cmocka_unit_test(every_prefix_decodes_identical),
                                     cmocka_unit_test(every_prefix_decodes_none),
                                     cmocka_unit_test(slf_open_wants_all)};
  return cmocka_run_group_tests_name("codec_prefix", tests, make_path, free_layered);
}
