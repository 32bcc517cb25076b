/* slf.h - surface light fields, compressed in blocks that decompress one by one.
 *
 * A surface light field is the radiance that leaves each point P(U,V) of a surface in each
 * direction (S,T) of its hemisphere (Miller, Rubin, Ponceleon 1998, section 2). A .slf file holds
 * the surfaces of one scene: for each a mesh with tangent frames, and one or more layers. A layer
 * is an array of s_count x t_count slices; a slice is an image of u_count x v_count texels, cut
 * into C-Blocks of 8x8 texels. A matte layer has one slice.
 *
 * Order of axes everywhere: u v s t. In an image u runs along a row and v down the rows.
 * Texel i of N sits at u = (i + 0.5) / N, slice i of N at S = (i + 0.5) / N.
 *
 * Errors: a function that can fail returns a slf_result and, if error is not NULL, fills its one
 * line: file, thing, numbers. *error is untouched on success. The library never prints or exits.
 *
 * Threads: a slf_file is immutable once open; any number of threads may read it without locks.
 * A slf_writer belongs to one thread at a time.
 *
 * Trust: a .slf file is untrusted. Any bytes are either refused or decoded to some texels, with
 * bounded work and memory and no access out of bounds. FORMAT.md is the format, byte by byte. */
#ifndef SLF_H
#define SLF_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

enum {
  SLF_BLOCK_SIDE = 8,       /* texels along a side of a block */
  SLF_BLOCK_NBYTES = 256,   /* one U-Block: 8 rows of 8 texels R G B X, X = 255 */
  SLF_NAME_NBYTES = 64,     /* longest name, its terminating zero included */
  SLF_MAX_TEXELS = 16384,   /* largest u_count and v_count */
  SLF_MAX_DIRECTIONS = 256, /* largest s_count and t_count */
  SLF_MAX_SURFACES = 4096,
  SLF_MAX_LAYERS = 8
};

typedef enum {
  SLF_OK = 0,
  SLF_ERROR_IO,       /* the system refused: open, read, write, rename */
  SLF_ERROR_FORMAT,   /* the bytes are not a .slf file of a known version */
  SLF_ERROR_CHECKSUM, /* a chunk's bytes are not the ones that were written */
  SLF_ERROR_MEMORY,   /* allocation failed */
  SLF_ERROR_ARGUMENT, /* the caller asked for something that does not exist */
  SLF_ERROR_PARTIAL   /* of a file that is not all there: more bytes are needed for this */
} slf_result;

typedef struct {
  char message[512]; /* one line, no newline at its end */
} slf_error;

/* ---- Geometry ------------------------------------------------------------------------------ */

/* A vertex of a surface's mesh. The frame is orthonormal (eq. 1 needs it):
 * D = s tangent_u + t tangent_v + n normal. Positions in scene units; u, v in [0,1]. */
typedef struct {
  float position[3];
  float normal[3];
  float tangent_u[3];
  float tangent_v[3];
  float u, v;
} slf_vertex;

typedef struct {
  const slf_vertex *vertices;
  const uint32_t *triangles; /* 3 indices a triangle; winding carries no meaning: normal does */
  uint32_t vertex_count;
  uint32_t triangle_count;
} slf_mesh;

enum {
  SLF_SURFACE_WRAP_U = 1, /* u = 1 continues at u = 0 */
  SLF_SURFACE_WRAP_V = 2,
  SLF_SURFACE_WATER = 4 /* the viewer may ripple it */
};

/* ---- Layers -------------------------------------------------------------------------------- */

/* What a layer holds. A surface's radiance is the sum of its layers of radiance. */
typedef enum {
  SLF_ROLE_FULL = 0,      /* all of it: the paper's way */
  SLF_ROLE_OWN = 1,       /* diffuse, highlight, emission */
  SLF_ROLE_REFLECTED = 2, /* what it reflects or refracts */
  /* Not radiance: for the reflected layer before it, of which it has the directions and the shape
   * of the texels, the height over the surface's tangent plane of what each sample reflects:
   * height_unit * c / (256 - c) scene units for the stored code c. */
  SLF_ROLE_HEIGHT = 3,
  /* Gray: how much of each texel shows something else than what its height is of. Of code
   * SLF_COVERED_BY_NONE + k, k / 127 of it lower things; of SLF_COVERED_BY_NONE - k, higher ones.
   */
  SLF_ROLE_COVERAGE = 4
} slf_role;

#define SLF_COVERED_BY_NONE 128
/* Heights whose codes are further apart than this are taken to be of two things. */
#define SLF_THING_CODES 12

/* How radiance is stored. */
typedef enum {
  SLF_CURVE_SRGB = 0, /* LDR: the sRGB curve of IEC 61966-2-1, clamped to [0,1], 8 bits */
  SLF_CURVE_DWA = 1   /* HDR: OpenEXR's DWA curve, x^(1/2.2) to 1, then ln(x)/2.2 + 1 */
} slf_curve;

/* How C-Blocks use angular coherence (section 3.3). */
typedef enum {
  SLF_ANGULAR_NONE = 0,      /* independent blocks */
  SLF_ANGULAR_IDENTICAL = 1, /* a block equal to the one of the first slice costs one bit */
  SLF_ANGULAR_MOTION = 2,    /* the paper's second scheme */
  SLF_ANGULAR_LAYERED = 3    /* mean, key block and shift: FORMAT.md */
} slf_angular;

typedef struct {
  slf_role role;
  slf_curve curve;
  slf_angular angular;
  uint32_t u_count, v_count; /* texels, 1 .. SLF_MAX_TEXELS */
  uint32_t s_count, t_count; /* directions, 1 .. SLF_MAX_DIRECTIONS */
  uint32_t block_u_count;    /* ceil(u_count / 8) */
  uint32_t block_v_count;    /* ceil(v_count / 8) */
  uint32_t slice_count;      /* slices that exist, see slf_slice_exists */
  uint64_t raw_nbytes;       /* 3 bytes a texel of every slice that exists */
  uint64_t payload_nbytes;   /* C-Blocks */
  uint64_t index_nbytes;     /* what finds them, tables included */
  float quality;             /* as asked of the encoder */
  float psnr;                /* dB, of all codes; the peak is white (of HDR, radiance 1) */
  float height_unit;         /* of SLF_ROLE_HEIGHT, scene units; else 0 */
} slf_layer;

/* What is behind a flat surface through which light passes: a solid whose far side is parallel,
 * `thickness` scene units behind, and whose other sides stand at right angles along the edges of
 * the surface. What enters leaves by the far side in its own direction, but for mirroring at the
 * others. Thickness 0: nothing is known of it. */
typedef struct {
  float thickness;
  float ior; /* index of refraction, above 1 */
} slf_slab;

typedef struct {
  char name[SLF_NAME_NBYTES];
  uint32_t flags; /* SLF_SURFACE_... */
  slf_mesh mesh;
  uint32_t layer_count;
  const slf_layer *layers;
  slf_slab slab;
} slf_surface;

/* A camera as POV-Ray's perspective camera means it; left-handed, sky = +y. */
typedef struct {
  char name[SLF_NAME_NBYTES];
  float location[3];
  float look_at[3];
  float angle_deg; /* across the width of the image, POV-Ray's `angle`; in (0, 180) */
} slf_view;

/* ---- Directions (eq. 1) -------------------------------------------------------------------- */

/* Slices with less n are baked as seen from there: see slf_direction. */
#define SLF_BAKED_N_MIN 0.02

/* Whether slice (s_index, t_index) is stored: whether a four-tap mix at some (S,T) inside the unit
 * circle can read it, that is, whether the square of two cells' side around its centre meets the
 * circle. A layer of one slice has it. */
bool slf_slice_exists(uint32_t s_count, uint32_t t_count, uint32_t s_index, uint32_t t_index);

/* The direction (s, t, n) in the tangent frame for (S,T), any finite values; a direction with
 * n < n_min (0 <= n_min < 1), or outside the circle, is pulled back along its radius to n_min. */
void slf_direction(double S, double T, double n_min, double direction[3]);

/* Linear radiance to the stored 8-bit code of SLF_CURVE_SRGB and back; NaN gives 0. */
uint8_t slf_srgb_from_linear(float radiance);
float slf_linear_from_srgb(uint8_t code);

/* The code of a height (SLF_ROLE_HEIGHT) and back; half of the codes are below height_unit.
 * Negative heights and NaN give 0, infinity gives 255. */
uint8_t slf_code_from_height(float height, float height_unit);
float slf_height_from_code(uint8_t code, float height_unit);

/* ---- Reading ------------------------------------------------------------------------------- */

typedef struct slf_file slf_file;

/* Opens a file (memory-mapped) or `nbytes` of memory that must outlive *file. Checks the structure
 * and the checksums of all but the C-Blocks; slf_verify checks those too. `name` is for messages.
 * *file is NULL on failure. slf_close accepts NULL. */
slf_result slf_open(const char *path, slf_file **file, slf_error *error);
slf_result slf_open_memory(const void *bytes, size_t nbytes, const char *name, slf_file **file,
                           slf_error *error);
void slf_close(slf_file *file);

/* The same for the first bytes of a file that is still to come, or never will. A file begins with
 * all but the C-Blocks: as long as those bytes are not there, SLF_ERROR_PARTIAL. Then come
 * matte layers and the means of all others, the keys, and the rest in the order of the slices. A
 * block that is not there yet decodes to the nearest key's, or to the mean over all directions, or
 * to gray: open the file again when more of it has come. */
slf_result slf_open_prefix(const char *path, slf_file **file, slf_error *error);
slf_result slf_open_prefix_memory(const void *bytes, size_t nbytes, const char *name,
                                  slf_file **file, slf_error *error);

/* Checks every checksum of the file and that every C-Block parses. */
slf_result slf_verify(const slf_file *file, slf_error *error);

/* What is in the file; owned by it. */
uint32_t slf_surface_count(const slf_file *file);
const slf_surface *slf_get_surface(const slf_file *file, uint32_t surface_index);
uint32_t slf_view_count(const slf_file *file);
const slf_view *slf_get_view(const slf_file *file, uint32_t view_index);
void slf_get_background(const slf_file *file, float linear_rgb[3]);
uint64_t slf_file_nbytes(const slf_file *file); /* of a prefix, those that are there */

/* The address of a block. Indices of slices that do not exist, or out of range, decode to zeros. */
typedef struct {
  uint16_t s, t;             /* slice */
  uint16_t block_u, block_v; /* block within the slice */
} slf_block_address;

/* Whether a block exists and is there, and so decodes to itself: false is a wait only in a prefix.
 */
bool slf_has_block(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                   slf_block_address address);

/* Decompresses one block into SLF_BLOCK_NBYTES at u_block: sRGB codes (of
 * SLF_CURVE_DWA, of the radiance clamped to [0,1]). Texels beyond the edge of the slice repeat
 * nothing in particular. Never fails: a damaged C-Block gives some texels. No allocation. */
void slf_decode_block(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                      slf_block_address address, uint8_t *u_block);

/* The same for `count` blocks, u_blocks[i] receiving addresses[i]: faster, as later C-Blocks are
 * fetched from memory while earlier ones are decoded, and references are shared. */
void slf_decode_blocks(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                       const slf_block_address *addresses, size_t count, uint8_t *const *u_blocks);

/* One block as linear RGB, 64 x 3 floats at rgb; of SLF_CURVE_DWA radiance up to 65504. */
void slf_decode_block_linear(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                             slf_block_address address, float *rgb);

/* Decodes one slice to linear RGB, v_count rows of u_count x 3 floats. */
slf_result slf_decode_slice(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                            uint32_t s_index, uint32_t t_index, float *rgb, slf_error *error);

/* ---- Writing ------------------------------------------------------------------------------- */

typedef struct slf_writer slf_writer;

/* Where the encoder gets a layer's slices: linear RGB, v_count rows of u_count x 3 floats, finite.
 * Called from one thread at a time, for any existing slice, in any order, more than once. Returns
 * SLF_OK or fills *error. */
typedef struct {
  slf_result (*read_slice)(void *context, uint32_t s_index, uint32_t t_index, float *rgb,
                           slf_error *error);
  void *context;
  void (*progress)(void *context, double fraction); /* may be NULL */
} slf_source;

typedef struct {
  slf_role role;
  slf_curve curve;
  slf_angular angular;
  uint32_t u_count, v_count, s_count, t_count;
  float quality;         /* 1 (small) .. 100 (exact to about a code value) */
  float height_unit;     /* of SLF_ROLE_HEIGHT, scene units, above 0; else 0 */
  float target_psnr;     /* above 0: the quality is searched for; dB, as slf_layer's psnr */
  float target_ratio;    /* above 0: likewise, of raw_nbytes to what is stored */
  uint32_t thread_count; /* 0: as many as there are processors */
} slf_layer_options;

/* Begins a file. Nothing is seen under `path` until slf_writer_finish, which renames a finished
 * temporary file beside it. slf_writer_abort removes the temporary; it accepts NULL. Both free. */
slf_result slf_writer_create(const char *path, slf_writer **writer, slf_error *error);
slf_result slf_writer_add_view(slf_writer *writer, const slf_view *view, slf_error *error);
void slf_writer_set_background(slf_writer *writer, const float linear_rgb[3]);

/* Adds a surface (name, flags, mesh, slab are read; layers are added by the next call). */
slf_result slf_writer_add_surface(slf_writer *writer, const slf_surface *surface, slf_error *error);
/* Encodes a layer of the surface added last. The same input gives the same bytes, whatever the
 * number of threads. Memory is a few slices, whatever their number and the size of the file: what
 * is done waits in a scratch file beside the one to be, as large as that. */
slf_result slf_writer_add_layer(slf_writer *writer, const slf_layer_options *options,
                                const slf_source *source, slf_error *error);
slf_result slf_writer_finish(slf_writer *writer, slf_error *error);
void slf_writer_abort(slf_writer *writer);

const char *slf_version(void); /* "major.minor.patch" of the library */

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
