/* The transform, the Huffman codes, the index; and all kernels give the same bits. */
#include "codec/file.h"
#include "codec/kernel.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* What a transform gives is counted by the plain build; a sanitized one, ten times as slow, takes a
 * tenth of the blocks: all reach the same memory. */
#if defined(__SANITIZE_ADDRESS__)
enum { FEWER = 10 };
#else
enum { FEWER = 1 };
#endif

static uint64_t random_state = 1;

static uint32_t random_u32(void) { /* xorshift64* */
  random_state ^= random_state >> 12;
  random_state ^= random_state << 25;
  random_state ^= random_state >> 27;
  return (uint32_t)(random_state * 2685821657736338717u >> 32);
}

static const kernel *kernels[MOST_KERNELS];
static int kernel_count;

static int find_kernels(void **state) {
  (void)state;
  kernel_count = kernels_that_run(kernels);
  for (int k = 0; k < kernel_count; k++) print_message("  kernel: %s\n", kernels[k]->name);
  return 0;
}

/* ---- Transform ----------------------------------------------------------------------------- */

static double cosine(int x, int k) {
  static double known[8][8]; /* a sanitized build would take minutes to find them again */
  if (known[x][k] == 0)
    known[x][k] = (k ? 0.5 : sqrt(0.125)) * cos((2 * x + 1) * k * 3.14159265358979323846 / 16);
  return known[x][k];
}

/* The definition, in double; coefficients [vertical][horizontal]. */
static void exact_forward(const double texels[8][8], double c[8][8]) {
  for (int v = 0; v < 8; v++)
    for (int u = 0; u < 8; u++) {
      c[v][u] = 0;
      for (int y = 0; y < 8; y++)
        for (int x = 0; x < 8; x++) c[v][u] += texels[y][x] * cosine(y, v) * cosine(x, u);
    }
}

static void exact_inverse(const double c[8][8], double texels[8][8]) {
  for (int y = 0; y < 8; y++)
    for (int x = 0; x < 8; x++) {
      texels[y][x] = 0;
      for (int v = 0; v < 8; v++)
        for (int u = 0; u < 8; u++) texels[y][x] += c[v][u] * cosine(y, v) * cosine(x, u);
    }
}

static int clamp_nine_bits(double x) {
  return (int)fmax(-256, fmin(255, floor(x + 0.5)));
}

/* IEEE 1180-1990: blocks of random texels, transformed and rounded; the inverse's error against
 * that of double precision. */
static void inverse_meets_ieee_1180(const kernel *k, int low, int high, int sign) {
  enum { BLOCKS = 10000 / FEWER };
  double sum[64] = {0}, squares[64] = {0}, peak = 0;
  for (int n = 0; n < BLOCKS; n++) {
    double texels[8][8], c[8][8], truth[8][8];
    float block[64];
    for (int i = 0; i < 64; i++)
      texels[i / 8][i % 8] = sign * (low + (int)(random_u32() % (uint32_t)(high - low + 1)));
    exact_forward(texels, c);
    for (int i = 0; i < 64; i++) {
      c[i / 8][i % 8] = fmax(-2048, fmin(2047, floor(c[i / 8][i % 8] + 0.5)));
      block[8 * (i % 8) + i / 8] = (float)c[i / 8][i % 8]; /* column-major */
    }
    exact_inverse(c, truth);
    k->plain_inverse_dct(block);
    for (int i = 0; i < 64; i++) {
      double e = clamp_nine_bits(block[i]) - clamp_nine_bits(truth[i / 8][i % 8]);
      sum[i] += e;
      squares[i] += e * e;
      peak = fmax(peak, fabs(e));
    }
  }
  double all = 0, all_squares = 0;
  for (int i = 0; i < 64; i++) {
    assert_true(squares[i] / BLOCKS <= 0.06); /* these five limits are the standard's */
    assert_true(fabs(sum[i]) / BLOCKS <= 0.015);
    all += sum[i];
    all_squares += squares[i];
  }
  assert_true(peak <= 1);
  assert_true(all_squares / (64.0 * BLOCKS) <= 0.02);
  assert_true(fabs(all) / (64.0 * BLOCKS) <= 0.0015);
}

static void inverse_transform_conforms(void **state) {
  (void)state;
  static const int ranges[3][2] = {{-256, 255}, {-5, 5}, {-300, 300}};
  for (int k = 0; k < kernel_count; k++) {
    for (int r = 0; r < 3; r++)
      for (int sign = -1; sign <= 1; sign += 2)
        inverse_meets_ieee_1180(kernels[k], ranges[r][0], ranges[r][1], sign);
    float zeros[64] = {0};
    kernels[k]->plain_inverse_dct(zeros);
    for (int i = 0; i < 64; i++) assert_true(zeros[i] == 0);
  }
}

static void forward_undoes_inverse(void **state) {
  (void)state;
  for (int k = 0; k < kernel_count; k++)
    for (int n = 0; n < 1000 / FEWER; n++) {
      float texels[64], c[64];
      for (int i = 0; i < 64; i++) texels[i] = (float)(random_u32() % 4096);
      kernels[k]->forward_dct(texels, c);
      kernels[k]->plain_inverse_dct(c);
      /* Some 100 rounded operations on numbers up to 8 * 4096: 2^-24 of that each. */
      for (int i = 0; i < 64; i++) assert_true(fabsf(texels[i] - c[i]) < 0.2f);
    }
}

static void random_colours(layer_state *layer) {
  int16_t to_rgb[3][3]; /* any that a file can have */
  for (int i = 0; i < 9; i++) to_rgb[i / 3][i % 3] = (int16_t)random_u32();
  layer_set_jfif_colours(layer);
  if (random_u32() % 2) layer_set_own_colours(layer, (const int16_t(*)[3])to_rgb);
}

static void kernels_transform_alike(void **state) {
  (void)state;
  if (kernel_count < 2) skip();
  for (int n = 0; n < 20000 / FEWER; n++) {
    /* From faint to far beyond what a file can ask for. */
    union {
      float channels[3][64], all[192];
    } from, x[MOST_KERNELS];
    float scale = exp2f((float)(n % 24) - 2);
    for (int i = 0; i < 192; i++)
      from.all[i] =
          n % 7 == 0 && random_u32() % 4 ? 0 : ((float)random_u32() / 2147483648.0f - 1) * scale;
    float forward[MOST_KERNELS][64];
    uint8_t codes[MOST_KERNELS][SLF_BLOCK_NBYTES];
    layer_state layer = {.level_shift = 128};
    random_colours(&layer);
    for (int k = 0; k < kernel_count; k++) {
      x[k] = from;
      kernels[k]->channels_to_codes(&layer, x[k].channels, codes[k]);
      for (int c = 0; c < 3; c++) kernels[k]->inverse_dct(x[k].channels[c]);
      assert_memory_equal(codes[k], codes[0], SLF_BLOCK_NBYTES);
      assert_memory_equal(&x[k], &x[0], sizeof x[0]);
      kernels[k]->forward_dct(x[k].channels[0], forward[k]);
      assert_memory_equal(forward[k], forward[0], sizeof forward[0]);
    }
  }
}

/* Levels of all kinds of blocks, with and without what they are added to. */
static void kernels_make_the_same_codes(void **state) {
  (void)state;
  if (kernel_count < 2) skip();
  for (int n = 0; n < 20000 / FEWER; n++) {
    layer_state layer = {.level_shift = 128, .difference_one = DIFFERENCE_ONE};
    random_colours(&layer);
    block_levels block = {.ac_flags = random_u32() % 8};
    int16_t prediction[3][64];
    shift_window window = {.begin = random_u32() % 8 * WINDOW_ROW + random_u32() % 8};
    uint32_t range = 1u << random_u32() % 16; /* 16: int16 arithmetic wraps */
    for (int i = 0; i < 3 * WINDOW_CHANNEL; i++)
      window.channels[i] = (int16_t)(random_u32() % (2 * range) - range);
    for (int c = 0; c < 3; c++) {
      block.last_k[c] = block.ac_flags >> c & 1 ? random_u32() % 64 : 0;
      for (int i = 0; i < 64; i++) {
        layer.scales[c][i] = 1 + (float)(random_u32() % 64) / 16;
        prediction[c][i] = (int16_t)(random_u32() % (2 * range) - range);
      }
      for (unsigned k = 0; k <= block.last_k[c]; k++)
        block.levels[c][slf_zigzag[k]] = (int16_t)(random_u32() % (2 * range) - range);
    }
    uint8_t codes[MOST_KERNELS][SLF_BLOCK_NBYTES];
    for (int k = 0; k < kernel_count; k++) {
      kernels[k]->levels_to_codes(&layer, n & 1 ? prediction : NULL, &block, 1 + n % MAX_GAIN,
                                  n & 2 ? &window : NULL, codes[k]);
      assert_memory_equal(codes[k], codes[0], SLF_BLOCK_NBYTES);
    }
  }
}

/* Where only the lowest 4x4 frequencies have levels, what the transform leaves out is zeros. */
static void low_frequencies_make_the_same_codes(void **state) {
  (void)state;
  layer_state layer = {.level_shift = 128, .difference_one = DIFFERENCE_ONE};
  layer_set_jfif_colours(&layer);
  for (int n = 0; n < 2000 / FEWER; n++) {
    block_levels s = {.ac_flags = random_u32() % 8};
    uint8_t codes[2][SLF_BLOCK_NBYTES];
    for (int c = 0; c < 3; c++) {
      for (int i = 0; i < 64; i++) layer.scales[c][i] = 1 + (float)(random_u32() % 64) / 16;
      for (unsigned k = 0; k <= 9; k++) /* the zigzag leaves the 4x4 at 10 */
        if (k == 0 || (s.ac_flags >> c & 1 && random_u32() % 2))
          s.levels[c][slf_zigzag[k]] = (int16_t)(random_u32() % 17) - 8;
    }
    for (int full = 0; full < 2; full++) {
      for (int c = 0; c < 3; c++) s.last_k[c] = full ? 63 : 9;
      levels_to_codes(&layer, NULL, &s, 1, NULL, codes[full]);
    }
    assert_memory_equal(codes[0], codes[1], SLF_BLOCK_NBYTES);
  }
}

/* ---- Parsing ------------------------------------------------------------------------------- */

/* As those of AC levels often are: short runs, and an end after some fifty symbols. */
static void count_likely_symbols(uint64_t counts[256]) {
  int steepness = (int)(random_u32() % 4);
  for (int s = 0; s < 256; s++) {
    int size = s & 15, weight = 20 - 3 * (s >> 4) - steepness * size;
    counts[s] = size && weight > 0 ? 1ull << weight : 0;
  }
  counts[SYMBOL_END] = 1 << 15;
  counts[SYMBOL_RUN_16] = counts[SYMBOL_ESCAPE] = 1 << 4;
}

/* Codes over symbols that a C-Block may have, with random weights. */
static void random_codes(block_codes *codes) {
  bool likely = random_u32() % 2;
  for (int code = 0; code < CODE_COUNT; code++) {
    uint64_t counts[256] = {0};
    int symbols = code == CODE_HEAD    ? PREDICTOR_COUNT * 8
                  : code == CODE_SHIFT ? 32
                  : code < CODE_AC     ? 16
                                       : 256;
    for (int s = 0; s < symbols; s++)
      if (random_u32() % 4) counts[s] = 1u << random_u32() % 20;
    counts[0]++;
    if (likely && code >= CODE_AC && code < CODE_WHOLE_HEAD) count_likely_symbols(counts);
    huffman_build(counts, &codes->codes[code]);
  }
  for (int i = 1; i <= MAX_WHOLE_HEADS; i++) {
    unsigned head = random_u32() % (PREDICTOR_COUNT * 8), sizes[3];
    for (int c = 0; c < 3; c++)
      sizes[c] = head >> 3 == PREDICT_INTRA || (head >> c & 1) ? random_u32() % 16 : 0;
    codes->whole_heads[i] = whole_head(head, sizes);
  }
  /* And streams that have none. */
  if (random_u32() % 4 == 0) codes->codes[CODE_WHOLE_HEAD] = (huffman_code){0};
}

/* Random bits are read alike, to the last one, and never beyond the padding (under ASan: the block
 * of memory ends there). Texels that are made meanwhile are those of the levels that were there
 * before, whether the next block is good or not. Near a stream's ends levels are read one by one,
 * elsewhere by vectors if there are any; streams are short and long. */
static void kernels_parse_random_bits_alike(void **state) {
  (void)state;
  block_codes codes;
  block_tables *tables = malloc(sizeof *tables);
  unsigned good_count = 0, most_levels = 0;
  layer_state layer = {.level_shift = 128, .difference_one = DIFFERENCE_ONE};
  random_colours(&layer);
  for (int i = 0; i < 3 * COEFFICIENTS; i++)
    layer.scales[i / COEFFICIENTS][i % COEFFICIENTS] = 1 + (float)(random_u32() % 64) / 16;
  for (int n = 0; n < 2000; n++) {
    if (n % 50 == 0) {
      random_codes(&codes);
      block_tables_make(&codes, tables);
    }
    size_t nbytes = 1 + random_u32() % (n % 3 ? 60 : 2000);
    uint8_t *bytes = calloc(1, nbytes + STREAM_PAD_NBYTES);
    for (size_t i = 0; i < nbytes; i++) bytes[i] = (uint8_t)random_u32();
    block_stream stream = {bytes, nbytes + STREAM_PAD_NBYTES, 2};
    entry_state states[MOST_KERNELS];
    bit_reader readers[MOST_KERNELS];
    texels_maker makers[MOST_KERNELS];
    uint8_t codes_now[SLF_BLOCK_NBYTES], codes_meanwhile[MOST_KERNELS][SLF_BLOCK_NBYTES];
    memset(states, 0, sizeof states);
    /* The second of a pair goes backwards from there. */
    uint64_t begin = random_u32() % nbytes, entry = n % 2;
    const int16_t dc_begin[3] = {(int16_t)random_u32(), 1, -2};
    for (int k = 0; k < kernel_count; k++) {
      entry_begin(&states[k], dc_begin);
      reader_begin(&readers[k], &stream, entry, begin);
      makers[k].step = TEXELS_MADE;
    }
    for (uint32_t block = 0; block < 8; block++) {
      bool good[MOST_KERNELS] = {false};
      for (int k = 0; k < kernel_count; k++)
        good[k] = kernels[k]->parse(tables, &readers[k], 0, block, block % 4 == 0, &makers[k],
                                    &states[k]);
      for (int k = 0; k < kernel_count; k++) {
        assert_int_equal(makers[k].step, TEXELS_MADE);
        if (block > 0) assert_memory_equal(codes_meanwhile[k], codes_now, sizeof codes_now);
        texels_begin(&makers[k], &layer, NULL, entry_levels(&states[k]), 1, NULL,
                     codes_meanwhile[k]);
      }
      levels_to_codes(&layer, NULL, entry_levels(&states[0]), 1, NULL, codes_now);
      for (int k = 1; k < kernel_count; k++) {
        assert_int_equal(good[0], good[k]);
        assert_memory_equal(&states[0], &states[k], sizeof states[0]);
        assert_true(reader_byte(&readers[0]) == reader_byte(&readers[k]));
        assert_true(readers[0].count % 8 == readers[k].count % 8);
      }
      if (!good[0]) break;
      unsigned levels = 0;
      for (int c = 0; c < 3; c++)
        for (int i = 1; i < COEFFICIENTS; i++)
          levels += entry_levels(&states[0])->levels[c][i] != 0;
      most_levels = levels > most_levels ? levels : most_levels;
      good_count++;
    }
    free(bytes);
  }
  print_message("  %u C-Blocks, the largest with %u levels\n", good_count, most_levels);
  assert_true(good_count > 1000 && most_levels > 64); /* or hardly anything was compared */
  free(tables);
}

/* One C-Block of INTRA with luma's AC alone, of symbols of one size and these runs; whether all
 * kernels take it for one. */
static bool is_block(const block_codes *codes, const block_tables *tables, const unsigned *runs,
                     int count) {
  bit_string bits = {0};
  huffman_encoder heads, sizes, first, later;
  huffman_make_encoder(&codes->codes[CODE_HEAD], &heads);
  huffman_make_encoder(&codes->codes[CODE_DC], &sizes);
  huffman_make_encoder(&codes->codes[CODE_AC], &first);
  huffman_make_encoder(&codes->codes[CODE_AC + 1], &later);
  bits_put(&bits, heads.codes[1], heads.bits[1]);
  for (int c = 0; c < 3; c++) bits_put(&bits, sizes.codes[0], sizes.bits[0]);
  for (int i = 0; i < count; i++) {
    const huffman_encoder *code = i ? &later : &first;
    const bool escapes = runs[i] > 15;
    const unsigned symbol = escapes ? SYMBOL_ESCAPE : runs[i] << 4 | 1;
    bits_put(&bits, code->codes[symbol], code->bits[symbol]);
    if (escapes) bits_put(&bits, runs[i] << ESCAPED_SIZE_BITS | 1, 10);
  }
  bits_put(&bits, later.codes[SYMBOL_END], later.bits[SYMBOL_END]);
  for (int i = 0; i < count; i++) bits_put(&bits, 1, 1);
  uint8_t bytes[128] = {0};
  memcpy(bytes, bits.bytes, (size_t)(bits.bit_count + 7) / 8);
  bits_free(&bits);
  block_stream stream = {bytes, sizeof bytes, 2};
  bool good[MOST_KERNELS] = {false};
  for (int k = 0; k < kernel_count; k++) {
    entry_state state = {0};
    bit_reader reader;
    entry_begin(&state, (int16_t[3]){0});
    reader_begin(&reader, &stream, 0, 0);
    good[k] = kernels[k]->parse(tables, &reader, 0, 0, true, NULL, &state);
    assert_int_equal(good[k], good[0]);
  }
  return good[0];
}

/* A level at place 63 is the last one; no symbol goes beyond, however it is coded. */
static void levels_end_with_the_scan(void **state) {
  (void)state;
  block_codes codes = {0};
  block_tables *tables = malloc(sizeof *tables);
  for (int code = 0; code < CODE_WHOLE_HEAD; code++) {
    uint64_t counts[256] = {1, 1};
    for (int run = 0; run < 16 && code >= CODE_AC; run++)
      counts[run << 4 | 1] = counts[run << 4] = 1;
    huffman_build(counts, &codes.codes[code]);
  }
  block_tables_make(&codes, tables);
  unsigned each[64] = {0}; /* a level at every place */
  assert_true(is_block(&codes, tables, each, 63));
  assert_false(is_block(&codes, tables, each, 64));
  static const unsigned last[] = {15, 15, 15, 14, 3}, beyond[] = {15, 15, 15, 15};
  assert_true(is_block(&codes, tables, last, 4)); /* places 16, 32, 48, 63 */
  assert_false(is_block(&codes, tables, last, 5));
  assert_false(is_block(&codes, tables, beyond, 4));
  static const unsigned escaped[] = {62, 0, 20}, far[] = {63};
  assert_true(is_block(&codes, tables, escaped, 1));
  assert_false(is_block(&codes, tables, escaped, 2));
  assert_false(is_block(&codes, tables, escaped, 3));
  assert_false(is_block(&codes, tables, far, 1));
  free(tables);
}

/* ---- Huffman codes ------------------------------------------------------------------------- */

static void codes_come_back(void **state) {
  (void)state;
  for (int n = 0; n < 500; n++) {
    uint64_t counts[256] = {0};
    int used = 1 + (int)(random_u32() % 256);
    /* Powers of two without limit make the longest codes: 16 bits must hold. */
    for (int i = 0; i < used; i++) counts[random_u32() % 256] = 1ull << random_u32() % 60;
    huffman_code code, again;
    huffman_encoder encoder;
    huffman_decoder decoder;
    huffman_build(counts, &code);
    uint8_t bytes[HUFFMAN_MAX_NBYTES];
    size_t nbytes = huffman_put(&code, bytes);
    assert_int_equal(huffman_get(bytes, nbytes, &again), nbytes);
    for (size_t less = 0; less < nbytes; less++)
      assert_int_equal(huffman_get(bytes, less, &again), 0);
    huffman_get(bytes, nbytes, &again);
    huffman_make_encoder(&code, &encoder);
    huffman_make_decoder(&again, &decoder);
    for (int s = 0; s < 256; s++) {
      assert_int_equal(encoder.bits[s] > 0, counts[s] > 0);
      if (!counts[s]) continue;
      unsigned bits, found = huffman_read(
                         &decoder, 1, (uint32_t)encoder.codes[s] << (16 - encoder.bits[s]), &bits);
      assert_int_equal(found, s);
      assert_int_equal(bits, encoder.bits[s]);
    }
  }
}

static void impossible_codes_are_refused(void **state) {
  (void)state;
  huffman_code code;
  uint8_t three_of_one_bit[19] = {3, [16] = 1, 2, 3}, none[16] = {0}, twice[18] = {2, [16] = 5, 5};
  assert_int_equal(huffman_get(three_of_one_bit, 19, &code), 0);
  assert_int_equal(huffman_get(none, 16, &code), 0);
  assert_int_equal(huffman_get(twice, 18, &code), 0);
}

/* ---- The index ----------------------------------------------------------------------------- */

static void entries_are_found(void **state) {
  (void)state;
  slf_error error;
  scratch_file scratch;
  assert_int_equal(scratch_open("/tmp/slf_codec_kernel", &scratch, &error), SLF_OK);
  for (int n = 0; n < 30; n++) {
    stream_writer writer;
    uint64_t lengths[600], count = 1 + random_u32() % 600, begin = scratch.nbytes, nbytes;
    block_stream stream = {NULL, 0, count += count % 2};
    stream_begin(&writer, &scratch, &stream);
    uint32_t longest = 1u << random_u32() % 12;
    for (uint64_t i = 0; i < count; i++) {
      bit_string entry = {0};
      lengths[i] = 16 + random_u32() % longest;
      bits_put(&entry, (uint32_t)(i + 1) & 0xffff, 16);
      for (uint64_t k = 16; k < lengths[i]; k++) bits_put(&entry, random_u32() & 1, 1);
      stream_put(&writer, &entry);
      bits_free(&entry);
    }
    scratch_map map;
    assert_int_equal(stream_finish(&writer, "test", &nbytes, &error), SLF_OK);
    assert_int_equal(scratch.nbytes, begin + nbytes);
    stream_writer_free(&writer);
    assert_int_equal(scratch_map_part(&scratch, begin, nbytes, "test", &map, &error), SLF_OK);
    const uint8_t *bytes = map.bytes;
    stream.bytes = bytes;
    stream.nbytes = nbytes;
    for (int k = 0; k < kernel_count; k++) {
      assert_int_equal(kernels[k]->check_stream(&stream, "test", &error), SLF_OK);
      for (uint64_t i = 0; i < count; i++) {
        const uint8_t *at = bytes + kernels[k]->find(&stream, i);
        unsigned number =
            i % 2 ? at[-1] << 8 | at[-2] : at[0] << 8 | at[1]; /* odd ones backwards */
        assert_int_equal(number, i + 1);
      }
    }
    scratch_unmap(&map);
  }
  scratch_close(&scratch);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(inverse_transform_conforms),
                                     cmocka_unit_test(forward_undoes_inverse),
                                     cmocka_unit_test(kernels_transform_alike),
                                     cmocka_unit_test(kernels_make_the_same_codes),
                                     cmocka_unit_test(low_frequencies_make_the_same_codes),
                                     cmocka_unit_test(kernels_parse_random_bits_alike),
                                     cmocka_unit_test(levels_end_with_the_scan),
                                     cmocka_unit_test(codes_come_back),
                                     cmocka_unit_test(impossible_codes_are_refused),
                                     cmocka_unit_test(entries_are_found)};
  return cmocka_run_group_tests_name("codec_kernel", tests, find_kernels, NULL);
}
