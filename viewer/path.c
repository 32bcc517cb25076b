#include "path.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NUMBERS = 7 }; /* of a camera: location, look_at, log of the angle */

bool path_add(camera_path *p, double time_s, const slf_view *view) {
  if (!isfinite(time_s) || (p->count && !(time_s > p->keys[p->count - 1].time_s))) return false;
  if (p->count == p->capacity) {
    size_t capacity = p->capacity ? 2 * p->capacity : 64;
    path_key *moved = realloc(p->keys, capacity * sizeof *moved);
    if (!moved) return false;
    p->keys = moved;
    p->capacity = capacity;
  }
  p->keys[p->count++] = (path_key){time_s, *view};
  return true;
}

void path_clear(camera_path *p) {
  free(p->keys);
  *p = (camera_path){0};
}

double path_end_s(const camera_path *p) {
  return p->count ? p->keys[p->count - 1].time_s : 0;
}

static void numbers_of(const slf_view *view, double x[NUMBERS]) {
  for (int k = 0; k < 3; k++) {
    x[k] = view->location[k];
    x[3 + k] = view->look_at[k];
  }
  x[6] = log(view->angle_deg);
}

/* The slope at key i: of the parabola through it and its neighbours; of the chord at an end. */
static double slope(const camera_path *p, size_t i, int number) {
  double x[3][NUMBERS], t[3];
  size_t before = i > 0 ? i - 1 : i, after = i + 1 < p->count ? i + 1 : i;
  size_t keys[3] = {before, i, after};
  for (int k = 0; k < 3; k++) {
    numbers_of(&p->keys[keys[k]].view, x[k]);
    t[k] = p->keys[keys[k]].time_s;
  }
  double left = before == i ? 0 : (x[1][number] - x[0][number]) / (t[1] - t[0]);
  double right = after == i ? 0 : (x[2][number] - x[1][number]) / (t[2] - t[1]);
  if (before == i) return right;
  if (after == i) return left;
  double share = (t[1] - t[0]) / (t[2] - t[0]);
  return left * (1 - share) + right * share;
}

slf_view path_at(const camera_path *p, double time_s) {
  size_t i = 0;
  if (!(time_s > p->keys[0].time_s)) return p->keys[0].view;
  if (time_s >= path_end_s(p)) return p->keys[p->count - 1].view;
  for (size_t step = p->count; step > 0; step /= 2) /* the last key not after time_s */
    while (i + step < p->count && p->keys[i + step].time_s <= time_s) i += step;
  const path_key *a = &p->keys[i], *b = &p->keys[i + 1];
  double length = b->time_s - a->time_s, x = (time_s - a->time_s) / length;
  double from[NUMBERS], to[NUMBERS], at[NUMBERS];
  numbers_of(&a->view, from);
  numbers_of(&b->view, to);
  for (int k = 0; k < NUMBERS; k++) {
    double m0 = slope(p, i, k) * length, m1 = slope(p, i + 1, k) * length;
    double x2 = x * x, x3 = x2 * x;
    at[k] = from[k] * (2 * x3 - 3 * x2 + 1) + m0 * (x3 - 2 * x2 + x) + to[k] * (3 * x2 - 2 * x3) +
            m1 * (x3 - x2);
  }
  slf_view view = a->view;
  for (int k = 0; k < 3; k++) {
    view.location[k] = (float)at[k];
    view.look_at[k] = (float)at[3 + k];
  }
  view.angle_deg = (float)fmin(exp(at[6]), 179);
  return view;
}

/* ---- Files ------------------------------------------------------------------------------------
 */

static slf_result refuse(slf_error *error, const char *file_name, int line, const char *what) {
  snprintf(error->message, sizeof error->message, "%.256s: line %d: %s", file_name, line, what);
  return SLF_ERROR_FORMAT;
}

static slf_result failed(slf_error *error, const char *file_name) {
  snprintf(error->message, sizeof error->message, "%.256s: %s", file_name, strerror(errno));
  return SLF_ERROR_IO;
}

slf_result path_read(const char *file_name, camera_path *p, slf_error *error) {
  char text[512];
  FILE *in = fopen(file_name, "r");
  if (!in) return failed(error, file_name);
  slf_result result = SLF_OK;
  for (int line = 1; result == SLF_OK && fgets(text, sizeof text, in); line++) {
    text[strcspn(text, "#\n")] = 0;
    if (text[strspn(text, " \t\r")] == 0) continue;
    slf_view view = {.name = ""};
    float *l = view.location, *a = view.look_at;
    double time_s;
    char rest;
    int count = sscanf(text, "%lf %f %f %f %f %f %f %f %c", &time_s, &l[0], &l[1], &l[2], &a[0],
                       &a[1], &a[2], &view.angle_deg, &rest);
    bool finite = count == 8;
    for (int k = 0; k < 3 && finite; k++) finite = isfinite(l[k]) && isfinite(a[k]);
    if (!finite || !(view.angle_deg > 0 && view.angle_deg < 180))
      result = refuse(error, file_name, line,
                      "expected time lx ly lz ax ay az angle, the angle between 0 and 180");
    else if (!path_add(p, time_s, &view))
      result = refuse(error, file_name, line, "its time is not after the line before");
  }
  if (result == SLF_OK && ferror(in)) result = failed(error, file_name);
  fclose(in);
  if (result == SLF_OK && p->count == 0) result = refuse(error, file_name, 1, "no camera in it");
  return result;
}

/* Writes beside the file and renames. */
static slf_result write_file(const char *file_name, void (*write)(FILE *, const void *),
                             const void *what, slf_error *error) {
  char part[4096];
  if (snprintf(part, sizeof part, "%s.part", file_name) >= (int)sizeof part) errno = ENAMETOOLONG;
  FILE *out = fopen(part, "w");
  if (!out) return failed(error, file_name);
  write(out, what);
  bool ok = !ferror(out);
  ok = fclose(out) == 0 && ok;
  if (ok && rename(part, file_name) == 0) return SLF_OK;
  slf_result result = failed(error, file_name);
  remove(part);
  return result;
}

static void write_keys(FILE *out, const void *what) {
  const camera_path *p = what;
  fprintf(out, "# time_s  location  look_at  angle_deg\n");
  for (size_t i = 0; i < p->count; i++) {
    const slf_view *v = &p->keys[i].view;
    fprintf(out, "%.4f  %.7g %.7g %.7g  %.7g %.7g %.7g  %.6g\n", p->keys[i].time_s, v->location[0],
            v->location[1], v->location[2], v->look_at[0], v->look_at[1], v->look_at[2],
            v->angle_deg);
  }
}

slf_result path_write(const char *file_name, const camera_path *p, slf_error *error) {
  return write_file(file_name, write_keys, p, error);
}

/* ---- POV-Ray ----------------------------------------------------------------------------------
 */

void view_print_pov(FILE *out, const slf_view *v, int width_px, int height_px) {
  fprintf(out,
          "camera { perspective location <%.7g, %.7g, %.7g> right x*%d/%d up y angle %.6g "
          "look_at <%.7g, %.7g, %.7g> }\n",
          v->location[0], v->location[1], v->location[2], width_px, height_px, v->angle_deg,
          v->look_at[0], v->look_at[1], v->look_at[2]);
}

typedef struct {
  const camera_path *p;
  const char *name; /* of the .inc, without folders */
  int width_px, height_px, frame_count;
} pov_export;

/* A frame a line, so that POV-Ray flies exactly what the viewer flew. */
static void write_inc(FILE *out, const void *what) {
  const pov_export *e = what;
  fprintf(out, "// A camera along a path, clock from 0 to 1: %d frames.\n", e->frame_count);
  for (int axis = 0; axis < 3; axis++) {
    static const char *const names[3] = {"Path_Location", "Path_Look_At", "Path_Angle"};
    fprintf(out, "#declare %s = array[%d] {\n", names[axis], e->frame_count);
    for (int i = 0; i < e->frame_count; i++) {
      double share = e->frame_count > 1 ? (double)i / (e->frame_count - 1) : 0;
      slf_view v = path_at(e->p, share * path_end_s(e->p));
      const float *x = axis == 0 ? v.location : v.look_at;
      if (axis == 2)
        fprintf(out, "  %.6g%s\n", v.angle_deg, i + 1 < e->frame_count ? "," : "");
      else
        fprintf(out, "  <%.7g, %.7g, %.7g>%s\n", x[0], x[1], x[2],
                i + 1 < e->frame_count ? "," : "");
    }
    fprintf(out, "}\n");
  }
  fprintf(out,
          "#declare Path_Frame = int(clock * %d + 0.5);\n"
          "camera { perspective location Path_Location[Path_Frame] right x*%d/%d up y\n"
          "  angle Path_Angle[Path_Frame] look_at Path_Look_At[Path_Frame] }\n",
          e->frame_count - 1, e->width_px, e->height_px);
}

static void write_ini(FILE *out, const void *what) {
  const pov_export *e = what;
  fprintf(out,
          "; povray %s.ini +ISCENE.pov, where SCENE.pov ends with #include \"%s.inc\"\n"
          "Initial_Frame=0\nFinal_Frame=%d\nInitial_Clock=0\nFinal_Clock=1\n"
          "Width=%d\nHeight=%d\n",
          e->name, e->name, e->frame_count - 1, e->width_px, e->height_px);
}

slf_result path_export_pov(const char *base_name, const camera_path *p, double frames_per_s,
                           int width_px, int height_px, slf_error *error) {
  char file_name[4096];
  const char *slash = strrchr(base_name, '/');
  pov_export e = {p, slash ? slash + 1 : base_name, width_px, height_px,
                  (int)fmin(floor(path_end_s(p) * frames_per_s) + 1, 1e6)};
  snprintf(file_name, sizeof file_name, "%.4000s.inc", base_name);
  slf_result result = write_file(file_name, write_inc, &e, error);
  if (result != SLF_OK) return result;
  snprintf(file_name, sizeof file_name, "%.4000s.ini", base_name);
  return write_file(file_name, write_ini, &e, error);
}
