#include "window.h"

#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "context.h"
#include "gl_api.h"
#include "window_parts.h"

glfw_library glfw;
window_state window = {.button = -1};

/* ---- Messages ----------------------------------------------------------------------------------
 */

void window_tell(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(window.message, sizeof window.message, format, arguments);
  va_end(arguments);
  window.message_until_s = glfw.call.glfwGetTime() + 5;
  window.changed = true;
}

void window_report(const slf_error *error) {
  fprintf(stderr, "slfview: %s\n", error->message);
  window_tell("%s", error->message);
}

/* ---- The window --------------------------------------------------------------------------------
 */

static slf_result refuse(slf_error *error) {
  const char *reason = NULL;
  glfw.call.glfwGetError(&reason);
  snprintf(error->message, sizeof error->message, "GLFW: %s", reason ? reason : "no window");
  return SLF_ERROR_IO;
}

slf_result window_open(const char *title, int width_px, int height_px, slf_error *error) {
  static const char *const names[] = {"libglfw.so.3", "libglfw.so", NULL};
  static const char *const symbols[] = {
#define SYMBOL(name) #name,
      GLFW_FUNCTIONS(SYMBOL)
#undef SYMBOL
          NULL};
  slf_result result = load_library(names, symbols, glfw.functions, error);
  if (result != SLF_OK) return result;
  if (!glfw.call.glfwInit()) return refuse(error);
  glfw.call.glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
  glfw.call.glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
  glfw.call.glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
  glfw.call.glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
  window.handle = glfw.call.glfwCreateWindow(width_px, height_px, title, NULL, NULL);
  if (!window.handle) return refuse(error);
  glfw.call.glfwMakeContextCurrent(window.handle);
  glfw.call.glfwSwapInterval(1);
  return gl_api_load((gl_function(*)(const char *))glfw.call.glfwGetProcAddress, error);
}

/* ---- Frames ------------------------------------------------------------------------------------
 */

bool window_has_water(void) {
  for (uint32_t i = 0; i < slf_surface_count(window_shown()); i++)
    if (drawing_water(window.drawing, i)) return true;
  return false;
}

/* Whether the next frame differs from this one though nothing happens. */
static bool goes_on(void) {
  int width_px, height_px;
  glfw.call.glfwGetFramebufferSize(window.handle, &width_px, &height_px);
  return width_px != window.width_px || height_px != window.height_px || window.settling > 0 ||
         window.statistics || window.recording || window.playing ||
         (window.truth && window.psnr < 0) || window_walks() || window_has_water();
}

static slf_result advance_water(double elapsed_s, slf_error *error) {
  slf_result result = SLF_OK;
  for (uint32_t i = 0; i < slf_surface_count(window_shown()) && result == SLF_OK; i++) {
    water *w = drawing_water(window.drawing, i);
    if (w) result = water_advance(w, elapsed_s, error);
  }
  return result;
}

static slf_result draw_frame(slf_error *error) {
  glfw.call.glfwGetFramebufferSize(window.handle, &window.width_px, &window.height_px);
  if (window.width_px == 0 || window.height_px == 0) return SLF_OK; /* minimised */
  slf_result result =
      drawing_render(window.drawing, &window.view, window.width_px, window.height_px, -1, error);
  if (result != SLF_OK) return result;
  if (drawing_get_cost(window.drawing).depth.texel_count)
    window.depth = drawing_get_cost(window.drawing).depth;
  window_draw_overlays();
  drawing_show(window.drawing, window.width_px, window.height_px);
  /* A file shows at once as matte; each frame makes it crisper. */
  if (window.settling > window.look.detail) {
    window.settling--;
    window.changed = true;
    window_apply_look();
  } else {
    window.settling = 0;
  }
  return SLF_OK;
}

slf_result window_run(const window_options *options, checked_file *opened, slf_error *error) {
  window.options = options;
  window.changed = true;
  window.look = options->look;
  window.speed = 1;
  slf_result result = overlay_create(&window.overlay, error);
  for (int i = 0; i < options->file_count && result == SLF_OK; i++)
    if (!window_add_file(options->files[i])) {
      snprintf(error->message, sizeof error->message, "out of memory");
      result = SLF_ERROR_MEMORY;
    }
  if (result == SLF_OK && options->path_file)
    result = path_read(options->path_file, &window.path, error);
  if (result == SLF_OK) result = window_show_file(opened, false, error);
  if (result != SLF_OK) {
    checked_file_close(opened);
    return result;
  }
  window_listen();
  double last_s = glfw.call.glfwGetTime(), watched_s = last_s;
  while (result == SLF_OK && !glfw.call.glfwWindowShouldClose(window.handle)) {
    /* What stands still is not drawn again; a tenth of a second is soon enough for what follows. */
    if (goes_on() || window.changed)
      glfw.call.glfwPollEvents();
    else
      glfw.call.glfwWaitEventsTimeout(0.1);
    double now_s = glfw.call.glfwGetTime(), elapsed_s = now_s - last_s;
    last_s = now_s;
    window.frame_s = window.frame_s > 0 ? 0.9 * window.frame_s + 0.1 * elapsed_s : elapsed_s;
    window_walk((float)elapsed_s);
    window_fly(elapsed_s);
    window_report_check();
    if (options->watch && now_s - watched_s > 0.5) {
      watched_s = now_s;
      window_watch_file();
    }
    if (window.message_until_s > 0 && now_s > window.message_until_s) {
      window.message_until_s = 0;
      window.changed = true;
    }
    if (!goes_on() && !window.changed) continue;
    window.changed = false;
    result = advance_water(elapsed_s, error);
    if (result == SLF_OK) result = draw_frame(error);
    glfw.call.glfwSwapBuffers(window.handle);
  }
  slf_error check_error;
  if (checked_file_wait(window.file, &check_error) != SLF_OK) window_report_check();
  if (result == SLF_OK && window.check_failed) result = SLF_ERROR_CHECKSUM;
  return result;
}

void window_close(void) {
  if (window.handle) {
    window_stop_comparing();
    drawing_free(window.drawing);
    overlay_free(window.overlay);
    checked_file_close(window.file);
  }
  for (int i = 0; i < window.file_count; i++) free(window.files[i]);
  free(window.files);
  path_clear(&window.path);
  maps_clear(&window.maps);
  if (glfw.call.glfwTerminate) glfw.call.glfwTerminate();
}
