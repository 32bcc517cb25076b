#include "depth_frames.h"

#include <math.h>
#include <stdlib.h>

static float dot(const float a[3], const float b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void normalise(float a[3]) {
  float length = sqrtf(dot(a, a));
  for (int k = 0; k < 3 && length > 0; k++) a[k] /= length;
}

static void blend(const slf_vertex *const v[3], const float w[3], depth_frame *out) {
  for (int k = 0; k < 3; k++) {
    out->position[k] = out->normal[k] = out->tangent_u[k] = 0;
    for (int i = 0; i < 3; i++) {
      out->position[k] += w[i] * v[i]->position[k];
      out->normal[k] += w[i] * v[i]->normal[k];
      out->tangent_u[k] += w[i] * v[i]->tangent_u[k];
    }
  }
  normalise(out->normal);
  float along = dot(out->tangent_u, out->normal);
  for (int k = 0; k < 3; k++) out->tangent_u[k] -= along * out->normal[k];
  normalise(out->tangent_u);
  /* Handedness carries no meaning: the mesh's own tangent_v says which it is. */
  float cross[3], side = 0;
  for (int k = 0; k < 3; k++) {
    int i = (k + 1) % 3, j = (k + 2) % 3;
    cross[k] = out->normal[i] * out->tangent_u[j] - out->normal[j] * out->tangent_u[i];
    side += cross[k] * v[0]->tangent_v[k];
  }
  for (int k = 0; k < 3; k++) out->tangent_v[k] = side < 0 ? -cross[k] : cross[k];
}

/* The frames of the texels whose centres the triangle covers. */
static void cover(const slf_mesh *mesh, const uint32_t *triangle, depth_frame *frames, bool *known,
                  uint32_t u_count, uint32_t v_count) {
  const slf_vertex *v[3];
  float x[3], y[3];
  for (int i = 0; i < 3; i++) {
    v[i] = &mesh->vertices[triangle[i]];
    x[i] = v[i]->u * (float)u_count - 0.5f, y[i] = v[i]->v * (float)v_count - 0.5f;
  }
  float area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
  if (area == 0) return;
  int left = (int)ceilf(fmaxf(fminf(x[0], fminf(x[1], x[2])), 0));
  int top = (int)ceilf(fmaxf(fminf(y[0], fminf(y[1], y[2])), 0));
  float right = fminf(fmaxf(x[0], fmaxf(x[1], x[2])), (float)u_count - 1);
  float bottom = fminf(fmaxf(y[0], fmaxf(y[1], y[2])), (float)v_count - 1);
  for (int j = top; (float)j <= bottom; j++)
    for (int i = left; (float)i <= right; i++) {
      float dx = (float)i - x[0], dy = (float)j - y[0], w[3];
      w[1] = (dx * (y[2] - y[0]) - (x[2] - x[0]) * dy) / area;
      w[2] = ((x[1] - x[0]) * dy - dx * (y[1] - y[0])) / area;
      w[0] = 1 - w[1] - w[2];
      const float hair = -1e-4f;
      if (!(w[0] >= hair && w[1] >= hair && w[2] >= hair)) continue;
      blend(v, w, &frames[(size_t)j * u_count + (size_t)i]);
      known[(size_t)j * u_count + (size_t)i] = true;
    }
}

/* From frame a to frame b, `steps` texels on, seen from the frame at: one column of how that
 * changes. */
static void differ(depth_frame *at, const depth_frame *a, const depth_frame *b, float steps,
                   int column) {
  float moved[3], tilted[3], turned[3];
  for (int k = 0; k < 3; k++) {
    moved[k] = (b->position[k] - a->position[k]) / steps;
    tilted[k] = (b->normal[k] - a->normal[k]) / steps;
    turned[k] = (b->tangent_u[k] - a->tangent_u[k]) / steps;
  }
  at->across[column] = dot(moved, at->tangent_u);
  at->across[2 + column] = dot(moved, at->tangent_v);
  at->bend[column] = dot(tilted, at->tangent_u);
  at->bend[2 + column] = dot(tilted, at->tangent_v);
  at->turn[column] = dot(turned, at->tangent_v);
}

depth_frame *depth_frames_create(const slf_mesh *mesh, uint32_t u_count, uint32_t v_count,
                                 bool wrap_u) {
  size_t count = (size_t)u_count * v_count;
  depth_frame *frames = calloc(count, sizeof *frames);
  bool *known = calloc(count, sizeof *known);
  if (!frames || !known) {
    free(frames);
    free(known);
    return NULL;
  }
  for (uint32_t i = 0; i < mesh->triangle_count; i++)
    cover(mesh, mesh->triangles + 3 * (size_t)i, frames, known, u_count, v_count);
  for (uint32_t j = 0; j < v_count; j++)
    for (uint32_t i = 0; i < u_count; i++) {
      size_t row = (size_t)j * u_count;
      size_t left = row + (i > 0 ? i - 1 : wrap_u ? u_count - 1 : i);
      size_t right = row + (i + 1 < u_count ? i + 1 : wrap_u ? 0 : i);
      size_t above = row + i - (j > 0 ? u_count : 0),
             below = row + i + (j + 1 < v_count ? u_count : 0);
      float columns = (i > 0 || wrap_u) + (i + 1 < u_count || wrap_u),
            rows = (j > 0) + (j + 1 < v_count);
      if (!known[row + i] || !known[left] || !known[right] || !known[above] || !known[below] ||
          columns == 0 || rows == 0)
        continue;
      differ(&frames[row + i], &frames[left], &frames[right], columns, 0);
      differ(&frames[row + i], &frames[above], &frames[below], rows, 1);
    }
  free(known);
  return frames;
}
