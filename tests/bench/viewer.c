/* viewer - what a compressed light field costs against an uncompressed one, in one run.
 *
 *   viewer FILE.slf...      prints one flat JSON object; keys end in the file's name
 *
 * Both go through the same code, texture_update; only the source of U-Blocks differs. The
 * uncompressed one is the strongest we know: decoded RGBX blocks of 8x8 in one array, all slices of
 * a block of texels side by side, so that a fetch is an address and the four taps of a cell lie
 * close. One thread. A ratio is the median over rounds of times taken right after each other. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "codec/parallel.h"
#include "tests/bench/figures.h"
#include "viewer/block_cache.h"
#include "viewer/texture.h"

enum { MAX_SURFACES = 16, ROUNDS = 41, MOVING_FRAMES = 60 };

/* ---- The uncompressed light field --------------------------------------------------------------
 */

typedef struct {
  uint8_t *blocks; /* [block_v][block_u][s][t] */
  uint32_t block_u_count, s_count, t_count;
} table;

static void fetch_table(void *context, uint32_t block_u, uint32_t block_v,
                        const slice_index *slices, size_t count, const uint8_t **u_blocks) {
  const table *x = context;
  const uint8_t *base = x->blocks + ((size_t)block_v * x->block_u_count + block_u) * x->s_count *
                                        x->t_count * SLF_BLOCK_NBYTES;
  for (size_t i = 0; i < count; i++)
    u_blocks[i] =
        base + ((size_t)(slices[i] >> 8) * x->t_count + (slices[i] & 0xff)) * SLF_BLOCK_NBYTES;
}

static bool fill_table(table *x, const slf_file *file, uint32_t surface, const slf_layer *layer) {
  size_t count =
      (size_t)layer->block_u_count * layer->block_v_count * layer->s_count * layer->t_count;
  *x = (table){malloc(count * SLF_BLOCK_NBYTES), layer->block_u_count, layer->s_count,
               layer->t_count};
  if (!x->blocks) return false;
  for (size_t i = 0; i < count; i += layer->t_count) {
    size_t slice = i % ((size_t)layer->s_count * layer->t_count);
    size_t block = i / ((size_t)layer->s_count * layer->t_count);
    slf_block_address addresses[SLF_MAX_DIRECTIONS];
    uint8_t *targets[SLF_MAX_DIRECTIONS];
    for (uint32_t t = 0; t < layer->t_count; t++) {
      addresses[t] = (slf_block_address){.s = (uint16_t)(slice / layer->t_count),
                                         .t = (uint16_t)t,
                                         .block_u = (uint16_t)(block % layer->block_u_count),
                                         .block_v = (uint16_t)(block / layer->block_u_count)};
      targets[t] = x->blocks + (i + t) * SLF_BLOCK_NBYTES;
    }
    slf_decode_blocks(file, surface, 0, addresses, layer->t_count, targets);
  }
  return true;
}

/* ---- A scene, once through a cache and once through tables -------------------------------------
 */

typedef struct {
  const slf_file *file;
  uint32_t count, surfaces[MAX_SURFACES]; /* the shiny ones */
  texture textures[MAX_SURFACES];
  table tables[MAX_SURFACES];
  block_cache *cache; /* NULL: uncompressed */
} scene;

static bool open_scene(scene *x, const slf_file *file, const scene *tables, size_t capacity) {
  memset(x, 0, sizeof *x);
  x->file = file;
  if (tables && !(x->cache = block_cache_create(file, capacity))) return false;
  for (uint32_t i = 0; i < slf_surface_count(file) && x->count < MAX_SURFACES; i++) {
    const slf_surface *surface = slf_get_surface(file, i);
    const slf_layer *layer = &surface->layers[0];
    if (layer->slice_count == 1) continue;
    block_source source = {.fetch = fetch_table, .context = &x->tables[x->count]};
    if (x->cache)
      source = block_cache_layer(x->cache, i, 0);
    else if (!fill_table(&x->tables[x->count], file, i, layer))
      return false;
    if (!texture_create(&x->textures[x->count], &surface->mesh, layer, source, UV_DICE_PX))
      return false;
    x->surfaces[x->count++] = i;
  }
  return true;
}

static void close_scene(scene *x) {
  for (uint32_t i = 0; i < x->count; i++) {
    texture_free(&x->textures[i]);
    free(x->tables[i].blocks);
  }
  block_cache_free(x->cache);
}

/* Makes all textures for a view and says how long it took. */
static double frame_ns(scene *x, const slf_view *view, size_t *texels) {
  camera c = camera_of_view(view, 4, 3);
  double start_s = clock_s(CLOCK_THREAD_CPUTIME_ID); /* others may share the processor */
  if (x->cache) block_cache_begin_frame(x->cache);
  *texels = 0;
  for (uint32_t i = 0; i < x->count; i++) {
    texture_update(&x->textures[i], &c, (direction_bend){0});
    *texels += 64 * (size_t)x->textures[i].made_count;
  }
  return 1e9 * (clock_s(CLOCK_THREAD_CPUTIME_ID) - start_s);
}

/* Half a degree a frame about what the view looks at. */
#define STEP_RAD (0.5f * (float)M_PI / 180)

/* What the viewer does on another thread while a frame is drawn, for the next one. */
static double look_ahead_ns(scene *x, const slf_view *view, const slf_view *before) {
  const atomic_bool stop = false;
  slf_view ahead = view_ahead(view, before);
  camera c = camera_of_view(&ahead, 4, 3);
  double start_s = clock_s(CLOCK_THREAD_CPUTIME_ID);
  for (uint32_t i = 0; i < x->count; i++) texture_look_ahead(&x->textures[i], &c, &stop);
  return 1e9 * (clock_s(CLOCK_THREAD_CPUTIME_ID) - start_s);
}

/* Frames of `x` against frames of `plain`, one view, `cold` with an emptied cache each time. */
static double still_ratio(scene *x, scene *plain, const slf_view *view, bool cold) {
  double ratios[ROUNDS];
  size_t texels;
  frame_ns(x, view, &texels);
  frame_ns(plain, view, &texels);
  for (int i = 0; i < ROUNDS; i++) {
    if (cold) block_cache_clear(x->cache);
    double ours = frame_ns(x, view, &texels), theirs = frame_ns(plain, view, &texels);
    ratios[i] = ours / theirs;
  }
  return median(ratios, ROUNDS);
}

/* The same over views drawn at random, once each: from anywhere around what the view looks at, up
 * to 30 degrees higher or lower. */
static double random_views_cold_ratio(scene *x, scene *plain, const slf_view *view) {
  double ours = 0, theirs = 0;
  size_t texels;
  srand(1);
  for (int i = 0; i < ROUNDS; i++) {
    slf_view drawn = *view;
    float around = (float)rand() / (float)RAND_MAX, up = (float)rand() / (float)RAND_MAX - 0.5f;
    view_orbit(&drawn, 2 * (float)M_PI * around, (float)M_PI / 3 * up);
    frame_ns(plain, &drawn, &texels);
    block_cache_clear(x->cache);
    ours += frame_ns(x, &drawn, &texels);
    theirs += frame_ns(plain, &drawn, &texels);
  }
  return ours / theirs;
}

/* How much sooner a frame is there for which all is decompressed when every processor helps. */
static double threads_speedup(scene *x, const slf_view *view) {
  double ratios[ROUNDS], s[2];
  size_t texels;
  for (int i = 0; i < ROUNDS; i++) {
    for (int all = 0; all < 2; all++) {
      for (uint32_t k = 0; k < x->count; k++)
        texture_decode_ahead(&x->textures[k], x->cache, all ? processor_count() : 1, 0);
      block_cache_clear(x->cache);
      double start_s = now_s();
      frame_ns(x, view, &texels);
      s[all] = now_s() - start_s;
    }
    ratios[i] = s[0] / s[1];
  }
  for (uint32_t k = 0; k < x->count; k++) texture_decode_ahead(&x->textures[k], NULL, 1, 0);
  return median(ratios, ROUNDS);
}

static double decompressions_per_block(scene *x, const slf_view *view) {
  size_t texels;
  frame_ns(x, view, &texels);
  frame_ns(x, view, &texels);
  uint64_t decompressions = block_cache_get_counts(x->cache)->frame_decompressions;
  scene all;
  open_scene(&all, x->file, x, BLOCK_CACHE_DEFAULT);
  frame_ns(&all, view, &texels);
  uint64_t blocks = block_cache_get_counts(all.cache)->frame_decompressions;
  close_scene(&all);
  return (double)decompressions / (double)blocks;
}

/* A flight of half degrees, summed over its frames. */
typedef struct {
  double ours_ns, theirs_ns, ahead_ns, texel_count, decompression_count;
  double our_frames_ns[MOVING_FRAMES], their_frames_ns[MOVING_FRAMES];
} flight;

static flight fly(scene *x, scene *plain, const slf_view *from, bool looks_ahead) {
  flight f = {0};
  slf_view view = *from, before = *from;
  size_t texels;
  view_orbit(&before, -STEP_RAD, 0);
  frame_ns(x, &view, &texels);
  for (int i = 0; i < MOVING_FRAMES; i++) {
    if (looks_ahead) f.ahead_ns += look_ahead_ns(x, &view, &before);
    before = view;
    view_orbit(&view, STEP_RAD, 0);
    f.ours_ns += f.our_frames_ns[i] = frame_ns(x, &view, &texels);
    f.theirs_ns += f.their_frames_ns[i] = frame_ns(plain, &view, &texels);
    f.texel_count += (double)texels;
    f.decompression_count += (double)block_cache_get_counts(x->cache)->frame_decompressions;
  }
  return f;
}

/* At first the cache is empty, so every block is new once; when the same is flown again, none is;
 * and once more from an empty cache, looking ahead. */
static void bench_flights(scene *x, scene *plain, const slf_view *view, const char *name) {
  block_cache_clear(x->cache);
  flight first = fly(x, plain, view, false), again = fly(x, plain, view, false);
  for (uint32_t i = 0; i < x->count; i++) texture_decode_ahead(&x->textures[i], x->cache, 1, 0);
  block_cache_clear(x->cache);
  flight ahead = fly(x, plain, view, true);
  for (uint32_t i = 0; i < x->count; i++) texture_decode_ahead(&x->textures[i], NULL, 1, 0);
  print_figure("moving_vs_uncompressed", name, first.ours_ns / first.theirs_ns);
  print_figure("moving_warm_vs_uncompressed", name, again.ours_ns / again.theirs_ns);
  print_figure("moving_ahead_vs_uncompressed", name, ahead.ours_ns / ahead.theirs_ns);
  print_figure("look_ahead_vs_uncompressed", name, ahead.ahead_ns / ahead.theirs_ns);
  print_figure("resample_ns_per_texel_moving", name, first.ours_ns / first.texel_count);
  print_figure("uncompressed_ns_per_texel_moving", name, first.theirs_ns / first.texel_count);
  print_figure("decompressions_per_frame_moving", name, first.decompression_count / MOVING_FRAMES);
  print_figure("decompressions_per_frame_moving_ahead", name,
               ahead.decompression_count / MOVING_FRAMES);
  print_figure("frame_ms_moving", name, median(first.our_frames_ns, MOVING_FRAMES) / 1e6);
  print_figure("frame_ms_moving_ahead", name, median(ahead.our_frames_ns, MOVING_FRAMES) / 1e6);
  print_figure("uncompressed_frame_ms_moving", name,
               median(first.their_frames_ns, MOVING_FRAMES) / 1e6);
}

static void bench(const slf_file *file, const char *name) {
  scene plain, warm, small;
  size_t texels;
  slf_view view = *slf_get_view(file, 0);
  char key[64];
  if (!open_scene(&plain, file, NULL, 0) || !open_scene(&warm, file, &plain, BLOCK_CACHE_DEFAULT)) {
    fprintf(stderr, "viewer: %s: out of memory\n", name);
    exit(1);
  }
  print_figure("warm_vs_uncompressed", name, still_ratio(&warm, &plain, &view, false));
  print_figure("cold_vs_uncompressed", name, still_ratio(&warm, &plain, &view, true));
  print_figure("random_views_cold_vs_uncompressed", name,
               random_views_cold_ratio(&warm, &plain, &view));
  print_figure("cold_threads_speedup", name, threads_speedup(&warm, &view));
  static const size_t capacities[] = {10000, 1000, 100, 10, 4, 1, 0};
  for (size_t i = 0; i < sizeof capacities / sizeof *capacities; i++) {
    open_scene(&small, file, &plain, capacities[i]);
    snprintf(key, sizeof key, "cache%zu_vs_uncompressed", capacities[i]);
    print_figure(key, name, still_ratio(&small, &plain, &view, false));
    /* Against the same frame by a cache that holds all of it, emptied before. */
    double ratios[ROUNDS];
    for (int k = 0; k < ROUNDS; k++) {
      block_cache_clear(warm.cache);
      double cold = frame_ns(&warm, &view, &texels);
      ratios[k] = frame_ns(&small, &view, &texels) / cold;
    }
    snprintf(key, sizeof key, "cache%zu_vs_cold", capacities[i]);
    print_figure(key, name, median(ratios, ROUNDS));
    snprintf(key, sizeof key, "decompressions_per_block_cache%zu", capacities[i]);
    print_figure(key, name, decompressions_per_block(&small, &view));
    close_scene(&small);
  }
  bench_flights(&warm, &plain, &view, name);
  double still[ROUNDS];
  frame_ns(&warm, &view, &texels);
  for (int i = 0; i < ROUNDS; i++) still[i] = frame_ns(&warm, &view, &texels);
  print_figure("frame_ms_warm", name, median(still, ROUNDS) / 1e6);
  for (int i = 0; i < ROUNDS; i++) still[i] = frame_ns(&plain, &view, &texels);
  print_figure("uncompressed_frame_ms_warm", name, median(still, ROUNDS) / 1e6);
  print_figure("texels_per_frame", name, (double)texels);
  print_figure("blocks_per_frame", name, (double)block_cache_get_counts(warm.cache)->frame_lookups);
  close_scene(&warm);
  close_scene(&plain);
}

int main(int argc, char **argv) {
  if (argc < 2) {
    fputs("usage: viewer FILE.slf...\n", stderr);
    return 2;
  }
  for (int i = 1; i < argc; i++) {
    slf_file *file;
    slf_error error;
    if (slf_open(argv[i], &file, &error) != SLF_OK) {
      fprintf(stderr, "viewer: %s\n", error.message);
      return 1;
    }
    const char *slash = strrchr(argv[i], '/');
    char name[64];
    snprintf(name, sizeof name, "%s", slash ? slash + 1 : argv[i]);
    name[strcspn(name, ".")] = 0;
    bench(file, name);
    slf_close(file);
  }
  end_figures();
  return 0;
}
