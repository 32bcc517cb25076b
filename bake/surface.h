/* surface.h - the surfaces that a scene names, and how their rays are cut into chunks.
 *
 * The describe pass of slf.inc writes one text file for a scene:
 *   surface NAME TEXELS_U TEXELS_V DIRECTIONS_S DIRECTIONS_T WRAP_U WRAP_V
 *   layers DISTANCE                      (only if it is to be baked as layers)
 *   auto ERROR LAYERS                    (only if the directions are 0 x 0: to be chosen, and, if
 *                                         LAYERS is 1, whether it is baked as layers)
 *   planar CORNER EDGE_U EDGE_V          (only if P(U,V) = corner + U edge_u + V edge_v)
 *   grid COLUMNS ROWS                    then as many vertices, row by row:
 *   POSITION NORMAL TANGENT_U TANGENT_V U V
 *   radiosity, photons                   (only if the light pass is to fill their caches)
 *   water NAME
 *   slab NAME THICKNESS IOR
 *   hdr NAME
 *   background R G B
 * A chunk is what one run of POV-Ray renders: a few slices of one surface. */
#ifndef BAKE_SURFACE_H
#define BAKE_SURFACE_H

#include <stdbool.h>
#include <stdint.h>

#include "slf.h"

typedef struct {
  char name[SLF_NAME_NBYTES];
  uint32_t u_count, v_count; /* texels */
  uint32_t s_count, t_count; /* directions; 1 x 1: matte; 0 x 0: not chosen yet */
  bool hdr;                  /* radiance above 1 is kept */
  double auto_error;      /* what the choice of directions may cost (choose.c); 0: they are given */
  bool auto_layers;       /* whether layers are to be chosen too */
  uint32_t flags;         /* SLF_SURFACE_... */
  slf_slab slab;          /* thickness 0: it is no face of one */
  double layers;          /* 0: one layer; else about how far away what it reflects is (layers.c) */
  bool layers_are_chosen; /* not declared by the scene */
  bool planar;
  double corner[3], edge_u[3], edge_v[3]; /* of a planar surface */
  uint32_t column_count, row_count;       /* of the mesh */
  slf_vertex *vertices;                   /* row_count x column_count */
} surface;

typedef struct {
  uint32_t surface_count;
  surface *surfaces;
  float background[3];     /* linear */
  bool radiosity, photons; /* shared by all slices: the light pass fills their caches */
} scene;

/* Reads what the describe pass wrote, FOLDER/scene.txt, or the part of it on one surface,
 * FOLDER/NAME/surface.txt; ends the program with a line for what is wrong. Directions that are to
 * be chosen come from FOLDER/NAME/choice, and so do layers; they are 0 x 0 while there is none. */
scene *scene_read(const char *folder);
void scene_free(scene *);
surface *surface_read(const char *folder, const char *name);
void surface_free(surface *);
/* The surface called `name`, or NULL. */
const surface *scene_find(const scene *, const char *name);

/* Whether it is baked as layers; a matte one never is. */
bool surface_has_layers(const surface *);

/* How many of the rays that are asked for a sample its pictures take: layers take one, as several
 * that hit different things have no one height; all are sent once more where one would leave steps
 * (layers.c). Tables (rays, cover) have all that are asked for; what takes
 * one takes the middle one, which starts from the texel's centre (sample.h). */
uint32_t surface_rays(const surface *, uint32_t asked);

/* What a chunk has of each slice, below each other: of layers these, the last of them only if more
 * than one ray is asked for, as all of them tell it (outline.h); else one image. */
enum { PART_OWN, PART_REFLECTED, PART_HEIGHT, PART_COVERAGE };
uint32_t surface_part_count(const surface *, uint32_t asked_rays);

/* The texel at (i, j), wherever the surface wraps; -1 beyond its edge. */
int64_t surface_texel(const surface *, int64_t i, int64_t j);

typedef struct {
  uint16_t s, t;
} slice;

/* The slices of a surface that exist, t by t and s by s: the order in which they are cut into
 * chunks. The caller frees the list. */
slice *surface_slices(const surface *, uint32_t *slice_count);

/* How many slices a chunk of the surface has (the last one may have fewer), where so many rays a
 * sample are asked for. */
uint32_t surface_slices_per_chunk(const surface *, uint32_t asked_rays);

/* The slices of a chunk: surface_slices(...)[first .. first + count - 1]. */
typedef struct {
  uint32_t first, count;
} chunk_range;
chunk_range surface_chunk(const surface *, uint32_t asked_rays, uint32_t chunk_index);
uint32_t surface_chunk_count(const surface *, uint32_t asked_rays);

/* Rows of texels whose rays one run of POV-Ray evaluates, for a surface that is not planar. */
typedef struct {
  uint32_t first, count;
} row_range;
row_range surface_ray_rows(const surface *, uint32_t rays, uint32_t part_index);
uint32_t surface_ray_part_count(const surface *, uint32_t rays);

/* The largest coordinate of its mesh, in scene units. */
double surface_extent(const surface *);

/* Distance from the surface at which rays start, in scene units. POV-Ray ignores what is nearer
 * than 1e-4; a ray that starts 1e-3 away has always found the surface. It keeps a mesh_camera's
 * vertices in floats, whose steps must stay far below the height n_min times this distance. */
double surface_ray_start(const surface *);

#endif
