#include "window.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

#include "context.h"
#include "gl_api.h"
#include "image.h"
#include "maps.h"
#include "overlay.h"
#include "path.h"
#include "truth.h"
#include "water_input.h"

#define GLFW_FUNCTIONS(X)                                                                          \
  X(glfwInit)                                                                                      \
  X(glfwTerminate)                                                                                 \
  X(glfwGetError)                                                                                  \
  X(glfwWindowHint)                                                                                \
  X(glfwCreateWindow)                                                                              \
  X(glfwSetWindowTitle)                                                                            \
  X(glfwMakeContextCurrent)                                                                        \
  X(glfwSwapInterval)                                                                              \
  X(glfwGetProcAddress)                                                                            \
  X(glfwSetKeyCallback)                                                                            \
  X(glfwSetCursorPosCallback)                                                                      \
  X(glfwSetMouseButtonCallback)                                                                    \
  X(glfwSetScrollCallback)                                                                         \
  X(glfwSetDropCallback)                                                                           \
  X(glfwSetWindowRefreshCallback)                                                                  \
  X(glfwSetClipboardString)                                                                        \
  X(glfwGetFramebufferSize)                                                                        \
  X(glfwGetWindowSize)                                                                             \
  X(glfwGetWindowContentScale)                                                                     \
  X(glfwGetKey)                                                                                    \
  X(glfwGetTime)                                                                                   \
  X(glfwSwapBuffers)                                                                               \
  X(glfwPollEvents)                                                                                \
  X(glfwWaitEventsTimeout)                                                                         \
  X(glfwWindowShouldClose)                                                                         \
  X(glfwSetWindowShouldClose)

static union {
  struct {
#define MEMBER(name) __typeof__(name) *name;
    GLFW_FUNCTIONS(MEMBER)
#undef MEMBER
  } call;
  void *functions[64];
} glfw;

typedef enum { COMPARE_SPLIT, COMPARE_BESIDE, COMPARE_DIFFERENCE, COMPARE_COUNT } comparison;

static struct {
  GLFWwindow *handle;
  const window_options *options;
  char **files; /* owned; grows by drops */
  int file_count, file_index;
  checked_file *file;
  bool check_reported, check_failed;
  struct timespec file_time; /* when it was written */
  drawing *drawing;
  drawing_look look;
  overlay *overlay;

  slf_view view, start;
  uint32_t view_index;
  float speed;               /* of walking, against the one that suits the scene */
  double cursor_x, cursor_y; /* of the latest cursor event: GLFW's own getter runs ahead of it */
  int button;                /* held down, or -1 */
  int width_px, height_px;   /* of the framebuffer */
  bool changed;              /* something happened that the picture may show */
  water_input water;

  bool help, statistics, cache_map, slice_view;
  uint32_t shown_surface, shown_layer, slice_s, slice_t; /* of the cache map and the slice view */
  maps maps;
  double frame_s;         /* smoothed */
  uint32_t settling;      /* levels of detail to go until all is crisp */
  depth_mix_counts depth; /* of the latest frame that mixed by depth */

  camera_path path;
  bool recording, playing;
  double path_time_s;

  truth *truth;
  slf_view truth_view;
  int truth_width_px, truth_height_px;
  comparison comparison;
  uint8_t *ours; /* the viewer's picture of truth_view, in ours_look */
  drawing_look ours_look;
  double psnr;

  char message[640];
  double message_until_s;
} window = {.button = -1};

/* ---- Messages ----------------------------------------------------------------------------------
 */

/* Shows a line for five seconds. */
__attribute__((format(printf, 1, 2))) static void tell(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(window.message, sizeof window.message, format, arguments);
  va_end(arguments);
  window.message_until_s = glfw.call.glfwGetTime() + 5;
  window.changed = true;
}

/* An error goes to the window and to stderr. */
static void report(const slf_error *error) {
  fprintf(stderr, "slfview: %s\n", error->message);
  tell("%s", error->message);
}

/* A name for a new file: slfview-TIME.EXTENSION, in the working folder. */
static void new_name(char *name, size_t name_nbytes, const char *extension) {
  time_t now = time(NULL);
  size_t length = strftime(name, name_nbytes, "slfview-%Y%m%d-%H%M%S", localtime(&now));
  snprintf(name + length, name_nbytes - length, "%s", extension);
}

/* ---- Files -------------------------------------------------------------------------------------
 */

static const slf_file *shown(void) {
  return checked_file_get(window.file);
}

/* The layer that the cache map and the slice view show, NULL if its surface has none. */
static const slf_layer *mapped_layer(void) {
  if (window.shown_surface >= slf_surface_count(shown())) return NULL;
  const slf_surface *surface = slf_get_surface(shown(), window.shown_surface);
  return surface->layer_count ? &surface->layers[window.shown_layer] : NULL;
}

static void map_layer(uint32_t surface, uint32_t layer) {
  window.shown_surface = surface;
  window.shown_layer = layer;
  window.slice_s = mapped_layer() ? mapped_layer()->s_count / 2 : 0;
  window.slice_t = mapped_layer() ? mapped_layer()->t_count / 2 : 0;
}

/* The first light field of more than one direction, if there is any. */
static void map_first_shiny(void) {
  map_layer(0, 0);
  for (uint32_t i = 0; i < slf_surface_count(shown()); i++)
    for (uint32_t k = 0; k < slf_get_surface(shown(), i)->layer_count; k++)
      if (slf_get_surface(shown(), i)->layers[k].slice_count > 1) {
        map_layer(i, k);
        return;
      }
}

static struct timespec time_of(const char *name) {
  struct stat status;
  return stat(name, &status) == 0 ? status.st_mtim : (struct timespec){0, 0};
}

static void stop_comparing(void) {
  truth_free(window.truth);
  free(window.ours);
  window.truth = NULL;
  window.ours = NULL;
}

/* The coarsest level that has more than one slice somewhere: where a file starts, matte. */
static uint32_t coarsest_level(void) {
  uint32_t most = 1, level = 0;
  for (uint32_t i = 0; i < slf_surface_count(shown()); i++)
    for (uint32_t k = 0; k < slf_get_surface(shown(), i)->layer_count; k++)
      most = slf_get_surface(shown(), i)->layers[k].s_count > most
                 ? slf_get_surface(shown(), i)->layers[k].s_count
                 : most;
  while (1u << level < most) level++;
  return level;
}

static void apply_look(void) {
  drawing_look look = window.look;
  if (window.settling > look.detail) look.detail = window.settling;
  drawing_set_look(window.drawing, &look);
}

/* Makes an open file the one that is shown; takes it over, or leaves things as they are. */
static slf_result show_file(checked_file *file, bool keep_view, slf_error *error) {
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
  stop_comparing();
  drawing_free(window.drawing);
  checked_file_close(window.file);
  window.file = file;
  window.drawing = d;
  window.water = (water_input){.file = f, .drawing = d};
  window.check_reported = false;
  window.file_time = time_of(checked_file_path(file));
  maps_clear(&window.maps);
  map_first_shiny();
  window.settling = coarsest_level();
  window.changed = true;
  apply_look();
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

static bool open_file(int index, bool keep_view) {
  checked_file *file;
  slf_error error;
  if (checked_file_open(window.files[index], &file, &error) != SLF_OK) {
    report(&error);
    return false;
  }
  if (show_file(file, keep_view, &error) != SLF_OK) {
    checked_file_close(file);
    report(&error);
    return false;
  }
  window.file_index = index;
  return true;
}

static void next_file(void) {
  open_file((window.file_index + 1) % window.file_count, false);
}

static void previous_file(void) {
  open_file((window.file_index + window.file_count - 1) % window.file_count, false);
}

static bool add_file(const char *name) {
  char **moved = realloc(window.files, ((size_t)window.file_count + 1) * sizeof *moved);
  if (moved) window.files = moved;
  if (!moved || !(window.files[window.file_count] = strdup(name))) return false;
  window.file_count++;
  return true;
}

static void on_drop(GLFWwindow *handle, int count, const char **names) {
  (void)handle;
  int first = window.file_count;
  for (int i = 0; i < count; i++) add_file(names[i]);
  if (window.file_count > first) open_file(first, false);
}

/* A baked file replaces the old one in one go (rename), so a new time means a whole new file. */
static void watch_file(void) {
  struct timespec now = time_of(window.files[window.file_index]);
  if (now.tv_sec == 0 ||
      (now.tv_sec == window.file_time.tv_sec && now.tv_nsec == window.file_time.tv_nsec))
    return;
  window.file_time = now;
  if (open_file(window.file_index, true)) tell("reloaded");
}

static void report_check(void) {
  slf_result result;
  slf_error error;
  if (window.check_reported || !checked_file_done(window.file, &result, &error)) return;
  window.check_reported = true;
  if (result == SLF_OK) return;
  window.check_failed = true;
  report(&error);
}

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
  uint32_t count = slf_view_count(shown());
  if (count == 0) return;
  window.view_index = (window.view_index + 1) % count;
  window.view = window.start = *slf_get_view(shown(), window.view_index);
  tell("view %s", window.view.name);
}

static void change_speed(float factor) {
  window.speed = fminf(fmaxf(window.speed * factor, 1.0f / 64), 64);
  tell("speed %.3g", window.speed);
}

static void slower(void) {
  change_speed(0.5f);
}

static void faster(void) {
  change_speed(2);
}

static void change_angle(float factor) {
  window.view.angle_deg = fminf(fmaxf(window.view.angle_deg * factor, 1), 170);
  tell("angle %.1f degrees", window.view.angle_deg);
}

static void narrower(void) {
  change_angle(1 / 1.1f);
}

static void wider(void) {
  change_angle(1.1f);
}

static void change_exposure(float steps) {
  window.look.exposure_ev = fminf(fmaxf(window.look.exposure_ev + steps, -16), 16);
  apply_look();
  tell("exposure %+.1f EV", window.look.exposure_ev);
}

static void darker(void) {
  change_exposure(-0.5f);
}

static void brighter(void) {
  change_exposure(0.5f);
}

static void toggle_tone_map(void) {
  window.look.tone_map = !window.look.tone_map;
  apply_look();
  tell("tone mapping %s", window.look.tone_map ? "on" : "off");
}

static void toggle_filter(void) {
  window.look.anisotropic = !window.look.anisotropic;
  apply_look();
  tell("filter: %s", window.look.anisotropic ? "anisotropic" : "trilinear");
}

static void toggle_mix(void) {
  if (!drawing_has_depth(window.drawing)) {
    tell("this file has no heights to mix by");
    return;
  }
  window.look.mix = window.look.mix == MIX_DEPTH ? MIX_FOUR_TAP : MIX_DEPTH;
  apply_look();
  tell("reflections mixed %s", window.look.mix == MIX_DEPTH ? "by depth" : "from four taps");
}

static void hold_detail(uint32_t level) {
  window.settling = 0;
  window.look.detail = level;
  apply_look();
  if (level == 0)
    tell("all directions");
  else
    tell("angular level of detail %u: %u x %u directions in one", level, 1u << level, 1u << level);
}

static void coarser(void) {
  if (window.look.detail < coarsest_level()) hold_detail(window.look.detail + 1);
}

static void finer(void) {
  if (window.look.detail > 0) hold_detail(window.look.detail - 1);
}

static void next_layer(void) {
  if (slf_surface_count(shown()) == 0) return;
  uint32_t i = window.shown_surface, k = window.shown_layer + 1;
  if (k >= slf_get_surface(shown(), i)->layer_count)
    i = (i + 1) % slf_surface_count(shown()), k = 0;
  map_layer(i, k);
}

static void move_slice(int ds, int dt) {
  const slf_layer *layer = mapped_layer();
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
    tell("wrote %s", name);
  else
    report(&error);
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
  tell("copied the camera for POV-Ray");
}

/* ---- Camera paths */

static void add_key(void) {
  double time_s = window.path.count ? path_end_s(&window.path) + 2 : 0;
  if (path_add(&window.path, time_s, &window.view))
    tell("camera %zu of the path, at %.1f s", window.path.count, time_s);
}

static void toggle_recording(void) {
  window.recording = !window.recording;
  window.playing = false;
  if (window.recording) {
    path_clear(&window.path);
    window.path_time_s = 0;
    tell("recording the flight");
  } else {
    tell("recorded %.1f s", path_end_s(&window.path));
  }
}

static void toggle_playing(void) {
  if (window.path.count < 2) {
    tell("no path yet: key some cameras or record a flight");
    return;
  }
  window.recording = false;
  window.playing = !window.playing;
  window.path_time_s = 0;
}

static void clear_path(void) {
  path_clear(&window.path);
  window.recording = window.playing = false;
  tell("path cleared");
}

static void export_path(void) {
  char base[64], name[72];
  slf_error error;
  if (window.path.count == 0) {
    tell("no path yet: key some cameras or record a flight");
    return;
  }
  new_name(base, sizeof base, "");
  snprintf(name, sizeof name, "%s.path", base);
  slf_result result = path_write(name, &window.path, &error);
  if (result == SLF_OK)
    result = path_export_pov(base, &window.path, 30, window.width_px, window.height_px, &error);
  if (result == SLF_OK)
    tell("wrote %s.path, .inc and .ini", base);
  else
    report(&error);
}

static void fly(double elapsed_s) {
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
    tell("slfview was not told the scene: --scene SCENE.pov");
    return;
  }
  bool had = window.truth != NULL;
  stop_comparing();
  if (had) {
    tell("comparison ended");
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
    stop_comparing();
    report(&error);
  }
  window.psnr = -1;
}

static void next_comparison(void) {
  static const char *const names[] = {"split: slf left, POV-Ray right", "side by side",
                                      "difference, times 8"};
  window.comparison = (window.comparison + 1) % COMPARE_COUNT;
  tell("comparison %s", names[window.comparison]);
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
    {GLFW_KEY_F3, "F3 F4", "file before, next file", previous_file},
    {GLFW_KEY_F4, NULL, NULL, next_file},
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

static void water_key_name(const water_key *k, char name[16]) {
  snprintf(name, 16, k->key == ' ' ? "Space" : "%c", k->key);
}

void window_print_bindings(FILE *out) {
  for (int i = 0; i < BINDING_COUNT; i++)
    if (bindings[i].name) fprintf(out, "%-11s  %s\n", bindings[i].name, bindings[i].what);
  for (int i = 0; i < WATER_KEY_COUNT; i++) {
    char name[16];
    water_key_name(&water_keys[i], name);
    fprintf(out, "%-11s  water: %s\n", name, water_keys[i].does);
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
static void walk(float elapsed_s) {
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

static bool walks(void) {
  static const int keys[] = {GLFW_KEY_W, GLFW_KEY_A, GLFW_KEY_S,
                             GLFW_KEY_D, GLFW_KEY_E, GLFW_KEY_Q};
  for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
    if (held(keys[i])) return true;
  return false;
}

static bool has_water(void) {
  for (uint32_t i = 0; i < slf_surface_count(shown()); i++)
    if (drawing_water(window.drawing, i)) return true;
  return false;
}

/* Whether the next frame differs from this one though nothing happens. */
static bool goes_on(void) {
  int width_px, height_px;
  glfw.call.glfwGetFramebufferSize(window.handle, &width_px, &height_px);
  return width_px != window.width_px || height_px != window.height_px || window.settling > 0 ||
         window.statistics || window.recording || window.playing ||
         (window.truth && window.psnr < 0) || walks() || has_water();
}

static slf_result advance_water(double elapsed_s, slf_error *error) {
  slf_result result = SLF_OK;
  for (uint32_t i = 0; i < slf_surface_count(shown()) && result == SLF_OK; i++) {
    water *w = drawing_water(window.drawing, i);
    if (w) result = water_advance(w, elapsed_s, error);
  }
  return result;
}

/* ---- Overlays ----------------------------------------------------------------------------------
 */

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
  uint64_t raw_nbytes = 0, file_nbytes = slf_file_nbytes(shown());
  for (uint32_t i = 0; i < slf_surface_count(shown()); i++)
    for (uint32_t k = 0; k < slf_get_surface(shown(), i)->layer_count; k++)
      raw_nbytes += slf_get_surface(shown(), i)->layers[k].raw_nbytes;
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
  char names[1024] = "", whats[4096] = "", name[16];
  int count = 0;
  for (int i = 0; i < BINDING_COUNT; i++) {
    if (!bindings[i].name) continue;
    count++;
    strcat(strcat(names, bindings[i].name), "\n");
    strcat(strcat(whats, bindings[i].what), "\n");
  }
  float width = show_keys(o, scale, 10 * scale, names, whats, count);
  if (!has_water()) return;
  names[0] = whats[0] = 0;
  for (int i = 0; i < WATER_KEY_COUNT; i++) {
    water_key_name(&water_keys[i], name);
    strcat(strcat(names, name), "\n");
    strcat(strcat(whats, water_keys[i].does), "\n");
  }
  show_keys(o, scale, 14 * scale + width, names, whats, WATER_KEY_COUNT);
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
    report(&error);
    stop_comparing();
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

static void draw_overlays(void) {
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
  if ((window.cache_map || window.slice_view) && mapped_layer()) {
    const uint8_t *map =
        window.slice_view
            ? maps_slice(&window.maps, shown(), window.shown_surface, window.shown_layer,
                         window.slice_s, window.slice_t, text, sizeof text, &width, &height)
            : maps_cache(&window.maps, shown(), drawing_cache(window.drawing), window.shown_surface,
                         window.shown_layer, text, sizeof text, &width, &height);
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

static slf_result draw_frame(slf_error *error) {
  glfw.call.glfwGetFramebufferSize(window.handle, &window.width_px, &window.height_px);
  if (window.width_px == 0 || window.height_px == 0) return SLF_OK; /* minimised */
  slf_result result =
      drawing_render(window.drawing, &window.view, window.width_px, window.height_px, -1, error);
  if (result != SLF_OK) return result;
  if (drawing_get_cost(window.drawing).depth.texel_count)
    window.depth = drawing_get_cost(window.drawing).depth;
  draw_overlays();
  drawing_show(window.drawing, window.width_px, window.height_px);
  /* A file shows at once as matte; each frame makes it crisper. */
  if (window.settling > window.look.detail) {
    window.settling--;
    window.changed = true;
    apply_look();
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
    if (!add_file(options->files[i])) {
      snprintf(error->message, sizeof error->message, "out of memory");
      result = SLF_ERROR_MEMORY;
    }
  if (result == SLF_OK && options->path_file)
    result = path_read(options->path_file, &window.path, error);
  if (result == SLF_OK) result = show_file(opened, false, error);
  if (result != SLF_OK) {
    checked_file_close(opened);
    return result;
  }
  glfw.call.glfwSetKeyCallback(window.handle, on_key);
  glfw.call.glfwSetCursorPosCallback(window.handle, on_cursor);
  glfw.call.glfwSetMouseButtonCallback(window.handle, on_button);
  glfw.call.glfwSetScrollCallback(window.handle, on_scroll);
  glfw.call.glfwSetDropCallback(window.handle, on_drop);
  glfw.call.glfwSetWindowRefreshCallback(window.handle, on_refresh);
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
    walk((float)elapsed_s);
    fly(elapsed_s);
    report_check();
    if (options->watch && now_s - watched_s > 0.5) {
      watched_s = now_s;
      watch_file();
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
  if (checked_file_wait(window.file, &check_error) != SLF_OK) report_check();
  if (result == SLF_OK && window.check_failed) result = SLF_ERROR_CHECKSUM;
  return result;
}

void window_close(void) {
  if (window.handle) {
    stop_comparing();
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
