#include "tests/bench/synthetic.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
  double x, y, z;
} vec;

static vec add(vec a, vec b, double scale) {
  return (vec){a.x + b.x * scale, a.y + b.y * scale, a.z + b.z * scale};
}
static double dot(vec a, vec b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
static vec normalise(vec a) {
  return add((vec){0, 0, 0}, a, 1 / sqrt(dot(a, a)));
}
static vec mix(vec a, vec b, double t) {
  return add(add((vec){0, 0, 0}, a, 1 - t), b, t);
}
static vec reflect(vec d, vec n) {
  return add(d, n, -2 * dot(d, n));
}

/* ---- Textures ------------------------------------------------------------------------------ */

static double hash(int x, int y, int seed) {
  uint32_t h = (uint32_t)x * 0x9e3779b1u ^ (uint32_t)y * 0x85ebca77u ^ (uint32_t)seed * 0xc2b2ae3du;
  h = (h ^ h >> 15) * 0x2c1b3c6du;
  h = (h ^ h >> 12) * 0x297a2d39u;
  return (h ^ h >> 15) / 4294967296.0;
}

static double noise(double x, double y, int seed) {
  int ix = (int)floor(x), iy = (int)floor(y);
  double fx = x - ix, fy = y - iy;
  fx = fx * fx * (3 - 2 * fx);
  fy = fy * fy * (3 - 2 * fy);
  double top = hash(ix, iy, seed) * (1 - fx) + hash(ix + 1, iy, seed) * fx;
  double low = hash(ix, iy + 1, seed) * (1 - fx) + hash(ix + 1, iy + 1, seed) * fx;
  return top * (1 - fy) + low * fy;
}

static vec wood(double u, double v) {
  double warp = noise(3 * u, 8 * v, 1) + 0.5 * noise(9 * u, 20 * v, 2);
  double ring = 0.5 + 0.5 * sin(40 * u + 7 * warp), grain = noise(90 * u, 14 * v, 3);
  return mix((vec){0.25, 0.13, 0.05}, (vec){0.55, 0.33, 0.15}, 0.7 * ring + 0.3 * grain);
}

static vec wall(double a, double b, vec tint) {
  double row = floor(b * 8), shifted = a * 4 + (fmod(row, 2) ? 0.5 : 0);
  double fa = shifted - floor(shifted), fb = b * 8 - row;
  vec brick = mix(tint, (vec){0.9, 0.85, 0.75}, 0.4 * hash((int)floor(shifted), (int)row, 4));
  return fa < 0.06 || fb < 0.1 ? (vec){0.75, 0.73, 0.7} : brick;
}

/* ---- The room ------------------------------------------------------------------------------ */

static const struct {
  vec centre;
  double radius, mirror;
  vec colour;
} spheres[] = {{{0.3, 0.25, 0.35}, 0.22, 0.4, {0.8, 0.15, 0.1}},
               {{0.75, 0.18, 0.6}, 0.15, 0.8, {0.9, 0.9, 0.95}},
               {{0.45, 0.14, 0.8}, 0.11, 0.2, {0.1, 0.35, 0.8}}};
static const vec lamp = {0.2, 1.3, -0.3};

static vec room(vec from, vec d) {
  double t = 1e9;
  vec hit, normal = {0, 0, 0}, colour = {0, 0, 0};
  const double low[3] = {-0.7, 0, -0.7}, high[3] = {1.7, 1.5, 1.7};
  double o[3] = {from.x, from.y, from.z}, r[3] = {d.x, d.y, d.z};
  int axis = 0;
  for (int i = 0; i < 3; i++) {
    double side = r[i] > 0 ? high[i] : low[i], ti = r[i] ? (side - o[i]) / r[i] : 1e9;
    if (ti < t) {
      t = ti;
      axis = i;
    }
  }
  hit = add(from, d, t);
  if (axis == 1) {
    colour = hit.y > 0.7 ? (vec){0.8, 0.8, 0.78} : wood(hit.x, hit.z);
    normal.y = hit.y > 0.7 ? -1 : 1;
  } else {
    colour =
        wall(axis ? hit.x : hit.z, hit.y, axis ? (vec){0.6, 0.3, 0.2} : (vec){0.3, 0.45, 0.35});
    *(axis ? &normal.z : &normal.x) = r[axis] > 0 ? -1 : 1;
  }
  vec to_lamp = add(lamp, hit, -1);
  double light =
      0.25 + 0.9 * fmax(0, dot(normal, normalise(to_lamp))) / (0.5 + dot(to_lamp, to_lamp));
  return add((vec){0, 0, 0}, colour, light);
}

static vec trace(vec from, vec d, int depth) {
  int nearest = -1;
  double t = 1e9;
  for (int i = 0; i < 3; i++) {
    vec to = add(from, spheres[i].centre, -1);
    double b = dot(to, d), c = dot(to, to) - spheres[i].radius * spheres[i].radius;
    double root = b * b - c;
    if (root < 0) continue;
    double ti = -b - sqrt(root);
    if (ti > 1e-6 && ti < t) {
      t = ti;
      nearest = i;
    }
  }
  if (nearest < 0) return room(from, d);
  vec hit = add(from, d, t);
  vec n = normalise(add(hit, spheres[nearest].centre, -1));
  vec l = normalise(add(lamp, hit, -1));
  double diffuse = 0.2 + 0.8 * fmax(0, dot(n, l));
  vec own = add((vec){0, 0, 0}, spheres[nearest].colour, diffuse * (1 - spheres[nearest].mirror));
  double shine = pow(fmax(0, dot(reflect(d, n), l)), 60);
  own = add(own, (vec){1, 1, 1}, shine);
  if (depth == 0) return own;
  return add(own, trace(hit, reflect(d, n), depth - 1), spheres[nearest].mirror);
}

static vec radiance(synthetic_kind kind, double u, double v, const double d[3]) {
  vec at = {u, 0, v}, out = {d[0], d[2], d[1]}; /* +y is the floor's normal */
  vec towards = {-out.x, out.y, -out.z};
  vec base = wood(u, v);
  if (kind == SYNTHETIC_GLOSS) {
    vec l = normalise(add(lamp, at, -1)), l2 = normalise(add((vec){1.2, 1, 1.1}, at, -1));
    double lobe = pow(fmax(0, dot(towards, l)), 12), lobe2 = pow(fmax(0, dot(towards, l2)), 5);
    return add(add(add((vec){0, 0, 0}, base, 0.6), (vec){1, 0.95, 0.8}, 0.6 * lobe),
               (vec){0.3, 0.4, 0.6}, 0.5 * lobe2);
  }
  double mirror = kind == SYNTHETIC_MIRROR ? 0.25 : u > 0.5 ? 1 : 0;
  vec shaded = add((vec){0, 0, 0}, base, 0.8 * (1 - mirror));
  return mirror > 0 ? add(shaded, trace(at, towards, 2), mirror) : shaded;
}

/* ---- Slices -------------------------------------------------------------------------------- */

static void make_slice(synthetic_kind kind, const light_field *f, uint32_t s, uint32_t t,
                       uint32_t rays_side, uint8_t *codes) {
  uint32_t p = rays_side;
  for (uint32_t v = 0; v < f->v_count; v++)
    for (uint32_t u = 0; u < f->u_count; u++, codes += 3) {
      vec sum = {0, 0, 0};
      for (uint32_t a = 0; a < p; a++)
        for (uint32_t b = 0; b < p; b++) { /* the orthogonal array of the baker */
          int ray = (int)(a * p + b), seed = (int)(v * f->u_count + u);
          double ju = (a + hash(ray, seed, 5)) / p, jv = (b + hash(ray, seed, 6)) / p;
          double js = ((a + b) % p + hash(ray, seed, 7)) / p;
          double jt = ((a + 2 * b) % p + hash(ray, seed, 8)) / p;
          double direction[3];
          slf_direction((s + js) / f->s_count, (t + jt) / f->t_count, 0.02, direction);
          sum =
              add(sum, radiance(kind, (u + ju) / f->u_count, (v + jv) / f->v_count, direction), 1);
        }
      sum = add((vec){0, 0, 0}, sum, 1.0 / (p * p));
      codes[0] = slf_srgb_from_linear((float)sum.x);
      codes[1] = slf_srgb_from_linear((float)sum.y);
      codes[2] = slf_srgb_from_linear((float)sum.z);
    }
}

bool synthetic_make(synthetic_kind kind, uint32_t texels, uint32_t directions, uint32_t rays_side,
                    light_field *field) {
  *field = (light_field){texels, texels, directions, directions, NULL};
  size_t slice_nbytes = (size_t)texels * texels * 3;
  field->codes = calloc((size_t)directions * directions, slice_nbytes);
  if (!field->codes) return false;
  for (uint32_t t = 0; t < directions; t++)
    for (uint32_t s = 0; s < directions; s++)
      if (slf_slice_exists(directions, directions, s, t))
        make_slice(kind, field, s, t, rays_side,
                   field->codes + ((size_t)t * directions + s) * slice_nbytes);
  return true;
}

void light_field_free(light_field *field) {
  free(field->codes);
  field->codes = NULL;
}

const uint8_t *light_field_slice(const light_field *field, uint32_t s, uint32_t t) {
  return field->codes + ((size_t)t * field->s_count + s) * field->u_count * field->v_count * 3;
}

slf_result light_field_read_slice(void *context, uint32_t s_index, uint32_t t_index, float *rgb,
                                  slf_error *error) {
  const light_field *field = context;
  const uint8_t *codes = light_field_slice(field, s_index, t_index);
  float linear[256];
  (void)error;
  for (int i = 0; i < 256; i++) linear[i] = slf_linear_from_srgb((uint8_t)i);
  size_t samples = (size_t)field->u_count * field->v_count * 3;
  for (size_t i = 0; i < samples; i++) rgb[i] = linear[codes[i]];
  return SLF_OK;
}
