#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "image.h"
#include "window_parts.h"

/* ---- What keys do ------------------------------------------------------------------------------
 */

static void end(void) {
  glfw.call.glfwSetWindowShouldClose(window.handle, GLFW_TRUE);
}

static void toggle_help(void) {
  window.help = !window.help;
}

static void toggle_statistics(void) {
  window.statistics = !window.statistics;
}

static void toggle_cache_map(void) {
  window.cache_map = !window.cache_map;
}

static void toggle_slice_view(void) {
  window.slice_view = !window.slice_view;
}

static void reset(void) {
  window.view = window.start;
  window.playing = false;
}

static void next_view(void) {
  uint32_t count = slf_view_count(window_shown());
  if (count == 0) return;
  window.view_index = (window.view_index + 1) % count;
  window.view = window.start = *slf_get_view(window_shown(), window.view_index);
  window_tell("view %s", window.view.name);
}

static void change_speed(float factor) {
  window.speed = fminf(fmaxf(window.speed * factor, 1.0f / 64), 64);
  window_tell("speed %.3g", window.speed);
}

static void slower(void) {
  change_speed(0.5f);
}

static void faster(void) {
  change_speed(2);
}

static void change_angle(float factor) {
  window.view.angle_deg = fminf(fmaxf(window.view.angle_deg * factor, 1), 170);
  window_tell("angle %.1f degrees", window.view.angle_deg);
}

static void narrower(void) {
  change_angle(1 / 1.1f);
}

static void wider(void) {
  change_angle(1.1f);
}

static void change_exposure(float steps) {
  window.look.exposure_ev = fminf(fmaxf(window.look.exposure_ev + steps, -16), 16);
  window_apply_look();
  window_tell("exposure %+.1f EV", window.look.exposure_ev);
}

static void darker(void) {
  change_exposure(-0.5f);
}

static void brighter(void) {
  change_exposure(0.5f);
}

static void toggle_tone_map(void) {
  window.look.tone_map = !window.look.tone_map;
  window_apply_look();
  window_tell("tone mapping %s", window.look.tone_map ? "on" : "off");
}

static void toggle_filter(void) {
  window.look.anisotropic = !window.look.anisotropic;
  window_apply_look();
  window_tell("filter: %s", window.look.anisotropic ? "anisotropic" : "trilinear");
}

static void toggle_mix(void) {
  if (!drawing_has_depth(window.drawing)) {
    window_tell("this file has no heights to mix by");
    return;
  }
  window.look.mix = window.look.mix == MIX_DEPTH ? MIX_FOUR_TAP : MIX_DEPTH;
  window_apply_look();
  window_tell("reflections mixed %s", window.look.mix == MIX_DEPTH ? "by depth" : "from four taps");
}

static void hold_detail(uint32_t level) {
  window.settling = 0;
  window.look.detail = level;
  window_apply_look();
  if (level == 0)
    window_tell("all directions");
  else
    window_tell("angular level of detail %u: %u x %u directions in one", level, 1u << level,
                1u << level);
}

static void coarser(void) {
  if (window.look.detail < window_coarsest_level()) hold_detail(window.look.detail + 1);
}

static void finer(void) {
  if (window.look.detail > 0) hold_detail(window.look.detail - 1);
}

static void next_layer(void) {
  if (slf_surface_count(window_shown()) == 0) return;
  uint32_t i = window.shown_surface, k = window.shown_layer + 1;
  if (k >= slf_get_surface(window_shown(), i)->layer_count)
    i = (i + 1) % slf_surface_count(window_shown()), k = 0;
  window_map_layer(i, k);
}

static void move_slice(int ds, int dt) {
  const slf_layer *layer = window_mapped_layer();
  uint32_t s = window.slice_s + (uint32_t)ds, t = window.slice_t + (uint32_t)dt;
  /* Wraps below 0, where no slice exists either. */
  if (!layer || !slf_slice_exists(layer->s_count, layer->t_count, s, t)) return;
  window.slice_s = s;
  window.slice_t = t;
}

static void slice_left(void) {
  move_slice(-1, 0);
}

static void slice_right(void) {
  move_slice(1, 0);
}

static void slice_up(void) {
  move_slice(0, -1);
}

static void slice_down(void) {
  move_slice(0, 1);
}

/* A name for a new file: slfview-TIME.EXTENSION, in the working folder. */
static void new_name(char *name, size_t name_nbytes, const char *extension) {
  time_t now = time(NULL);
  size_t length = strftime(name, name_nbytes, "slfview-%Y%m%d-%H%M%S", localtime(&now));
  snprintf(name + length, name_nbytes - length, "%s", extension);
}

static void screenshot(void) {
  char name[64];
  slf_error error;
  uint8_t *rgba = malloc((size_t)window.width_px * (size_t)window.height_px * 4);
  new_name(name, sizeof name, ".png");
  if (!rgba) return;
  slf_result result =
      drawing_render(window.drawing, &window.view, window.width_px, window.height_px, -1, &error);
  if (result == SLF_OK) {
    drawing_read(window.drawing, rgba);
    result = image_write_png(name, rgba, window.width_px, window.height_px, &error);
  }
  free(rgba);
  if (result == SLF_OK)
    window_tell("wrote %s", name);
  else
    window_report(&error);
}

/* The present view as text, for a POV-Ray scene. */
static void copy_camera(void) {
  char text[512] = "";
  FILE *out = fmemopen(text, sizeof text, "w");
  if (!out) return;
  view_print_pov(out, &window.view, window.width_px, window.height_px);
  fclose(out);
  glfw.call.glfwSetClipboardString(window.handle, text);
  fputs(text, stdout);
  fflush(stdout);
  window_tell("copied the camera for POV-Ray");
}

/* ---- Camera paths */

static void add_key(void) {
  double time_s = window.path.count ? path_end_s(&window.path) + 2 : 0;
  if (path_add(&window.path, time_s, &window.view))
    window_tell("camera %zu of the path, at %.1f s", window.path.count, time_s);
}

static void toggle_recording(void) {
  window.recording = !window.recording;
  window.playing = false;
  if (window.recording) {
    path_clear(&window.path);
    window.path_time_s = 0;
    window_tell("recording the flight");
  } else {
    window_tell("recorded %.1f s", path_end_s(&window.path));
  }
}

static void toggle_playing(void) {
  if (window.path.count < 2) {
    window_tell("no path yet: key some cameras or record a flight");
    return;
  }
  window.recording = false;
  window.playing = !window.playing;
  window.path_time_s = 0;
}

static void clear_path(void) {
  path_clear(&window.path);
  window.recording = window.playing = false;
  window_tell("path cleared");
}

static void export_path(void) {
  char base[64], name[72];
  slf_error error;
  if (window.path.count == 0) {
    window_tell("no path yet: key some cameras or record a flight");
    return;
  }
  new_name(base, sizeof base, "");
  snprintf(name, sizeof name, "%s.path", base);
  slf_result result = path_write(name, &window.path, &error);
  if (result == SLF_OK)
    result = path_export_pov(base, &window.path, 30, window.width_px, window.height_px, &error);
  if (result == SLF_OK)
    window_tell("wrote %s.path, .inc and .ini", base);
  else
    window_report(&error);
}

void window_fly(double elapsed_s) {
  window.path_time_s += elapsed_s;
  if (window.recording) path_add(&window.path, window.path_time_s, &window.view);
  if (!window.playing) return;
  window.view = path_at(&window.path, window.path_time_s);
  if (window.path_time_s > path_end_s(&window.path)) window.path_time_s = 0;
}

/* ---- Comparison with POV-Ray */

static void compare_with_povray(void) {
  slf_error error;
  if (!window.options->scene) {
    window_tell("slfview was not told the scene: --scene SCENE.pov");
    return;
  }
  bool had = window.truth != NULL;
  window_stop_comparing();
  if (had) {
    window_tell("comparison ended");
    return;
  }
  window.truth_view = window.view;
  window.truth_width_px = window.width_px;
  window.truth_height_px = window.height_px;
  window.ours = malloc((size_t)window.width_px * (size_t)window.height_px * 4);
  if (!window.ours) return;
  slf_result result =
      drawing_render(window.drawing, &window.view, window.width_px, window.height_px, -1, &error);
  if (result == SLF_OK) {
    drawing_read(window.drawing, window.ours);
    window.ours_look = drawing_get_look(window.drawing);
    result = truth_start(window.options->scene, &window.view, window.width_px, window.height_px,
                         &window.truth, &error);
  }
  if (result != SLF_OK) {
    window_stop_comparing();
    window_report(&error);
  }
  window.psnr = -1;
}

static void next_comparison(void) {
  static const char *const names[] = {"split: slf left, POV-Ray right", "side by side",
                                      "difference, times 8"};
  window.comparison = (window.comparison + 1) % COMPARE_COUNT;
  window_tell("comparison %s", names[window.comparison]);
}

/* ---- The table ---------------------------------------------------------------------------------
 */

/* `act` is called when the key goes down; keys without it are asked for each frame (walk). A key
 * without a name is told of with the one before. */
typedef struct {
  int key;
  const char *name, *what;
  void (*act)(void);
} binding;

static const binding bindings[] = {
    {GLFW_KEY_H, "H", "this help", toggle_help},
    {GLFW_KEY_ESCAPE, "Escape", "end", end},
    {0, "left drag", "orbit, or disturb water (shift: a ball)", NULL},
    {0, "right drag", "look around", NULL},
    {0, "wheel", "approach", NULL},
    {0, "W A S D", "walk", NULL},
    {0, "E Q", "rise, sink", NULL},
    {GLFW_KEY_PAGE_DOWN, "PageDown Up", "slower, faster", slower},
    {GLFW_KEY_PAGE_UP, NULL, NULL, faster},
    {GLFW_KEY_9, "9 0", "narrower, wider field of view", narrower},
    {GLFW_KEY_0, NULL, NULL, wider},
    {GLFW_KEY_R, "R", "back to the start", reset},
    {GLFW_KEY_V, "V", "next view of the file", next_view},
    {GLFW_KEY_F3, "F3 F4", "file before, next file", window_previous_file},
    {GLFW_KEY_F4, NULL, NULL, window_next_file},
    {GLFW_KEY_I, "I", "statistics", toggle_statistics},
    {GLFW_KEY_M, "M", "cache map: green kept, red new this frame", toggle_cache_map},
    {GLFW_KEY_L, "L", "slice view", toggle_slice_view},
    {GLFW_KEY_TAB, "Tab", "next layer in map and slice view", next_layer},
    {GLFW_KEY_LEFT, "Left Right", "slice: S down, up", slice_left},
    {GLFW_KEY_RIGHT, NULL, NULL, slice_right},
    {GLFW_KEY_UP, "Up Down", "slice: T down, up", slice_up},
    {GLFW_KEY_DOWN, NULL, NULL, slice_down},
    {GLFW_KEY_J, "J K", "coarser, finer angular level of detail", coarser},
    {GLFW_KEY_K, NULL, NULL, finer},
    {GLFW_KEY_B, "B", "reflections: by depth, or from four taps", toggle_mix},
    {GLFW_KEY_G, "G", "texture filter", toggle_filter},
    {GLFW_KEY_F7, "F7 F8", "darker, brighter", darker},
    {GLFW_KEY_F8, NULL, NULL, brighter},
    {GLFW_KEY_T, "T", "tone mapping", toggle_tone_map},
    {GLFW_KEY_F12, "F12", "screenshot", screenshot},
    {GLFW_KEY_C, "C", "copy the camera for POV-Ray", copy_camera},
    {GLFW_KEY_ENTER, "Enter", "add a camera to the path", add_key},
    {GLFW_KEY_O, "O", "record a flight, or stop", toggle_recording},
    {GLFW_KEY_Y, "Y", "play the path, or stop", toggle_playing},
    {GLFW_KEY_U, "U", "write the path, for POV-Ray too", export_path},
    {GLFW_KEY_DELETE, "Delete", "clear the path", clear_path},
    {GLFW_KEY_F5, "F5", "compare with POV-Ray, or stop", compare_with_povray},
    {GLFW_KEY_F6, "F6", "split, side by side or difference", next_comparison},
};

enum { BINDING_COUNT = sizeof bindings / sizeof *bindings };

int window_list_keys(bool of_water, char *names, char *whats) {
  int count = 0;
  names[0] = whats[0] = 0;
  for (int i = 0; of_water && i < WATER_KEY_COUNT; i++, count++) {
    const char name[2] = {water_keys[i].key, 0};
    strcat(strcat(names, name[0] == ' ' ? "Space" : name), "\n");
    strcat(strcat(whats, water_keys[i].does), "\n");
  }
  for (int i = 0; !of_water && i < BINDING_COUNT; i++) {
    if (!bindings[i].name) continue;
    strcat(strcat(names, bindings[i].name), "\n");
    strcat(strcat(whats, bindings[i].what), "\n");
    count++;
  }
  return count;
}

void window_print_bindings(FILE *out) {
  char names[WINDOW_KEY_NAMES_NBYTES], whats[WINDOW_KEY_WHATS_NBYTES];
  for (int of_water = 0; of_water < 2; of_water++) {
    int count = window_list_keys(of_water, names, whats);
    const char *name = names, *what = whats;
    for (; count > 0; count--, name += strcspn(name, "\n") + 1, what += strcspn(what, "\n") + 1)
      fprintf(out, "%-11.*s  %s%.*s\n", (int)strcspn(name, "\n"), name, of_water ? "water: " : "",
              (int)strcspn(what, "\n"), what);
  }
}

/* ---- Events ------------------------------------------------------------------------------------
 */

static void on_key(GLFWwindow *handle, int key, int scancode, int action, int mods) {
  (void)handle, (void)scancode, (void)mods;
  window.changed = true;
  if (action == GLFW_RELEASE) return;
  for (int i = 0; i < BINDING_COUNT; i++)
    if (bindings[i].key == key && bindings[i].act) bindings[i].act();
  if (key < 128) water_press_key(&window.water, (char)key); /* GLFW names such keys by ASCII */
}

static void on_cursor(GLFWwindow *handle, double x, double y) {
  window.changed = true;
  float dx = (float)(x - window.cursor_x) * 0.005f, dy = (float)(y - window.cursor_y) * 0.005f;
  window.cursor_x = x;
  window.cursor_y = y;
  int width, height; /* in the cursor's units, which need not be pixels */
  glfw.call.glfwGetWindowSize(handle, &width, &height);
  water_move(&window.water, &window.view, x + 0.5, y + 0.5, width, height);
  if (window.button == GLFW_MOUSE_BUTTON_LEFT) view_orbit(&window.view, dx, dy);
  if (window.button == GLFW_MOUSE_BUTTON_RIGHT) view_turn(&window.view, dx, -dy);
}

static void on_button(GLFWwindow *handle, int button, int action, int mods) {
  window.changed = true;
  window.button = -1;
  water_release(&window.water);
  if (action != GLFW_PRESS) return;
  window.button = button;
  if (button != GLFW_MOUSE_BUTTON_LEFT) return;
  int width, height;
  glfw.call.glfwGetWindowSize(handle, &width, &height);
  const water_tool tool = mods & GLFW_MOD_SHIFT ? WATER_BALL : WATER_FINGER;
  if (water_press(&window.water, tool, &window.view, window.cursor_x + 0.5, window.cursor_y + 0.5,
                  width, height))
    window.button = -1;
}

static void on_scroll(GLFWwindow *handle, double x, double y) {
  (void)handle, (void)x;
  window.changed = true;
  view_approach(&window.view, powf(0.9f, (float)y));
}

static void on_refresh(GLFWwindow *handle) {
  (void)handle;
  window.changed = true;
}

static bool held(int key) {
  return glfw.call.glfwGetKey(window.handle, key) == GLFW_PRESS;
}

/* Steps by the time that passed: half of the start's distance to look_at in a second. */
void window_walk(float elapsed_s) {
  float distance_2 = 0;
  for (int k = 0; k < 3; k++) {
    float d = window.start.look_at[k] - window.start.location[k];
    distance_2 += d * d;
  }
  float step = sqrtf(distance_2) * 0.5f * window.speed * fminf(elapsed_s, 0.1f);
  float right = step * (float)(held(GLFW_KEY_D) - held(GLFW_KEY_A));
  float up = step * (float)(held(GLFW_KEY_E) - held(GLFW_KEY_Q));
  float forward = step * (float)(held(GLFW_KEY_W) - held(GLFW_KEY_S));
  if (right != 0 || up != 0 || forward != 0) view_walk(&window.view, right, up, forward);
}

bool window_walks(void) {
  static const int keys[] = {GLFW_KEY_W, GLFW_KEY_A, GLFW_KEY_S,
                             GLFW_KEY_D, GLFW_KEY_E, GLFW_KEY_Q};
  for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
    if (held(keys[i])) return true;
  return false;
}

static void on_drop(GLFWwindow *handle, int count, const char **names) {
  (void)handle;
  int first = window.file_count;
  for (int i = 0; i < count; i++) window_add_file(names[i]);
  if (window.file_count > first) window_open_file(first, false);
}

void window_listen(void) {
  glfw.call.glfwSetKeyCallback(window.handle, on_key);
  glfw.call.glfwSetCursorPosCallback(window.handle, on_cursor);
  glfw.call.glfwSetMouseButtonCallback(window.handle, on_button);
  glfw.call.glfwSetScrollCallback(window.handle, on_scroll);
  glfw.call.glfwSetDropCallback(window.handle, on_drop);
  glfw.call.glfwSetWindowRefreshCallback(window.handle, on_refresh);
}
