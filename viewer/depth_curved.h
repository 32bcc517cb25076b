/* depth_curved.h - a curved surface, eight lanes at once: its frames, and how far from them a
 * slice's ray meets a point.
 *
 * Part of depth_kernel.c, which alone includes it: once in each of its compilations. */
#ifndef DEPTH_CURVED_H
#define DEPTH_CURVED_H

#include <string.h>

#include "depth_lanes.h"

INLINE bool is_curved(const depth_field *field) {
  return !FLAT && field->frames;
}

/* Eight of a curved surface's frames: depth_frames.h. */
typedef union {
  struct {
    f8 position[3], normal[3], tangent_u[3], tangent_v[3], across[4], bend[4], turn[2];
  };
  f8 numbers[sizeof(depth_frame) / sizeof(float)];
} frame8;

/* Eight frames side by side, each number of theirs in a vector. */
INLINE void load_frames(const depth_frame *frames, const int32_t texel[LANES], frame8 *at) {
  enum { COUNT = sizeof(depth_frame) / sizeof(float) };
  _Static_assert(COUNT % LANES == 0, "frames are read by the vector");
#if defined(__AVX2__)
  for (int k = 0; k < COUNT; k += LANES) {
    __m256 a[LANES], b[LANES];
    for (int l = 0; l < LANES; l++)
      a[l] = _mm256_loadu_ps((const float *)(const void *)&frames[texel[l]] + k);
    for (int l = 0; l < LANES; l += 2) {
      b[l] = _mm256_unpacklo_ps(a[l], a[l + 1]);
      b[l + 1] = _mm256_unpackhi_ps(a[l], a[l + 1]);
    }
    for (int l = 0; l < LANES; l += 4)
      for (int i = 0; i < 2; i++) {
        a[l + 2 * i] = _mm256_shuffle_ps(b[l + i], b[l + 2 + i], 0x44);
        a[l + 2 * i + 1] = _mm256_shuffle_ps(b[l + i], b[l + 2 + i], 0xee);
      }
    for (int i = 0; i < 4; i++) {
      at->numbers[k + i] = _mm256_permute2f128_ps(a[i], a[i + 4], 0x20);
      at->numbers[k + i + 4] = _mm256_permute2f128_ps(a[i], a[i + 4], 0x31);
    }
  }
#else
  for (int l = 0; l < LANES; l++) {
    float of_one[COUNT];
    memcpy(of_one, &frames[texel[l]], sizeof of_one);
    for (int k = 0; k < COUNT; k++) at->numbers[k][l] = of_one[k];
  }
#endif
}

/* The texels of the light that are nearest to places, and how far from them those lie. */
typedef struct {
  int32_t texel[LANES];
  f8 e_u, e_v;
} nearest8;

INLINE nearest8 nearest_to(const depth_field *field, f8 x, f8 y) {
  const depth_pages *p = &field->pages;
  nearest8 at;
  f8 u = x + 0.5f, v = y + 0.5f;
  if (!FLAT && p->wrap_u) {
    f8 round = all((float)p->u_count);
    u = choose(u < all(0), u + round, choose(u >= round, u - round, u));
  }
  i8 i = to_int(smaller(larger(u, all(0)), all((float)p->u_count - 0.5f)));
  i8 j = to_int(smaller(larger(v, all(0)), all((float)p->v_count - 0.5f)));
  i8 number = j * (int32_t)p->u_count + i;
  memcpy(at.texel, &number, sizeof number);
  at.e_u = u - to_float(i) - 0.5f, at.e_v = v - to_float(j) - 0.5f;
  return at;
}

INLINE void prefetch_frames(const depth_frame *frames, const int32_t texel[LANES]) {
  for (int l = 0; l < LANES; l++) {
    __builtin_prefetch(&frames[texel[l]]);
    __builtin_prefetch((const char *)&frames[texel[l] + 1] - 1);
  }
}

/* The frames at texels (x, y) of the light: those of the nearest, moved on by how they change. */
static __attribute__((noinline)) void frames_at(const depth_field *field, const f8 *x, const f8 *y,
                                                frame8 *at) {
  const nearest8 nearest = nearest_to(field, *x, *y);
  const f8 e_u = nearest.e_u, e_v = nearest.e_v;
  load_frames(field->frames, nearest.texel, at);
  f8 right_u = at->across[0] * e_u + at->across[1] * e_v;
  f8 right_v = at->across[2] * e_u + at->across[3] * e_v;
  f8 tilt_u = at->bend[0] * e_u + at->bend[1] * e_v, tilt_v = at->bend[2] * e_u + at->bend[3] * e_v;
  f8 turn = at->turn[0] * e_u + at->turn[1] * e_v;
  for (int k = 0; k < 3; k++) {
    f8 n = at->normal[k], t_u = at->tangent_u[k], t_v = at->tangent_v[k];
    at->position[k] += t_u * right_u + t_v * right_v;
    at->normal[k] += t_u * tilt_u + t_v * tilt_v;
    at->tangent_u[k] += t_v * turn - n * tilt_u;
    at->tangent_v[k] -= t_u * turn + n * tilt_v;
  }
}

/* A point in frames: along their tangents, and above them. */
typedef struct {
  f8 u, v, height;
} place8;

INLINE f8 dot(const f8 a[3], const f8 b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* How many texels on a slice's ray, of slopes (q_u, q_v), meets the point, and how much higher the
 * point is there, to first order in frames at e, of which it leaves along -q + turn . e (q_v, -q_u)
 * + bend e in the tangent plane and rises by 1 + q . bend e: (across + h (bend + (q_v, -q_u) turn +
 * q (q . bend))) e = point + h q. */
INLINE void step_to(const frame8 *at, const place8 *point, f8 q_u, f8 q_v, f8 *e_u, f8 *e_v,
                    f8 *rise) {
  const f8 *p = at->across, *n = at->bend, *w = at->turn, h = point->height;
  f8 right_u = point->u + h * q_u, right_v = point->v + h * q_v;
  f8 rise_u = q_u * n[0] + q_v * n[2], rise_v = q_u * n[1] + q_v * n[3];
  f8 uu = p[0] + h * (n[0] + q_v * w[0] + q_u * rise_u),
     uv = p[1] + h * (n[1] + q_v * w[1] + q_u * rise_v);
  f8 vu = p[2] + h * (n[2] - q_u * w[0] + q_v * rise_u),
     vv = p[3] + h * (n[3] - q_u * w[1] + q_v * rise_v);
  f8 scale = 1.0f / (uu * vv - uv * vu);
  *e_u = (right_u * vv - right_v * uv) * scale, *e_v = (uu * right_v - vu * right_u) * scale;
  f8 shorten =
      (float)LONGEST_STEP / larger(larger(magnitude(*e_u), magnitude(*e_v)), all(LONGEST_STEP));
  *e_u *= shorten, *e_v *= shorten;
  *rise = (n[0] * *e_u + n[1] * *e_v) * point->u + (n[2] * *e_u + n[3] * *e_v) * point->v;
}

/* A search for where a slice sees a point. */
typedef struct {
  f8 q_u, q_v, x, y, expected;
  i8 moving;
  nearest8 nearest;
} meeting;

/* On from frames at texels (x, y), in which the point is at `at`. */
INLINE void step_meeting(meeting *m, const frame8 *frames, f8 x, f8 y, const place8 *at) {
  f8 e_u, e_v, rise;
  step_to(frames, at, m->q_u, m->q_v, &e_u, &e_v, &rise);
  x += e_u, y += e_v;
  f8 moved = larger(magnitude(x - m->x), magnitude(y - m->y));
  m->x = choose(m->moving, x, m->x), m->y = choose(m->moving, y, m->y);
  m->expected = at->height + rise;
  m->moving = ~(moved < all(SETTLED_TEXELS));
}

INLINE place8 place_in(const frame8 *frames, const f8 point[3]) {
  f8 off[3];
  for (int k = 0; k < 3; k++) off[k] = point[k] - frames->position[k];
  return (place8){dot(off, frames->tangent_u), dot(off, frames->tangent_v),
                  dot(off, frames->normal)};
}

#endif
