/* exact PLACE MIRROR DIFFUSE REFLECTION - checks four bakes of tests/bake/exact against their
 * closed forms; prints TAP. Run by exact.sh, which bakes them. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bake/fail.h"
#include "bake/image.h"
#include "bake/surface.h"

typedef struct {
  surface *self;
  slice *slices;
  uint32_t slice_count;
  float *rgb;  /* slice_count slices */
  float *rays; /* 12 floats a texel, NULL for a planar surface */
} baked;

static scene *open_scene(const char *folder) {
  return scene_read(folder);
}

static baked open_baked(const char *folder, scene *whole, const char *name, uint32_t rays) {
  baked out = {.self = (surface *)scene_find(whole, name)};
  if (!out.self) fail("%s: no surface %s", folder, name);
  uint32_t u = out.self->u_count, v = out.self->v_count;
  out.slices = surface_slices(out.self, &out.slice_count);
  out.rgb = allocate((size_t)out.slice_count * u * v * 3, sizeof(float), name);
  float *next = out.rgb;
  for (uint32_t i = 0; i < surface_chunk_count(out.self, rays); i++) {
    char *path = format_text("%s/%s/%04u.exr", folder, name, i);
    image *chunk = image_open(path);
    image_read_rows(chunk, "RGB", 0, image_height(chunk), next);
    next += (size_t)image_height(chunk) * u * 3;
    image_close(chunk);
    free(path);
  }
  if (out.self->planar || rays > 1) return out;
  char *path = format_text("%s/%s/rays", folder, name);
  FILE *file = fopen(path, "rb");
  out.rays = allocate((size_t)u * v, 12 * sizeof(float), name);
  if (!file || fread(out.rays, 12 * sizeof(float), (size_t)u * v, file) != (size_t)u * v)
    fail("%s: cannot be read", path);
  fclose(file);
  free(path);
  return out;
}

/* The frame of a texel's centre. */
static void frame_at(const baked *b, uint32_t i, uint32_t j, double frame[4][3]) {
  const surface *self = b->self;
  if (b->rays) {
    for (int k = 0; k < 12; k++)
      frame[k / 3][k % 3] = b->rays[((size_t)j * self->u_count + i) * 12 + k];
    return;
  }
  const slf_vertex *vertex = self->vertices;
  for (int axis = 0; axis < 3; axis++) {
    frame[0][axis] = self->corner[axis] + (i + 0.5) / self->u_count * self->edge_u[axis] +
                     (j + 0.5) / self->v_count * self->edge_v[axis];
    frame[1][axis] = vertex->normal[axis];
    frame[2][axis] = vertex->tangent_u[axis];
    frame[3][axis] = vertex->tangent_v[axis];
  }
}

static double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double distance(const double a[3], const double b[3]) {
  double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
  return sqrt(dot(d, d));
}

/* The shorter side of a texel, from its neighbours' centres. */
static double texel_size(const baked *b, uint32_t i, uint32_t j) {
  double here[4][3], right[4][3], below[4][3];
  frame_at(b, i, j, here);
  frame_at(b, i + 1 < b->self->u_count ? i + 1 : i - 1, j, right);
  frame_at(b, i, j + 1 < b->self->v_count ? j + 1 : j - 1, below);
  return fmin(distance(here[0], right[0]), distance(here[0], below[0]));
}

typedef struct {
  double sum, largest;
  size_t count;
} errors;

static void add_error(errors *self, double error) {
  self->sum += error;
  self->count++;
  if (error > self->largest) self->largest = error;
}

/* For every texel of every slice with n >= 0.1: the place that was seen, in texels from where it
 * should be; or the direction in which a mirror was seen to reflect, in degrees. */
static errors measure(const baked *b, bool mirror) {
  errors out = {0};
  const surface *self = b->self;
  for (uint32_t k = 0; k < b->slice_count; k++) {
    double stn[3];
    slf_direction((b->slices[k].s + 0.5) / self->s_count, (b->slices[k].t + 0.5) / self->t_count,
                  0.02, stn);
    if (stn[2] < 0.1) continue;
    for (uint32_t texel = 0; texel < self->u_count * self->v_count; texel++) {
      uint32_t i = texel % self->u_count, j = texel / self->u_count;
      const float *rgb = b->rgb + ((size_t)k * self->u_count * self->v_count + texel) * 3;
      double frame[4][3], seen[3], expected[3], scale = mirror ? 4 : 1;
      frame_at(b, i, j, frame);
      for (int axis = 0; axis < 3; axis++) {
        double d = stn[0] * frame[2][axis] + stn[1] * frame[3][axis] + stn[2] * frame[1][axis];
        expected[axis] = mirror ? 2 * stn[2] * frame[1][axis] - d : frame[0][axis];
        double turns = rgb[axis] - 0.5 - expected[axis] * scale;
        seen[axis] = expected[axis] + (turns - round(turns)) / scale;
      }
      if (mirror)
        add_error(&out, distance(seen, expected) * 180 / M_PI);
      else
        add_error(&out, distance(seen, expected) / texel_size(b, i, j));
    }
  }
  return out;
}

static int test_count;
static void report(bool ok, const char *what) {
  printf("%sok %d - %s\n", ok ? "" : "not ", ++test_count, what);
}

static void test_surface(const char *folder, const char *name, bool mirror) {
  scene *whole = open_scene(folder);
  baked b = open_baked(folder, whole, name, 1);
  errors found = measure(&b, mirror);
  double mean = found.sum / (double)found.count;
  const char *unit = mirror ? "degrees" : "texels";
  printf("# figure: %s, %s: mean error %.5f %s, largest %.5f, of %zu\n", name,
         mirror ? "reflected direction" : "place", mean, unit, found.largest, found.count);
  /* Radiance holds what is less than 1 of place x 1 or direction x 4, and half floats below 1 step
   * by 1/2048: steps of 0.0005, 1/70 of the smallest texel, or of 0.007 degrees. A ray that met
   * something else would be off by far more than 0.05. */
  char *what = format_text("%s: %s within 0.01 %s in the mean, 0.05 at most", name,
                           mirror ? "reflected direction" : "place", unit);
  report(found.count > 1000 && mean < 0.01 && found.largest < 0.05, what);
  free(what);
}

/* The same place seen by the planar and by the curved camera: a step of the half floats apart. */
static void test_cameras(const char *folder, uint32_t rays) {
  scene *whole = open_scene(folder);
  baked planar = open_baked(folder, whole, "quad", rays);
  baked curved = open_baked(folder, whole, "same", rays);
  double largest = 0;
  size_t count = (size_t)planar.slice_count * planar.self->u_count * planar.self->v_count * 3;
  for (size_t i = 0; i < count; i++) largest = fmax(largest, fabs(planar.rgb[i] - curved.rgb[i]));
  printf("# figure: planar and curved camera, %u rays: differ by at most %.6f\n", rays, largest);
  report(planar.slice_count == curved.slice_count && largest <= 1.0 / 2048,
         "planar and curved cameras agree within two half-float steps");
}

/* The mesh_camera keeps ray origins in floats. Their last bit, seen at a grazing angle of n = 0.02,
 * moves the place by 1e-5 at most, 1/200 of a half-float step here: one number in a few thousand
 * may round the other way. */
static void test_diffuse(const char *folder, const char *name, uint32_t rays) {
  scene *whole = open_scene(folder);
  baked b = open_baked(folder, whole, name, rays);
  size_t slice_size = (size_t)b.self->u_count * b.self->v_count * 3;
  size_t count = slice_size * (b.slice_count - 1), differing = 0;
  double largest = 0;
  for (size_t i = 0; i < count; i++) {
    double difference = fabs(b.rgb[slice_size + i] - b.rgb[i % slice_size]);
    differing += difference > 0;
    largest = fmax(largest, difference);
  }
  printf(
      "# figure: diffuse %s: %zu of %zu numbers differ from the first slice's, by at most %.6f\n",
      name, differing, count, largest);
  char *what = format_text("diffuse %s: slices are identical but for roundings", name);
  report(b.slice_count > 1 && differing * 5000 <= count && largest <= 1.0 / 2048, what);
  free(what);
}

int main(int argc, char **argv) {
  if (argc != 5) return 2;
  const char *names[] = {"quad", "same", "ball", "wave"};
  printf("1..12\n");
  for (int mirror = 0; mirror < 2; mirror++)
    for (int i = 0; i < 4; i++) test_surface(argv[1 + mirror], names[i], mirror);
  test_cameras(argv[3], 9);
  test_cameras(argv[4], 9);
  test_diffuse(argv[3], "quad", 9);
  test_diffuse(argv[3], "ball", 9);
  return 0;
}
