/* camera - writes the scene that POV-Ray renders for one chunk of slices.
 *
 * A planar surface is seen by mesh_camera type 3: each (slice, ray of a sample) is one tile of the
 * frame, a parallelogram on the surface whose normals all point against the direction. A curved
 * one is seen by type 0: one face for each texel, one mesh for each ray of a sample. Both put the
 * ray's origin on P + start D and send it along -D; both are exact to float precision.
 *
 * Two rules of POV-Ray 3.7's mesh_camera (source/backend/render/tracepixel.cpp): its image row 0
 * repeats row 1, in type 3 also the last column its neighbour, so a frame has one row more at the
 * top, and in type 3 one column more at the right; type 3 looks at the pixel's left edge. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fail.h"
#include "sample.h"
#include "surface.h"

/* Slices at the rim are seen from here, so that each has real data (n of eq. 1). */
static const double n_min = SLF_BAKED_N_MIN;

typedef struct {
  double position[3], normal[3], tangent_u[3], tangent_v[3];
} frame;

static void add_scaled(double sum[3], const double vector[3], double scale) {
  for (int i = 0; i < 3; i++) sum[i] += scale * vector[i];
}

static double normalise(double vector[3]) {
  double length = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
  for (int i = 0; i < 3; i++) vector[i] /= length;
  return length;
}

/* The direction of a frame for eq. 1's (s, t, n), in scene coordinates. */
static void to_scene(const frame *at, const double stn[3], double direction[3]) {
  memset(direction, 0, 3 * sizeof *direction);
  add_scaled(direction, at->tangent_u, stn[0]);
  add_scaled(direction, at->tangent_v, stn[1]);
  add_scaled(direction, at->normal, stn[2]);
}

/* (s, t, n) of every ray of a sample in one slice. A matte surface is seen along its normal. */
static void slice_directions(const surface *self, slice at, uint32_t rays, double (*stn)[3]) {
  double st[SAMPLE_MAX_RAYS][2];
  sample_cell_offsets(rays, at.s, at.t, st);
  bool matte = self->s_count == 1 && self->t_count == 1;
  for (uint32_t m = 0; m < rays; m++) {
    if (surface_has_layers(self)) /* what blurs over a cell's directions has no one height */
      st[m][0] = st[m][1] = 0.5;
    if (matte)
      memcpy(stn[m], (double[3]){0, 0, 1}, sizeof stn[m]);
    else
      slf_direction((at.s + st[m][0]) / self->s_count, (at.t + st[m][1]) / self->t_count, n_min,
                    stn[m]);
  }
}

static void frame_of_vertex(const slf_vertex *vertex, frame *out) {
  for (int i = 0; i < 3; i++) {
    out->normal[i] = vertex->normal[i];
    out->tangent_u[i] = vertex->tangent_u[i];
    out->tangent_v[i] = vertex->tangent_v[i];
  }
  normalise(out->normal), normalise(out->tangent_u), normalise(out->tangent_v);
}

/* A tile: texel i at u = (i + uv_offset) / u_count lies at pixel column x + i, rows alike. */
static void write_tile_vertices(const surface *self, const double uv[2], const double direction[3],
                                double start) {
  for (int corner = 0; corner < 4; corner++) {
    double u = ((corner & 1 ? self->u_count - 0.5 : -0.5) + uv[0]) / self->u_count;
    double v = ((corner & 2 ? self->v_count - 0.5 : -0.5) + uv[1]) / self->v_count;
    double origin[3];
    memcpy(origin, self->corner, sizeof origin);
    add_scaled(origin, self->edge_u, u);
    add_scaled(origin, self->edge_v, v);
    add_scaled(origin, direction, start);
    printf("<%.10g,%.10g,%.10g>\n", origin[0], origin[1], origin[2]);
  }
}

/* Of a frame with fog the first row, which nobody reads, looks from the middle straight up. POV-Ray
 * finds the objects around the first ray's origin and takes them to be around all: a corner texel's
 * may lie in a wall, where no fog is. */
static void write_first_tile_vertices(const surface *self) {
  const slf_vertex *vertex = &self->vertices[0];
  const double normal[3] = {vertex->normal[0], vertex->normal[1], vertex->normal[2]};
  for (int corner = 0; corner < 4; corner++) {
    double origin[3];
    memcpy(origin, self->corner, sizeof origin);
    add_scaled(origin, self->edge_u, 0.5 + 0.5 * (corner & 1) / self->u_count);
    add_scaled(origin, self->edge_v, 0.5 + 0.25 * (corner & 2) / self->v_count);
    add_scaled(origin, normal, surface_ray_start(self));
    printf("<%.10g,%.10g,%.10g>\n", origin[0], origin[1], origin[2]);
  }
}

static void write_planar_camera(const surface *self, const slice *slices, uint32_t slice_count,
                                uint32_t rays, bool fogged) {
  uint32_t width = self->u_count * rays + 1, height = self->v_count * slice_count + 1;
  uint32_t tile_count = slice_count * rays + fogged;
  double uv[SAMPLE_MAX_RAYS][2], stn[SAMPLE_MAX_RAYS][3], direction[3];
  double start = surface_ray_start(self);
  sample_texel_offsets(rays, uv);
  frame at;
  frame_of_vertex(&self->vertices[0], &at);

  printf("#declare Slf_Tiles = mesh2 {\nvertex_vectors { %u\n", 4 * tile_count);
  if (fogged) write_first_tile_vertices(self);
  for (uint32_t k = 0; k < slice_count; k++) {
    slice_directions(self, slices[k], rays, stn);
    for (uint32_t m = 0; m < rays; m++) {
      to_scene(&at, stn[m], direction);
      write_tile_vertices(self, uv[m], direction, start);
    }
  }
  printf("}\nnormal_vectors { %u\n", tile_count);
  if (fogged) printf("<%.10g,%.10g,%.10g>\n", -at.normal[0], -at.normal[1], -at.normal[2]);
  for (uint32_t k = 0; k < slice_count; k++) {
    slice_directions(self, slices[k], rays, stn);
    for (uint32_t m = 0; m < rays; m++) {
      to_scene(&at, stn[m], direction);
      printf("<%.10g,%.10g,%.10g>\n", -direction[0], -direction[1], -direction[2]);
    }
  }
  printf("}\nuv_vectors { %u\n", 4 * tile_count);
  /* Row 0 is looked up at y = 0.5, row 1 at y = 1; the first tile that has the place is taken. */
  for (int corner = 0; corner < 4 && fogged; corner++)
    printf("<%d,%.12g>\n", corner & 1, 1 - (corner & 2 ? 0.75 : 0.25) / height);
  for (uint32_t k = 0; k < slice_count; k++) {
    for (uint32_t m = 0; m < rays; m++) {
      for (int corner = 0; corner < 4; corner++) {
        double x = m * self->u_count + (corner & 1 ? self->u_count - 0.5 : -0.5);
        double y = 1 + k * self->v_count + (corner & 2 ? self->v_count - 0.5 : -0.5);
        printf("<%.12g,%.12g>\n", x / width, 1 - y / height);
      }
    }
  }
  printf("}\nface_indices { %u\n", 2 * tile_count);
  for (uint32_t i = 0; i < tile_count; i++) {
    uint32_t c = 4 * i;
    printf("<%u,%u,%u>\n<%u,%u,%u>\n", c, c + 1, c + 2, c + 1, c + 3, c + 2);
  }
  printf("}\nnormal_indices { %u\n", 2 * tile_count);
  for (uint32_t i = 0; i < tile_count; i++) printf("<%u,%u,%u>\n<%u,%u,%u>\n", i, i, i, i, i, i);
  printf("} }\ncamera { mesh_camera { 1 3 mesh { Slf_Tiles } smooth } location 0 direction z }\n");
}

/* A face whose centroid is the ray's origin and whose right-hand normal is the direction: POV-Ray
 * sends the ray against that. */
static void write_face(const double origin[3], const double direction[3]) {
  int least = fabs(direction[0]) < fabs(direction[1]) ? 0 : 1;
  if (fabs(direction[2]) < fabs(direction[least])) least = 2;
  double a[3], b[3];
  int next = (least + 1) % 3, last = (least + 2) % 3;
  a[least] = 0, a[next] = -direction[last], a[last] = direction[next];
  normalise(a);
  b[0] = direction[1] * a[2] - direction[2] * a[1];
  b[1] = direction[2] * a[0] - direction[0] * a[2];
  b[2] = direction[0] * a[1] - direction[1] * a[0];
  const double turn[3][2] = {{1, 0}, {-0.5, 0.8660254}, {-0.5, -0.8660254}};
  for (int corner = 0; corner < 3; corner++) {
    double vertex[3];
    memcpy(vertex, origin, sizeof vertex);
    add_scaled(vertex, a, turn[corner][0]);
    add_scaled(vertex, b, turn[corner][1]);
    printf("<%.8g,%.8g,%.8g>\n", vertex[0], vertex[1], vertex[2]);
  }
}

/* The frames of all rays of all texels: texel by texel, its rays together, as floats. */
static float *read_rays(const char *path, const surface *self, uint32_t rays) {
  size_t count = (size_t)self->u_count * self->v_count * rays * 12;
  float *values = allocate(count, sizeof *values, path);
  FILE *file = fopen(path, "rb");
  if (!file) fail("%s: cannot be read", path);
  if (fread(values, sizeof *values, count, file) != count || fgetc(file) != EOF)
    fail("%s: expected %zu numbers", path, count);
  fclose(file);
  return values;
}

static void frame_of_ray(const float values[12], frame *out) {
  for (int i = 0; i < 3; i++) {
    out->position[i] = values[i];
    out->normal[i] = values[3 + i];
    out->tangent_u[i] = values[6 + i];
    out->tangent_v[i] = values[9 + i];
  }
}

static void write_curved_camera(const surface *self, const slice *slices, uint32_t slice_count,
                                uint32_t rays, const float *table) {
  size_t texel_count = (size_t)self->u_count * self->v_count;
  double stn[SAMPLE_MAX_RAYS][3];
  double start = surface_ray_start(self);
  for (uint32_t m = 0; m < rays; m++) {
    printf("#declare Slf_Rays_%u = mesh2 {\nvertex_vectors { %zu\n", m,
           3 * texel_count * slice_count);
    for (uint32_t k = 0; k < slice_count; k++) {
      slice_directions(self, slices[k], rays, stn);
      for (size_t i = 0; i < texel_count; i++) {
        frame at;
        double direction[3];
        frame_of_ray(table + (i * rays + m) * 12, &at);
        to_scene(&at, stn[m], direction);
        normalise(direction);
        add_scaled(at.position, direction, start);
        write_face(at.position, direction);
      }
    }
    printf("}\nface_indices { %zu\n", texel_count * slice_count);
    for (size_t i = 0; i < texel_count * slice_count; i++)
      printf("<%zu,%zu,%zu>\n", 3 * i, 3 * i + 1, 3 * i + 2);
    printf("}\nhierarchy off }\n");
  }
  printf("camera { mesh_camera { %u 0\n", rays);
  for (uint32_t m = 0; m < rays; m++) printf("mesh { Slf_Rays_%u }\n", m);
  printf("} location 0 direction z }\n");
}

int main(int argc, char **argv) {
  if (argc != 6 && argc != 8) {
    fputs("usage: camera SURFACE.txt RAYTABLE SCENE.pov RAYS CHUNK [FOG_DISTANCE FOG_GREY] > CHUNK.pov\n",
          stderr);
    return 2;
  }
  uint32_t rays = (uint32_t)atoi(argv[4]), slice_count;
  scene *whole = scene_read(argv[1]);
  const surface *self = &whole->surfaces[0];
  slice *slices = surface_slices(self, &slice_count);
  chunk_range range = surface_chunk(self, rays, (uint32_t)atoi(argv[5]));

  /* The size of the frame, for whoever calls POV-Ray. */
  printf("// +W%u +H%u\n", self->planar ? self->u_count * rays + 1 : self->u_count,
         self->v_count * range.count + 1);
  printf("#version 3.7;\n#declare Slf_Pass = 3;\n#include \"%s\"\n", argv[3]);
  if (argc == 8) printf("fog { fog_type 1 distance %s rgb %s }\n", argv[6], argv[7]);
  if (self->planar) {
    write_planar_camera(self, slices + range.first, range.count, rays, argc == 8);
  } else {
    float *table = read_rays(argv[2], self, rays);
    write_curved_camera(self, slices + range.first, range.count, rays, table);
    free(table);
  }
  free(slices);
  scene_free(whole);
  if (fflush(stdout) || ferror(stdout))
    fail("%s: the scene of chunk %s cannot be written", self->name, argv[5]);
  return 0;
}
