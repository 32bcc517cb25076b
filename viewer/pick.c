#include "viewer/pick.h"

#include <math.h>

static void cross(const double a[3], const double b[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

static double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Moeller and Trumbore 1997. The distance along the ray, or INFINITY; a and b are the weights of
 * the second and third vertex. */
static double meet(const slf_vertex *p[3], const double origin[3], const double direction[3],
                   double *a, double *b) {
  double edge_a[3], edge_b[3], offset[3], plane[3], side[3];
  for (int k = 0; k < 3; k++) {
    edge_a[k] = (double)p[1]->position[k] - p[0]->position[k];
    edge_b[k] = (double)p[2]->position[k] - p[0]->position[k];
    offset[k] = origin[k] - p[0]->position[k];
    side[k] = (double)p[0]->normal[k] + p[1]->normal[k] + p[2]->normal[k];
  }
  cross(edge_a, edge_b, plane);
  if (dot(plane, direction) * (dot(plane, side) < 0 ? -1 : 1) >= 0) return INFINITY;
  double by_b[3], by_offset[3];
  cross(direction, edge_b, by_b);
  cross(offset, edge_a, by_offset);
  const double determinant = dot(edge_a, by_b);
  if (determinant == 0) return INFINITY;
  *a = dot(offset, by_b) / determinant;
  *b = dot(direction, by_offset) / determinant;
  if (!(*a >= 0) || !(*b >= 0) || !(*a + *b <= 1)) return INFINITY;
  const double distance = dot(edge_b, by_offset) / determinant;
  return distance > 0 ? distance : INFINITY;
}

bool pick_surface(const slf_file *file, const camera *c, double x_px, double y_px, int width_px,
                  int height_px, pick_hit *hit) {
  double origin[3], direction[3], nearest = INFINITY;
  const double x = (2 * x_px / width_px - 1) * c->tan_x, y = (1 - 2 * y_px / height_px) * c->tan_y;
  for (int k = 0; k < 3; k++) {
    origin[k] = c->location[k];
    direction[k] = c->forward[k] + x * c->right[k] + y * c->up[k];
  }
  for (uint32_t i = 0; i < slf_surface_count(file); i++) {
    const slf_mesh *mesh = &slf_get_surface(file, i)->mesh;
    for (size_t j = 0; j < mesh->triangle_count; j++) {
      const slf_vertex *p[3];
      double a = 0, b = 0;
      for (int k = 0; k < 3; k++) p[k] = &mesh->vertices[mesh->triangles[3 * j + (size_t)k]];
      const double distance = meet(p, origin, direction, &a, &b);
      if (!(distance < nearest)) continue;
      nearest = distance;
      *hit = (pick_hit){i, (float)(p[0]->u + a * (p[1]->u - p[0]->u) + b * (p[2]->u - p[0]->u)),
                        (float)(p[0]->v + a * (p[1]->v - p[0]->v) + b * (p[2]->v - p[0]->v))};
    }
  }
  return nearest < INFINITY;
}
