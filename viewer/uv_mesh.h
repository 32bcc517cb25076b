/* uv_mesh.h - a surface's mesh, diced and scan-converted in texture space.
 *
 * A texture is made by interpolating (S,T) over polygons in (U,V) (paper, section 2.1). The
 * parametrisation never moves, so everything but the values of (S,T) is found once, at opening:
 * the polygons are diced to at most `dice_px` texels along a side, and for each block of 8x8
 * texels there is a list of the triangles that touch it with the set of texels whose centre each
 * one covers. A frame computes (S,T) at the vertices and looks up the rest.
 *
 * The fill rule is watertight: vertices are snapped to 1/256 texel, edge functions are exact
 * integers, and a centre on an edge belongs to one of the two triangles that share it. */
#ifndef UV_MESH_H
#define UV_MESH_H

#include "slf.h"

enum { UV_SNAP = 256, UV_DICE_PX = 8 };

/* A triangle's map from texel coordinates to barycentric ones, b1 = m[0] x + m[1] y and
 * b2 = m[2] x + m[3] y with (x, y) measured from (x0, y0) in texels. */
typedef struct {
  uint32_t vertex[3];
  uint32_t parent; /* the triangle of the slf_mesh that this is a piece of */
  float x0, y0, m[4];
} uv_triangle;

/* The texels of one block whose centre lies in one triangle: bit 8 * row + column. It may be empty:
 * the triangle then touches the block between centres. */
typedef struct {
  uint64_t mask;
  uint32_t triangle;
} uv_cover;

typedef struct {
  uint32_t u_count, v_count; /* texels */
  uint32_t block_u_count, block_v_count;
  slf_vertex *vertices;
  uint32_t vertex_count;
  uv_triangle *triangles;
  uint32_t triangle_count;
  uv_cover *covers;
  uint32_t *cover_start; /* block b = block_v * block_u_count + block_u has covers
                            cover_start[b] .. cover_start[b + 1] - 1 */
} uv_mesh;

/* Dices and scan-converts. dice_px is at least 1 texel. Memory grows with the number of texels over
 * dice_px squared. False if memory ran out. */
bool uv_mesh_create(uv_mesh *diced, const slf_mesh *mesh, uint32_t u_count, uint32_t v_count,
                    uint32_t dice_px);
void uv_mesh_free(uv_mesh *diced);

#endif
