/* window_parts.h - what the parts of the window share: the one window of the process and GLFW,
 * which is loaded at run time. window.c opens it and runs its frames, window_files.c shows light
 * fields in it, window_keys.c does what keys and mouse ask for, window_overlays.c draws over the
 * picture. All of it on the main thread. */
#ifndef WINDOW_PARTS_H
#define WINDOW_PARTS_H

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <time.h>

#include "maps.h"
#include "overlay.h"
#include "path.h"
#include "truth.h"
#include "water_input.h"
#include "window.h"

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

typedef union {
  struct {
#define MEMBER(name) __typeof__(name) *name;
    GLFW_FUNCTIONS(MEMBER)
#undef MEMBER
  } call;
  void *functions[64];
} glfw_library;

extern glfw_library glfw;

typedef enum { COMPARE_SPLIT, COMPARE_BESIDE, COMPARE_DIFFERENCE, COMPARE_COUNT } comparison;

typedef struct {
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
} window_state;

extern window_state window;

/* Shows a line for five seconds. */
__attribute__((format(printf, 1, 2))) void window_tell(const char *format, ...);
/* An error goes to the window and to stderr. */
void window_report(const slf_error *error);
/* Whether some surface of the file is water. */
bool window_has_water(void);

/* ---- window_files.c */

const slf_file *window_shown(void);
/* The layer that the cache map and the slice view show, NULL if its surface has none. */
const slf_layer *window_mapped_layer(void);
void window_map_layer(uint32_t surface, uint32_t layer);
/* The coarsest level that has more than one slice somewhere: where a file starts, matte. */
uint32_t window_coarsest_level(void);
/* What window.look asks for goes to the drawing. */
void window_apply_look(void);
/* Makes an open file the one that is shown; takes it over, or leaves things as they are. */
slf_result window_show_file(checked_file *file, bool keep_view, slf_error *error);
/* Shows files[index] instead; false, and told, if it cannot be. */
bool window_open_file(int index, bool keep_view);
void window_next_file(void);
void window_previous_file(void);
/* Appends to the files; false if there is no memory. */
bool window_add_file(const char *name);
/* Shows the file again if it was baked again. */
void window_watch_file(void);
/* Tells once what the check of the whole file found wrong. */
void window_report_check(void);
/* Ends the comparison with POV-Ray, whose renderer is stopped. */
void window_stop_comparing(void);

/* ---- window_keys.c */

/* Keys, mouse and drops call what they ask for from now on. */
void window_listen(void);
/* Moves the camera for the time that passed, by the keys held down. */
void window_walk(float elapsed_s);
/* Whether such a key is held down. */
bool window_walks(void);
/* Records or plays the camera path for the time that passed. */
void window_fly(double elapsed_s);
enum { WINDOW_KEY_NAMES_NBYTES = 1024, WINDOW_KEY_WHATS_NBYTES = 4096 };
/* The keys' names and what they do, a line each; of the window, or those of water. Returns the
 * lines. */
int window_list_keys(bool of_water, char *names, char *whats);

/* ---- window_overlays.c */

void window_draw_overlays(void);

#endif
