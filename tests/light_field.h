/* light_field.h - what tests of light fields begin with: surfaces, and files of them. */
#ifndef TESTS_LIGHT_FIELD_H
#define TESTS_LIGHT_FIELD_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "slf.h"

/* A grid of columns x rows quads over (U,V), as slf.inc writes it. */
typedef struct {
  slf_mesh mesh;
  slf_vertex *vertices;
  uint32_t *triangles;
} grid;

/* P(u,v) with its frame. */
typedef slf_vertex (*surface_point)(float u, float v);

static inline grid make_grid(uint32_t columns, uint32_t rows, surface_point at) {
  grid g;
  g.vertices = calloc((columns + 1) * (rows + 1), sizeof *g.vertices);
  g.triangles = calloc(6 * columns * rows, sizeof *g.triangles);
  assert_true(g.vertices && g.triangles);
  uint32_t *triangle = g.triangles;
  for (uint32_t j = 0; j <= rows; j++)
    for (uint32_t i = 0; i <= columns; i++) {
      const uint32_t a = j * (columns + 1) + i, b = a + 1, c = a + columns + 1, d = c + 1;
      const float u = (float)i / (float)columns, v = (float)j / (float)rows;
      g.vertices[a] = at(u, v);
      g.vertices[a].u = u;
      g.vertices[a].v = v;
      if (i == columns || j == rows) continue;
      memcpy(triangle, (uint32_t[]){a, b, c, c, b, d}, 6 * sizeof *triangle);
      triangle += 6;
    }
  g.mesh = (slf_mesh){g.vertices, g.triangles, (columns + 1) * (rows + 1), 2 * columns * rows};
  return g;
}

static inline void free_grid(grid *g) {
  free(g->vertices);
  free(g->triangles);
}

/* The unit square of the plane y = 0, u along x, v along z. */
static inline slf_vertex square_at(float u, float v) {
  return (slf_vertex){
      .position = {u, 0, v}, .normal = {0, 1, 0}, .tangent_u = {1, 0, 0}, .tangent_v = {0, 0, 1}};
}

/* A surface of one layer. */
typedef struct {
  slf_surface surface;
  slf_layer_options layer;
  slf_source source;
} light_field;

static inline slf_result write_light_fields(const char *path, const light_field *fields,
                                            size_t count, slf_error *error) {
  slf_writer *writer;
  slf_result result = slf_writer_create(path, &writer, error);
  for (size_t i = 0; i < count && result == SLF_OK; i++) {
    result = slf_writer_add_surface(writer, &fields[i].surface, error);
    if (result == SLF_OK)
      result = slf_writer_add_layer(writer, &fields[i].layer, &fields[i].source, error);
  }
  if (result == SLF_OK) return slf_writer_finish(writer, error);
  slf_writer_abort(writer);
  return result;
}

/* Writes them under a name made of mkstemp's template and opens that: 0, or -1 with a message, as
 * cmocka wants of what sets up a group. */
static inline int make_light_fields(char *path, const light_field *fields, size_t count,
                                    slf_file **file) {
  slf_error error = {""};
  const int descriptor = mkstemp(path);
  if (descriptor < 0) return -1;
  close(descriptor);
  if (write_light_fields(path, fields, count, &error) == SLF_OK &&
      slf_open(path, file, &error) == SLF_OK)
    return 0;
  fprintf(stderr, "%s\n", error.message);
  return -1;
}

#endif
