/* A block cache that thrashes: no room at all, access that defeats least-recently-used, and a file
 * of 64x64 directions read in the worst order. What comes out is the file, and the counts add up.
 */
#include "viewer/block_cache.h"
#include "viewer/resample.h"

#include "slf.h"
#include "tests/stability/closed_form.h"

enum { TEXELS = 16, DIRECTIONS = 64 };

static char path[] = "/tmp/slf_stability_cache_XXXXXX";
static slf_file *file;
static const closed_form field = {TEXELS, TEXELS, DIRECTIONS, DIRECTIONS, 2, 0, NULL};

static slf_result read_slice(void *context, uint32_t s_index, uint32_t t_index, float *rgb,
                             slf_error *error) {
  (void)context, (void)error;
  for (uint32_t k = 0; k < TEXELS * TEXELS; k++)
    for (int c = 0; c < 3; c++)
      rgb[3 * k + (uint32_t)c] = (float)radiance(
          (k % TEXELS + 0.5) / TEXELS, (k / TEXELS + 0.5) / TEXELS,
          2 * (s_index + 0.5) / DIRECTIONS - 1, 2 * (t_index + 0.5) / DIRECTIONS - 1, c);
  return SLF_OK;
}

static int write_file(void **state) {
  (void)state;
  grid square = make_grid(1, 1, square_at);
  const light_field whole = {.surface = {.name = "square", .mesh = square.mesh},
                             .layer = {.angular = SLF_ANGULAR_LAYERED,
                                       .u_count = TEXELS,
                                       .v_count = TEXELS,
                                       .s_count = DIRECTIONS,
                                       .t_count = DIRECTIONS,
                                       .quality = 85},
                             .source = {.read_slice = read_slice}};
  const int failed = make_light_fields(path, &whole, 1, &file);
  free_grid(&square);
  return failed;
}

static int remove_file(void **state) {
  (void)state;
  slf_close(file);
  return unlink(path);
}

/* ---- Fetches -----------------------------------------------------------------------------------
 */

static slice_index slice_at(uint32_t number) {
  return (slice_index)((16 + number % 32) << 8 | (16 + number / 32 % 32));
}

static void assert_block(const uint8_t *u_block, uint32_t block_u, uint32_t block_v,
                         slice_index slice) {
  uint8_t expected[SLF_BLOCK_NBYTES];
  slf_decode_block(file, 0, 0,
                   (slf_block_address){.s = slice >> 8,
                                       .t = slice & 0xff,
                                       .block_u = (uint16_t)block_u,
                                       .block_v = (uint16_t)block_v},
                   expected);
  assert_memory_equal(u_block, expected, SLF_BLOCK_NBYTES);
}

/* N + K blocks in turn, in fetches of one: with at most N + 2 resident, least-recently-used misses
 * them all for K > 2; the clock may do better, never worse. One less than N blocks, and nothing is
 * missed after the first round. */
static void blocks_in_turn(void **state) {
  (void)state;
  static const uint32_t capacities[] = {0, 1, 4, 10, 100};
#if defined(__SANITIZE_ADDRESS__)
  enum { ROUNDS = 4, MORE = 3 };
#else
  enum { ROUNDS = 20, MORE = 3 };
#endif
  for (size_t i = 0; i < sizeof capacities / sizeof *capacities; i++)
    for (int fits = 0; fits < 2; fits++) {
      const uint32_t capacity = capacities[i];
      const uint32_t count = fits ? capacity : capacity + MORE;
      block_cache *cache = block_cache_create(file, capacity);
      const block_source source = block_cache_layer(cache, 0, 0);
      for (uint32_t n = 0; n < ROUNDS * count; n++) {
        const slice_index slice = slice_at(n % count);
        const uint8_t *u_block;
        source.fetch(source.context, 1, 0, &slice, 1, &u_block);
        assert_block(u_block, 1, 0, slice);
        assert_true(block_cache_resident(cache) <= capacity + 2);
      }
      const block_cache_counts *counts = block_cache_get_counts(cache);
      assert_int_equal(counts->lookups, ROUNDS * count);
      assert_int_equal(counts->lookups, counts->hits + counts->decompressions);
      if (fits)
        assert_int_equal(counts->decompressions, count);
      else
        assert_true(counts->decompressions >= count);
      if (!fits)
        print_message("%3u blocks in turn through a cache of %3u: %.0f %% decompressed\n", count,
                      capacity, 100.0 * (double)counts->decompressions / (double)counts->lookups);
      block_cache_free(cache);
    }
}

/* Every fetch pins as many blocks as there can be, 256, twice over; capacity 0, 1 and 4. */
static void as_many_slices_as_can_be(void **state) {
  (void)state;
  static const size_t capacities[] = {0, 1, 4};
  for (size_t i = 0; i < 3; i++) {
    block_cache *cache = block_cache_create(file, capacities[i]);
    const block_source source = block_cache_layer(cache, 0, 0);
    static slice_index slices[2][BLOCK_MAX_SLICES];
    static const uint8_t *u_blocks[2][BLOCK_MAX_SLICES];
    for (uint32_t n = 0; n < 12; n++) {
      const uint32_t now = n & 1, before = 1 - now;
      for (uint32_t k = 0; k < BLOCK_MAX_SLICES; k++) slices[now][k] = slice_at(n * 200 + k);
      source.fetch(source.context, n % 2, n / 2 % 2, slices[now], BLOCK_MAX_SLICES, u_blocks[now]);
      for (uint32_t k = 0; k < BLOCK_MAX_SLICES; k += 17) {
        assert_block(u_blocks[now][k], n % 2, n / 2 % 2, slices[now][k]);
        /* The fetch before is still good: it is being mixed. */
        if (n > 0)
          assert_block(u_blocks[before][k], (n - 1) % 2, (n - 1) / 2 % 2, slices[before][k]);
      }
      assert_true(block_cache_resident(cache) <= capacities[i] + 2 * BLOCK_MAX_SLICES);
    }
    block_cache_free(cache);
  }
}

/* A pair of neighbours decodes as each does alone, whichever comes first: blocks of a quad lean on
 * each other, and what lies between the two is passed over. */
static void pairs_decode_as_blocks_alone(void **state) {
  (void)state;
  for (uint16_t s = 0; s + 1 < DIRECTIONS; s++)
    for (uint16_t t = 0; t + 1 < DIRECTIONS; t++)
      for (int first = 0; first < 4; first++)
        for (int second = 0; second < 4; second++) {
          const slf_block_address pair[2] = {
              {(uint16_t)(s + first % 2), (uint16_t)(t + first / 2), 1, 0},
              {(uint16_t)(s + second % 2), (uint16_t)(t + second / 2), 1, 0}};
          uint8_t blocks[2][SLF_BLOCK_NBYTES], *out[2] = {blocks[0], blocks[1]};
          slf_decode_blocks(file, 0, 0, pair, 2, out);
          for (int k = 0; k < 2; k++)
            assert_block(blocks[k], 1, 0, (slice_index)(pair[k].s << 8 | pair[k].t));
        }
}

/* ---- Through the mix ---------------------------------------------------------------------------
 */

static float any_01(void) {
  return (float)rand() / (float)RAND_MAX;
}

/* Every texel in a direction of its own over 64x64 of them, frame after frame, as no water could be
 * rougher. The picture does not depend on the cache, and is the field to within the mix and the
 * codec's steps: at quality 85 2^(15/8) = 3.7 codes, half of it in each of 64 coefficients and
 * three channels at worst a uniform error of 3.7 / sqrt(12) codes RMS times 2.9 (codec_file.c). */
static void every_texel_its_own_direction(void **state) {
  (void)state;
  static const size_t capacities[] = {65536, 0, 1, 4, 100};
  enum { FRAMES = 30, BLOCKS = 4 };
  static mixed_block pictures[2][FRAMES * BLOCKS];
  for (size_t i = 0; i < sizeof capacities / sizeof *capacities; i++) {
    block_cache *cache = block_cache_create(file, capacities[i]);
    resampler *r = resampler_create(DIRECTIONS, DIRECTIONS, block_cache_layer(cache, 0, 0));
    double square_sum = 0, mix = 0;
    srand(11);
    for (uint32_t n = 0; n < FRAMES * BLOCKS; n++) {
      block_directions d = {.mask = ~(uint64_t)0};
      for (int k = 0; k < 64; k++) d.s[k] = any_01(), d.t[k] = any_01();
      uint16_t *texels = pictures[i > 0][n].texels;
      resample_block(r, n % 2, n / 2 % 2, &d, texels, MIXED_ROW_NBYTES);
      resample_flush(r);
      for (uint32_t k = 0; k < 64 && i == 0; k++) {
        double axes[3];
        slf_direction(d.s[k], d.t[k], 0, axes);
        for (int c = 0; c < 3; c++) {
          const double truth =
              radiance((n % 2 * 8 + k % 8 + 0.5) / TEXELS, (n / 2 % 2 * 8 + k / 8 + 0.5) / TEXELS,
                       axes[0], axes[1], c);
          const double error = float_from_half(texels[4 * k + (uint32_t)c]) - truth;
          square_sum += error * error;
        }
        mix = fmax(mix, mix_error(&field, axes[0], axes[1]));
      }
    }
    const block_cache_counts *counts = block_cache_get_counts(cache);
    assert_int_equal(counts->lookups, counts->hits + counts->decompressions);
    if (i == 0) {
      const double rms = sqrt(square_sum / (FRAMES * BLOCKS * 64 * 3));
      const double codec = sqrt(2.9 / 12) * 3.7 * 1.9 / 255;
      print_message("64x64 directions at random: error %.5f rms, bound %.5f\n", rms, mix + codec);
      assert_true(rms <= mix + codec);
    } else {
      assert_memory_equal(pictures[1], pictures[0], sizeof pictures[0]);
      print_message("cache of %zu: %.1f %% of %llu look-ups decompressed\n", capacities[i],
                    100.0 * (double)counts->decompressions / (double)counts->lookups,
                    (unsigned long long)counts->lookups);
    }
    /* Without room nothing is found twice, but what the fetches before still pin. */
    if (capacities[i] == 0) assert_true(counts->decompressions * 10 > counts->lookups * 9);
    resampler_free(r);
    block_cache_free(cache);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(blocks_in_turn),
      cmocka_unit_test(as_many_slices_as_can_be),
      cmocka_unit_test(pairs_decode_as_blocks_alone),
      cmocka_unit_test(every_texel_its_own_direction),
  };
  return cmocka_run_group_tests(tests, write_file, remove_file);
}
