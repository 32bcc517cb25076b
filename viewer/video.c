#include "video.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

struct video {
  pid_t child;
  int pictures; /* the pipe into ffmpeg */
  size_t picture_nbytes;
  char path[PATH_MAX], part[PATH_MAX + 16];
};

bool video_is_name(const char *path) {
  static const char *const endings[] = {".mp4", ".mkv", ".webm", ".gif"};
  const char *dot = strrchr(path, '.');
  for (size_t i = 0; dot && i < sizeof endings / sizeof *endings; i++)
    if (!strcmp(dot, endings[i])) return true;
  return false;
}

static slf_result refuse(video *v, slf_error *error, const char *what) {
  snprintf(error->message, sizeof error->message, "%.300s: ffmpeg: %s", v->path, what);
  video_abort(v);
  return SLF_ERROR_IO;
}

static void run_ffmpeg(const video *v, int read_end, const char *size, const char *rate) {
  int nothing = open("/dev/null", O_WRONLY);
  bool is_gif = !strcmp(strrchr(v->path, '.'), ".gif");
  dup2(read_end, STDIN_FILENO);
  dup2(nothing, STDOUT_FILENO);
  /* Players want chroma at half the resolution, and even sizes with it; a GIF has its own palette.
   */
  const char *filter = is_gif ? "split[a][b];[a]palettegen[p];[b][p]paletteuse"
                              : "pad=ceil(iw/2)*2:ceil(ih/2)*2,format=yuv420p";
  execlp("ffmpeg", "ffmpeg", "-loglevel", "error", "-y", "-f", "rawvideo", "-pixel_format", "rgba",
         "-video_size", size, "-framerate", rate, "-i", "-", "-filter_complex", filter, v->part,
         (char *)NULL);
  _exit(127);
}

slf_result video_start(const char *path, int width_px, int height_px, double frames_per_s,
                       video **out, slf_error *error) {
  *out = NULL;
  char size[32], rate[32];
  int ends[2];
  video *v = calloc(1, sizeof *v);
  if (!v) {
    snprintf(error->message, sizeof error->message, "out of memory");
    return SLF_ERROR_MEMORY;
  }
  v->pictures = -1;
  v->picture_nbytes = (size_t)width_px * (size_t)height_px * 4;
  snprintf(v->path, sizeof v->path, "%s", path);
  /* ffmpeg chooses the format by the ending, so that stays last. */
  const char *dot = strrchr(v->path, '.');
  snprintf(v->part, sizeof v->part, "%.*s.part%s", (int)(dot - v->path), v->path, dot);
  snprintf(size, sizeof size, "%dx%d", width_px, height_px);
  snprintf(rate, sizeof rate, "%g", frames_per_s);
  if (pipe(ends) != 0) return refuse(v, error, strerror(errno));
  fcntl(ends[1], F_SETFD, FD_CLOEXEC);
  signal(SIGPIPE, SIG_IGN); /* ffmpeg may end first: a write then fails, and says so */
  v->child = fork();
  if (v->child == 0) run_ffmpeg(v, ends[0], size, rate);
  close(ends[0]);
  v->pictures = ends[1];
  if (v->child < 0) return refuse(v, error, strerror(errno));
  *out = v;
  return SLF_OK;
}

static int wait_for(video *v) {
  int status = -1;
  if (v->pictures >= 0) close(v->pictures);
  v->pictures = -1;
  if (v->child > 0) waitpid(v->child, &status, 0);
  v->child = 0;
  return status;
}

slf_result video_add(video *v, const uint8_t *rgba, slf_error *error) {
  for (size_t done = 0; done < v->picture_nbytes;) {
    ssize_t count = write(v->pictures, rgba + done, v->picture_nbytes - done);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) {
      int status = wait_for(v);
      snprintf(error->message, sizeof error->message, "%.300s: ffmpeg %s", v->path,
               WIFEXITED(status) && WEXITSTATUS(status) == 127 ? "is not installed"
                                                               : "ended before the last picture");
      return SLF_ERROR_IO;
    }
    done += (size_t)count;
  }
  return SLF_OK;
}

slf_result video_finish(video *v, slf_error *error) {
  int status = wait_for(v);
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) return refuse(v, error, "failed");
  if (rename(v->part, v->path) != 0) return refuse(v, error, strerror(errno));
  free(v);
  return SLF_OK;
}

void video_abort(video *v) {
  if (!v) return;
  wait_for(v);
  unlink(v->part);
  free(v);
}
