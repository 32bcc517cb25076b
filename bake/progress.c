/* progress - says what a bake will take, and how far it is: a bar on a terminal, a line a minute
 * elsewhere. A chunk is done when its file is there and no older than what it was made from.
 *
 * FOLDER/SURFACE/cost holds the microseconds that one of the surface's rays took in a trial, of a
 * matte one FOLDER/cost those of the scene's own camera; FOLDER/begun, when this bake began and how
 * many rays were done by then. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "fail.h"
#include "fog.h"
#include "surface.h"

/* Writing and reading a ray of a curved surface's camera, a face of a mesh, takes about this long.
 */
static const double curved_ray_us = 3;

typedef struct {
  uint64_t rays, rays_done;
  uint64_t samples, samples_outside; /* U V S T of surfaces that are not matte */
  uint32_t chunks, chunks_done;
  uint64_t nbytes; /* of what is gathered */
  double left_us;  /* processor time of the rays not done, estimated */
} tally;

static double changed_at(const char *path) {
  struct stat info;
  if (stat(path, &info)) return -1;
  return (double)info.st_mtim.tv_sec + 1e-9 * (double)info.st_mtim.tv_nsec;
}

static double number_in(const char *folder, const char *name, double otherwise) {
  char *path = format_text("%s/%s", folder, name);
  FILE *file = fopen(path, "r");
  double number;
  if (!file || fscanf(file, "%lf", &number) != 1) number = otherwise;
  if (file) fclose(file);
  free(path);
  return number;
}

static void add_surface(tally *sum, const char *folder, const surface *self, uint32_t asked_rays,
                        double look_at, double cost_us) {
  char *path = format_text("%s/%s/surface.txt", folder, self->name);
  double from = changed_at(path);
  free(path);
  if (from < look_at) from = look_at;
  path = format_text("%s/%s", folder, self->name);
  cost_us = number_in(path, "cost", cost_us);
  free(path);
  /* Layers: one ray without fog and through each; all of them so that light has no steps. */
  const bool layers = surface_has_layers(self);
  const uint32_t rays = layers ? 1 + FOG_COUNT + (asked_rays > 1 ? asked_rays : 0) : asked_rays;
  uint64_t slice_rays = (uint64_t)self->u_count * self->v_count * rays;
  uint32_t slice_count, chunk_count = surface_chunk_count(self, asked_rays);
  free(surface_slices(self, &slice_count));
  if (self->s_count * self->t_count > 1) {
    uint64_t texels = (uint64_t)self->u_count * self->v_count;
    sum->samples += texels * self->s_count * self->t_count;
    sum->samples_outside += texels * (self->s_count * self->t_count - slice_count);
  }
  sum->nbytes += (uint64_t)self->u_count * self->v_count * slice_count * 6 *
                 surface_part_count(self, asked_rays);
  for (uint32_t i = 0; i < chunk_count; i++) {
    uint64_t chunk_rays = slice_rays * surface_chunk(self, asked_rays, i).count;
    path = format_text("%s/%s/%04u.exr", folder, self->name, i);
    bool done = changed_at(path) >= from;
    free(path);
    sum->chunks++, sum->rays += chunk_rays;
    if (done)
      sum->chunks_done++, sum->rays_done += chunk_rays;
    else
      sum->left_us += (double)chunk_rays * (cost_us + (self->planar ? 0 : curved_ray_us));
  }
}

static tally count(const char *folder, uint32_t rays, uint32_t *surface_count) {
  tally sum = {0};
  char *look = format_text("%s/look", folder);
  scene *whole = scene_read(folder);
  double cost_us = number_in(folder, "cost", 3), look_at = changed_at(look);
  for (uint32_t i = 0; i < whole->surface_count; i++)
    add_surface(&sum, folder, &whole->surfaces[i], rays, look_at, cost_us);
  *surface_count = whole->surface_count;
  scene_free(whole);
  free(look);
  return sum;
}

static char *format_time(double seconds) {
  if (seconds < 90) return format_text("%.0f s", seconds);
  if (seconds < 90 * 60) return format_text("%.0f min", seconds / 60);
  return format_text("%.1f h", seconds / 3600);
}

static double now(void) {
  struct timespec time;
  clock_gettime(CLOCK_REALTIME, &time);
  return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static void begin(const char *folder, const char *name, uint32_t rays) {
  uint32_t surface_count;
  tally sum = count(folder, rays, &surface_count);
  if (sum.chunks_done == sum.chunks) return;
  char *time_text = format_time(sum.left_us * 1e-6 / (double)sysconf(_SC_NPROCESSORS_ONLN));
  fprintf(stderr, "bake %s: %u surface%s, %.1f M rays in %u chunks", name, surface_count,
          surface_count == 1 ? "" : "s", (double)sum.rays * 1e-6, sum.chunks);
  if (sum.chunks_done) fprintf(stderr, ", %u of them baked already", sum.chunks_done);
  fprintf(stderr, "; about %s here and %.1f MB\n", time_text, (double)sum.nbytes * 1e-6);
  if (sum.samples_outside)
    fprintf(stderr,
            "bake %s: %.3f M of %.3f M samples (U x V x S x T) skipped: their directions lie below "
            "the surface\n",
            name, (double)sum.samples_outside * 1e-6, (double)sum.samples * 1e-6);
  free(time_text);
  char *path = format_text("%s/begun", folder);
  FILE *file = fopen(path, "w");
  if (!file || fprintf(file, "%.3f %llu\n", now(), (unsigned long long)sum.rays_done) < 0 ||
      fclose(file))
    fail("%s: cannot be written", path);
  free(path);
}

/* Whether it is time for a line where there is no terminal: a minute after the last. */
static bool line_is_due(const char *said_path, double began) {
  return now() - began >= 60 && now() - changed_at(said_path) >= 60;
}

static void print_progress(const tally *sum, const char *name, double left_s, bool terminal) {
  char *left = format_time(left_s);
  double fraction = (double)sum->rays_done / (double)sum->rays;
  bool done = sum->chunks_done == sum->chunks;
  char bar[31] = "..............................";
  memset(bar, '#', (size_t)(fraction * 30));
  if (terminal)
    fprintf(stderr, "\rbake %s [%s] %3.0f %%, %s left \033[K%s", name, bar, fraction * 100, left,
            done ? "\n" : "");
  else
    fprintf(stderr, "bake %s: %.0f %%, %u of %u chunks, %s left\n", name, fraction * 100,
            sum->chunks_done, sum->chunks, left);
  free(left);
}

static void report(const char *folder, const char *name, uint32_t rays) {
  char *path = format_text("%s/begun", folder), *said = format_text("%s/said", folder);
  FILE *file = fopen(path, "r");
  double began;
  unsigned long long rays_before;
  bool terminal = isatty(STDERR_FILENO);
  if (file && fscanf(file, "%lf %llu", &began, &rays_before) == 2 &&
      (terminal || line_is_due(said, began))) {
    uint32_t surface_count;
    tally sum = count(folder, rays, &surface_count);
    double rate = (double)(sum.rays_done - rays_before) / (now() - began);
    print_progress(&sum, name, (double)(sum.rays - sum.rays_done) / (rate > 1 ? rate : 1),
                   terminal);
    FILE *mark = fopen(said, "w");
    if (mark) fclose(mark);
  }
  if (file) fclose(file);
  free(said);
  free(path);
}

int main(int argc, char **argv) {
  if (argc != 4 || (strcmp(argv[1], "begin") && strcmp(argv[1], "report"))) {
    fputs("usage: progress begin|report FOLDER RAYS\n", stderr);
    return 2;
  }
  const char *slash = strrchr(argv[2], '/');
  const char *name = slash ? slash + 1 : argv[2];
  if (!strcmp(argv[1], "begin"))
    begin(argv[2], name, (uint32_t)atoi(argv[3]));
  else
    report(argv[2], name, (uint32_t)atoi(argv[3]));
  return 0;
}
