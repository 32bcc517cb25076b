/* ray_table - checks what POV-Ray wrote for ray_scene and writes it as floats: for each texel, for
 * each ray, position, normal, tangent_u, tangent_v. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "fail.h"
#include "surface.h"

static double dot(const float *a, const float *b) {
  return (double)a[0] * b[0] + (double)a[1] * b[1] + (double)a[2] * b[2];
}

/* eq. 1 needs an orthonormal frame; 1e-5 is what floats and ten decimals leave of it. */
static bool frame_is_orthonormal(const float *normal, const float *tangent_u,
                                 const float *tangent_v) {
  const double limit = 1e-5;
  return fabs(dot(normal, normal) - 1) < limit && fabs(dot(tangent_u, tangent_u) - 1) < limit &&
         fabs(dot(tangent_v, tangent_v) - 1) < limit && fabs(dot(normal, tangent_u)) < limit &&
         fabs(dot(normal, tangent_v)) < limit && fabs(dot(tangent_u, tangent_v)) < limit;
}

int main(int argc, char **argv) {
  if (argc != 6) {
    fputs("usage: ray_table FOLDER SURFACE RAYS PART TEXT > TABLE\n", stderr);
    return 2;
  }
  surface *self = surface_read(argv[1], argv[2]);
  uint32_t rays = (uint32_t)atoi(argv[3]);
  row_range rows = surface_ray_rows(self, rays, (uint32_t)atoi(argv[4]));
  FILE *text = fopen(argv[5], "r");
  if (!text) fail("%s: surface '%s': POV-Ray wrote no rays", argv[5], self->name);
  size_t count = (size_t)rows.count * self->u_count * rays;
  for (size_t i = 0; i < count; i++) {
    float values[12];
    size_t texel = i / rays;
    for (int j = 0; j < 12; j++)
      if (fscanf(text, "%f", &values[j]) != 1)
        fail("surface '%s': POV-Ray wrote %zu of %zu rays", self->name, i, count);
    if (!isfinite(dot(values, values)) || !frame_is_orthonormal(values + 3, values + 6, values + 9))
      fail("surface '%s', texel %zu,%zu: no orthonormal frame at P = %g %g %g", self->name,
           texel % self->u_count, rows.first + texel / self->u_count, values[0], values[1],
           values[2]);
    if (fwrite(values, sizeof values, 1, stdout) != 1)
      fail("surface '%s': its rays cannot be written", self->name);
  }
  fclose(text);
  if (fflush(stdout)) fail("surface '%s': its rays cannot be written", self->name);
  surface_free(self);
  return 0;
}
