/* The block cache: any capacity gives the same picture, counts what it does, and keeps its promise
 * about memory. The light field is a file written here. */
#include <malloc.h>

#include "tests/light_field.h"
#include "viewer/block_cache.h"
#include "viewer/half.h"
#include "viewer/texture.h"

enum { TEXELS = 44, DIRECTIONS = 12 }; /* not a multiple of 8: blocks hang over the edge */

static char path[] = "/tmp/slf_viewer_cache_XXXXXX";
static slf_file *file;

static slf_result read_slice(void *context, uint32_t s_index, uint32_t t_index, float *rgb,
                             slf_error *error) {
  (void)context, (void)error;
  for (uint32_t i = 0; i < TEXELS * TEXELS * 3; i++) {
    uint32_t x = i / 3 % TEXELS, y = i / 3 / TEXELS;
    rgb[i] = (float)((x / 3 + y / 5 + s_index + 2 * t_index + i % 3) % 7) / 7;
  }
  return SLF_OK;
}

static int write_file(void **state) {
  (void)state;
  grid square = make_grid(1, 1, square_at);
  light_field fields[2];
  for (int i = 0; i < 2; i++) {
    fields[i] = (light_field){.surface = {.mesh = square.mesh},
                              .layer = {.u_count = TEXELS,
                                        .v_count = TEXELS,
                                        .s_count = DIRECTIONS,
                                        .t_count = DIRECTIONS,
                                        .quality = 80,
                                        .thread_count = 1},
                              .source = {.read_slice = read_slice}};
    snprintf(fields[i].surface.name, SLF_NAME_NBYTES, "square %d", i);
  }
  const int failed = make_light_fields(path, fields, 2, &file);
  free_grid(&square);
  return failed;
}

static int remove_file(void **state) {
  (void)state;
  slf_close(file);
  return unlink(path);
}

enum { FRAMES = 8 };

static camera flight_at(int frame) {
  slf_view view = {.location = {0.3f + 0.05f * (float)(frame / 2), 0.4f, 0.2f},
                   .look_at = {0.5f, 0, 0.5f},
                   .angle_deg = 120};
  return camera_of_view(&view, 1, 1);
}

/* What a flight does between its frames; NULL: nothing. */
typedef void look_ahead(texture x[2], const camera *next);

/* Frames of a flight over both squares, texels appended to `picture`. *late: blocks decompressed in
 * a frame, but for the first one. */
static block_cache_counts fly(size_t capacity, uint32_t thread_count, look_ahead *ahead,
                              uint8_t *picture, size_t *most_resident, uint64_t *late) {
  block_cache *cache = block_cache_create(file, capacity);
  assert_non_null(cache);
  texture x[2];
  for (uint32_t i = 0; i < 2; i++) {
    const slf_surface *surface = slf_get_surface(file, i);
    assert_true(texture_create(&x[i], &surface->mesh, &surface->layers[0],
                               block_cache_layer(cache, i, 0), UV_DICE_PX));
    texture_decode_ahead(&x[i], cache, thread_count, 0);
  }
  *most_resident = *late = 0;
  for (int frame = 0; frame < FRAMES; frame++) {
    const camera c = flight_at(frame), next = flight_at(frame + 1);
    block_cache_begin_frame(cache);
    for (int i = 0; i < 2; i++) {
      texture_update(&x[i], &c, (direction_bend){0});
      size_t nbytes = x[i].levels[0].row_nbytes * 8 * x[i].mesh.block_v_count;
      memcpy(picture, x[i].levels[0].texels, nbytes);
      picture += nbytes;
      if (block_cache_resident(cache) > *most_resident)
        *most_resident = block_cache_resident(cache);
    }
    if (frame) *late += block_cache_get_counts(cache)->frame_decompressions;
    if (ahead) ahead(x, &next);
  }
  block_cache_counts counts = *block_cache_get_counts(cache);
  for (int i = 0; i < 2; i++) texture_free(&x[i]);
  block_cache_free(cache);
  return counts;
}

enum { PICTURE_NBYTES = FRAMES * 2 * 48 * 48 * 8 };

static void test_any_capacity_gives_the_same_bytes(void **state) {
  (void)state;
  static const size_t capacities[] = {0, 1, 3, 4, 5, 100, 1000, 65536};
  uint8_t *reference = malloc(PICTURE_NBYTES), *picture = malloc(PICTURE_NBYTES);
  uint64_t lookups = 0, fewest = UINT64_MAX, distinct = 0, again = 0, late;
  for (size_t i = 0; i < sizeof capacities / sizeof *capacities; i++) {
    size_t resident;
    block_cache_counts counts =
        fly(capacities[i], 1, NULL, i ? picture : reference, &resident, &late);
    print_message("capacity %5zu: %llu look-ups, %llu decompressions, at most %zu resident\n",
                  capacities[i], (unsigned long long)counts.lookups,
                  (unsigned long long)counts.decompressions, resident);
    if (i) assert_memory_equal(picture, reference, PICTURE_NBYTES);
    if (i == 0) lookups = counts.lookups;
    assert_int_equal(counts.lookups, lookups);
    assert_int_equal(counts.lookups, counts.hits + counts.decompressions);
    /* N between fetches, plus what the two latest fetches pinned. */
    assert_true(resident <= capacities[i] + 2 * BLOCK_MAX_SLICES);
    assert_true(counts.decompressions <= fewest);
    fewest = counts.decompressions;
    /* A cache that holds nothing decompresses each block of each frame once, and no more. */
    if (i == 0) assert_int_equal(counts.decompressions, counts.lookups);
    /* Blocks that were decompressed at all are the same ones; the largest cache did none twice. */
    again = counts.decompressions_again;
    if (i == 0) distinct = counts.decompressions - again;
    assert_int_equal(counts.decompressions - again, distinct);
  }
  assert_int_equal(again, 0);
  /* The largest holds all: frames 2 k and 2 k + 1 are the same, so half of all look-ups hit. */
  assert_true(fewest * 2 <= lookups);
  free(reference);
  free(picture);
}

/* On several threads, ahead: the same picture, each block once. */
static void test_decoding_ahead(void **state) {
  (void)state;
  static const size_t capacities[] = {0, 1, 3, 100, 1000, 65536};
  uint8_t *reference = malloc(PICTURE_NBYTES), *picture = malloc(PICTURE_NBYTES);
  size_t resident;
  uint64_t late;
  block_cache_counts alone = fly(65536, 1, NULL, reference, &resident, &late), counts;
  for (size_t i = 0; i < sizeof capacities / sizeof *capacities; i++)
    for (uint32_t thread_count = 2; thread_count <= 5; thread_count++) {
      counts = fly(capacities[i], thread_count, NULL, picture, &resident, &late);
      assert_memory_equal(picture, reference, PICTURE_NBYTES);
      assert_int_equal(counts.lookups, alone.lookups);
      assert_int_equal(counts.lookups, counts.hits + counts.decompressions);
      assert_true(counts.decompressions >= alone.decompressions);
      assert_true(resident <= capacities[i] + 2 * BLOCK_MAX_SLICES);
    }
  /* The last cache holds all: nothing was decompressed that was not fetched then. */
  assert_int_equal(counts.decompressions, alone.decompressions);
  assert_int_equal(counts.decompressions_again, 0);
  assert_int_equal(counts.hits, alone.hits);
  free(reference);
  free(picture);
}

static void look_at_next(texture x[2], const camera *next) {
  const atomic_bool stop = false;
  for (int i = 0; i < 2; i++) texture_look_ahead(&x[i], next, &stop);
}

static void look_no_further(texture x[2], const camera *next) {
  const atomic_bool stop = true;
  for (int i = 0; i < 2; i++) texture_look_ahead(&x[i], next, &stop);
}

/* Between frames: the same picture, and nothing left to decompress in the frames themselves. */
static void test_looking_ahead(void **state) {
  (void)state;
  static const size_t capacities[] = {0, 1, 3, 100, 1000, 65536};
  uint8_t *reference = malloc(PICTURE_NBYTES), *picture = malloc(PICTURE_NBYTES);
  size_t resident;
  uint64_t late, late_alone;
  block_cache_counts alone = fly(65536, 1, NULL, reference, &resident, &late_alone), counts;
  assert_true(late_alone > 0);
  for (size_t i = 0; i < sizeof capacities / sizeof *capacities; i++) {
    counts = fly(capacities[i], 1, look_at_next, picture, &resident, &late);
    assert_memory_equal(picture, reference, PICTURE_NBYTES);
    assert_int_equal(counts.lookups, alone.lookups);
    assert_true(resident <= capacities[i] + 2 * BLOCK_MAX_SLICES);
    /* At most a quarter of the capacity a frame. */
    const uint64_t in_frames = counts.lookups - counts.hits;
    assert_true(counts.decompressions - in_frames <= FRAMES * (capacities[i] / 4));
  }
  /* The last cache holds all: each block was decompressed once, those of frame FRAMES among them.
   */
  assert_int_equal(late, 0);
  /* What the first frame missed is all that was no hit. */
  assert_int_equal(counts.lookups - counts.hits, alone.decompressions - late_alone);
  assert_int_equal(counts.decompressions_again, 0);
  assert_true(counts.decompressions > alone.decompressions);
  counts = fly(65536, 1, look_no_further, picture, &resident, &late);
  assert_int_equal(counts.decompressions, alone.decompressions);
  assert_int_equal(late, late_alone);
  free(reference);
  free(picture);
}

typedef struct {
  size_t all, fresh;
} tally;

static void count_block(void *context, slf_block_address address, bool fresh) {
  tally *t = context;
  assert_true(address.s < DIRECTIONS && address.t < DIRECTIONS);
  assert_true(address.block_u < 6 && address.block_v < 6);
  t->all++;
  t->fresh += fresh;
}

static void test_counts_of_a_frame_and_the_map(void **state) {
  (void)state;
  block_cache *cache = block_cache_create(file, 50);
  block_source source = block_cache_layer(cache, 1, 0);
  const uint8_t *blocks[3];
  const slice_index first[3] = {5 << 8 | 5, 5 << 8 | 6, 6 << 8 | 5}, second[2] = {6 << 8 | 5, 2};
  block_cache_begin_frame(cache);
  source.fetch(source.context, 2, 3, first, 3, blocks);
  uint8_t expected[SLF_BLOCK_NBYTES];
  slf_decode_block(file, 1, 0, (slf_block_address){.s = 6, .t = 5, .block_u = 2, .block_v = 3},
                   expected);
  assert_memory_equal(blocks[2], expected, SLF_BLOCK_NBYTES);
  block_cache_begin_frame(cache);
  source.fetch(source.context, 2, 3, second, 2, blocks);
  assert_memory_equal(blocks[0], expected, SLF_BLOCK_NBYTES);
  const block_cache_counts *counts = block_cache_get_counts(cache);
  assert_int_equal(counts->frame_lookups, 2);
  assert_int_equal(counts->frame_decompressions, 1);
  assert_int_equal(counts->decompressions, 4);
  assert_int_equal(block_cache_resident(cache), 4);
  tally other = {0, 0}, map = {0, 0};
  block_cache_visit(cache, 0, 0, count_block, &other);
  block_cache_visit(cache, 1, 0, count_block, &map);
  assert_int_equal(other.all, 0);
  assert_int_equal(map.all, 4);
  assert_int_equal(map.fresh, 1);
  block_cache_clear(cache);
  assert_int_equal(block_cache_resident(cache), 0);
  block_cache_free(cache);
}

/* Random fetches against a small cache: whatever is evicted, the bytes are those of the file. */
static void test_random_fetches(void **state) {
  (void)state;
  static const size_t capacities[] = {0, 2, 37, 300};
  srand(3);
  for (size_t i = 0; i < 4; i++) {
    block_cache *cache = block_cache_create(file, capacities[i]);
    for (int round = 0; round < 2000; round++) {
      uint32_t surface = (uint32_t)rand() % 2;
      block_source source = block_cache_layer(cache, surface, 0);
      uint32_t block_u = (uint32_t)rand() % 2, block_v = (uint32_t)rand() % 6;
      slice_index slices[20];
      const uint8_t *blocks[20];
      size_t count = 1 + (size_t)rand() % 20;
      uint32_t start = (uint32_t)rand() % 124; /* different from each other, as promised */
      for (size_t k = 0; k < count; k++) {
        uint32_t slice = start + (uint32_t)k;
        slices[k] = (slice_index)(slice / DIRECTIONS << 8 | slice % DIRECTIONS);
      }
      source.fetch(source.context, block_u, block_v, slices, count, blocks);
      size_t k = (size_t)rand() % count;
      uint8_t expected[SLF_BLOCK_NBYTES];
      slf_decode_block(file, surface, 0,
                       (slf_block_address){.s = slices[k] >> 8,
                                           .t = slices[k] & 0xff,
                                           .block_u = (uint16_t)block_u,
                                           .block_v = (uint16_t)block_v},
                       expected);
      assert_memory_equal(blocks[k], expected, SLF_BLOCK_NBYTES);
    }
    block_cache_free(cache);
  }
}

static float any(float scale) {
  return scale * (2 * (float)rand() / (float)RAND_MAX - 1);
}

/* A sanitized build flies a fifth as far. */
#if defined(__SANITIZE_ADDRESS__)
enum { FLIGHT_FRAMES = 2000 };
#else
enum { FLIGHT_FRAMES = 10000 };
#endif

/* 10,000 cameras anywhere: inside, behind, on the plane itself, at vertices, at 1e6. Every texel of
 * every level is radiance of the file or nothing, and nothing is allocated on the way. */
static void test_flight(void **state) {
  (void)state;
  block_cache *cache = block_cache_create(file, 200);
  const slf_surface *surface = slf_get_surface(file, 0);
  texture x;
  assert_true(texture_create(&x, &surface->mesh, &surface->layers[0],
                             block_cache_layer(cache, 0, 0), UV_DICE_PX));
  texture_decode_ahead(&x, cache, 1, 0);
  srand(4);
  size_t made = 0, allocated = 0;
  slf_view before = {.angle_deg = 90};
  for (int frame = 0; frame < FLIGHT_FRAMES; frame++) {
    static const float scales[] = {1, 1e-3f, 30, 1e6f};
    float scale = scales[frame % 4];
    slf_view view = {.location = {0.5f + any(scale), any(scale), 0.5f + any(scale)},
                     .look_at = {any(2), any(2), any(2)},
                     .angle_deg = 90 + any(89)};
    if (frame % 5 == 0) view.location[1] = 0;
    if (frame % 7 == 0) memcpy(view.location, view.look_at, sizeof view.location);
    if (frame % 11 == 0) memset(view.location, 0, sizeof view.location);
    camera c = camera_of_view(&view, 4, 3);
    block_cache_begin_frame(cache);
    texture_update(&x, &c, (direction_bend){0});
    texture_make_levels(&x);
    const slf_view ahead = view_ahead(&view, &before);
    const camera expected = camera_of_view(&ahead, 4, 3);
    const atomic_bool stop = false;
    texture_look_ahead(&x, &expected, &stop);
    before = view;
    made += x.made_count;
    for (uint32_t level = 0; level < x.level_count; level++)
      for (uint32_t v = 0; v < x.levels[level].height; v++) {
        const uint16_t *texel = (const uint16_t *)((const uint8_t *)x.levels[level].texels +
                                                   v * x.levels[level].row_nbytes);
        /* Halves above 1 (the brightest code, and room for the mean's rounding) or NaN are larger
         * integers than 0x3c01; a colour is premultiplied, so never above its alpha by more. */
        for (uint32_t i = 0; i < 4 * x.levels[level].width; i++) {
          assert_true(texel[i] <= HALF_ONE + 1);
          if (i % 4 == 3 && level == 0) assert_true(texel[i] == 0 || texel[i] == HALF_ONE);
          if (i % 4 != 3)
            assert_true(float_from_half(texel[i]) <= float_from_half(texel[i | 3]) * 1.002f);
        }
      }
    assert_true(block_cache_resident(cache) <= 200 + 2 * BLOCK_MAX_SLICES);
    if (frame == 100) allocated = mallinfo2().uordblks;
  }
  /* Under the address sanitizer mallinfo2 gives zeros, and its leak check does this work. */
  assert_int_equal(mallinfo2().uordblks, allocated);
  assert_true(made > FLIGHT_FRAMES); /* many of them saw something */
  texture_free(&x);
  block_cache_free(cache);
}

/* Several places are asked for before anything is there; then all of it is, whatever the cache
 * holds, as long as nothing else is fetched. */
static void test_fetching_later(void **state) {
  (void)state;
  enum { PLACES = 6, SLICES = BLOCK_MAX_SLICES / PLACES };
  static const size_t capacities[] = {0, 2, 37, 300};
  srand(4);
  for (size_t i = 0; i < 4; i++) {
    block_cache *cache = block_cache_create(file, capacities[i]);
    for (int round = 0; round < 200; round++) {
      block_source source = block_cache_layer(cache, (uint32_t)round % 2, 0);
      slf_block_address addresses[PLACES][SLICES];
      const uint8_t *blocks[PLACES][SLICES];
      for (uint16_t place = 0; place < PLACES; place++) {
        slice_index slices[SLICES];
        uint32_t start = (uint32_t)rand() % (DIRECTIONS * DIRECTIONS - SLICES);
        for (uint32_t k = 0; k < SLICES; k++) {
          uint32_t s = (start + k) / DIRECTIONS, t = (start + k) % DIRECTIONS;
          slices[k] = (slice_index)(s << 8 | t);
          addresses[place][k] = (slf_block_address){(uint16_t)s, (uint16_t)t, place, 1};
        }
        source.fetch_later(source.context, place, 1, slices, SLICES, blocks[place]);
      }
      source.finish(source.context);
      for (int place = 0; place < PLACES; place++)
        for (int k = 0; k < SLICES; k++) {
          uint8_t expected[SLF_BLOCK_NBYTES];
          slf_decode_block(file, (uint32_t)round % 2, 0, addresses[place][k], expected);
          assert_memory_equal(blocks[place][k], expected, SLF_BLOCK_NBYTES);
        }
      assert_true(block_cache_resident(cache) <= capacities[i] + 2 * BLOCK_MAX_SLICES);
    }
    block_cache_free(cache);
  }
}

/* ---- Angular levels ----------------------------------------------------------------------------
 */

/* Whether slice x of count lies in share i of n, [i count / n, (i + 1) count / n) rounded. */
static bool in_share(uint32_t x, uint32_t count, uint32_t i, uint32_t n) {
  return x >= lround((double)i * count / n) && x < lround((i + 1.0) * count / n);
}

/* The slices that stand for a coarser one are stored, of its own share of the axes where one there
 * is, and no slice stands for two. Down to shares of 4 slices every stored one is in the mean. */
static void test_samples_of_a_level(void **state) {
  (void)state;
  static const uint32_t counts[][2] = {{1, 1},   {1, 7},   {4, 4},   {5, 12},   {12, 12},
                                       {13, 16}, {16, 16}, {64, 64}, {100, 37}, {256, 256}};
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (uint32_t level = 0; level <= ANGULAR_MAX_LEVEL; level++) {
      uint32_t s_count = counts[n][0], t_count = counts[n][1];
      uint32_t coarse_s = angular_count(s_count, level), coarse_t = angular_count(t_count, level);
      uint8_t *used = calloc((size_t)s_count * t_count, 1);
      size_t stored = 0, taken = 0;
      if (level == ANGULAR_MAX_LEVEL) assert_true(coarse_s == 1 && coarse_t == 1);
      for (uint32_t i = 0; i < coarse_s; i++)
        for (uint32_t j = 0; j < coarse_t; j++) {
          slice_index samples[ANGULAR_MAX_SAMPLES];
          size_t count =
              angular_samples(s_count, t_count, level, (slice_index)(i << 8 | j), samples);
          assert_true(count >= 1 && count <= ANGULAR_MAX_SAMPLES);
          for (size_t k = 0; k < count; k++) {
            uint32_t s = samples[k] >> 8, t = samples[k] & 0xff;
            assert_true(slf_slice_exists(s_count, t_count, s, t));
            bool own = in_share(s, s_count, i, coarse_s) && in_share(t, t_count, j, coarse_t);
            assert_true(own || count == 1);
            if (!own) continue;
            assert_int_equal(used[s * t_count + t], 0);
            used[s * t_count + t] = 1;
            taken++;
          }
        }
      for (uint32_t s = 0; s < s_count; s++)
        for (uint32_t t = 0; t < t_count; t++) stored += slf_slice_exists(s_count, t_count, s, t);
      if (s_count <= 4 * coarse_s && t_count <= 4 * coarse_t) assert_int_equal(taken, stored);
      free(used);
    }
}

static void test_a_level_is_the_mean(void **state) {
  (void)state;
  for (uint32_t level = 1; level <= 4; level++) {
    block_cache *cache = block_cache_create(file, 1000);
    block_source source = block_cache_level(cache, 0, 0, level);
    uint32_t coarse = angular_count(DIRECTIONS, level);
    for (uint32_t i = 0; i < coarse * coarse; i++) {
      slice_index slice = (slice_index)(i / coarse << 8 | i % coarse);
      slice_index samples[ANGULAR_MAX_SAMPLES];
      size_t count = angular_samples(DIRECTIONS, DIRECTIONS, level, slice, samples);
      const uint8_t *mean;
      double sum[256] = {0};
      uint64_t before = block_cache_get_counts(cache)->decompressions;
      source.fetch(source.context, 2, 3, &slice, 1, &mean);
      assert_int_equal(block_cache_get_counts(cache)->decompressions - before, count);
      for (size_t k = 0; k < count; k++) {
        uint8_t block[SLF_BLOCK_NBYTES];
        slf_decode_block(file, 0, 0, (slf_block_address){samples[k] >> 8, samples[k] & 0xff, 2, 3},
                         block);
        for (int c = 0; c < 256; c++) sum[c] += slf_linear_from_srgb(block[c]);
      }
      /* Rounded to a code, which is looked up in steps of at most 1/5 code. */
      for (int c = 0; c < 256; c++) {
        double code = slf_srgb_from_linear((float)(sum[c] / (double)count));
        assert_true(c % 4 == 3 || fabs(mean[c] - code) <= 1);
      }
      source.fetch(source.context, 2, 3, &slice, 1, &mean); /* it is kept */
      assert_int_equal(block_cache_get_counts(cache)->decompressions - before, count);
    }
    block_cache_free(cache);
  }
}

/* One slice looks the same from everywhere. */
static void test_the_coarsest_level_is_matte(void **state) {
  (void)state;
  block_cache *cache = block_cache_create(file, 1000);
  resampler *r = resampler_create(DIRECTIONS, DIRECTIONS, block_cache_layer(cache, 0, 0));
  resampler_use_slices(r, 1, 1, block_cache_level(cache, 0, 0, 4));
  uint16_t first[256], out[256];
  for (int i = 0; i < 50; i++) {
    block_directions d = {.mask = ~(uint64_t)0};
    for (int k = 0; k < 64; k++) d.s[k] = (float)(i % 7) / 6, d.t[k] = (float)(k + i) / 113;
    resample_block(r, 1, 1, &d, i ? out : first, 64);
    resample_flush(r);
    if (i) assert_memory_equal(out, first, sizeof out);
  }
  resampler_free(r);
  block_cache_free(cache);
}

/* Radiance far above white: what is mixed is what the file holds, to a half float's rounding. */
static slf_result read_bright(void *context, uint32_t s_index, uint32_t t_index, float *rgb,
                              slf_error *error) {
  (void)context, (void)error;
  for (uint32_t i = 0; i < 16 * 16 * 3; i++)
    rgb[i] = expf(0.02f * (float)(i / 3 % 16 * s_index + i / 48 * t_index)) * 3;
  return SLF_OK;
}

static void test_hdr(void **state) {
  (void)state;
  char bright[] = "/tmp/slf_viewer_hdr_XXXXXX";
  slf_file *hdr;
  const light_field field = {.surface = {.name = "bright", .mesh = slf_get_surface(file, 0)->mesh},
                             .layer = {.curve = SLF_CURVE_DWA,
                                       .u_count = 16,
                                       .v_count = 16,
                                       .s_count = 6,
                                       .t_count = 6,
                                       .quality = 90,
                                       .thread_count = 1},
                             .source = {.read_slice = read_bright}};
  assert_int_equal(make_light_fields(bright, &field, 1, &hdr), 0);
  for (size_t capacity = 0; capacity < 200; capacity += 100)
    for (int kernel = 0; kernel < 2; kernel++) {
      block_cache *cache = block_cache_create(hdr, capacity);
      resampler *r = resampler_create(6, 6, block_cache_layer(cache, 0, 0));
      resampler_use_format(r, U_BLOCK_HALF);
      resampler_use_kernel(r, kernel ? RESAMPLE_PLAIN_C : RESAMPLE_BEST);
      block_directions d = {.mask = ~(uint64_t)0};
      /* Half way between slices 2 and 3 along s, on slice 4 along t. */
      for (int k = 0; k < 64; k++) d.s[k] = 0.5f, d.t[k] = 4.5f / 6;
      uint16_t out[256];
      float a[192], b[192], brightest = 0;
      resample_block(r, 1, 0, &d, out, 64);
      resample_flush(r);
      slf_decode_block_linear(hdr, 0, 0, (slf_block_address){2, 4, 1, 0}, a);
      slf_decode_block_linear(hdr, 0, 0, (slf_block_address){3, 4, 1, 0}, b);
      for (int k = 0; k < 64; k++)
        for (int c = 0; c < 3; c++) {
          float exact = 0.5f * (a[3 * k + c] + b[3 * k + c]);
          /* Each tap and the result are rounded to 11 bits. */
          assert_true(fabsf(float_from_half(out[4 * k + c]) - exact) <= exact * 2 / 2048);
          brightest = fmaxf(brightest, exact);
        }
      assert_true(brightest > 5); /* the file did not clamp it */
      resampler_free(r);
      block_cache_free(cache);
    }
  slf_close(hdr);
  unlink(bright);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_any_capacity_gives_the_same_bytes),
      cmocka_unit_test(test_decoding_ahead),
      cmocka_unit_test(test_looking_ahead),
      cmocka_unit_test(test_counts_of_a_frame_and_the_map),
      cmocka_unit_test(test_random_fetches),
      cmocka_unit_test(test_fetching_later),
      cmocka_unit_test(test_samples_of_a_level),
      cmocka_unit_test(test_a_level_is_the_mean),
      cmocka_unit_test(test_the_coarsest_level_is_matte),
      cmocka_unit_test(test_flight),
      cmocka_unit_test(test_hdr),
  };
  return cmocka_run_group_tests(tests, write_file, remove_file);
}
