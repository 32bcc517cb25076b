#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "window_parts.h"

const slf_file *window_shown(void) {
  return checked_file_get(window.file);
}

const slf_layer *window_mapped_layer(void) {
  if (window.shown_surface >= slf_surface_count(window_shown())) return NULL;
  const slf_surface *surface = slf_get_surface(window_shown(), window.shown_surface);
  return surface->layer_count ? &surface->layers[window.shown_layer] : NULL;
}

void window_map_layer(uint32_t surface, uint32_t layer) {
  window.shown_surface = surface;
  window.shown_layer = layer;
  window.slice_s = window_mapped_layer() ? window_mapped_layer()->s_count / 2 : 0;
  window.slice_t = window_mapped_layer() ? window_mapped_layer()->t_count / 2 : 0;
}

/* The first light field of more than one direction, if there is any. */
static void map_first_shiny(void) {
  window_map_layer(0, 0);
  for (uint32_t i = 0; i < slf_surface_count(window_shown()); i++)
    for (uint32_t k = 0; k < slf_get_surface(window_shown(), i)->layer_count; k++)
      if (slf_get_surface(window_shown(), i)->layers[k].slice_count > 1) {
        window_map_layer(i, k);
        return;
      }
}

static struct timespec time_of(const char *name) {
  struct stat status;
  return stat(name, &status) == 0 ? status.st_mtim : (struct timespec){0, 0};
}

void window_stop_comparing(void) {
  truth_free(window.truth);
  free(window.ours);
  window.truth = NULL;
  window.ours = NULL;
}

uint32_t window_coarsest_level(void) {
  uint32_t most = 1, level = 0;
  for (uint32_t i = 0; i < slf_surface_count(window_shown()); i++)
    for (uint32_t k = 0; k < slf_get_surface(window_shown(), i)->layer_count; k++)
      most = slf_get_surface(window_shown(), i)->layers[k].s_count > most
                 ? slf_get_surface(window_shown(), i)->layers[k].s_count
                 : most;
  while (1u << level < most) level++;
  return level;
}

void window_apply_look(void) {
  drawing_look look = window.look;
  if (window.settling > look.detail) look.detail = window.settling;
  drawing_set_look(window.drawing, &look);
}

slf_result window_show_file(checked_file *file, bool keep_view, slf_error *error) {
  drawing *d = NULL;
  const slf_file *f = checked_file_get(file);
  slf_result result = drawing_create(f, window.options->drawing, &d, error);
  if (result == SLF_OK) drawing_set_look(d, &window.look);
  if (result == SLF_OK && window.options->prepare)
    result = window.options->prepare(window.options->context, f, d, error);
  if (result == SLF_OK) window.look = drawing_get_look(d);
  if (result != SLF_OK) {
    drawing_free(d);
    return result;
  }
  window_stop_comparing();
  drawing_free(window.drawing);
  checked_file_close(window.file);
  window.file = file;
  window.drawing = d;
  window.water = (water_input){.file = f, .drawing = d};
  window.check_reported = false;
  window.file_time = time_of(checked_file_path(file));
  maps_clear(&window.maps);
  map_first_shiny();
  window.settling = keep_view ? 0 : window_coarsest_level();
  window.changed = true;
  window_apply_look();
  if (!keep_view) {
    static const slf_view from_far = {"", {0, 2, -5}, {0, 0, 0}, 60};
    window.view = window.options->view ? *window.options->view
                  : slf_view_count(f)  ? *slf_get_view(f, 0)
                                       : from_far;
    window.start = window.view;
    window.view_index = 0;
  }
  glfw.call.glfwSetWindowTitle(window.handle, checked_file_path(file));
  return SLF_OK;
}

bool window_open_file(int index, bool keep_view) {
  checked_file *file;
  slf_error error;
  if (checked_file_open(window.files[index], window.options->watch, &file, &error) != SLF_OK) {
    window_report(&error);
    return false;
  }
  if (window_show_file(file, keep_view, &error) != SLF_OK) {
    checked_file_close(file);
    window_report(&error);
    return false;
  }
  window.file_index = index;
  return true;
}

void window_next_file(void) {
  window_open_file((window.file_index + 1) % window.file_count, false);
}

void window_previous_file(void) {
  window_open_file((window.file_index + window.file_count - 1) % window.file_count, false);
}

bool window_add_file(const char *name) {
  char **moved = realloc(window.files, ((size_t)window.file_count + 1) * sizeof *moved);
  if (moved) window.files = moved;
  if (!moved || !(window.files[window.file_count] = strdup(name))) return false;
  window.file_count++;
  return true;
}

/* A baked file replaces the old one in one go (rename), so a new time means a whole new file, or
 * more of one that is still coming. */
void window_watch_file(void) {
  struct timespec now = time_of(window.files[window.file_index]);
  if (now.tv_sec == 0 ||
      (now.tv_sec == window.file_time.tv_sec && now.tv_nsec == window.file_time.tv_nsec))
    return;
  window.file_time = now;
  if (window_open_file(window.file_index, true)) window_tell("reloaded");
}

void window_report_check(void) {
  slf_result result;
  slf_error error;
  if (window.check_reported || !checked_file_done(window.file, &result, &error)) return;
  window.check_reported = true;
  if (result == SLF_ERROR_PARTIAL)
    window_tell("%.1f MB of the file are here", 1e-6 * (double)slf_file_nbytes(window_shown()));
  if (result == SLF_OK || result == SLF_ERROR_PARTIAL) return;
  window.check_failed = true;
  window_report(&error);
}
