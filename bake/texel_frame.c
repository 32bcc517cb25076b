#include "texel_frame.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "fail.h"
#include "sample.h"

float *texel_frames_read(const char *folder, const surface *self, uint32_t table_rays) {
  if (self->planar) return NULL;
  char *path = format_text("%s/%s/rays", folder, self->name);
  size_t count = (size_t)self->u_count * self->v_count * table_rays * 12;
  float *values = allocate(count, sizeof *values, path);
  FILE *file = fopen(path, "rb");
  if (!file) fail("%s: cannot be read", path);
  if (fread(values, sizeof *values, count, file) != count || fgetc(file) != EOF)
    fail("%s: expected %zu numbers", path, count);
  fclose(file);
  free(path);
  return values;
}

static void normalise(double vector[3]) {
  double length = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
  for (int i = 0; i < 3; i++) vector[i] /= length;
}

static texel_frame frame_of_plane(const surface *self, uint32_t rays, size_t ray) {
  const slf_vertex *vertex = &self->vertices[0];
  double uv[SAMPLE_MAX_RAYS][2];
  sample_texel_offsets(rays, uv);
  const size_t texel = ray / rays;
  const double u = ((double)(texel % self->u_count) + uv[ray % rays][0]) / self->u_count;
  const double v = ((double)(texel / self->u_count) + uv[ray % rays][1]) / self->v_count;
  texel_frame at;
  for (int i = 0; i < 3; i++) {
    at.position[i] = self->corner[i] + u * self->edge_u[i] + v * self->edge_v[i];
    at.normal[i] = vertex->normal[i];
    at.tangent_u[i] = vertex->tangent_u[i];
    at.tangent_v[i] = vertex->tangent_v[i];
  }
  normalise(at.normal), normalise(at.tangent_u), normalise(at.tangent_v);
  return at;
}

texel_frame texel_frame_of_ray(const surface *self, const float *table, uint32_t table_rays,
                               size_t ray) {
  if (self->planar) return frame_of_plane(self, table_rays, ray);
  const float *values = table + ray * 12;
  texel_frame at;
  for (int axis = 0; axis < 3; axis++) {
    at.position[axis] = values[axis];
    at.normal[axis] = values[3 + axis];
    at.tangent_u[axis] = values[6 + axis];
    at.tangent_v[axis] = values[9 + axis];
  }
  return at;
}

texel_frame texel_frame_of_centre(const surface *self, const float *table, uint32_t table_rays,
                                  size_t texel) {
  return texel_frame_of_ray(self, table, table_rays, texel * table_rays + table_rays / 2);
}

void texel_frame_to_scene(const texel_frame *at, const double stn[3], double direction[3]) {
  for (int i = 0; i < 3; i++)
    direction[i] = stn[0] * at->tangent_u[i] + stn[1] * at->tangent_v[i] + stn[2] * at->normal[i];
}
