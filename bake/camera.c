/* camera - writes the scene that POV-Ray renders for one chunk of slices.
 *
 * A planar surface is seen by mesh_camera type 3: each (slice, ray of a sample) is one tile of the
 * frame, part of a triangle on the surface whose normals all point against the direction. A curved
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

#include "cover.h"
#include "fail.h"
#include "frame.h"
#include "outline.h"
#include "probe.h"
#include "sample.h"
#include "texel_frame.h"

/* What the camera sees: some texels of a surface from a list of views. */
typedef struct {
  const surface *self;
  texel_grid grid;
  view_list views;
  bool planar;        /* seen by tiles; else by faces */
  double reach;       /* rays end there; 0: nowhere */
  bool apart;         /* each ray of a curved surface's sample has an image of its own */
  const float *table; /* texel_frame.h */
  uint32_t table_rays;
  const uint32_t *sources; /* which ray to take for which (cover.h); NULL: itself */
  const uint32_t
      *places; /* which texel to take in each view for each of the grid's; NULL: itself */
} shot;

static void add_scaled(double sum[3], const double vector[3], double scale) {
  for (int i = 0; i < 3; i++) sum[i] += scale * vector[i];
}

static double normalise(double vector[3]) {
  double length = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
  for (int i = 0; i < 3; i++) vector[i] /= length;
  return length;
}

/* A tile is one triangle, half of a parallelogram twice the tile's size: it reaches from the tile's
 * lower left corner over the tile, and beyond it to the right and up, where tiles lie that come
 * before it in the list: POV-Ray takes the first that has the pixel. Its corners, in tiles: */
static const int tile_corners[3][2] = {{0, 1}, {2, 1}, {0, -1}};

/* Texel i of the grid, u = (u_first + i u_step + offset) / u_count, lies at the i-th pixel of the
 * tile; the tile reaches half a pixel further on each side. */
static void write_tile_vertices(const shot *self, const double uv[2], const double direction[3],
                                double start) {
  const surface *on = self->self;
  const texel_grid *grid = &self->grid;
  for (int corner = 0; corner < 3; corner++) {
    double i = tile_corners[corner][0] * (double)grid->u_count - 0.5;
    double j = tile_corners[corner][1] * (double)grid->v_count - 0.5;
    double origin[3];
    memcpy(origin, on->corner, sizeof origin);
    add_scaled(origin, on->edge_u, (grid->u_first + i * grid->u_step + uv[0]) / on->u_count);
    add_scaled(origin, on->edge_v, (grid->v_first + j * grid->v_step + uv[1]) / on->v_count);
    add_scaled(origin, direction, start);
    printf("<%.10g,%.10g,%.10g>\n", origin[0], origin[1], origin[2]);
  }
}

/* Of a frame with fog the first row, which nobody reads, looks from the surface's middle straight
 * up. POV-Ray finds the objects around the first ray's origin and takes them to be around all: a
 * corner texel's may lie in a wall, where no fog is. */
static void write_first_tile(const surface *self, const double normal[3]) {
  for (int corner = 0; corner < 3; corner++) {
    double origin[3];
    memcpy(origin, self->corner, sizeof origin);
    add_scaled(origin, self->edge_u, 0.5 + 0.5 * tile_corners[corner][0] / self->u_count);
    add_scaled(origin, self->edge_v, 0.5 + 0.5 * tile_corners[corner][1] / self->v_count);
    add_scaled(origin, normal, surface_ray_start(self));
    printf("<%.10g,%.10g,%.10g>\n", origin[0], origin[1], origin[2]);
  }
}

static void write_camera(const shot *self, uint32_t rays, int type) {
  printf("camera { mesh_camera { %u %d", rays, type);
  if (self->reach > 0) printf(" %.10g", self->reach);
  putchar('\n');
}

/* The i-th tile in the list: rows of tiles from the top, each from right to left, or they would
 * hide each other. Returns false where a row has no tile. */
static bool tile_in_list(uint32_t i, uint32_t columns, uint32_t count, uint32_t *tile) {
  *tile = i / columns * columns + (columns - 1 - i % columns);
  return *tile < count;
}

static void write_planar_camera(const shot *self, uint32_t width, uint32_t height, bool fogged) {
  uint32_t rays = self->views.rays, view_tile_count = self->views.view_count * rays;
  uint32_t tile_count = view_tile_count + fogged, columns = width / self->grid.u_count;
  uint32_t place_count = (view_tile_count + columns - 1) / columns * columns, tile;
  double uv[SAMPLE_MAX_RAYS][2], direction[3];
  double start = surface_ray_start(self->self);
  sample_texel_offsets(rays, uv);
  texel_frame at = texel_frame_of_centre(self->self, NULL, 1, 0);

  printf("#declare Slf_Tiles = mesh2 {\nvertex_vectors { %u\n", 3 * tile_count);
  if (fogged) write_first_tile(self->self, at.normal);
  for (uint32_t i = 0; i < place_count; i++) {
    if (!tile_in_list(i, columns, view_tile_count, &tile)) continue;
    texel_frame_to_scene(&at, self->views.stn[tile], direction);
    write_tile_vertices(self, uv[tile % rays], direction, start);
  }
  printf("}\nnormal_vectors { %u\n", tile_count);
  if (fogged) printf("<%.10g,%.10g,%.10g>\n", -at.normal[0], -at.normal[1], -at.normal[2]);
  for (uint32_t i = 0; i < place_count; i++) {
    if (!tile_in_list(i, columns, view_tile_count, &tile)) continue;
    texel_frame_to_scene(&at, self->views.stn[tile], direction);
    printf("<%.10g,%.10g,%.10g>\n", -direction[0], -direction[1], -direction[2]);
  }
  printf("}\nuv_vectors { %u\n", 3 * tile_count);
  /* Row 0 is looked up at y = 0.5, row 1 at y = 1. */
  for (int corner = 0; corner < 3 && fogged; corner++)
    printf("<%d,%.12g>\n", tile_corners[corner][0],
           1 - (0.25 + 0.5 * tile_corners[corner][1]) / height);
  for (uint32_t i = 0; i < place_count; i++) {
    uint32_t column, row;
    if (!tile_in_list(i, columns, view_tile_count, &tile)) continue;
    frame_tile(self->self, self->grid, rays, tile / rays, tile % rays, &column, &row);
    for (int corner = 0; corner < 3; corner++) {
      double x = column + tile_corners[corner][0] * (double)self->grid.u_count - 0.5;
      double y = 1 + row + tile_corners[corner][1] * (double)self->grid.v_count - 0.5;
      printf("<%.12g,%.12g>\n", x / width, 1 - y / height);
    }
  }
  printf("}\nface_indices { %u\n", tile_count);
  for (uint32_t i = 0; i < tile_count; i++) printf("<%u,%u,%u>\n", 3 * i, 3 * i + 1, 3 * i + 2);
  printf("}\nnormal_indices { %u\n", tile_count);
  for (uint32_t i = 0; i < tile_count; i++) printf("<%u,%u,%u>\n", i, i, i);
  printf("} }\n");
  write_camera(self, 1, 3);
  printf("mesh { Slf_Tiles } smooth } location 0 direction z }\n");
}

/* Vertices of a curved camera are whole numbers of a unit, which a scale of the mesh turns into
 * scene units: POV-Ray reads those in two thirds of the time. They stay below 2^23, so that they
 * are exact in the floats in which it keeps them, and so is all but the largest of sums of three. A
 * face is half as large as the surface's largest coordinate: directions are as exact as places. */
typedef struct {
  double per_scene_unit; /* a power of two */
  double face_size;      /* distance of a face's corners from its centroid, in these units */
} lattice;

static lattice lattice_of(const surface *self) {
  /* Between a mesh's vertices the surface may bulge: a factor of two has room for that. */
  int exponent;
  frexp(2 * surface_extent(self), &exponent);
  return (lattice){ldexp(1, 23 - exponent), ldexp(1, 21)};
}

static char *put_integer(char *to, long value) {
  char digits[24];
  int count = 0;
  unsigned long left = (unsigned long)(value < 0 ? -value : value);
  do digits[count++] = (char)('0' + left % 10);
  while (left /= 10);
  if (value < 0) *to++ = '-';
  while (count) *to++ = digits[--count];
  return to;
}

/* printf would take as long as the rest of the program. */
static void write_integers(const long vector[3]) {
  char line[80], *to = line;
  for (int axis = 0; axis < 3; axis++) {
    *to++ = axis ? ',' : '<';
    to = put_integer(to, vector[axis]);
  }
  *to++ = '>', *to++ = '\n';
  fwrite(line, 1, (size_t)(to - line), stdout);
}

/* A face whose centroid is the ray's origin and whose right-hand normal is the direction: POV-Ray
 * sends the ray against that. */
static void write_face(const lattice *on, const double origin[3], const double direction[3]) {
  int least = fabs(direction[0]) < fabs(direction[1]) ? 0 : 1;
  if (fabs(direction[2]) < fabs(direction[least])) least = 2;
  double a[3], b[3];
  int next = (least + 1) % 3, last = (least + 2) % 3;
  a[least] = 0, a[next] = -direction[last], a[last] = direction[next];
  normalise(a);
  b[0] = direction[1] * a[2] - direction[2] * a[1];
  b[1] = direction[2] * a[0] - direction[0] * a[2];
  b[2] = direction[0] * a[1] - direction[1] * a[0];
  long vertices[3][3];
  for (int axis = 0; axis < 3; axis++) {
    double centre = origin[axis] * on->per_scene_unit;
    double along = a[axis] * on->face_size, across = b[axis] * on->face_size * 0.8660254;
    vertices[0][axis] = lround(centre + along);
    vertices[1][axis] = lround(centre - 0.5 * along + across);
    vertices[2][axis] = lround(3 * centre) - vertices[0][axis] - vertices[1][axis];
  }
  for (int corner = 0; corner < 3; corner++) write_integers(vertices[corner]);
}

/* Ray m of texel i of the grid, in a view. */
static texel_frame frame_of_ray(const shot *self, uint32_t view, size_t i, uint32_t m) {
  const texel_grid *grid = &self->grid;
  uint32_t rays = self->views.rays;
  size_t u = grid->u_first + i % grid->u_count * grid->u_step;
  size_t v = grid->v_first + i / grid->u_count * grid->v_step;
  size_t texel = v * self->self->u_count + u;
  if (self->places) texel = self->places[(size_t)view * grid->u_count * grid->v_count + i];
  size_t ray = texel * rays + m;
  if (self->sources) ray = self->sources[ray];
  return rays == 1 ? texel_frame_of_centre(self->self, self->table, self->table_rays, ray)
                   : texel_frame_of_ray(self->self, self->table, self->table_rays, ray);
}

/* Against a direction of a frame, from where it leaves the surface. */
static void write_ray(const lattice *on, const texel_frame *at, const double stn[3], double start) {
  double direction[3], origin[3];
  texel_frame_to_scene(at, stn, direction);
  normalise(direction);
  memcpy(origin, at->position, sizeof origin);
  add_scaled(origin, direction, start);
  write_face(on, origin, direction);
}

static void write_view_faces(const shot *self, const lattice *on, uint32_t view, uint32_t m,
                             double start) {
  for (size_t i = 0; i < (size_t)self->grid.u_count * self->grid.v_count; i++) {
    texel_frame at = frame_of_ray(self, view, i, m);
    write_ray(on, &at, self->views.stn[view * self->views.rays + m], start);
  }
}

/* Scenes of before 1.5 had no expressions in vectors: POV-Ray then does not look for any. */
static void begin_meshes(void) {
  printf("#declare Slf_Version = version;\n#version 1.0;\n");
}

static void begin_mesh(uint32_t mesh, long face_count) {
  printf("#declare Slf_Rays_%u = mesh2 {\nvertex_vectors { %ld\n", mesh, 3 * face_count);
}

static void end_mesh(long face_count) {
  printf("}\nface_indices { %ld\n", face_count);
  for (long i = 0; i < face_count; i++)
    write_integers((const long[3]){3 * i, 3 * i + 1, 3 * i + 2});
  printf("}\nhierarchy off }\n");
}

static void end_meshes(const shot *self, const lattice *on, uint32_t mesh_count) {
  printf("#version Slf_Version;\n");
  write_camera(self, mesh_count, 0);
  for (uint32_t mesh = 0; mesh < mesh_count; mesh++)
    printf("mesh { Slf_Rays_%u scale %.17g }\n", mesh, 1 / on->per_scene_unit);
  printf("} location 0 direction z }\n");
}

/* Mesh m holds ray m of every texel of every view; apart, the one mesh holds ray after ray. */
static void write_curved_camera(const shot *self) {
  uint32_t rays = self->views.rays, view_count = self->views.view_count;
  uint32_t mesh_count = self->apart ? 1 : rays,
           images = self->apart ? rays * view_count : view_count;
  long face_count = (long)self->grid.u_count * self->grid.v_count * images;
  double start = surface_ray_start(self->self);
  lattice on = lattice_of(self->self);
  begin_meshes();
  for (uint32_t mesh = 0; mesh < mesh_count; mesh++) {
    begin_mesh(mesh, face_count);
    for (uint32_t k = 0; k < images; k++)
      write_view_faces(self, &on, self->apart ? k / rays : k, self->apart ? k % rays : mesh, start);
    end_mesh(face_count);
  }
  end_meshes(self, &on, mesh_count);
}

/* Every ray of a sample of each texel, by itself; views are those of a chunk of layers, one ray
 * each. What is left of the frame's last row looks where the first ray does. */
static void write_outline_camera(const shot *self, const outline_list *outlines) {
  const surface *of = self->self;
  const uint32_t rays = self->table_rays;
  const long used = 1 + (long)outlines->count * rays;
  const long face_count = (long)OUTLINE_FRAME_WIDTH * (outline_frame_height(outlines, rays) - 1);
  const size_t middle = (size_t)(of->v_count / 2) * of->u_count + of->u_count / 2;
  const texel_frame middle_frame = texel_frame_of_centre(of, self->table, rays, middle);
  const double up[3] = {0, 0, 1}, start = surface_ray_start(of);
  lattice on = lattice_of(of);
  begin_meshes();
  begin_mesh(0, face_count);
  write_ray(&on, &middle_frame, up, start);
  for (uint32_t i = 0; i < outlines->count; i++)
    for (uint32_t m = 0; m < rays; m++) {
      size_t ray = (size_t)outlines->texels[i].texel * rays + m;
      if (self->sources) ray = self->sources[ray];
      const texel_frame at = texel_frame_of_ray(of, self->table, rays, ray);
      write_ray(&on, &at, self->views.stn[outlines->texels[i].slice], start);
    }
  for (long i = used; i < face_count; i++) write_ray(&on, &middle_frame, up, start);
  end_mesh(face_count);
  end_meshes(self, &on, 1);
}

int main(int argc, char **argv) {
  if (argc != 6 && argc != 8 && argc != 9) {
    fputs("usage: camera FOLDER SURFACE RAYS SCENE.pov "
          "CHUNK|smooth-CHUNK|cover|light|probe|tests|match|cost\n"
          "              [FOG_DISTANCE FOG_GREY [OUTLINES]] > OUT.pov\n"
          "OUTLINES: of the chunk (outline.h), seen by all rays\n",
          stderr);
    return 2;
  }
  const char *folder = argv[1], *what = argv[5];
  surface *on = surface_read(folder, argv[2]);
  uint32_t table_rays = (uint32_t)atoi(argv[3]);
  uint32_t rays = table_rays, chunk, hole_count, width, height;
  if (strspn(what, "0123456789") == strlen(what)) rays = surface_rays(on, table_rays);
  if (!strcmp(what, "tests") || !strcmp(what, "match")) rays = 1;
  shot self = {.self = on, .grid = grid_of_all(on), .planar = on->planar, .table_rays = table_rays};
  float *table = texel_frames_read(folder, on, table_rays);
  uint32_t *sources = NULL, *places = NULL;
  outline_list outlines = {0};
  if (!strcmp(what, "cover")) {
    self.views = views_of_cover(rays);
    self.reach = COVER_REACH * surface_ray_start(on);
    self.apart = true;
  } else {
    sources = cover_sources(folder, on, table_rays, argc == 9 ? table_rays : rays, &hole_count);
    if (!strcmp(what, "probe"))
      self.views = probe_views(rays), self.grid = probe_grid(on);
    else if (!strcmp(what, "tests"))
      self.views = light_views(on, rays), self.grid = probe_grid(on);
    else if (!strcmp(what, "match"))
      self.views = match_views(), self.grid = probe_grid(on), self.planar = false,
      places = match_places_read(folder, on);
    else if (!strcmp(what, "light"))
      self.views = light_views(on, rays), self.grid = light_grid(on);
    else if (!strcmp(what, "cost"))
      self.views = light_views(on, rays), self.grid = cost_grid(on);
    else
      self.apart = chunk_is_smooth(what, &chunk),
      self.views = views_of_chunk(on, table_rays, rays, chunk);
  }
  self.table = table;
  self.sources = sources;
  self.places = places;

  /* The size of the frame, for whoever calls POV-Ray, and the number of its rays. */
  frame_size(self.planar, self.grid, &self.views, self.apart, &width, &height);
  uint32_t ray_count = self.grid.u_count * self.grid.v_count * self.views.view_count * rays;
  if (argc == 9) {
    outlines = outlines_read(argv[8], on, self.views.view_count);
    width = OUTLINE_FRAME_WIDTH, height = outline_frame_height(&outlines, table_rays);
    ray_count = width * (height - 1);
  }
  printf("// +W%u +H%u\n// %u\n#version 3.7;\n#declare Slf_Pass = %d;\n", width, height, ray_count,
         strcmp(what, "light") ? 3 : 4);
  printf("#declare Slf_Photon_Map = \"%s/light.photons\";\n#include \"%s\"\n", folder, argv[4]);
  if (argc >= 8) printf("fog { fog_type 1 distance %s rgb %s }\n", argv[6], argv[7]);
  if (argc == 9)
    write_outline_camera(&self, &outlines);
  else if (self.planar)
    write_planar_camera(&self, width, height, argc == 8);
  else
    write_curved_camera(&self);
  free(outlines.texels);
  free(self.views.stn);
  free(places);
  free(sources);
  free(table);
  surface_free(on);
  if (fflush(stdout) || ferror(stdout))
    fail("%s: the scene of its %s cannot be written", argv[2], what);
  return 0;
}
