/* room - writes a .slf file without POV-Ray: a room of checkered walls, a mirror floor and a mirror
 * ball, all in closed form. For speed, which needs light fields of any size at once, and for tests
 * of the window, which need some file.
 *
 *   room TEXELS DIRECTIONS SAMPLES QUALITY OUT.slf [BALL_TEXELS [TILES]]
 *
 * TEXELS along each side of the floor, and of the ball unless told otherwise. The floor is TILES x
 * TILES surfaces (1). SAMPLES squared per texel, spread over its (U,V) and its (S,T) cell; 0 makes
 * every texel of floor and ball 0.5 in every direction, so that whatever a viewer shows of them
 * must be just that. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "slf.h"

typedef struct {
  double x, y, z;
} vec;

static vec add(vec a, vec b, double scale) {
  return (vec){a.x + scale * b.x, a.y + scale * b.y, a.z + scale * b.z};
}

static double dot(vec a, vec b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

static vec unit(vec a) {
  return add((vec){0, 0, 0}, a, 1 / sqrt(dot(a, a)));
}

static const double half = 3, height = 4; /* the room: |x|, |z| <= half, 0 <= y <= height */
static const vec ball = {0.6, 1.1, 0.4};
static const double ball_radius = 0.7;

/* Checkers of 0.4 units, brighter upwards, each wall in a colour of its own. */
static void wall_radiance(vec p, int wall, float rgb[3]) {
  static const float paint[6][3] = {{0.9f, 0.3f, 0.2f}, {0.2f, 0.7f, 0.3f}, {0.8f, 0.8f, 0.8f},
                                    {0.9f, 0.9f, 0.9f}, {0.3f, 0.4f, 0.9f}, {0.9f, 0.8f, 0.3f}};
  int odd = (int)(floor(p.x / 0.4 + 1e-9) + floor(p.y / 0.4 + 1e-9) + floor(p.z / 0.4 + 1e-9)) & 1;
  float light = (float)(0.3 + 0.12 * p.y) * (odd ? 1.0f : 0.35f);
  for (int k = 0; k < 3; k++) rgb[k] = paint[wall][k] * light;
}

/* Where a ray from inside leaves the room, and through which wall: 2 k + (positive side). */
static vec leave_room(vec p, vec d, int *wall) {
  const double low[3] = {-half, 0, -half}, high[3] = {half, height, half};
  const double *o = &p.x, *r = &d.x;
  double nearest = INFINITY;
  for (int k = 0; k < 3; k++) {
    if (fabs(r[k]) < 1e-12) continue;
    double distance = ((r[k] > 0 ? high[k] : low[k]) - o[k]) / r[k];
    if (distance < nearest) {
      nearest = distance;
      *wall = 2 * k + (r[k] > 0);
    }
  }
  return add(p, d, nearest);
}

static double hit_ball(vec p, vec d) {
  vec to = add(ball, p, -1);
  double along = dot(to, d), off_2 = dot(to, to) - along * along;
  double in = ball_radius * ball_radius - off_2;
  return in > 0 && along > 0 ? along - sqrt(in) : INFINITY;
}

/* The radiance that comes in along d; mirrors answer at most `depth` times, then are grey. */
static void trace(vec p, vec d, int depth, float rgb[3]) {
  int wall = 0;
  double distance = hit_ball(p, d);
  vec hit, normal;
  if (isfinite(distance)) {
    hit = add(p, d, distance);
    normal = unit(add(hit, ball, -1));
  } else {
    hit = leave_room(p, d, &wall);
    normal = (vec){0, 1, 0};
    if (wall != 2) {
      wall_radiance(hit, wall, rgb);
      return;
    }
  }
  if (depth == 0) {
    rgb[0] = rgb[1] = rgb[2] = 0.2f;
    return;
  }
  vec out = unit(add(d, normal, -2 * dot(d, normal)));
  trace(add(hit, normal, 1e-6), out, depth - 1, rgb);
  for (int k = 0; k < 3; k++) rgb[k] *= 0.85f;
}

/* ---- Surfaces ---------------------------------------------------------------------------------
 */

/* P(u,v) with its frame. */
typedef struct {
  vec point, normal, tangent_u, tangent_v;
} frame;

static int tile_count = 1, tile_u, tile_v; /* a side, and the one at hand */

static frame floor_at(double u, double v) {
  u = (u + tile_u) / tile_count;
  v = (v + tile_v) / tile_count;
  return (frame){{(2 * u - 1) * half, 0, (2 * v - 1) * half}, {0, 1, 0}, {1, 0, 0}, {0, 0, 1}};
}

static frame ball_at(double u, double v) {
  double a = 2 * M_PI * u, b = M_PI * v;
  vec normal = {cos(a) * sin(b), cos(b), sin(a) * sin(b)};
  return (frame){add(ball, normal, ball_radius),
                 normal,
                 {-sin(a), 0, cos(a)},
                 {cos(a) * cos(b), -sin(b), sin(a) * cos(b)}};
}

static int wall_now;

static frame wall_at(double u, double v) {
  int axis = wall_now / 2, side = wall_now % 2 ? 1 : -1;
  vec in[3] = {{-side, 0, 0}, {0, -side, 0}, {0, 0, -side}};
  frame f = {.normal = in[axis]};
  double x = (2 * u - 1) * half, z = (2 * v - 1) * half;
  if (axis == 0)
    f = (frame){{side * half, (1 - v) * height, x}, in[0], {0, 0, 1}, {0, -1, 0}};
  else if (axis == 1)
    f = (frame){{x, height, z}, in[1], {1, 0, 0}, {0, 0, 1}};
  else
    f = (frame){{x, (1 - v) * height, side * half}, in[2], {1, 0, 0}, {0, -1, 0}};
  return f;
}

typedef struct {
  frame (*at)(double u, double v);
  uint32_t texels, directions, samples;
} shape;

static slf_result read_slice(void *context, uint32_t s_index, uint32_t t_index, float *rgb,
                             slf_error *error) {
  (void)error;
  const shape *s = context;
  for (uint32_t y = 0; y < s->texels; y++)
    for (uint32_t x = 0; x < s->texels; x++, rgb += 3) {
      const uint32_t side = s->samples;
      rgb[0] = rgb[1] = rgb[2] = side ? 0 : 0.5f;
      for (uint32_t k = 0; k < side * side; k++) {
        frame f = s->at((x + (k % side + 0.5) / side) / s->texels,
                        (y + (k / side + 0.5) / side) / s->texels);
        float one[3];
        if (s->directions == 1) {
          wall_radiance(add(f.point, f.normal, 1e-6), wall_now, one);
        } else {
          double d[3];
          slf_direction((s_index + (k % side + 0.5) / side) / s->directions,
                        (t_index + (k / side + 0.5) / side) / s->directions, 0.02, d);
          vec in =
              add(add(add((vec){0, 0, 0}, f.tangent_u, -d[0]), f.tangent_v, -d[1]), f.normal, d[2]);
          trace(add(f.point, f.normal, 1e-6), unit(in), 3, one);
        }
        for (int c = 0; c < 3; c++) rgb[c] += 0.85f * one[c] / (float)(side * side);
      }
    }
  return SLF_OK;
}

static slf_result add_surface(slf_writer *writer, const char *name, shape *s, uint32_t steps,
                              uint32_t flags, float quality, slf_error *error) {
  uint32_t side = steps + 1;
  slf_vertex *vertices = calloc(side * side, sizeof *vertices);
  uint32_t *triangles = calloc(6 * steps * steps, sizeof *triangles), *t = triangles;
  for (uint32_t j = 0; j < side; j++)
    for (uint32_t i = 0; i < side; i++) {
      slf_vertex *v = &vertices[j * side + i];
      frame f = s->at((double)i / steps, (double)j / steps);
      const double *from[4] = {&f.point.x, &f.normal.x, &f.tangent_u.x, &f.tangent_v.x};
      float *to[4] = {v->position, v->normal, v->tangent_u, v->tangent_v};
      for (int k = 0; k < 12; k++) to[k / 3][k % 3] = (float)from[k / 3][k % 3];
      v->u = (float)i / (float)steps;
      v->v = (float)j / (float)steps;
      if (i == steps || j == steps) continue;
      uint32_t a = j * side + i, b = a + 1, c = a + side, d = c + 1;
      memcpy(t, (uint32_t[]){a, b, c, c, b, d}, 6 * sizeof *t);
      t += 6;
    }
  slf_surface surface = {.flags = flags,
                         .mesh = {.vertices = vertices,
                                  .triangles = triangles,
                                  .vertex_count = side * side,
                                  .triangle_count = 2 * steps * steps}};
  snprintf(surface.name, sizeof surface.name, "%s", name);
  slf_layer_options options = {.angular = SLF_ANGULAR_NONE,
                               .u_count = s->texels,
                               .v_count = s->texels,
                               .s_count = s->directions,
                               .t_count = s->directions,
                               .quality = quality};
  slf_source source = {.read_slice = read_slice, .context = s};
  slf_result result = slf_writer_add_surface(writer, &surface, error);
  if (result == SLF_OK) result = slf_writer_add_layer(writer, &options, &source, error);
  free(vertices);
  free(triangles);
  return result;
}

int main(int argc, char **argv) {
  if (argc < 6 || argc > 8) {
    fputs("usage: room TEXELS DIRECTIONS SAMPLES QUALITY OUT.slf [BALL_TEXELS [TILES]]\n", stderr);
    return 2;
  }
  uint32_t texels = (uint32_t)atoi(argv[1]), directions = (uint32_t)atoi(argv[2]),
           samples = (uint32_t)atoi(argv[3]);
  float quality = (float)atof(argv[4]);
  static const slf_view views[] = {
      {"door", {-2.2f, 1.7f, -2.4f}, {0.5f, 0.6f, 0.5f}, 70},
      {"floor", {0.2f, 0.4f, -2.8f}, {0.3f, 0.3f, 1}, 75},
      {"ball", {1.9f, 1.6f, -0.9f}, {0.6f, 1.1f, 0.4f}, 60},
      {"near", {0.6f, 1.9f, -0.1f}, {0.6f, 1.6f, 0.4f}, 90},
      {"grazing", {-2.9f, 0.02f, -2.9f}, {0.6f, 0.3f, 0.4f}, 60},
  };
  slf_writer *writer = NULL;
  slf_error error;
  slf_result result = slf_writer_create(argv[5], &writer, &error);
  for (size_t i = 0; i < sizeof views / sizeof *views && result == SLF_OK; i++)
    result = slf_writer_add_view(writer, &views[i], &error);
  shape floor_shape = {floor_at, texels, directions, samples},
        ball_shape = {ball_at, argc > 6 ? (uint32_t)atoi(argv[6]) : texels, directions, samples},
        wall_shape = {wall_at, 128, 1, 2};
  if (argc > 7) tile_count = atoi(argv[7]);
  floor_shape.texels /= (uint32_t)tile_count;
  for (int i = 0; i < tile_count * tile_count && result == SLF_OK; i++) {
    char name[32] = "floor";
    if (tile_count > 1) snprintf(name, sizeof name, "floor_%d", i);
    tile_u = i % tile_count;
    tile_v = i / tile_count;
    result = add_surface(writer, name, &floor_shape, 4, SLF_SURFACE_WATER, quality, &error);
  }
  if (result == SLF_OK)
    result = add_surface(writer, "ball", &ball_shape, 48, SLF_SURFACE_WRAP_U, quality, &error);
  for (wall_now = 0; wall_now < 6 && result == SLF_OK; wall_now++) {
    static const char *const names[] = {"left", "right", NULL, "ceiling", "front", "back"};
    if (wall_now != 2) /* the floor */
      result = add_surface(writer, names[wall_now], &wall_shape, 1, 0, 90, &error);
  }
  if (result == SLF_OK) result = slf_writer_finish(writer, &error);
  if (result == SLF_OK) return 0;
  slf_writer_abort(writer);
  fprintf(stderr, "room: %s\n", error.message);
  return 1;
}
