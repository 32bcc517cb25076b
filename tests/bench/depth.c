/* depth - what the mix by depth costs a texel against the four-tap mix, in one run.
 *
 *   depth FILE.slf      prints one flat JSON object
 *
 * Both make the same texels of the same layer, out of one block cache that holds all they read
 * (warm), and from file views moved a little each frame (moving). One thread. A ratio is the median
 * over rounds of times taken right after each other. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "viewer/block_cache.h"
#include "viewer/texture.h"

enum { ROUNDS = 5 };

/* Of the thread: what else runs on the machine does not count. */
static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int by_value(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static double median(double *values, int count) {
  qsort(values, (size_t)count, sizeof *values, by_value);
  return values[count / 2];
}

/* Nanoseconds a texel of all views of the file; step moves them. */
static double time_views(texture *x, const slf_file *file, float step) {
  double elapsed_s = 0, texels = 0;
  for (uint32_t i = 0; i < slf_view_count(file); i++) {
    slf_view view = *slf_get_view(file, i);
    view.location[0] += step;
    camera c = camera_of_view(&view, 640, 480);
    double begin_s = now_s();
    texture_update(x, &c, (direction_bend){NULL, NULL});
    elapsed_s += now_s() - begin_s;
    texels += 64.0 * x->made_count;
  }
  return 1e9 * elapsed_s / texels;
}

int main(int argc, char **argv) {
  slf_error error;
  slf_file *file;
  if (argc != 2) return fprintf(stderr, "depth: expected FILE.slf\n"), 2;
  if (slf_open(argv[1], &file, &error) != SLF_OK)
    return fprintf(stderr, "depth: %s\n", error.message), 1;
  const slf_surface *s = NULL;
  uint32_t index = 0, k = 0;
  for (uint32_t i = 0; i < slf_surface_count(file) && !s; i++)
    for (k = 0; k + 1 < slf_get_surface(file, i)->layer_count; k++)
      if (slf_get_surface(file, i)->layers[k + 1].role == SLF_ROLE_HEIGHT) {
        s = slf_get_surface(file, index = i);
        break;
      }
  if (!s) return fprintf(stderr, "depth: %s: no surface has heights\n", argv[1]), 1;
  const slf_layer *layer = &s->layers[k];
  block_cache *cache = block_cache_create(file, 1 << 18);
  texture four, depth;
  if (!cache ||
      !texture_create(&four, &s->mesh, layer, block_cache_layer(cache, index, k), UV_DICE_PX) ||
      !texture_create(&depth, &s->mesh, layer, block_cache_layer(cache, index, k), UV_DICE_PX) ||
      !(depth.depth = depth_mixer_create(layer, block_cache_layer(cache, index, k), layer + 1,
                                         block_cache_layer(cache, index, k + 1), s, layer->u_count,
                                         layer->v_count)))
    return fprintf(stderr, "depth: %s: out of memory\n", argv[1]), 1;
  double four_ns[ROUNDS], depth_ns[ROUNDS], ratio[ROUNDS], moving[ROUNDS];
  time_views(&four, file, 0), time_views(&depth, file, 0);
  for (int round = 0; round < ROUNDS; round++) {
    four_ns[round] = time_views(&four, file, 0);
    depth_ns[round] = time_views(&depth, file, 0);
    ratio[round] = depth_ns[round] / four_ns[round];
    float step = 0.02f * (float)(round + 1);
    double plain = time_views(&four, file, step);
    moving[round] = time_views(&depth, file, step) / plain;
  }
  const depth_mix_counts *counts = depth_mixer_counts(depth.depth);
  printf("{\n  \"depth_four_tap_ns_per_texel\": %.2f,\n  \"depth_ns_per_texel\": %.2f,\n"
         "  \"depth_resample_vs_four_tap\": %.2f,\n  \"depth_resample_vs_four_tap_moving\": %.2f,\n"
         "  \"depth_foretold_fraction\": %.5f,\n  \"depth_wide_fraction\": %.5f,\n  "
         "\"depth_fallback_fraction\": %.5f\n}\n",
         median(four_ns, ROUNDS), median(depth_ns, ROUNDS), median(ratio, ROUNDS),
         median(moving, ROUNDS), (double)counts->foretold_count / (double)counts->texel_count,
         (double)counts->wide_count / (double)counts->texel_count,
         (double)counts->four_tap_count / (double)counts->texel_count);
  texture_free(&four);
  texture_free(&depth);
  block_cache_free(cache);
  slf_close(file);
  return 0;
}
