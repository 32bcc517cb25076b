/* depth_frames.h - a curved surface's tangent frames, and how they change from texel to texel.
 *
 * A texel's neighbour at (e_u, e_v), in texels, lies across e away in the tangent plane, and its
 * frame is this one's but for a normal tilted by bend e and tangents turned by turn . e about it.
 */
#ifndef DEPTH_FRAMES_H
#define DEPTH_FRAMES_H

#include <stdbool.h>

#include "slf.h"

typedef struct {
  float position[3], normal[3], tangent_u[3], tangent_v[3]; /* at the texel's centre */
  float across[4]; /* scene units along tangent_u and tangent_v for a texel along u, along v:
                      {u_tu, v_tu, u_tv, v_tv} */
  float bend[4];   /* the same of the normal's tilt */
  float turn[2];   /* radians from tangent_u to tangent_v for a texel along u, along v */
  float rest[2];   /* 0: a frame is three times eight numbers, to be read as such */
} depth_frame;

/* Of each texel, row by row; NULL if memory ran out. `wrap_u`: u = 1 continues at u = 0. The caller
 * frees it. */
depth_frame *depth_frames_create(const slf_mesh *mesh, uint32_t u_count, uint32_t v_count,
                                 bool wrap_u);

#endif
