#include "truth.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <png.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "path.h"

enum { MAX_ARGUMENTS = 32 };

struct truth {
  pid_t child;
  int messages; /* what povray says, non-blocking */
  char folder[64], line[512], reason[256];
  size_t line_length;
  int percent, width_px, height_px;
  truth_state state;
  uint8_t *picture;
};

static slf_result refuse(truth *t, slf_error *error, const char *what) {
  snprintf(error->message, sizeof error->message, "povray: %.200s: %s", what, strerror(errno));
  truth_free(t);
  return SLF_ERROR_IO;
}

static void file_in(const truth *t, const char *name, char path[PATH_MAX]) {
  snprintf(path, PATH_MAX, "%s/%s", t->folder, name);
}

/* The scene with the view's camera after its own: the last camera counts. */
static bool write_wrapper(const truth *t, const char *scene, const slf_view *view) {
  char path[PATH_MAX];
  file_in(t, "view.pov", path);
  FILE *out = fopen(path, "w");
  if (!out) return false;
  fprintf(out, "#version 3.7;\n#include \"%s\"\n", scene);
  view_print_pov(out, view, t->width_px, t->height_px);
  bool ok = !ferror(out);
  return fclose(out) == 0 && ok;
}

static void run_povray(char *const *arguments, int write_end) {
  int nothing = open("/dev/null", O_RDWR);
  dup2(nothing, STDIN_FILENO);
  dup2(nothing, STDOUT_FILENO);
  dup2(write_end, STDERR_FILENO);
  setpgid(0, 0);
  execvp("povray", arguments);
  dprintf(STDERR_FILENO, "cannot be started: %s\n", strerror(errno));
  _exit(127);
}

slf_result truth_start(const char *scene, const slf_view *view, int width_px, int height_px,
                       truth **out, slf_error *error) {
  *out = NULL;
  char words[4096], absolute[PATH_MAX], size[4][PATH_MAX + 32];
  char *arguments[MAX_ARGUMENTS], *rest = words;
  int count = 0, ends[2];
  truth *t = calloc(1, sizeof *t);
  if (!t) {
    snprintf(error->message, sizeof error->message, "out of memory");
    return SLF_ERROR_MEMORY;
  }
  t->messages = -1;
  t->width_px = width_px;
  t->height_px = height_px;
  snprintf(words, sizeof words, "%s", scene);
  const char *file = strtok_r(rest, " ", &rest);
  if (!file || !realpath(file, absolute)) return refuse(t, error, file ? file : "no scene");
  snprintf(t->folder, sizeof t->folder, "/tmp/slfview-truth-XXXXXX");
  if (!mkdtemp(t->folder)) return refuse(t, error, t->folder);
  if (!write_wrapper(t, absolute, view)) return refuse(t, error, t->folder);

  char wrapper[PATH_MAX], picture[PATH_MAX];
  file_in(t, "view.pov", wrapper);
  file_in(t, "view.png", picture);
  snprintf(size[0], sizeof size[0], "+I%s", wrapper);
  snprintf(size[1], sizeof size[1], "+O%s", picture);
  snprintf(size[2], sizeof size[2], "+W%d", width_px);
  snprintf(size[3], sizeof size[3], "+H%d", height_px);
  const char *const fixed[] = {"povray", size[0], size[1], size[2], size[3],
                               "-D",     "+V",    "+A0.1", "+AM2",  "+R3"};
  for (size_t i = 0; i < sizeof fixed / sizeof *fixed; i++)
    arguments[count++] = (char *)(uintptr_t)fixed[i];
  for (char *word; count < MAX_ARGUMENTS - 2 && (word = strtok_r(NULL, " ", &rest));)
    arguments[count++] = word;
  char library[PATH_MAX + 8];
  char *slash = strrchr(absolute, '/');
  snprintf(library, sizeof library, "+L%.*s", (int)(slash - absolute), absolute);
  arguments[count++] = library;
  arguments[count] = NULL;

  if (pipe(ends) != 0) return refuse(t, error, "pipe");
  t->child = fork();
  if (t->child == 0) run_povray(arguments, ends[1]);
  close(ends[1]);
  t->messages = ends[0];
  if (t->child < 0) return refuse(t, error, "fork");
  fcntl(t->messages, F_SETFL, O_NONBLOCK);
  fcntl(t->messages, F_SETFD, FD_CLOEXEC);
  *out = t;
  return SLF_OK;
}

static void remove_files(const truth *t) {
  static const char *const names[] = {"view.pov", "view.png", "view.pov-state"};
  char path[PATH_MAX];
  if (!t->folder[0]) return;
  for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
    file_in(t, names[i], path);
    unlink(path);
  }
  rmdir(t->folder);
}

void truth_free(truth *t) {
  if (!t) return;
  if (t->child > 0) {
    kill(t->child, SIGKILL);
    waitpid(t->child, NULL, 0);
  }
  if (t->messages >= 0) close(t->messages);
  remove_files(t);
  free(t->picture);
  free(t);
}

/* "Rendered 1024 of 307200 pixels (0%)" tells how far it is, "Parse Error: ..." why it will fail.
 */
static void hear_line(truth *t) {
  long done, all;
  if (sscanf(t->line, "Rendered %ld of %ld", &done, &all) == 2 && all > 0)
    t->percent = (int)(100 * done / all);
  else if (strstr(t->line, "rror:") || strstr(t->line, "cannot be started"))
    snprintf(t->reason, sizeof t->reason, "%.250s", t->line);
}

static void hear(truth *t) {
  char heard[4096];
  ssize_t count;
  while ((count = read(t->messages, heard, sizeof heard)) > 0)
    for (ssize_t i = 0; i < count; i++) {
      if (heard[i] == '\r' || heard[i] == '\n') {
        t->line[t->line_length] = 0;
        hear_line(t);
        t->line_length = 0;
      } else if (t->line_length + 1 < sizeof t->line) {
        t->line[t->line_length++] = heard[i];
      }
    }
}

static bool read_picture(truth *t) {
  char path[PATH_MAX];
  png_image png = {.version = PNG_IMAGE_VERSION};
  file_in(t, "view.png", path);
  if (!png_image_begin_read_from_file(&png, path)) return false;
  png.format = PNG_FORMAT_RGBA;
  if ((int)png.width == t->width_px && (int)png.height == t->height_px)
    t->picture = malloc(PNG_IMAGE_SIZE(png));
  if (t->picture && png_image_finish_read(&png, NULL, t->picture, 0, NULL)) return true;
  png_image_free(&png);
  return false;
}

truth_state truth_poll(truth *t, int *percent, slf_error *error) {
  int status;
  if (t->state == TRUTH_RUNNING) {
    hear(t);
    if (waitpid(t->child, &status, WNOHANG) == t->child) {
      hear(t);
      t->child = 0;
      /* Exit 0 without a picture happens when it could not be written. */
      t->state = WIFEXITED(status) && WEXITSTATUS(status) == 0 && read_picture(t) ? TRUTH_DONE
                                                                                  : TRUTH_FAILED;
    }
  }
  *percent = t->state == TRUTH_DONE ? 100 : t->percent;
  if (t->state == TRUTH_FAILED)
    snprintf(error->message, sizeof error->message, "povray: %s",
             t->reason[0] ? t->reason : "ended without a picture");
  return t->state;
}

const uint8_t *truth_picture(const truth *t) {
  return t->picture;
}

double picture_psnr(const uint8_t *a, const uint8_t *b, size_t pixel_count) {
  double sum = 0;
  for (size_t i = 0; i < 4 * pixel_count; i++)
    if (i % 4 != 3) sum += ((double)a[i] - b[i]) * ((double)a[i] - b[i]);
  return sum > 0 ? 10 * log10(255.0 * 255.0 * 3.0 * (double)pixel_count / sum) : INFINITY;
}
