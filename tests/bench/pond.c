/* pond - what ripples cost, and what compression costs rippled water; prints one flat JSON object.
 *
 *   pond FILE.slf...     each with a surface marked as water
 *
 * Whole frames of 640x480 with software GL: steps of the water, its normals, bent directions, mix,
 * mip levels, upload, drawing, and the wait for the last pixel. Compressed is the block cache over
 * the file; uncompressed the same code over a table of decoded blocks, all slices of a block side
 * by side. Frames of the two alternate; a ratio is the median over rounds, frames a second the
 * median over frames. Keys that end in _cpu are by processor time of all threads instead of the
 * clock, for when others share the machine. Each file is measured with water grids of 64 and of 128
 * cells; the keys without a file's name are the worst over all.
 *
 *   calm        the water at rest, the camera still
 *   disturbed   from rest, with what was decompressed for the calm view in the cache: a drop, a
 *               stroke and rain, water time 1/60 s a frame, 40 frames
 *   small cache the paper's setting: the cache holds twice what the calm view reads */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/bench/figures.h"
#include "viewer/context.h"
#include "viewer/draw.h"
#include "viewer/gl_api.h"

enum { ROUNDS = 5, FRAMES = 40, WIDTH_PX = 640, HEIGHT_PX = 480 };

static void fail(const char *what) {
  fprintf(stderr, "pond: %s\n", what);
  exit(1);
}

/* ---- The uncompressed light field --------------------------------------------------------------
 */

typedef struct {
  uint8_t *blocks; /* [block_v][block_u][s][t] */
  const slf_layer *layer;
} table;

typedef struct {
  const slf_file *file;
  table *tables; /* of the first layer of each surface */
} table_set;

static void fetch(void *context, uint32_t block_u, uint32_t block_v, const slice_index *slices,
                  size_t count, const uint8_t **u_blocks) {
  const table *x = context;
  const size_t block = (size_t)block_v * x->layer->block_u_count + block_u;
  const uint8_t *base =
      x->blocks + block * x->layer->s_count * x->layer->t_count * SLF_BLOCK_NBYTES;
  for (size_t i = 0; i < count; i++)
    u_blocks[i] = base + ((size_t)(slices[i] >> 8) * x->layer->t_count + (slices[i] & 0xff)) *
                             SLF_BLOCK_NBYTES;
}

static block_source table_source(void *context, uint32_t surface, uint32_t layer_index) {
  table_set *set = context;
  table *x = &set->tables[surface];
  const slf_layer *layer = &slf_get_surface(set->file, surface)->layers[layer_index];
  const size_t slice_count = (size_t)layer->s_count * layer->t_count;
  const size_t count = slice_count * layer->block_u_count * layer->block_v_count;
  if (layer_index > 0) fail("more than one layer");
  if (!x->blocks) {
    *x = (table){malloc(count * SLF_BLOCK_NBYTES), layer};
    if (!x->blocks) fail("out of memory");
    for (size_t i = 0; i < count; i++) {
      const size_t slice = i % slice_count, block = i / slice_count;
      const slf_block_address address = {.s = (uint16_t)(slice / layer->t_count),
                                         .t = (uint16_t)(slice % layer->t_count),
                                         .block_u = (uint16_t)(block % layer->block_u_count),
                                         .block_v = (uint16_t)(block / layer->block_u_count)};
      slf_decode_block(set->file, surface, 0, address, x->blocks + i * SLF_BLOCK_NBYTES);
    }
  }
  return (block_source){.fetch = fetch, .context = x};
}

/* ---- Frames ------------------------------------------------------------------------------------
 */

typedef struct {
  drawing *drawing;
  water *water;
  double cpu_s; /* of the frames that are measured */
} scene;

static uint32_t water_index(const slf_file *file) {
  for (uint32_t i = 0; i < slf_surface_count(file); i++)
    if (slf_get_surface(file, i)->flags & SLF_SURFACE_WATER) return i;
  fail("a file without water");
  return 0;
}

static scene open_scene(const slf_file *file, drawing_options options) {
  scene x = {0};
  slf_error error;
  options.dice_px = UV_DICE_PX;
  if (drawing_create(file, options, &x.drawing, &error) != SLF_OK) fail(error.message);
  x.water = drawing_water(x.drawing, water_index(file));
  return x;
}

static double frame_s(scene *x, const slf_file *file, double water_s) {
  slf_error error;
  const double start = now_s(), start_cpu = cpu_s();
  if (water_advance(x->water, water_s, &error) != SLF_OK ||
      drawing_render(x->drawing, slf_get_view(file, 0), WIDTH_PX, HEIGHT_PX, -1, &error) != SLF_OK)
    fail(error.message);
  gl.Finish();
  x->cpu_s += cpu_s() - start_cpu;
  return now_s() - start;
}

static double total(const double *values, size_t count) {
  double sum = 0;
  for (size_t i = 0; i < count; i++) sum += values[i];
  return sum;
}

static void calm(scene *x, const slf_file *file) {
  (void)file;
  water_reset(x->water);
}

/* The same on every call: what the calm view needs is in the cache, nothing else. */
static void disturb(scene *x, const slf_file *file) {
  water_reset(x->water);
  block_cache_clear(drawing_cache(x->drawing));
  frame_s(x, file, 0);
  ripple *pond = x->water->pond;
  const ripple_options *o = ripple_get_options(pond);
  const float size = fmaxf(o->u_length, o->v_length);
  ripple_drop(pond, 0.4f, 0.4f, size / 20, -size / 30);
  ripple_stroke(pond, 0.2f, 0.7f, 0.8f, 0.6f, size / 30, size / 100);
  ripple_rain(pond, 20, size / 32, -size / 80, 1);
}

typedef struct {
  double ratio, ratio_cpu; /* of the frames a second uncompressed */
  double fps;              /* compressed */
} speed;

/* Frames of both in turn, so that whatever else the machine does meets both. */
static speed compare(scene *cached, scene *plain, const slf_file *file,
                     void (*begin)(scene *, const slf_file *)) {
  double all[ROUNDS * FRAMES], plain_frames[FRAMES], ratios[ROUNDS], ratios_cpu[ROUNDS];
  for (int round = 0; round < ROUNDS; round++) {
    double *frames = all + round * FRAMES;
    begin(plain, file);
    begin(cached, file);
    plain->cpu_s = cached->cpu_s = 0;
    for (int i = 0; i < FRAMES; i++) {
      plain_frames[i] = frame_s(plain, file, 1 / 60.0);
      frames[i] = frame_s(cached, file, 1 / 60.0);
    }
    ratios[round] = total(plain_frames, FRAMES) / total(frames, FRAMES);
    ratios_cpu[round] = plain->cpu_s / cached->cpu_s;
  }
  return (speed){median(ratios, ROUNDS), median(ratios_cpu, ROUNDS),
                 1 / median(all, ROUNDS * FRAMES)};
}

/* The part of a disturbed frame that compression can touch: directions and mix, no drawing. */
static double texture_ratio(const slf_file *file, const drawing_options *compressed,
                            const drawing_options *tables) {
  const uint32_t index = water_index(file);
  const slf_surface *surface = slf_get_surface(file, index);
  const slf_layer *layer = &surface->layers[0];
  const camera c = camera_of_view(slf_get_view(file, 0), WIDTH_PX, HEIGHT_PX);
  block_cache *cache = block_cache_create(file, compressed->cache_blocks);
  const block_source sources[2] = {tables->source(tables->source_context, index, 0),
                                   block_cache_layer(cache, index, 0)};
  texture textures[2];
  water *w;
  slf_error error;
  double ratios[ROUNDS];
  for (int k = 0; k < 2; k++)
    if (!texture_create(&textures[k], &surface->mesh, layer, sources[k], UV_DICE_PX))
      fail("out of memory");
  if (water_create(file, index, layer->u_count, layer->v_count, compressed->water_cells, &w,
                   &error) != SLF_OK)
    fail(error.message);
  for (int round = 0; round < ROUNDS; round++) {
    double spent[2] = {0, 0};
    water_reset(w);
    block_cache_clear(cache);
    texture_update(&textures[1], &c, (direction_bend){0});
    ripple_drop(w->pond, 0.4f, 0.4f, w->rectangle.u_length / 20, -w->rectangle.u_length / 30);
    ripple_rain(w->pond, 20, w->rectangle.u_length / 32, -w->rectangle.u_length / 80, 1);
    for (int i = 0; i < FRAMES; i++) {
      ripple_advance(w->pond, 1 / 60.0);
      for (int k = 0; k < 2; k++) {
        const double start = now_s();
        if (k == 1) block_cache_begin_frame(cache);
        texture_update(&textures[k], &c, water_begin_frame(w));
        spent[k] += now_s() - start;
      }
    }
    ratios[round] = spent[0] / spent[1];
  }
  water_free(w);
  for (int k = 0; k < 2; k++) texture_free(&textures[k]);
  block_cache_free(cache);
  return median(ratios, ROUNDS);
}

/* ---- Worst over all ----------------------------------------------------------------------------
 */

static double worst_calm = INFINITY, worst_disturbed = INFINITY, worst_small = INFINITY,
              worst_texture = INFINITY, fps_disturbed_256 = INFINITY;

static void measure(const slf_file *file, const char *name, uint32_t cells, table_set *set) {
  char key[128];
  const slf_layer *layer = &slf_get_surface(file, water_index(file))->layers[0];
  const drawing_options compressed = {.cache_blocks = BLOCK_CACHE_DEFAULT, .water_cells = cells};
  drawing_options tables = compressed, small = compressed;
  tables.source = table_source;
  tables.source_context = set;
  scene plain = open_scene(file, tables), cached = open_scene(file, compressed);
  snprintf(key, sizeof key, "%s_grid_%u", name, cells);

  const speed still = compare(&cached, &plain, file, calm);
  print_figure("pond_calm_vs_uncompressed_fps", key, still.ratio);
  print_figure("pond_calm_vs_uncompressed_cpu", key, still.ratio_cpu);
  print_figure("pond_fps_calm", key, still.fps);
  small.cache_blocks = 2 * block_cache_resident(drawing_cache(cached.drawing));
  const speed disturbed = compare(&cached, &plain, file, disturb);
  print_figure("pond_disturbed_vs_uncompressed_fps", key, disturbed.ratio);
  print_figure("pond_disturbed_vs_uncompressed_cpu", key, disturbed.ratio_cpu);
  print_figure("pond_fps_disturbed", key, disturbed.fps);
  const water_counts rays = water_get_counts(cached.water);
  print_figure("pond_below_horizon_share", key, (double)rays.below_count / (double)rays.ray_count);
  drawing_free(cached.drawing);

  cached = open_scene(file, small);
  const speed paper = compare(&cached, &plain, file, disturb);
  print_figure("pond_small_cache_blocks", key, (double)small.cache_blocks);
  print_figure("pond_disturbed_small_cache_vs_uncompressed_fps", key, paper.ratio);
  drawing_free(cached.drawing);
  drawing_free(plain.drawing);

  const double mix = texture_ratio(file, &compressed, &tables);
  print_figure("pond_disturbed_vs_uncompressed_texture", key, mix);
  worst_calm = fmin(worst_calm, still.ratio);
  worst_disturbed = fmin(worst_disturbed, disturbed.ratio);
  worst_small = fmin(worst_small, paper.ratio);
  worst_texture = fmin(worst_texture, mix);
  if (layer->u_count == 256) fps_disturbed_256 = fmin(fps_disturbed_256, disturbed.fps);
}

static void measure_file(const char *path) {
  char name[64];
  slf_file *file;
  slf_error error;
  const char *base = strrchr(path, '/');
  snprintf(name, sizeof name, "%s", base ? base + 1 : path);
  name[strcspn(name, ".")] = 0;
  if (slf_open(path, &file, &error) != SLF_OK) fail(error.message);
  const slf_layer *layer = &slf_get_surface(file, water_index(file))->layers[0];
  print_figure("pond_compression", name,
               (double)layer->raw_nbytes / (double)(layer->payload_nbytes + layer->index_nbytes));
  table_set set = {file, calloc(slf_surface_count(file), sizeof *set.tables)};
  if (!set.tables) fail("out of memory");
  for (uint32_t cells = 64; cells <= 128; cells *= 2) measure(file, name, cells, &set);
  for (uint32_t i = 0; i < slf_surface_count(file); i++) free(set.tables[i].blocks);
  free(set.tables);
  slf_close(file);
}

/* ---- The water alone ---------------------------------------------------------------------------
 */

static void measure_steps(void) {
  for (uint32_t cells = 64; cells <= 512; cells *= 2) {
    const ripple_options options = {.u_count = cells,
                                    .v_count = cells,
                                    .u_length = 8,
                                    .v_length = 8,
                                    .step_s = 1 / 120.0f,
                                    .wave_speed = 1.6f,
                                    .viscosity = 8e-3f,
                                    .height_limit = 1};
    double times[ROUNDS];
    ripple *pond;
    slf_error error;
    if (ripple_create(&options, &pond, &error) != SLF_OK) fail(error.message);
    ripple_drop(pond, 0.5f, 0.5f, 0.3f, 0.2f);
    const int count = (int)(2e7 / (cells * cells));
    for (int round = 0; round < ROUNDS; round++) {
      const double start = now_s();
      for (int i = 0; i < count; i++) ripple_step(pond);
      times[round] = (now_s() - start) / count;
    }
    const double step_s = median(times, ROUNDS);
    char key[32];
    snprintf(key, sizeof key, "%u", cells);
    print_figure("ripple_step_ms", key, 1e3 * step_s);
    print_figure("ripple_step_ns_a_cell", key, 1e9 * step_s / (cells * cells));
    ripple_destroy(pond);
  }
  /* Still falling asleep: from 1000 times the height at which the water is set to rest, against
   * waves of full height. Denormals would show as a slow end. */
  double spent[2] = {0, 0};
  ripple *pond;
  slf_error error;
  const ripple_options options = {.u_count = 256,
                                  .v_count = 256,
                                  .u_length = 256,
                                  .v_length = 256,
                                  .step_s = 1,
                                  .wave_speed = 0.4f,
                                  .damping_per_s = 0.02f,
                                  .height_limit = 10};
  if (ripple_create(&options, &pond, &error) != SLF_OK) fail(error.message);
  ripple_drop(pond, 0.1f, 0.1f, 3, 1);
  int counts[2] = {0, 0};
  while (!ripple_is_calm(pond)) {
    const double start = now_s();
    ripple_step(pond);
    const int late = counts[0] >= 200;
    spent[late] += now_s() - start;
    counts[late]++;
  }
  print_figure("ripple_calming_vs_waving_step", "", spent[1] / counts[1] / (spent[0] / counts[0]));
  ripple_destroy(pond);
}

int main(int argc, char **argv) {
  slf_error error;
  if (argc < 2) return fputs("usage: pond FILE.slf...\n", stderr), 2;
  if (context_open_osmesa(&error) != SLF_OK && context_open_egl(&error) != SLF_OK)
    fail(error.message);
  measure_steps();
  for (int i = 1; i < argc; i++) measure_file(argv[i]);
  print_figure("pond_calm_vs_uncompressed_fps", "", worst_calm);
  print_figure("pond_disturbed_vs_uncompressed_fps", "", worst_disturbed);
  print_figure("pond_disturbed_small_cache_vs_uncompressed_fps", "", worst_small);
  print_figure("pond_disturbed_vs_uncompressed_texture", "", worst_texture);
  if (isfinite(fps_disturbed_256)) print_figure("pond_fps_disturbed_256", "", fps_disturbed_256);
  end_figures();
  return 0;
}
