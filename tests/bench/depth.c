/* depth - what the mix by depth costs; prints one flat JSON object.
 *
 * usage: depth mix FILE.slf
 *        depth pond FILE.slf
 *
 * mix: a texel of the file's first layer that has heights, against the four-tap mix of the same
 * texels out of the same block cache, in flights from the file's views. A flight is 9 frames, 0.02
 * units aside each; the first, which knows nothing of the heights, is told apart. It is flown
 * twice: `unread` are the frames of the first time, which bring in what was not read before, and
 * all other figures are of the second. `as_drawn` are twice as many texels each way, as the viewer
 * makes them. Both mixes make each frame in turn, on one thread; what the four-tap mix reads is
 * decompressed.
 *
 * pond: whole frames of disturbed water, 640x480 with software GL, filtered as a window does there
 * (trilinear); `anisotropic` as pictures and other drivers are. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/bench/figures.h"
#include "viewer/block_cache.h"
#include "viewer/context.h"
#include "viewer/draw.h"
#include "viewer/gl_api.h"
#include "viewer/texture.h"

enum {
  FRAMES = 8,
  POND_FRAMES = 60,
  MAX_VIEWS = 64,
  ROOM = 1 << 18 /* blocks: all that is read */
};

static void fail(const char *what) {
  fprintf(stderr, "depth: %s\n", what);
  exit(1);
}

/* Of this thread, so that what else runs does not count. */
static double update_ns(texture *x, const camera *c) {
  const double begin_s = clock_s(CLOCK_THREAD_CPUTIME_ID);
  texture_update(x, c, (direction_bend){NULL, NULL});
  return 1e9 * (clock_s(CLOCK_THREAD_CPUTIME_ID) - begin_s) / (64.0 * x->made_count);
}

typedef struct {
  double four_tap_ns, first_ns, ns; /* a texel: medians over frames */
} flight;

static flight fly(texture *four_tap, texture *by_depth, slf_view view) {
  double four_tap_ns[FRAMES], ns[FRAMES];
  flight f = {0};
  for (int i = 0; i <= FRAMES; i++) {
    view.location[0] += 0.02f;
    const camera c = camera_of_view(&view, 640, 480);
    update_ns(four_tap, &c);
    const double plain = update_ns(four_tap, &c), deep = update_ns(by_depth, &c);
    if (i == 0)
      f.first_ns = deep;
    else
      four_tap_ns[i - 1] = plain, ns[i - 1] = deep;
  }
  f.four_tap_ns = median(four_tap_ns, FRAMES);
  f.ns = median(ns, FRAMES);
  return f;
}

/* `fineness`: texels mixed by depth for each of the layer's, each way. */
static void measure_mix(const slf_file *file, uint32_t fineness, const char *name) {
  const slf_surface *s = NULL;
  uint32_t index = 0, k = 0;
  for (uint32_t i = 0; i < slf_surface_count(file) && !s; i++)
    for (k = 0; k + 1 < slf_get_surface(file, i)->layer_count; k++)
      if (slf_get_surface(file, i)->layers[k + 1].role == SLF_ROLE_HEIGHT) {
        s = slf_get_surface(file, index = i);
        break;
      }
  if (!s) fail("no surface has heights");
  const slf_layer *layer = &s->layers[k];
  slf_layer finer = *layer;
  finer.u_count *= fineness, finer.v_count *= fineness;
  block_cache *cache = block_cache_create(file, ROOM);
  texture four_tap, by_depth;
  if (!cache) fail("out of memory");
  const block_source light = block_cache_layer(cache, index, k);
  depth_sources sources = {
      {layer, light}, {layer + 1, block_cache_layer(cache, index, k + 1)}, {NULL, {0}}};
  if (k + 2 < s->layer_count && layer[2].role == SLF_ROLE_COVERAGE)
    sources.coverage = (depth_source){layer + 2, block_cache_layer(cache, index, k + 2)};
  if (!texture_create(&four_tap, &s->mesh, layer, light, UV_DICE_PX) ||
      !texture_create(&by_depth, &s->mesh, &finer, light, UV_DICE_PX) ||
      !(by_depth.depth = depth_mixer_create(&sources, s, finer.u_count, finer.v_count)))
    fail("out of memory");
  double four_tap_ns[MAX_VIEWS], ns[MAX_VIEWS], ratios[MAX_VIEWS], first[MAX_VIEWS];
  double unread[MAX_VIEWS];
  size_t count = 0;
  for (uint32_t i = 0; i < slf_view_count(file) && count < MAX_VIEWS; i++, count++) {
    const flight before = fly(&four_tap, &by_depth, *slf_get_view(file, i));
    const flight f = fly(&four_tap, &by_depth, *slf_get_view(file, i));
    four_tap_ns[count] = f.four_tap_ns, ns[count] = f.ns;
    ratios[count] = f.ns / f.four_tap_ns, unread[count] = before.ns / before.four_tap_ns;
    first[count] = before.first_ns / before.four_tap_ns;
  }
  const depth_mix_counts counts = depth_mixer_counts(by_depth.depth);
  const double texels = (double)counts.texel_count;
  print_figure("depth_four_tap_ns_per_texel", name, median(four_tap_ns, count));
  print_figure("depth_ns_per_texel", name, median(ns, count));
  print_figure("depth_resample_vs_four_tap", name, median(ratios, count));
  print_figure("depth_resample_vs_four_tap_unread", name, median(unread, count));
  print_figure("depth_resample_vs_four_tap_first_frame", name, median(first, count));
  print_figure("depth_foretold_fraction", name, (double)counts.foretold_count / texels);
  print_figure("depth_wide_fraction", name, (double)counts.wide_count / texels);
  print_figure("depth_fallback_fraction", name, (double)counts.four_tap_count / texels);
  texture_free(&four_tap);
  texture_free(&by_depth);
  block_cache_free(cache);
}

/* Frames a second of water that a drop, a stroke and rain disturb, as bench/pond does it. */
static double disturbed_fps(const slf_file *file, drawing_mix mix, bool anisotropic,
                            size_t *mixed_count) {
  slf_error error;
  drawing *d;
  double frames[POND_FRAMES];
  const drawing_options options = {.cache_blocks = BLOCK_CACHE_DEFAULT, .dice_px = UV_DICE_PX};
  if (drawing_create(file, options, &d, &error) != SLF_OK) fail(error.message);
  drawing_look look = drawing_get_look(d);
  look.mix = mix, look.anisotropic = anisotropic;
  drawing_set_look(d, &look);
  water *w = NULL;
  for (uint32_t i = 0; i < slf_surface_count(file) && !w; i++) w = drawing_water(d, i);
  if (!w) fail("a file without water");
  const float size = fmaxf(w->rectangle.u_length, w->rectangle.v_length);
  for (int i = -2; i < POND_FRAMES; i++) {
    if (i == 0) {
      ripple_drop(w->pond, 0.4f, 0.4f, size / 20, -size / 30);
      ripple_stroke(w->pond, 0.2f, 0.7f, 0.8f, 0.6f, size / 30, size / 100);
      ripple_rain(w->pond, 20, size / 32, -size / 80, 1);
    }
    const double begin_s = now_s();
    if (water_advance(w, i < 0 ? 0 : 1 / 60.0, &error) != SLF_OK ||
        drawing_render(d, slf_get_view(file, 0), 640, 480, -1, &error) != SLF_OK)
      fail(error.message);
    drawing_finish(d);
    if (i >= 0) frames[i] = now_s() - begin_s;
  }
  *mixed_count = drawing_get_cost(d).texel_count;
  drawing_free(d);
  return 1 / median(frames, POND_FRAMES);
}

static void measure_pond(const slf_file *file) {
  slf_error error;
  size_t mixed;
  if (context_open_osmesa(&error) != SLF_OK) fail(error.message);
  for (int anisotropic = 0; anisotropic < 2; anisotropic++) {
    const char *name = anisotropic ? "anisotropic" : "";
    print_figure("pond_fps_disturbed_256_depth", name,
                 disturbed_fps(file, MIX_DEPTH, anisotropic, &mixed));
    if (!anisotropic) print_figure("pond_disturbed_256_depth_texels", "", (double)mixed);
    print_figure("pond_fps_disturbed_256_depth_four_tap", name,
                 disturbed_fps(file, MIX_FOUR_TAP, anisotropic, &mixed));
  }
  context_close_osmesa();
}

int main(int argc, char **argv) {
  slf_error error;
  slf_file *file;
  const bool pond = argc == 3 && !strcmp(argv[1], "pond");
  if (!pond && !(argc == 3 && !strcmp(argv[1], "mix")))
    return fprintf(stderr, "depth: expected mix or pond, and FILE.slf\n"), 2;
  if (slf_open(argv[2], &file, &error) != SLF_OK) fail(error.message);
  if (pond)
    measure_pond(file);
  else
    measure_mix(file, 1, ""), measure_mix(file, 2, "as_drawn");
  end_figures();
  slf_close(file);
  return 0;
}
