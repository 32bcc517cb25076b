/* frame - what a frame costs and reads, as one JSON object.
 *
 *   frame info FILE.slf                        surfaces and layers
 *   frame time FILE.slf WxH DICE CACHE         milliseconds of processor time a frame, with drawing
 *   frame counts FILE.slf CACHE...             blocks a frame reads and decompresses (tables 1, 2)
 *   frame motion FILE.slf DIRECTIONS OFFSET... blocks that are new after a camera's way (table 3)
 *   frame map FILE.slf SCRIPT OUT.ppm          figure 8: flat water and rippled, one above the
 * other
 *
 * The camera is the file's first view. Times are medians of processor time, all threads together,
 * so that others on the machine do not count. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "tests/bench/figures.h"
#include "viewer/context.h"
#include "viewer/draw.h"

static slf_error error;

static void check(slf_result result) {
  if (result == SLF_OK) return;
  fprintf(stderr, "frame: %s\n", error.message);
  exit(1);
}

static void *need(void *memory) {
  if (memory) return memory;
  fputs("frame: out of memory\n", stderr);
  exit(1);
}

static double cpu_ms(void) {
  return 1e3 * cpu_s();
}

/* ---- What is in the file -----------------------------------------------------------------------
 */

static void print_info(const slf_file *file) {
  printf("{\"file_nbytes\": %llu, \"surfaces\": [", (unsigned long long)slf_file_nbytes(file));
  for (uint32_t i = 0; i < slf_surface_count(file); i++) {
    const slf_surface *surface = slf_get_surface(file, i);
    printf("%s\n  {\"name\": \"%s\", \"layers\": [", i ? "," : "", surface->name);
    for (uint32_t k = 0; k < surface->layer_count; k++) {
      const slf_layer *x = &surface->layers[k];
      printf(
          "%s{\"texels\": [%u, %u], \"directions\": [%u, %u], \"slices\": %u, \"raw_nbytes\": "
          "%llu, \"payload_nbytes\": %llu, \"index_nbytes\": %llu, \"quality\": %g, \"psnr\": %g}",
          k ? ", " : "", x->u_count, x->v_count, x->s_count, x->t_count, x->slice_count,
          (unsigned long long)x->raw_nbytes, (unsigned long long)x->payload_nbytes,
          (unsigned long long)x->index_nbytes, (double)x->quality, (double)x->psnr);
    }
    fputs("]}", stdout);
  }
  puts("]}");
}

/* ---- Time --------------------------------------------------------------------------------------
 */

enum { ROUNDS = 15 };

static void render(drawing *d, const slf_view *view, int width_px, int height_px) {
  check(drawing_render(d, view, width_px, height_px, -1, &error));
}

static void print_time(const slf_file *file, const char *size, uint32_t dice_px, size_t cache) {
  int width_px, height_px;
  if (sscanf(size, "%dx%d", &width_px, &height_px) != 2) exit(2);
  uint8_t *rgba = need(malloc((size_t)width_px * (size_t)height_px * 4));
  drawing *d;
  check(context_open_osmesa(&error));
  const double start = cpu_ms();
  check(drawing_create(file, (drawing_options){.cache_blocks = cache, .dice_px = dice_px}, &d,
                       &error));
  const double open_ms = cpu_ms() - start;
  slf_view view = *slf_get_view(file, 0);
  double still[ROUNDS], moving[ROUNDS];
  uint64_t decompressions = 0;
  render(d, &view, width_px, height_px);
  drawing_read(d, rgba);
  for (int i = 0; i < 2 * ROUNDS; i++) {
    if (i >= ROUNDS) view_orbit(&view, 0.5f * (float)M_PI / 180, 0);
    const double before = cpu_ms();
    render(d, &view, width_px, height_px);
    drawing_read(d, rgba); /* waits until it is drawn */
    *(i < ROUNDS ? &still[i] : &moving[i - ROUNDS]) = cpu_ms() - before;
    if (i >= ROUNDS)
      decompressions += block_cache_get_counts(drawing_cache(d))->frame_decompressions;
  }
  struct rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  printf("{\"still_ms\": %.4g, \"moving_ms\": %.4g, \"open_ms\": %.4g, \"moving_decompressions\": "
         "%.6g, \"cache_nbytes\": %zu, \"resident_nbytes\": %llu}\n",
         median(still, ROUNDS), median(moving, ROUNDS), open_ms, (double)decompressions / ROUNDS,
         block_cache_nbytes(drawing_cache(d)), (unsigned long long)usage.ru_maxrss * 1024);
  drawing_free(d);
  context_close_osmesa();
  free(rgba);
}

/* ---- Textures of the shiny surfaces ------------------------------------------------------------
 */

enum { MAX_SHINY = 64 };

typedef struct {
  uint32_t surface;
  texture texture;
} shiny;

typedef struct {
  uint32_t count;
  shiny x[MAX_SHINY];
} shiny_surfaces;

typedef block_source (*source_of)(void *context, uint32_t surface);

/* directions 0: those of the file. */
static void open_shiny(const slf_file *file, uint32_t directions, source_of source, void *context,
                       shiny_surfaces *all) {
  all->count = 0;
  for (uint32_t i = 0; i < slf_surface_count(file) && all->count < MAX_SHINY; i++) {
    const slf_surface *surface = slf_get_surface(file, i);
    slf_layer layer = surface->layers[0];
    if (layer.slice_count == 1) continue;
    if (directions) layer.s_count = layer.t_count = directions;
    shiny *x = &all->x[all->count++];
    x->surface = i;
    if (!texture_create(&x->texture, &surface->mesh, &layer, source(context, i), UV_DICE_PX))
      need(NULL);
  }
}

static void update_shiny(shiny_surfaces *all, const slf_view *view) {
  const camera c = camera_of_view(view, 4, 3);
  for (uint32_t i = 0; i < all->count; i++)
    texture_update(&all->x[i].texture, &c, (direction_bend){0});
}

static void close_shiny(shiny_surfaces *all) {
  for (uint32_t i = 0; i < all->count; i++) texture_free(&all->x[i].texture);
}

static block_source source_in_cache(void *context, uint32_t surface) {
  return block_cache_layer(context, surface, 0);
}

/* ---- Counts ------------------------------------------------------------------------------------
 */

/* Frames of a static camera through caches of each size, each beside a frame that finds all. */
static void print_counts(const slf_file *file, size_t count, char **capacities) {
  block_cache *whole = need(block_cache_create(file, 1 << 22));
  shiny_surfaces warm, small;
  const slf_view *view = slf_get_view(file, 0);
  open_shiny(file, 0, source_in_cache, whole, &warm);
  block_cache_begin_frame(whole);
  update_shiny(&warm, view);
  const uint64_t blocks = block_cache_get_counts(whole)->frame_decompressions;
  printf("{\"blocks\": %llu, \"cache\": {", (unsigned long long)blocks);
  for (size_t i = 0; i < count; i++) {
    /* "all" and "all-1" as in the paper; else a number. */
    size_t capacity = strcmp(capacities[i], "all") == 0     ? (size_t)blocks
                      : strcmp(capacities[i], "all-1") == 0 ? (size_t)blocks - 1
                                                            : (size_t)atol(capacities[i]);
    block_cache *cache = need(block_cache_create(file, capacity));
    open_shiny(file, 0, source_in_cache, cache, &small);
    update_shiny(&small, view);
    double ratios[ROUNDS];
    for (int k = 0; k < ROUNDS; k++) {
      block_cache_begin_frame(cache);
      const double start = cpu_ms();
      update_shiny(&small, view);
      const double middle = cpu_ms();
      update_shiny(&warm, view);
      ratios[k] = (middle - start) / (cpu_ms() - middle);
    }
    printf("%s\n  \"%s\": {\"capacity\": %zu, \"decompressions\": %llu, \"time_vs_warm\": %.4g}",
           i ? "," : "", capacities[i], capacity,
           (unsigned long long)block_cache_get_counts(cache)->frame_decompressions,
           median(ratios, ROUNDS));
    close_shiny(&small);
    block_cache_free(cache);
  }
  puts("}}");
  close_shiny(&warm);
  block_cache_free(whole);
}

/* ---- Motion ------------------------------------------------------------------------------------
 */

/* Notes which blocks are read. What they hold does not matter: which ones are read depends on the
 * geometry and on the number of directions alone. */
typedef struct {
  uint8_t *seen; /* [block][s][t] */
  uint32_t block_u_count, directions;
  uint64_t fresh;
} noted_layer;

typedef struct {
  const slf_file *file;
  uint32_t directions;
  noted_layer layers[MAX_SHINY];
  uint32_t count;
} noted_file;

static void fetch_noted(void *context, uint32_t block_u, uint32_t block_v,
                        const slice_index *slices, size_t count, const uint8_t **u_blocks) {
  static const uint8_t grey[SLF_BLOCK_NBYTES];
  noted_layer *x = context;
  const size_t block = (size_t)block_v * x->block_u_count + block_u;
  for (size_t i = 0; i < count; i++) {
    uint8_t *seen =
        x->seen + (block * x->directions + (slices[i] >> 8)) * x->directions + (slices[i] & 0xff);
    x->fresh += !*seen;
    *seen = 1;
    u_blocks[i] = grey;
  }
}

static block_source source_noted(void *context, uint32_t surface) {
  noted_file *all = context;
  const slf_layer *layer = &slf_get_surface(all->file, surface)->layers[0];
  noted_layer *x = &all->layers[all->count++];
  *x = (noted_layer){need(calloc((size_t)layer->block_u_count * layer->block_v_count,
                                 (size_t)all->directions * all->directions)),
                     layer->block_u_count, all->directions, 0};
  return (block_source){.fetch = fetch_noted, .context = x};
}

/* The camera moves across its line of sight, as the paper's does: by OFFSET fifths of its distance
 * to what it looks at, which in the paper is 5 units. */
static void print_motion(const slf_file *file, uint32_t directions, size_t count, char **offsets) {
  printf("{\"offsets\": {");
  uint64_t all_blocks = 0;
  for (size_t i = 0; i < count; i++) {
    noted_file noted = {.file = file, .directions = directions};
    shiny_surfaces all;
    open_shiny(file, directions, source_noted, &noted, &all);
    slf_view view = *slf_get_view(file, 0);
    update_shiny(&all, &view);
    all_blocks = 0;
    for (uint32_t k = 0; k < noted.count; k++) {
      all_blocks += noted.layers[k].fresh;
      noted.layers[k].fresh = 0;
    }
    const camera c = camera_of_view(&view, 4, 3);
    float distance = 0;
    for (int k = 0; k < 3; k++)
      distance += (view.look_at[k] - view.location[k]) * (view.look_at[k] - view.location[k]);
    const float way = (float)atof(offsets[i]) * sqrtf(distance) / 5;
    for (int k = 0; k < 3; k++) view.location[k] += way * c.right[k];
    update_shiny(&all, &view);
    uint64_t fresh = 0;
    for (uint32_t k = 0; k < noted.count; k++) fresh += noted.layers[k].fresh;
    printf("%s\"%s\": %llu", i ? ", " : "", offsets[i], (unsigned long long)fresh);
    close_shiny(&all);
    for (uint32_t k = 0; k < noted.count; k++) free(noted.layers[k].seen);
  }
  printf("}, \"blocks\": %llu}\n", (unsigned long long)all_blocks);
}

/* ---- Figure 8 ----------------------------------------------------------------------------------
 */

typedef struct {
  uint8_t *rgb;
  uint32_t width, top, block_u_count, block_v_count;
} map_picture;

/* A box for each (S,T), a pixel for each block: green cached, red decompressed in this frame. */
static void paint_block(void *context, slf_block_address address, bool fresh) {
  const map_picture *p = context;
  const uint32_t x = address.s * (p->block_u_count + 1) + address.block_u;
  const uint32_t y = p->top + address.t * (p->block_v_count + 1) + address.block_v;
  uint8_t *pixel = p->rgb + 3 * ((size_t)y * p->width + x);
  pixel[0] = fresh ? 230 : 40;
  pixel[1] = fresh ? 60 : 200;
  pixel[2] = 60;
}

static void write_map(const slf_file *file, const char *script_path, const char *path) {
  block_cache *cache = need(block_cache_create(file, 1 << 20));
  shiny_surfaces all;
  water *w = NULL;
  ripple_script *script;
  uint32_t surface = 0;
  while (surface < slf_surface_count(file) &&
         !(slf_get_surface(file, surface)->flags & SLF_SURFACE_WATER))
    surface++;
  if (surface == slf_surface_count(file)) {
    fputs("frame: no surface is water\n", stderr);
    exit(1);
  }
  const slf_layer *layer = &slf_get_surface(file, surface)->layers[0];
  check(ripple_script_read(script_path, &script, &error));
  check(water_create(file, surface, layer->u_count, layer->v_count, 0, &w, &error));
  w->script = script;
  open_shiny(file, 0, source_in_cache, cache, &all);
  uint32_t number = 0;
  while (all.x[number].surface != surface) number++;
  const camera c = camera_of_view(slf_get_view(file, 0), 4, 3);

  map_picture p = {.block_u_count = layer->block_u_count, .block_v_count = layer->block_v_count};
  p.width = layer->s_count * (p.block_u_count + 1);
  const uint32_t half = layer->t_count * (p.block_v_count + 1), height = 2 * half + 8;
  p.rgb = need(malloc((size_t)p.width * height * 3));
  memset(p.rgb, 255, (size_t)p.width * height * 3);
  for (uint32_t y = 0; y < 2 * half; y++)
    for (uint32_t x = 0; x < p.width; x++) {
      const uint32_t s = x / (p.block_u_count + 1), t = y % half / (p.block_v_count + 1);
      const bool line = x % (p.block_u_count + 1) == p.block_u_count ||
                        y % half % (p.block_v_count + 1) == p.block_v_count;
      const bool stored = slf_slice_exists(layer->s_count, layer->t_count, s, t);
      memset(p.rgb + 3 * ((size_t)(y < half ? y : y + 8) * p.width + x),
             line     ? 255
             : stored ? 40
                      : 225,
             3);
    }
  uint64_t fresh[2] = {0};
  const double frame_s = 1 / 30.0; /* faster than the paper's 2.5 to 13 a second */
  for (int rippled = 0; rippled < 2; rippled++) {
    /* Flat: the frame before was the same. Rippled: the latest two up to the script's end. */
    for (int frame = 0; frame < 2; frame++) {
      const double until_s = ripple_script_end_s(script) - (1 - frame) * frame_s;
      while (rippled && water_time_s(w) < until_s) check(water_step(w, &error));
      const direction_bend bend = water_begin_frame(w);
      block_cache_begin_frame(cache);
      texture_update(&all.x[number].texture, &c, bend);
    }
    fresh[rippled] = block_cache_get_counts(cache)->frame_decompressions;
    p.top = rippled ? half + 8 : 0;
    block_cache_visit(cache, surface, 0, paint_block, &p);
  }
  FILE *out = fopen(path, "wb");
  if (!out || fprintf(out, "P6\n%u %u\n255\n", p.width, height) < 0 ||
      fwrite(p.rgb, 3, (size_t)p.width * height, out) != (size_t)p.width * height ||
      fclose(out) != 0) {
    fprintf(stderr, "frame: %s: cannot write\n", path);
    exit(1);
  }
  printf("{\"flat_fresh\": %llu, \"rippled_fresh\": %llu, \"resident\": %zu}\n",
         (unsigned long long)fresh[0], (unsigned long long)fresh[1], block_cache_resident(cache));
  free(p.rgb);
  close_shiny(&all);
  water_free(w);
  ripple_script_free(script);
  block_cache_free(cache);
}

int main(int argc, char **argv) {
  slf_file *file;
  if (argc < 3) {
    fputs("usage: frame info|time|counts|motion|map FILE.slf ...\n", stderr);
    return 2;
  }
  check(slf_open(argv[2], &file, &error));
  if (!strcmp(argv[1], "info"))
    print_info(file);
  else if (!strcmp(argv[1], "time") && argc == 6)
    print_time(file, argv[3], (uint32_t)atol(argv[4]), (size_t)atol(argv[5]));
  else if (!strcmp(argv[1], "counts"))
    print_counts(file, (size_t)argc - 3, argv + 3);
  else if (!strcmp(argv[1], "motion") && argc > 4)
    print_motion(file, (uint32_t)atol(argv[3]), (size_t)argc - 4, argv + 4);
  else if (!strcmp(argv[1], "map") && argc == 5)
    write_map(file, argv[3], argv[4]);
  else
    return 2;
  slf_close(file);
  return 0;
}
