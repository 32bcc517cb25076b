/* water_mesh FILE.slf SURFACE SCRIPT OUT.inc - the water of a file at the end of a ripple script,
 * as POV-Ray understands it: the flat rectangle as a mesh2, with the ripples' normals at its
 * vertices, named Water_Mesh. Two vertices a texel along each side. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "viewer/water.h"

static int complain(const char *message) {
  fprintf(stderr, "water_mesh: %s\n", message);
  return 1;
}

/* Vertex i of n sits at (i + 0.5) / n, where its normal is known; the first and last at the edge.
 */
static float place(uint32_t i, uint32_t n) {
  return i == 0 ? 0 : i == n - 1 ? 1 : ((float)i + 0.5f) / (float)n;
}

static void write_mesh(FILE *out, const water_rectangle *r, uint32_t u_count, uint32_t v_count,
                       const float *slope_u, const float *slope_v) {
  fprintf(out, "#declare Water_Mesh = mesh2 {\n  vertex_vectors { %u\n", u_count * v_count);
  for (uint32_t j = 0; j < v_count; j++)
    for (uint32_t i = 0; i < u_count; i++) {
      const float x = place(i, u_count) * r->u_length, y = place(j, v_count) * r->v_length;
      fputs("    <", out);
      for (int k = 0; k < 3; k++)
        fprintf(out, "%.7g%s", r->corner[k] + x * r->along_u[k] + y * r->along_v[k],
                k < 2 ? "," : ">\n");
    }
  fprintf(out, "  }\n  normal_vectors { %u\n", u_count * v_count);
  for (size_t at = 0; at < (size_t)u_count * v_count; at++) {
    fputs("    <", out);
    for (int k = 0; k < 3; k++)
      fprintf(out, "%.7g%s",
              r->normal[k] - slope_u[at] * r->along_u[k] - slope_v[at] * r->along_v[k],
              k < 2 ? "," : ">\n");
  }
  fprintf(out, "  }\n  face_indices { %u\n", 2 * (u_count - 1) * (v_count - 1));
  for (uint32_t j = 0; j + 1 < v_count; j++)
    for (uint32_t i = 0; i + 1 < u_count; i++) {
      const uint32_t a = j * u_count + i, b = a + 1, c = a + u_count, d = c + 1;
      fprintf(out, "    <%u,%u,%u> <%u,%u,%u>\n", a, b, c, c, b, d);
    }
  fputs("  }\n}\n", out);
}

static uint32_t find_surface(const slf_file *file, const char *name) {
  uint32_t i = 0;
  while (i < slf_surface_count(file) && strcmp(slf_get_surface(file, i)->name, name)) i++;
  return i;
}

int main(int argc, char **argv) {
  if (argc != 5) return complain("expected FILE.slf SURFACE SCRIPT OUT.inc") + 1;
  slf_error error = {{0}};
  slf_file *file;
  ripple_script *script;
  water *w;
  if (slf_open(argv[1], &file, &error) != SLF_OK) return complain(error.message);
  const uint32_t surface = find_surface(file, argv[2]);
  if (surface == slf_surface_count(file)) return complain("no surface of that name");
  const slf_layer *layer = &slf_get_surface(file, surface)->layers[0];
  if (ripple_script_read(argv[3], &script, &error) != SLF_OK ||
      water_create(file, surface, layer->u_count, layer->v_count, 0, &w, &error) != SLF_OK)
    return complain(error.message);
  w->script = script;
  const double step_s = ripple_get_options(w->pond)->step_s;
  const uint64_t step_count = (uint64_t)llround(ripple_script_end_s(script) / step_s);
  while (w->step_index < step_count)
    if (water_step(w, &error) != SLF_OK) return complain(error.message);

  const uint32_t u_count = 2 * layer->u_count, v_count = 2 * layer->v_count;
  float *slopes = malloc(2 * (size_t)u_count * v_count * sizeof *slopes);
  FILE *out = fopen(argv[4], "w");
  if (!slopes || !out) return complain("cannot write");
  float *slope_v = slopes + (size_t)u_count * v_count;
  ripple_slopes(w->pond, u_count, v_count, slopes, slope_v, u_count);
  double sum = 0;
  for (size_t at = 0; at < (size_t)u_count * v_count; at++)
    sum += (double)slopes[at] * slopes[at] + (double)slope_v[at] * slope_v[at];
  write_mesh(out, &w->rectangle, u_count, v_count, slopes, slope_v);
  printf("%.4f\n", sqrt(sum / (u_count * v_count))); /* root mean square slope */
  free(slopes);
  water_free(w);
  ripple_script_free(script);
  slf_close(file);
  return fclose(out) == 0 ? 0 : complain("cannot write");
}
