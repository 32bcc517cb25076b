#include <math.h>
#include <string.h>

#include "maps.h"
#include "window_parts.h"

/* How reflections that have heights are mixed, and how often those did not help. */
static void describe_mix(char *text, size_t text_nbytes) {
  const depth_mix_counts *counts = &window.depth;
  if (drawing_get_look(window.drawing).mix == MIX_FOUR_TAP)
    snprintf(text, text_nbytes, "reflections from four taps");
  else if (drawing_get_look(window.drawing).detail > 0)
    snprintf(text, text_nbytes, "reflections from four taps: coarser levels have no depth");
  else
    snprintf(text, text_nbytes, "reflections by depth, %.2f %% of texels from four taps",
             counts->texel_count
                 ? 100.0 * (double)counts->four_tap_count / (double)counts->texel_count
                 : 0.0);
}

static void describe_statistics(char *text, size_t text_nbytes) {
  const block_cache *cache = drawing_cache(window.drawing);
  const block_cache_counts *counts = block_cache_get_counts(cache);
  drawing_cost cost = drawing_get_cost(window.drawing);
  uint64_t raw_nbytes = 0, file_nbytes = slf_file_nbytes(window_shown());
  for (uint32_t i = 0; i < slf_surface_count(window_shown()); i++)
    for (uint32_t k = 0; k < slf_get_surface(window_shown(), i)->layer_count; k++)
      raw_nbytes += slf_get_surface(window_shown(), i)->layers[k].raw_nbytes;
  int length = snprintf(
      text, text_nbytes,
      "%.1f frames a second, %.2f ms\n"
      "resampling %.2f ms, upload %.2f ms, %zu texels\n"
      "blocks %llu, decompressed %llu, again %llu, hit rate %.1f %%\n"
      "cache %zu blocks, %.1f MB\n"
      "file %.2f MB, %.1f : 1\n"
      "detail %u, exposure %+.1f EV, %s\n"
      "%dx%d  <%.2f, %.2f, %.2f>",
      1 / window.frame_s, window.frame_s * 1e3, cost.resample_s * 1e3, cost.upload_s * 1e3,
      cost.texel_count, (unsigned long long)counts->frame_lookups,
      (unsigned long long)counts->frame_decompressions,
      (unsigned long long)counts->frame_decompressions_again,
      counts->frame_lookups ? 100.0 * (double)counts->frame_hits / (double)counts->frame_lookups
                            : 100.0,
      block_cache_resident(cache), (double)block_cache_nbytes(cache) / 1e6,
      (double)file_nbytes / 1e6, (double)raw_nbytes / (double)file_nbytes,
      drawing_get_look(window.drawing).detail, window.look.exposure_ev,
      window.look.anisotropic ? "anisotropic" : "trilinear", window.width_px, window.height_px,
      window.view.location[0], window.view.location[1], window.view.location[2]);
  if (!drawing_has_depth(window.drawing) || (size_t)length + 1 >= text_nbytes) return;
  text[length++] = '\n';
  describe_mix(text + length, text_nbytes - (size_t)length);
}

/* A list of keys, names in one column and what they do in the next; returns the width taken. */
static float show_keys(overlay *o, float scale, float x, const char *names, const char *whats,
                       int count) {
  float margin = 6 * scale, y = 10 * scale;
  float column = overlay_text_width(o, names) + 10 * scale;
  float width = column + overlay_text_width(o, whats) + 2 * margin;
  overlay_box(o, x, y, width, (float)count * overlay_line_height(o) + 2 * margin,
              (overlay_colour){0, 0, 0, 200});
  overlay_text(o, x + margin, y + margin, (overlay_colour){255, 220, 120, 255}, names);
  overlay_text(o, x + margin + column, y + margin, (overlay_colour){255, 255, 255, 255}, whats);
  return width;
}

static void show_help(overlay *o, float scale) {
  char names[WINDOW_KEY_NAMES_NBYTES], whats[WINDOW_KEY_WHATS_NBYTES];
  int count = window_list_keys(false, names, whats);
  float width = show_keys(o, scale, 10 * scale, names, whats, count);
  if (!window_has_water()) return;
  count = window_list_keys(true, names, whats);
  show_keys(o, scale, 14 * scale + width, names, whats, count);
}

/* A picture as large as fits into the right two thirds of the window, whole pixels a texel where it
 * can be, with a line above. */
static void show_map(overlay *o, float scale, const uint8_t *rgba, int width, int height,
                     const char *title) {
  float fit = fminf((float)window.width_px * 0.66f / (float)width,
                    ((float)window.height_px - 44 * scale) / (float)height);
  float size = fit >= 1 ? floorf(fit) : fit;
  float x = (float)window.width_px - (float)width * size - 10 * scale;
  float top = 10 * scale + overlay_panel(o, x, 10 * scale, title);
  overlay_image(o, x, top, (float)width * size, (float)height * size, rgba, width, height, 0, 1);
}

static bool same_look(drawing_look a, drawing_look b) {
  return a.exposure_ev == b.exposure_ev && a.tone_map == b.tone_map &&
         a.anisotropic == b.anisotropic && a.detail == b.detail && a.mix == b.mix;
}

static void show_comparison(overlay *o, float scale) {
  int percent;
  slf_error error;
  char text[160];
  float width = (float)window.width_px, height = (float)window.height_px;
  size_t pixel_count = (size_t)window.width_px * (size_t)window.height_px;
  truth_state state = truth_poll(window.truth, &percent, &error);
  if (state == TRUTH_FAILED) {
    window_report(&error);
    window_stop_comparing();
    return;
  }
  if (state == TRUTH_RUNNING) {
    snprintf(text, sizeof text, "POV-Ray renders this view: %d %%", percent);
    overlay_panel(o, 10 * scale, height - 34 * scale, text);
    return;
  }
  const uint8_t *theirs = truth_picture(window.truth);
  if (!same_look(window.ours_look, drawing_get_look(window.drawing))) {
    window.ours_look = drawing_get_look(window.drawing);
    drawing_read(window.drawing, window.ours); /* this frame, without overlays */
    window.psnr = -1;
  }
  if (window.psnr < 0) window.psnr = picture_psnr(window.ours, theirs, pixel_count);
  if (window.comparison == COMPARE_SPLIT) {
    overlay_image(o, 0, 0, width, height, theirs, window.width_px, window.height_px, 0.5f, 1);
    overlay_box(o, width / 2 - scale, 0, 2 * scale, height, (overlay_colour){255, 255, 255, 255});
  } else if (window.comparison == COMPARE_BESIDE) {
    overlay_box(o, 0, 0, width, height, (overlay_colour){0, 0, 0, 255});
    overlay_image(o, 0, height / 4, width / 2, height / 2, window.ours, window.width_px,
                  window.height_px, 0, 1);
    overlay_image(o, width / 2, height / 4, width / 2, height / 2, theirs, window.width_px,
                  window.height_px, 0, 1);
  } else {
    const uint8_t *difference = maps_difference(&window.maps, window.ours, theirs, pixel_count);
    if (difference)
      overlay_image(o, 0, 0, width, height, difference, window.width_px, window.height_px, 0, 1);
  }
  snprintf(text, sizeof text, "POV-Ray against slf: PSNR %.2f dB over the picture", window.psnr);
  overlay_panel(o, 10 * scale, height - 34 * scale, text);
}

void window_draw_overlays(void) {
  overlay *o = window.overlay;
  char text[1024];
  float content_scale = 1, unused;
  glfw.call.glfwGetWindowContentScale(window.handle, &content_scale, &unused);
  /* Two pixels a dot where there is room, one in small windows; more on high-DPI screens. */
  float scale = content_scale * (window.height_px >= 900 * content_scale ? 2 : 1);
  if (window.height_px < 480) scale = 1;
  overlay_begin(o, window.width_px, window.height_px, scale);
  bool same_view = memcmp(&window.view, &window.truth_view, sizeof window.view) == 0 &&
                   window.width_px == window.truth_width_px &&
                   window.height_px == window.truth_height_px;
  if (window.truth && same_view) show_comparison(o, scale);
  int width, height;
  if ((window.cache_map || window.slice_view) && window_mapped_layer()) {
    const uint8_t *map =
        window.slice_view
            ? maps_slice(&window.maps, window_shown(), window.shown_surface, window.shown_layer,
                         window.slice_s, window.slice_t, text, sizeof text, &width, &height)
            : maps_cache(&window.maps, window_shown(), drawing_cache(window.drawing),
                         window.shown_surface, window.shown_layer, text, sizeof text, &width,
                         &height);
    if (map) show_map(o, scale, map, width, height, text);
  }
  if (window.statistics && !window.help) {
    describe_statistics(text, sizeof text);
    overlay_panel(o, 10 * scale, 10 * scale, text);
  }
  if (window.help) show_help(o, scale);
  if (window.recording) {
    snprintf(text, sizeof text, "recording %.1f s", window.path_time_s);
    overlay_panel(o, 10 * scale, (float)window.height_px - 86 * scale, text);
  }
  if (window.message_until_s > 0)
    overlay_panel(o, 10 * scale, (float)window.height_px - 60 * scale, window.message);
  overlay_finish(o);
}
