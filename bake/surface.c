#include "surface.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fail.h"

/* Rays of one run of POV-Ray: some 3 s of work, against 0.2 s to start and end. */
static const uint64_t planar_chunk_rays = 1u << 21;
/* POV-Ray keeps 270 bytes for each face of a curved surface's camera, and parses them alone. */
static const uint64_t curved_chunk_rays = 1u << 20;

/* POV-Ray's own language takes some 25 us to evaluate P(U,V) and its frame. */
static const uint64_t ray_part_samples = 1u << 17;

static const char *const name_characters =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-";

static void check_surface(const char *path, const scene *self, const surface *new) {
  if (new->name[0] == '-' || new->name[strspn(new->name, name_characters)])
    fail("%s: surface '%s': a name has letters, digits, _ and - only", path, new->name);
  if (scene_find(self, new->name)) fail("%s: two surfaces are called '%s'", path, new->name);
  if (new->u_count < 1 || new->u_count > SLF_MAX_TEXELS || new->v_count < 1 ||
      new->v_count > SLF_MAX_TEXELS)
    fail("%s: surface '%s': %u x %u texels, expected 1 to %d", path, new->name, new->u_count,
         new->v_count, SLF_MAX_TEXELS);
  if (new->s_count > SLF_MAX_DIRECTIONS || new->t_count > SLF_MAX_DIRECTIONS ||
      !new->s_count != !new->t_count)
    fail("%s: surface '%s': %u x %u directions, expected 1 to %d", path, new->name, new->s_count,
         new->t_count, SLF_MAX_DIRECTIONS);
}

static void read_vertices(FILE *file, const char *path, surface *self) {
  if (fscanf(file, "%u %u", &self->column_count, &self->row_count) != 2 || self->column_count < 2 ||
      self->row_count < 2)
    fail("%s: surface '%s': a mesh has at least 2 x 2 vertices", path, self->name);
  size_t count = (size_t)self->column_count * self->row_count;
  self->vertices = allocate(count, sizeof *self->vertices, path);
  for (size_t i = 0; i < count; i++) {
    slf_vertex *vertex = &self->vertices[i];
    float *values[5] = {vertex->position, vertex->normal, vertex->tangent_u, vertex->tangent_v,
                        &vertex->u};
    for (int j = 0; j < 14; j++) {
      float *value = j == 13 ? &vertex->v : &values[j / 3][j % 3];
      if (fscanf(file, "%f", value) != 1 || !isfinite(*value))
        fail("%s: surface '%s': vertex %zu: not a finite number", path, self->name, i);
    }
  }
}

static bool read_vector(FILE *file, double vector[3]) {
  return fscanf(file, "%lf %lf %lf", &vector[0], &vector[1], &vector[2]) == 3;
}

static void read_surface(FILE *file, const char *path, scene *self) {
  surface new = {0};
  int wrap_u, wrap_v;
  if (fscanf(file, "%63s %u %u %u %u %d %d", new.name, &new.u_count, &new.v_count, &new.s_count,
             &new.t_count, &wrap_u, &wrap_v) != 7)
    fail("%s: surface '%s': incomplete", path, new.name);
  check_surface(path, self, &new);
  if (self->surface_count == SLF_MAX_SURFACES)
    fail("%s: more than %d surfaces", path, SLF_MAX_SURFACES);
  new.flags = (wrap_u ? SLF_SURFACE_WRAP_U : 0u) | (wrap_v ? SLF_SURFACE_WRAP_V : 0u);
  self->surfaces = realloc(self->surfaces, (self->surface_count + 1) * sizeof new);
  if (!self->surfaces) fail("%s: no memory for %u surfaces", path, self->surface_count + 1);
  self->surfaces[self->surface_count++] = new;
}

static scene *read_description(const char *path) {
  FILE *file = fopen(path, "r");
  if (!file) fail("%s: cannot be opened", path);
  scene *self = allocate(1, sizeof *self, path);
  char word[SLF_NAME_NBYTES];
  while (fscanf(file, "%63s", word) == 1) {
    surface *last = self->surface_count ? &self->surfaces[self->surface_count - 1] : NULL;
    if (!strcmp(word, "surface")) {
      read_surface(file, path, self);
    } else if (!strcmp(word, "layers") && last) {
      if (fscanf(file, "%lf", &last->layers) != 1 || !(last->layers > 0))
        fail("%s: surface '%s': layers: expected a distance above 0", path, last->name);
    } else if (!strcmp(word, "auto") && last) {
      int layers;
      if (fscanf(file, "%lf %d", &last->auto_error, &layers) != 2 || !(last->auto_error > 0))
        fail("%s: surface '%s': auto: expected an error above 0, and 0 or 1", path, last->name);
      last->auto_layers = layers;
    } else if (!strcmp(word, "planar") && last) {
      last->planar = true;
      if (!read_vector(file, last->corner) || !read_vector(file, last->edge_u) ||
          !read_vector(file, last->edge_v))
        fail("%s: surface '%s': planar: expected three vectors", path, last->name);
    } else if (!strcmp(word, "grid") && last) {
      read_vertices(file, path, last);
    } else if (!strcmp(word, "water") && fscanf(file, "%63s", word) == 1) {
      surface *water = (surface *)scene_find(self, word);
      if (!water) fail("%s: Slf_Water: no surface is called '%s'", path, word);
      water->flags |= SLF_SURFACE_WATER;
    } else if (!strcmp(word, "slab") && fscanf(file, "%63s", word) == 1) {
      surface *pane = (surface *)scene_find(self, word);
      if (!pane || !pane->planar) fail("%s: Slf_Slab: no flat surface is called '%s'", path, word);
      if (fscanf(file, "%f %f", &pane->slab.thickness, &pane->slab.ior) != 2 ||
          !(pane->slab.thickness > 0) || !(pane->slab.ior > 1))
        fail("%s: Slf_Slab: '%s': expected a thickness above 0 and an index of refraction above 1",
             path, word);
    } else if (!strcmp(word, "hdr") && fscanf(file, "%63s", word) == 1) {
      surface *bright = (surface *)scene_find(self, word);
      if (!bright) fail("%s: Slf_Hdr: no surface is called '%s'", path, word);
      bright->hdr = true;
    } else if (!strcmp(word, "radiosity")) {
      self->radiosity = true;
    } else if (!strcmp(word, "photons")) {
      self->photons = true;
    } else if (!strcmp(word, "background")) {
      double rgb[3];
      if (!read_vector(file, rgb)) fail("%s: background: expected a colour", path);
      for (int i = 0; i < 3; i++) self->background[i] = (float)rgb[i];
    } else {
      fail("%s: '%s' was not expected", path, word);
    }
  }
  fclose(file);
  for (uint32_t i = 0; i < self->surface_count; i++)
    if (!self->surfaces[i].vertices)
      fail("%s: surface '%s': has no mesh", path, self->surfaces[i].name);
  return self;
}

static void read_choice(const char *folder, surface *self) {
  if (!self->auto_error) return;
  char *path = format_text("%s/%s/choice", folder, self->name);
  FILE *file = fopen(path, "r");
  if (file) {
    double layers = 0;
    if (fscanf(file, "%u %u %lf", &self->s_count, &self->t_count, &layers) < 2)
      fail("%s: expected two numbers of directions", path);
    if (layers > 0) self->layers = layers, self->layers_are_chosen = true;
    fclose(file);
  }
  free(path);
}

scene *scene_read(const char *folder) {
  char *path = format_text("%s/scene.txt", folder);
  scene *self = read_description(path);
  for (uint32_t i = 0; i < self->surface_count; i++) {
    read_choice(folder, &self->surfaces[i]);
    if (surface_has_layers(&self->surfaces[i]) && self->surfaces[i].hdr &&
        !self->surfaces[i].layers_are_chosen)
      fail("%s: surface '%s': layers do not keep radiance above 1: Slf_Hdr or Slf_Layers, not both",
           path, self->surfaces[i].name);
  }
  free(path);
  return self;
}

void scene_free(scene *self) {
  if (!self) return;
  for (uint32_t i = 0; i < self->surface_count; i++) free(self->surfaces[i].vertices);
  free(self->surfaces);
  free(self);
}

surface *surface_read(const char *folder, const char *name) {
  char *path = format_text("%s/%s/surface.txt", folder, name);
  scene *whole = read_description(path);
  if (whole->surface_count != 1) fail("%s: expected one surface", path);
  surface *self = whole->surfaces;
  read_choice(folder, self);
  free(whole);
  free(path);
  return self;
}

void surface_free(surface *self) {
  free(self->vertices);
  free(self);
}

const surface *scene_find(const scene *self, const char *name) {
  for (uint32_t i = 0; i < self->surface_count; i++)
    if (!strcmp(self->surfaces[i].name, name)) return &self->surfaces[i];
  return NULL;
}

bool surface_has_layers(const surface *self) {
  return self->layers > 0 && self->s_count * self->t_count > 1;
}

uint32_t surface_rays(const surface *self, uint32_t asked) {
  return surface_has_layers(self) ? 1 : asked;
}

uint32_t surface_part_count(const surface *self, uint32_t asked_rays) {
  if (!surface_has_layers(self)) return 1;
  return asked_rays > 1 ? PART_COVERAGE + 1 : PART_COVERAGE;
}

int64_t surface_texel(const surface *self, int64_t i, int64_t j) {
  int64_t u_count = self->u_count, v_count = self->v_count;
  if (self->flags & SLF_SURFACE_WRAP_U) i = (i + u_count) % u_count;
  if (self->flags & SLF_SURFACE_WRAP_V) j = (j + v_count) % v_count;
  return i < 0 || i >= u_count || j < 0 || j >= v_count ? -1 : j * u_count + i;
}

slice *surface_slices(const surface *self, uint32_t *slice_count) {
  slice *slices = allocate((size_t)self->s_count * self->t_count, sizeof *slices, self->name);
  *slice_count = 0;
  for (uint32_t t = 0; t < self->t_count; t++)
    for (uint32_t s = 0; s < self->s_count; s++)
      if (slf_slice_exists(self->s_count, self->t_count, s, t))
        slices[(*slice_count)++] = (slice){(uint16_t)s, (uint16_t)t};
  return slices;
}

uint32_t surface_slices_per_chunk(const surface *self, uint32_t asked_rays) {
  uint64_t slice_rays = (uint64_t)self->u_count * self->v_count * asked_rays;
  uint64_t count = (self->planar ? planar_chunk_rays : curved_chunk_rays) / slice_rays;
  return count > 1 ? (uint32_t)count : 1;
}

uint32_t surface_chunk_count(const surface *self, uint32_t asked_rays) {
  uint32_t slice_count, per_chunk = surface_slices_per_chunk(self, asked_rays);
  free(surface_slices(self, &slice_count));
  return (slice_count + per_chunk - 1) / per_chunk;
}

chunk_range surface_chunk(const surface *self, uint32_t asked_rays, uint32_t chunk_index) {
  uint32_t slice_count, per_chunk = surface_slices_per_chunk(self, asked_rays);
  free(surface_slices(self, &slice_count));
  uint32_t first = chunk_index * per_chunk;
  if (first >= slice_count) fail("surface '%s' has no chunk %u", self->name, chunk_index);
  uint32_t left = slice_count - first;
  return (chunk_range){first, left < per_chunk ? left : per_chunk};
}

static uint32_t rows_per_part(const surface *self, uint32_t rays) {
  uint64_t count = ray_part_samples / ((uint64_t)self->u_count * rays);
  return count > 1 ? (uint32_t)count : 1;
}

uint32_t surface_ray_part_count(const surface *self, uint32_t rays) {
  uint32_t per_part = rows_per_part(self, rays);
  return self->planar ? 0 : (self->v_count + per_part - 1) / per_part;
}

row_range surface_ray_rows(const surface *self, uint32_t rays, uint32_t part_index) {
  uint32_t per_part = rows_per_part(self, rays);
  uint32_t first = part_index * per_part, left = self->v_count - first;
  if (first >= self->v_count) fail("surface '%s' has no rays %u", self->name, part_index);
  return (row_range){first, left < per_part ? left : per_part};
}

double surface_extent(const surface *self) {
  double largest = 0;
  for (size_t i = 0; i < (size_t)self->column_count * self->row_count; i++)
    for (int axis = 0; axis < 3; axis++)
      largest = fmax(largest, fabs(self->vertices[i].position[axis]));
  return largest;
}

double surface_ray_start(const surface *self) {
  return fmax(1e-3, 2e-5 * surface_extent(self));
}
