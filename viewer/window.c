#include "window.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "context.h"
#include "gl_api.h"
#include "water_input.h"

#define GLFW_FUNCTIONS(X)                                                                          \
  X(glfwInit)                                                                                      \
  X(glfwTerminate)                                                                                 \
  X(glfwGetError)                                                                                  \
  X(glfwWindowHint)                                                                                \
  X(glfwCreateWindow)                                                                              \
  X(glfwMakeContextCurrent)                                                                        \
  X(glfwSwapInterval)                                                                              \
  X(glfwGetProcAddress)                                                                            \
  X(glfwSetKeyCallback)                                                                            \
  X(glfwSetCursorPosCallback)                                                                      \
  X(glfwSetMouseButtonCallback)                                                                    \
  X(glfwSetScrollCallback)                                                                         \
  X(glfwGetWindowSize)                                                                             \
  X(glfwGetFramebufferSize)                                                                        \
  X(glfwGetKey)                                                                                    \
  X(glfwGetTime)                                                                                   \
  X(glfwSwapBuffers)                                                                               \
  X(glfwPollEvents)                                                                                \
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

typedef struct {
  GLFWwindow *handle;
  slf_view view, start;
  double cursor_x, cursor_y; /* of the latest cursor event: GLFW's own getter runs ahead of it */
  int button;                /* held down, or -1 */
  water_input water;
} window_state;

static window_state window = {.button = -1};

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

static void on_key(GLFWwindow *handle, int key, int scancode, int action, int mods) {
  (void)scancode, (void)mods;
  if (action != GLFW_PRESS) return;
  if (key == GLFW_KEY_ESCAPE) glfw.call.glfwSetWindowShouldClose(handle, GLFW_TRUE);
  if (key == GLFW_KEY_R) window.view = window.start;
  if (key < 128) water_press_key(&window.water, (char)key); /* GLFW names such keys by ASCII */
}

static void on_cursor(GLFWwindow *handle, double x, double y) {
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
  view_approach(&window.view, powf(0.9f, (float)y));
}

static bool held(int key) {
  return glfw.call.glfwGetKey(window.handle, key) == GLFW_PRESS;
}

/* Steps by the time that passed: half a distance to look_at in a second. */
static void walk(float elapsed_s) {
  float distance_2 = 0;
  for (int k = 0; k < 3; k++) {
    float d = window.start.look_at[k] - window.start.location[k];
    distance_2 += d * d;
  }
  float step = sqrtf(distance_2) * 0.5f * fminf(elapsed_s, 0.1f);
  view_walk(&window.view, step * (float)(held(GLFW_KEY_D) - held(GLFW_KEY_A)),
            step * (float)(held(GLFW_KEY_E) - held(GLFW_KEY_Q)),
            step * (float)(held(GLFW_KEY_W) - held(GLFW_KEY_S)));
}

static slf_result advance_water(double elapsed_s, slf_error *error) {
  slf_result result = SLF_OK;
  for (uint32_t i = 0; i < slf_surface_count(window.water.file) && result == SLF_OK; i++) {
    water *w = drawing_water(window.water.drawing, i);
    if (w) result = water_advance(w, elapsed_s, error);
  }
  return result;
}

slf_result window_run(drawing *d, const slf_view *view, slf_error *error) {
  window.view = window.start = *view;
  window.water = (water_input){.file = drawing_file(d), .drawing = d};
  glfw.call.glfwSetKeyCallback(window.handle, on_key);
  glfw.call.glfwSetCursorPosCallback(window.handle, on_cursor);
  glfw.call.glfwSetMouseButtonCallback(window.handle, on_button);
  glfw.call.glfwSetScrollCallback(window.handle, on_scroll);
  double last_s = glfw.call.glfwGetTime();
  while (!glfw.call.glfwWindowShouldClose(window.handle)) {
    int width_px, height_px;
    glfw.call.glfwPollEvents();
    double now_s = glfw.call.glfwGetTime();
    walk((float)(now_s - last_s));
    slf_result result = advance_water(now_s - last_s, error);
    if (result != SLF_OK) return result;
    last_s = now_s;
    glfw.call.glfwGetFramebufferSize(window.handle, &width_px, &height_px);
    if (width_px > 0 && height_px > 0) { /* not while it is minimised */
      result = drawing_render(d, &window.view, width_px, height_px, -1, error);
      if (result != SLF_OK) return result;
      drawing_show(d, width_px, height_px);
    }
    glfw.call.glfwSwapBuffers(window.handle);
  }
  return SLF_OK;
}

void window_close(void) {
  if (glfw.call.glfwTerminate) glfw.call.glfwTerminate();
}
