#include "draw.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "codec/parallel.h"
#include "depth_pages.h"
#include "gl_api.h"
#include "half.h"

/* Not in GL 3.3 core, but in every driver; where it is missing, filtering is only trilinear. */
#define TEXTURE_MAX_ANISOTROPY 0x84FE
#define MAX_TEXTURE_MAX_ANISOTROPY 0x84FF

typedef struct {
  GLuint texture;
  bool matte;  /* made once */
  bool joined; /* the layer before has its radiance, too */
  /* Of a shiny layer. by_depth.depth is NULL where the file has no heights. */
  texture four_tap, by_depth, *shown;
} drawn_layer;

typedef struct {
  GLuint vertex_array, vertices, indices;
  GLsizei index_count;
  drawn_layer *layers;
  uint32_t layer_count;
  water *water;          /* or NULL */
  bool was_bent;         /* the latest texture shows ripples */
  float low[3], high[3]; /* the box around its vertices */
} drawn_surface;

/* Below some 2 ms of decompression nobody waits; above, a thread that others keep from its
 * processor costs little of it. */
enum { AHEAD_BLOCKS = 4000 };
/* Blocks of texels: some 1.5 ms of mixing by depth on calm water, 3 on disturbed. */
enum { TOGETHER_BLOCKS = 512 };

typedef struct {
  GLuint framebuffer, colour, depth;
} canvas;

struct drawing {
  const slf_file *file;
  drawing_options options;
  block_cache *cache;
  drawn_surface *surfaces;
  uint32_t surface_count;
  float centre[3], radius; /* a sphere around all vertices */
  GLuint program;
  GLint clip_uniform, paint_uniform, tone_uniform;
  canvas picture;
  canvas matte;   /* what is matte of it, kept while only water moves */
  bool has_matte; /* of the latest frame's camera and look */
  int width_px, height_px;
  drawing_look look;
  drawing_cost cost;
  GLint most_anisotropic;      /* 1: the driver has none */
  camera latest, latest_matte; /* what the textures show, and what the matte surfaces */
  bool textures_valid;
  slf_view view, view_before; /* the latest frame's, the one before's; angle_deg 0: none yet */
  bool looks_ahead;           /* a thread of its own has the textures and the cache */
  pthread_t ahead;
  camera expected;
  atomic_bool stop;
};

/* Colour comes premultiplied by coverage: texels that were not made are zeros, so that bilinear,
 * mip-mapped and anisotropic filters all sum colour and weight over the texels that were, and the
 * quotient is their weighted mean. Nothing undefined reaches the screen at any level. */
static const char vertex_shader[] = "#version 330 core\n"
                                    "layout(location = 0) in vec3 position;\n"
                                    "layout(location = 1) in vec2 uv;\n"
                                    "uniform mat4 clip;\n"
                                    "out vec2 texel;\n"
                                    "void main() {\n"
                                    "  texel = uv;\n"
                                    "  gl_Position = clip * vec4(position, 1.0);\n"
                                    "}\n";
static const char fragment_shader[] =
    "#version 330 core\n"
    "uniform sampler2D light;\n"
    "uniform vec4 paint;\n"
    "uniform vec4 tone;\n" /* exposure, and whether to map */
    "in vec2 texel;\n"
    "out vec4 colour;\n"
    "void main() {\n"
    "  vec4 sum = texture(light, texel);\n"
    "  vec3 radiance = sum.rgb / max(sum.a, 1.0 / 65536.0);\n"
    "  radiance *= tone.x;\n"
    "  if (tone.y > 0.0) radiance = radiance / (1.0 + radiance);\n"
    "  colour = vec4(mix(radiance, paint.rgb, paint.a), 1.0);\n"
    "}\n";

static slf_result fail(slf_error *error, slf_result result, const char *message) {
  snprintf(error->message, sizeof error->message, "%s", message);
  return result;
}

static slf_result link_program(drawing *d, slf_error *error) {
  slf_result result = gl_link_program(vertex_shader, fragment_shader, &d->program, error);
  if (result != SLF_OK) return result;
  d->clip_uniform = gl.GetUniformLocation(d->program, "clip");
  d->paint_uniform = gl.GetUniformLocation(d->program, "paint");
  d->tone_uniform = gl.GetUniformLocation(d->program, "tone");
  return SLF_OK;
}

/* Triangles wound so that the side of their vertices' normals is the front. */
static uint32_t *wound_triangles(const slf_mesh *mesh) {
  uint32_t *indices = malloc((3 * (size_t)mesh->triangle_count + 1) * sizeof *indices);
  if (!indices) return NULL;
  for (size_t i = 0; i < mesh->triangle_count; i++) {
    const uint32_t *v = mesh->triangles + 3 * i;
    const slf_vertex *p[3];
    float normal[3], plane[3];
    for (int k = 0; k < 3; k++) p[k] = &mesh->vertices[v[k]];
    for (int k = 0; k < 3; k++) {
      int a = (k + 1) % 3, b = (k + 2) % 3;
      normal[k] = p[0]->normal[k] + p[1]->normal[k] + p[2]->normal[k];
      plane[k] = (p[1]->position[a] - p[0]->position[a]) * (p[2]->position[b] - p[0]->position[b]) -
                 (p[1]->position[b] - p[0]->position[b]) * (p[2]->position[a] - p[0]->position[a]);
    }
    bool flip = normal[0] * plane[0] + normal[1] * plane[1] + normal[2] * plane[2] < 0;
    indices[3 * i] = v[0];
    indices[3 * i + 1] = v[flip ? 2 : 1];
    indices[3 * i + 2] = v[flip ? 1 : 2];
  }
  return indices;
}

static bool upload_mesh(drawn_surface *s, const slf_mesh *mesh) {
  uint32_t *indices = wound_triangles(mesh);
  if (!indices) return false;
  s->index_count = (GLsizei)(3 * mesh->triangle_count);
  gl.GenVertexArrays(1, &s->vertex_array);
  gl.BindVertexArray(s->vertex_array);
  gl.GenBuffers(1, &s->vertices);
  gl.BindBuffer(GL_ARRAY_BUFFER, s->vertices);
  gl.BufferData(GL_ARRAY_BUFFER, (GLsizeiptr)(mesh->vertex_count * sizeof(slf_vertex)),
                mesh->vertices, GL_STATIC_DRAW);
  gl.GenBuffers(1, &s->indices);
  gl.BindBuffer(GL_ELEMENT_ARRAY_BUFFER, s->indices);
  gl.BufferData(GL_ELEMENT_ARRAY_BUFFER, (GLsizeiptr)(3 * (size_t)mesh->triangle_count * 4),
                indices, GL_STATIC_DRAW);
  gl.EnableVertexAttribArray(0);
  gl.VertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, sizeof(slf_vertex),
                         (const void *)offsetof(slf_vertex, position));
  gl.EnableVertexAttribArray(1);
  gl.VertexAttribPointer(1, 2, GL_FLOAT, GL_FALSE, sizeof(slf_vertex),
                         (const void *)offsetof(slf_vertex, u));
  free(indices);
  return true;
}

static bool has_extension(const char *name) {
  GLint count = 0;
  gl.GetIntegerv(GL_NUM_EXTENSIONS, &count);
  for (GLint i = 0; i < count; i++)
    if (!strcmp((const char *)gl.GetStringi(GL_EXTENSIONS, (GLuint)i), name)) return true;
  return false;
}

static void filter_texture(const drawing *d, const drawn_layer *layer) {
  if (d->most_anisotropic == 1) return;
  gl.BindTexture(GL_TEXTURE_2D, layer->texture);
  gl.TexParameterf(GL_TEXTURE_2D, TEXTURE_MAX_ANISOTROPY,
                   d->look.anisotropic ? (float)d->most_anisotropic : 1);
}

static void create_texture(const drawing *d, drawn_layer *layer, const slf_surface *surface) {
  bool wrap_u = surface->flags & SLF_SURFACE_WRAP_U, wrap_v = surface->flags & SLF_SURFACE_WRAP_V;
  gl.GenTextures(1, &layer->texture);
  gl.BindTexture(GL_TEXTURE_2D, layer->texture);
  gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, wrap_u ? GL_REPEAT : GL_CLAMP_TO_EDGE);
  gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, wrap_v ? GL_REPEAT : GL_CLAMP_TO_EDGE);
  gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
  gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
  filter_texture(d, layer);
}

static void upload_texels(const drawn_layer *layer, const texture *x) {
  gl.BindTexture(GL_TEXTURE_2D, layer->texture);
  for (uint32_t i = 0; i < x->level_count; i++) {
    const mipmap_level *level = &x->levels[i];
    const mipmap_area *a = &x->changed[i];
    if (a->x1 == 0) continue;
    gl.PixelStorei(GL_UNPACK_ROW_LENGTH, (GLint)(level->row_nbytes / 8));
    gl.TexSubImage2D(GL_TEXTURE_2D, (GLint)i, (GLint)a->x0, (GLint)a->y0, (GLsizei)(a->x1 - a->x0),
                     (GLsizei)(a->y1 - a->y0), GL_RGBA, GL_HALF_FLOAT,
                     (const uint8_t *)level->texels + a->y0 * level->row_nbytes + a->x0 * 8);
  }
  gl.PixelStorei(GL_UNPACK_ROW_LENGTH, 0);
}

/* Gives the bound texture the size of x and what is in it, at first nothing. */
static void upload_texels_anew(const texture *x) {
  for (uint32_t i = 0; i < x->level_count; i++) {
    const mipmap_level *level = &x->levels[i];
    gl.PixelStorei(GL_UNPACK_ROW_LENGTH, (GLint)(level->row_nbytes / 8));
    gl.TexImage2D(GL_TEXTURE_2D, (GLint)i, GL_RGBA16F, (GLsizei)level->width,
                  (GLsizei)level->height, 0, GL_RGBA, GL_HALF_FLOAT, level->texels);
  }
  gl.PixelStorei(GL_UNPACK_ROW_LENGTH, 0);
}

static void decode_matte_block(const drawing *d, uint32_t surface, uint32_t layer_index, bool half,
                               slf_block_address address, uint8_t *u_block) {
  float rgb[3 * 64];
  if (!half) {
    slf_decode_block(d->file, surface, layer_index, address, u_block);
    return;
  }
  uint16_t *texel = (uint16_t *)(void *)u_block;
  slf_decode_block_linear(d->file, surface, layer_index, address, rgb);
  for (int k = 0; k < 64; k++, texel += 4) {
    for (int c = 0; c < 3; c++) texel[c] = half_from_float(half_range(rgb[3 * k + c]));
    texel[3] = HALF_ONE;
  }
}

/* A matte layer is one slice, shown as it is. */
static bool upload_matte(const drawing *d, uint32_t surface, uint32_t layer_index,
                         const slf_layer *shape) {
  bool half = shape->curve == SLF_CURVE_DWA;
  size_t block_row_nbytes = half ? 64 : 32;
  size_t row_nbytes = (size_t)shape->block_u_count * block_row_nbytes;
  uint8_t *texels = malloc(row_nbytes * 8 * shape->block_v_count);
  if (!texels) return false;
  for (uint32_t bv = 0; bv < shape->block_v_count; bv++)
    for (uint32_t bu = 0; bu < shape->block_u_count; bu++) {
      _Alignas(16) uint8_t u_block[U_BLOCK_HALF_NBYTES];
      slf_block_address address = {.block_u = (uint16_t)bu, .block_v = (uint16_t)bv};
      decode_matte_block(d, surface, layer_index, half, address, u_block);
      for (size_t row = 0; row < 8; row++)
        memcpy(texels + (8 * bv + row) * row_nbytes + bu * block_row_nbytes,
               u_block + block_row_nbytes * row, block_row_nbytes);
    }
  gl.PixelStorei(GL_UNPACK_ROW_LENGTH, (GLint)(8 * shape->block_u_count));
  gl.TexImage2D(GL_TEXTURE_2D, 0, half ? GL_RGBA16F : GL_SRGB8_ALPHA8, (GLsizei)shape->u_count,
                (GLsizei)shape->v_count, 0, GL_RGBA, half ? GL_HALF_FLOAT : GL_UNSIGNED_BYTE,
                texels);
  gl.PixelStorei(GL_UNPACK_ROW_LENGTH, 0);
  gl.GenerateMipmap(GL_TEXTURE_2D);
  free(texels);
  return true;
}

/* A shiny flat surface that the file marks so. */
static slf_result create_water(drawing *d, uint32_t index, uint32_t cells, slf_error *error) {
  const slf_surface *surface = slf_get_surface(d->file, index);
  if (!(surface->flags & SLF_SURFACE_WATER) || surface->layer_count == 0) return SLF_OK;
  if (d->surfaces[index].layers[0].matte) return SLF_OK;
  const slf_layer *shape = &surface->layers[0];
  return water_create(d->file, index, shape->u_count, shape->v_count, cells,
                      &d->surfaces[index].water, error);
}

/* Whether the layer after the k-th has that role and the same slices. */
static bool has_next(const slf_surface *surface, uint32_t k, slf_role role) {
  const slf_layer *layer = &surface->layers[k];
  return k + 1 < surface->layer_count && layer[1].role == role &&
         layer[1].curve == SLF_CURVE_SRGB && layer[1].s_count == layer->s_count &&
         layer[1].t_count == layer->t_count;
}

/* Whether a layer is what a surface reflects, with its heights. */
static bool has_depth(const slf_surface *surface, uint32_t k) {
  const slf_layer *shape = &surface->layers[k];
  return shape->role == SLF_ROLE_REFLECTED && shape->curve == SLF_CURVE_SRGB &&
         has_next(surface, k, SLF_ROLE_HEIGHT) && depth_pages_fit(shape);
}

/* Whether the k-th layer, of heights, is followed by their coverage. */
static bool has_coverage(const slf_surface *surface, uint32_t k) {
  const slf_layer *heights = &surface->layers[k];
  return has_next(surface, k, SLF_ROLE_COVERAGE) && heights[1].u_count == heights->u_count &&
         heights[1].v_count == heights->v_count;
}

static block_source source_of(const drawing *d, uint32_t index, uint32_t k) {
  const drawing_options *o = &d->options;
  return o->source ? o->source(o->source_context, index, k) : block_cache_layer(d->cache, index, k);
}

/* The texture of a layer that has heights; it has more texels than the layer, see depth_mix.h. */
static bool create_by_depth(drawing *d, uint32_t index, uint32_t k) {
  const slf_surface *surface = slf_get_surface(d->file, index);
  const slf_layer *shape = &surface->layers[k];
  texture *x = &d->surfaces[index].layers[k].by_depth;
  slf_layer drawn = *shape;
  if (!(surface->flags & SLF_SURFACE_WATER)) drawn.u_count *= 2, drawn.v_count *= 2;
  if (!texture_create(x, &surface->mesh, &drawn, source_of(d, index, k), d->options.dice_px))
    return false;
  depth_sources sources = {
      {shape, source_of(d, index, k)}, {shape + 1, source_of(d, index, k + 1)}, {NULL, {0}}};
  if (has_coverage(surface, k + 1))
    sources.coverage = (depth_source){shape + 2, source_of(d, index, k + 2)};
  x->depth = depth_mixer_create(&sources, surface, drawn.u_count, drawn.v_count);
  texture_mix_together(x, processor_count(), TOGETHER_BLOCKS);
  return x->depth;
}

/* The look's mix and level of detail, for one shiny layer. */
static void choose_texture(drawing *d, uint32_t index, uint32_t k) {
  const slf_layer *shape = &slf_get_surface(d->file, index)->layers[k];
  drawn_layer *layer = &d->surfaces[index].layers[k];
  const uint32_t level = d->look.detail;
  const bool deep = layer->by_depth.depth && d->look.mix == MIX_DEPTH && level == 0;
  texture *chosen = deep ? &layer->by_depth : &layer->four_tap;
  resampler_use_slices(layer->four_tap.resampler, angular_count(shape->s_count, level),
                       angular_count(shape->t_count, level),
                       level ? block_cache_level(d->cache, index, k, level)
                             : source_of(d, index, k));
  if (chosen == layer->shown) return;
  layer->shown = chosen;
  gl.BindTexture(GL_TEXTURE_2D, layer->texture);
  upload_texels_anew(chosen);
}

static bool create_surface(drawing *d, uint32_t index) {
  const slf_surface *surface = slf_get_surface(d->file, index);
  drawn_surface *s = &d->surfaces[index];
  s->layers = calloc(surface->layer_count + (size_t)1, sizeof *s->layers);
  if (!s->layers || !upload_mesh(s, &surface->mesh)) return false;
  s->layer_count = surface->layer_count;
  for (uint32_t k = 0; k < surface->layer_count; k++) {
    const slf_layer *shape = &surface->layers[k];
    drawn_layer *layer = &s->layers[k];
    layer->matte = shape->role == SLF_ROLE_HEIGHT || shape->role == SLF_ROLE_COVERAGE;
    if (layer->matte) continue; /* nothing to see */
    create_texture(d, layer, surface);
    layer->matte = shape->s_count == 1 && shape->t_count == 1;
    if (layer->matte) {
      if (!upload_matte(d, index, k, shape)) return false;
      continue;
    }
    if (!texture_create(&layer->four_tap, &surface->mesh, shape, source_of(d, index, k),
                        d->options.dice_px))
      return false;
    if (!d->options.source)
      texture_decode_ahead(&layer->four_tap, d->cache, processor_count(), AHEAD_BLOCKS);
    if (has_depth(surface, k) && !create_by_depth(d, index, k)) return false;
    choose_texture(d, index, k);
  }
  return true;
}

static void bound_surface(drawn_surface *s, const slf_mesh *mesh) {
  for (int k = 0; k < 3; k++) {
    s->low[k] = INFINITY;
    s->high[k] = -INFINITY;
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
      s->low[k] = fminf(s->low[k], mesh->vertices[v].position[k]);
      s->high[k] = fmaxf(s->high[k], mesh->vertices[v].position[k]);
    }
  }
}

static void bound_scene(drawing *d) {
  float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
  for (uint32_t i = 0; i < d->surface_count; i++) {
    bound_surface(&d->surfaces[i], &slf_get_surface(d->file, i)->mesh);
    for (int k = 0; k < 3; k++) {
      low[k] = fminf(low[k], d->surfaces[i].low[k]);
      high[k] = fmaxf(high[k], d->surfaces[i].high[k]);
    }
  }
  float radius_2 = 0;
  for (int k = 0; k < 3; k++) {
    d->centre[k] = 0.5f * (low[k] + high[k]);
    radius_2 += 0.25f * (high[k] - low[k]) * (high[k] - low[k]);
  }
  d->radius = sqrtf(radius_2);
  if (!isfinite(d->radius) || !(d->radius > 0)) {
    memset(d->centre, 0, sizeof d->centre);
    d->radius = 1;
  }
}

slf_result drawing_create(const slf_file *file, drawing_options options, drawing **out,
                          slf_error *error) {
  *out = NULL;
  drawing *d = calloc(1, sizeof *d);
  if (!d) return fail(error, SLF_ERROR_MEMORY, "out of memory");
  d->file = file;
  d->options = options;
  d->look.anisotropic = true;
  d->most_anisotropic = 1;
  if (has_extension("GL_EXT_texture_filter_anisotropic"))
    gl.GetIntegerv(MAX_TEXTURE_MAX_ANISOTROPY, &d->most_anisotropic);
  slf_result result = link_program(d, error);
  if (result != SLF_OK) goto refused;
  result = SLF_ERROR_MEMORY;
  d->cache = block_cache_create(file, options.cache_blocks);
  d->surfaces = calloc(slf_surface_count(file) + (size_t)1, sizeof *d->surfaces);
  if (!d->cache || !d->surfaces) goto out_of_memory;
  d->surface_count = slf_surface_count(file);
  for (uint32_t i = 0; i < d->surface_count; i++)
    if (!create_surface(d, i)) goto out_of_memory;
  for (uint32_t i = 0; i < d->surface_count; i++)
    if ((result = create_water(d, i, options.water_cells, error)) != SLF_OK) goto refused;
  bound_scene(d);
  *out = d;
  return SLF_OK;

out_of_memory:
  fail(error, result, "out of memory for textures and the block cache");
refused:
  drawing_free(d);
  return result;
}

/* ---- Looking ahead ------------------------------------------------------------------------------
 *
 * While the driver draws a frame and the display shows it, what a camera that goes on as it does
 * will need next is decompressed by another thread. */

static void *look_ahead(void *context) {
  drawing *d = context;
  for (uint32_t i = 0; i < d->surface_count; i++)
    for (uint32_t k = 0; k < d->surfaces[i].layer_count; k++) {
      texture *shown = d->surfaces[i].layers[k].shown;
      if (shown && !d->surfaces[i].was_bent) texture_look_ahead(shown, &d->expected, &d->stop);
    }
  return NULL;
}

static void end_look_ahead(drawing *d) {
  if (!d->looks_ahead) return;
  atomic_store(&d->stop, true);
  pthread_join(d->ahead, NULL);
  d->looks_ahead = false;
}

/* Where the thread cannot be made, the next frame decompresses what it needs. */
static void begin_look_ahead(drawing *d) {
  const slf_view *at = &d->view, *from = &d->view_before;
  if (from->angle_deg == 0 || !memcmp(at, from, sizeof *at) || processor_count() == 1) return;
  const slf_view next = view_ahead(at, from);
  end_look_ahead(d);
  d->expected = camera_of_view(&next, d->width_px, d->height_px);
  atomic_store(&d->stop, false);
  d->looks_ahead = pthread_create(&d->ahead, NULL, look_ahead, d) == 0;
}

static void free_canvas(canvas *c) {
  gl.DeleteFramebuffers(1, &c->framebuffer);
  gl.DeleteRenderbuffers(1, &c->colour);
  gl.DeleteRenderbuffers(1, &c->depth);
}

void drawing_free(drawing *d) {
  if (!d) return;
  end_look_ahead(d);
  for (uint32_t i = 0; i < d->surface_count; i++) {
    drawn_surface *s = &d->surfaces[i];
    for (uint32_t k = 0; k < s->layer_count; k++) {
      gl.DeleteTextures(1, &s->layers[k].texture);
      texture_free(&s->layers[k].four_tap);
      texture_free(&s->layers[k].by_depth);
    }
    free(s->layers);
    water_free(s->water);
    gl.DeleteVertexArrays(1, &s->vertex_array);
    gl.DeleteBuffers(1, &s->vertices);
    gl.DeleteBuffers(1, &s->indices);
  }
  free_canvas(&d->picture);
  free_canvas(&d->matte);
  gl.DeleteProgram(d->program);
  block_cache_free(d->cache);
  free(d->surfaces);
  free(d);
}

static bool resize_canvas(canvas *c, int width_px, int height_px) {
  if (!c->framebuffer) {
    gl.GenFramebuffers(1, &c->framebuffer);
    gl.GenRenderbuffers(1, &c->colour);
    gl.GenRenderbuffers(1, &c->depth);
  }
  gl.BindRenderbuffer(GL_RENDERBUFFER, c->colour);
  gl.RenderbufferStorage(GL_RENDERBUFFER, GL_SRGB8_ALPHA8, width_px, height_px);
  gl.BindRenderbuffer(GL_RENDERBUFFER, c->depth);
  gl.RenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT32F, width_px, height_px);
  gl.BindFramebuffer(GL_FRAMEBUFFER, c->framebuffer);
  gl.FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, c->colour);
  gl.FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, c->depth);
  return gl.CheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
}

static slf_result resize(drawing *d, int width_px, int height_px, slf_error *error) {
  if (d->picture.framebuffer && d->width_px == width_px && d->height_px == height_px) return SLF_OK;
  GLint most = 0;
  gl.GetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &most);
  if (width_px < 1 || height_px < 1 || width_px > most || height_px > most) {
    snprintf(error->message, sizeof error->message,
             "a picture of %dx%d pixels (samples included): OpenGL draws 1x1 to %dx%d here",
             width_px, height_px, most, most);
    return SLF_ERROR_ARGUMENT;
  }
  d->has_matte = false;
  if (!resize_canvas(&d->picture, width_px, height_px))
    return fail(error, SLF_ERROR_IO, "OpenGL: no sRGB framebuffer of that size");
  d->width_px = width_px;
  d->height_px = height_px;
  return SLF_OK;
}

static float distance_to_box(const float point[3], const float low[3], const float high[3]) {
  float out[3];
  for (int k = 0; k < 3; k++) out[k] = fmaxf(fmaxf(low[k] - point[k], point[k] - high[k]), 0);
  return sqrtf(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]);
}

/* Near and far follow what there is: nothing is cut off but what is nearer than 1/100,000 of the
 * scene's radius. Of two points at one distance the one in the picture's corner lies least deep. */
static void clip_planes(const drawing *d, const camera *c, float *z_near, float *z_far) {
  float nearest = INFINITY, distance_2 = 0;
  for (uint32_t i = 0; i < d->surface_count; i++)
    nearest = fminf(nearest, distance_to_box(c->location, d->surfaces[i].low, d->surfaces[i].high));
  for (int k = 0; k < 3; k++)
    distance_2 += (d->centre[k] - c->location[k]) * (d->centre[k] - c->location[k]);
  const float corner = sqrtf(1 + c->tan_x * c->tan_x + c->tan_y * c->tan_y);
  *z_near = fmaxf(0.99f * nearest / corner, 1e-5f * d->radius);
  *z_far = sqrtf(distance_2) + d->radius * 1.01f;
  if (!(*z_far > *z_near * 1.0001f)) *z_far = *z_near * 1.0001f; /* rounding, very far away */
}

static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void add_depth_counts(depth_mix_counts *sum, const depth_mix_counts *before,
                             depth_mix_counts after) {
  sum->texel_count += after.texel_count - before->texel_count;
  sum->foretold_count += after.foretold_count - before->foretold_count;
  sum->wide_count += after.wide_count - before->wide_count;
  sum->four_tap_count += after.four_tap_count - before->four_tap_count;
}

static void update_layer(drawing *d, drawn_layer *layer, direction_bend bend, const camera *c) {
  texture *x = layer->shown;
  const depth_mix_counts before = x->depth ? depth_mixer_counts(x->depth) : (depth_mix_counts){0};
  texture_update(x, c, bend);
  d->cost.texel_count += 64 * (size_t)x->made_count;
  if (x->depth) add_depth_counts(&d->cost.depth, &before, depth_mixer_counts(x->depth));
}

/* A layer's texels can be added to those of the one before, which saves drawing them. */
static bool can_join(const drawn_layer *before, const drawn_layer *layer) {
  if (before->matte || layer->matte) return false;
  const mipmap_level *a = &before->shown->levels[0], *b = &layer->shown->levels[0];
  return a->width == b->width && a->height == b->height;
}

static void update_surface(drawing *d, drawn_surface *s, direction_bend bend, const camera *c) {
  double start_s = now_s();
  for (uint32_t k = s->layer_count; k-- > 0;) {
    drawn_layer *layer = &s->layers[k];
    if (layer->matte) continue;
    update_layer(d, layer, bend, c);
    if (k + 1 == s->layer_count) continue;
    drawn_layer *next = &s->layers[k + 1];
    next->joined = can_join(layer, next);
    if (next->joined)
      mipmap_add(&next->shown->levels[0], &layer->shown->levels[0], layer->shown->changed[0]);
  }
  d->cost.resample_s += now_s() - start_s;
  for (uint32_t k = 0; k < s->layer_count; k++) {
    drawn_layer *layer = &s->layers[k];
    if (layer->matte || layer->joined) continue;
    start_s = now_s();
    if (s->water)
      water_finish_frame(s->water, layer->shown->levels[0].texels,
                         layer->shown->levels[0].row_nbytes);
    texture_make_levels(layer->shown);
    double made_s = now_s();
    upload_texels(layer, layer->shown);
    d->cost.resample_s += made_s - start_s;
    d->cost.upload_s += now_s() - made_s;
  }
}

/* Makes the shiny layers for the camera, unless they are made for it already. */
static void update_textures(drawing *d, const camera *c) {
  bool moved = !d->textures_valid || memcmp(c, &d->latest, sizeof *c) != 0;
  block_cache_begin_frame(d->cache);
  d->cost = (drawing_cost){0};
  for (uint32_t i = 0; i < d->surface_count; i++) {
    drawn_surface *s = &d->surfaces[i];
    const direction_bend bend = s->water ? water_begin_frame(s->water) : (direction_bend){0};
    bool was_bent = s->was_bent;
    s->was_bent = bend.bend != NULL;
    if (!moved && !s->was_bent && !was_bent) continue;
    update_surface(d, s, bend, c);
  }
  d->latest = *c;
  d->textures_valid = true;
}

void drawing_set_look(drawing *d, const drawing_look *look) {
  end_look_ahead(d);
  if (look->detail != d->look.detail || look->mix != d->look.mix) d->textures_valid = false;
  d->has_matte = false;
  d->look = *look;
  for (uint32_t i = 0; i < d->surface_count; i++)
    for (uint32_t k = 0; k < d->surfaces[i].layer_count; k++) {
      drawn_layer *layer = &d->surfaces[i].layers[k];
      filter_texture(d, layer);
      if (layer->shown) choose_texture(d, i, k);
    }
}

bool drawing_has_depth(const drawing *d) {
  for (uint32_t i = 0; i < d->surface_count; i++)
    for (uint32_t k = 0; k < d->surfaces[i].layer_count; k++)
      if (d->surfaces[i].layers[k].by_depth.depth) return true;
  return false;
}

drawing_look drawing_get_look(const drawing *d) {
  return d->look;
}

bool drawing_is_software(const drawing *d) {
  (void)d;
  const char *renderer = (const char *)gl.GetString(GL_RENDERER);
  return renderer && (strstr(renderer, "llvmpipe") || strstr(renderer, "softpipe"));
}

drawing_cost drawing_get_cost(const drawing *d) {
  return d->cost;
}

static bool is_matte(const drawn_surface *s) {
  for (uint32_t k = 0; k < s->layer_count; k++)
    if (!s->layers[k].matte) return false;
  return true;
}

/* Whether water moved in the latest frame. */
static bool any_bent(const drawing *d) {
  for (uint32_t i = 0; i < d->surface_count; i++)
    if (d->surfaces[i].was_bent) return true;
  return false;
}

static bool mixes_by_depth(const drawing *d) {
  for (uint32_t i = 0; i < d->surface_count; i++)
    for (uint32_t k = 0; k < d->surfaces[i].layer_count; k++) {
      const texture *shown = d->surfaces[i].layers[k].shown;
      if (shown && shown->depth) return true;
    }
  return false;
}

/* Radiance is the sum of the layers: all but the first are added at equal depth. */
static void draw_surface(const drawing *d, uint32_t index, int mask_surface) {
  const drawn_surface *s = &d->surfaces[index];
  const float paint = (int)index == mask_surface ? 1 : 0;
  gl.Uniform4f(d->paint_uniform, paint, paint, paint, mask_surface >= 0 ? 1 : 0);
  gl.BindVertexArray(s->vertex_array);
  for (uint32_t k = 0; k < s->layer_count && (k == 0 || mask_surface < 0); k++) {
    if (s->layers[k].texture == 0 || s->layers[k].joined) continue;
    if (k == 1) gl.Enable(GL_BLEND);
    gl.BindTexture(GL_TEXTURE_2D, s->layers[k].texture);
    gl.DrawElements(GL_TRIANGLES, s->index_count, GL_UNSIGNED_INT, NULL);
  }
  gl.Disable(GL_BLEND);
}

/* Like formats on both sides, sRGB as drawn: the driver copies bytes. */
static void copy_canvas(const drawing *d, const canvas *from, const canvas *to) {
  gl.BindFramebuffer(GL_READ_FRAMEBUFFER, from->framebuffer);
  gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, to->framebuffer);
  gl.BlitFramebuffer(0, 0, d->width_px, d->height_px, 0, 0, d->width_px, d->height_px,
                     GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT, GL_NEAREST);
  gl.BindFramebuffer(GL_FRAMEBUFFER, d->picture.framebuffer);
}

static void draw_matte(const drawing *d, int mask_surface) {
  float background[3] = {0, 0, 0};
  if (mask_surface < 0) slf_get_background(d->file, background);
  gl.ClearColor(background[0], background[1], background[2], 1);
  gl.Clear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
  for (uint32_t i = 0; i < d->surface_count; i++)
    if (is_matte(&d->surfaces[i])) draw_surface(d, i, mask_surface);
}

/* From the second frame on in which only water moves what is matte is kept, and then copied. */
static void show_matte(drawing *d, const camera *c) {
  const bool still = !memcmp(c, &d->latest_matte, sizeof *c) && any_bent(d);
  d->has_matte = d->has_matte && still;
  d->latest_matte = *c;
  if (d->has_matte) {
    copy_canvas(d, &d->matte, &d->picture);
    return;
  }
  draw_matte(d, -1);
  d->has_matte = still && resize_canvas(&d->matte, d->width_px, d->height_px);
  if (d->has_matte) copy_canvas(d, &d->picture, &d->matte);
  gl.BindFramebuffer(GL_FRAMEBUFFER, d->picture.framebuffer);
}

slf_result drawing_render(drawing *d, const slf_view *view, int width_px, int height_px,
                          int mask_surface, slf_error *error) {
  slf_result result = resize(d, width_px, height_px, error);
  if (result != SLF_OK) return result;
  end_look_ahead(d);
  camera c = camera_of_view(view, width_px, height_px);
  float matrix[16], z_near, z_far;
  clip_planes(d, &c, &z_near, &z_far);
  camera_clip_matrix(&c, z_near, z_far, matrix);
  gl.BindFramebuffer(GL_FRAMEBUFFER, d->picture.framebuffer);
  gl.Viewport(0, 0, width_px, height_px);
  gl.Enable(GL_FRAMEBUFFER_SRGB);
  gl.Enable(GL_DEPTH_TEST);
  gl.Enable(GL_CULL_FACE);
  gl.CullFace(GL_FRONT); /* the camera is left-handed: what winds forwards winds back on screen */
  gl.UseProgram(d->program);
  gl.UniformMatrix4fv(d->clip_uniform, 1, GL_FALSE, matrix);
  gl.Uniform4f(d->tone_uniform, exp2f(d->look.exposure_ev), d->look.tone_map ? 1 : 0, 0, 0);
  gl.ActiveTexture(GL_TEXTURE0);
  gl.BlendFunc(GL_ONE, GL_ONE);
  gl.DepthFunc(GL_LEQUAL);
  const bool long_update = mask_surface < 0 && mixes_by_depth(d);
  if (mask_surface < 0 && !long_update) update_textures(d, &c);
  if (mask_surface < 0)
    show_matte(d, &c);
  else
    draw_matte(d, mask_surface);
  if (long_update) { /* the driver draws that meanwhile, on threads of its own */
    gl.Flush();
    update_textures(d, &c);
  }
  for (uint32_t i = 0; i < d->surface_count; i++)
    if (!is_matte(&d->surfaces[i])) draw_surface(d, i, mask_surface);
  d->view_before = d->view;
  d->view = *view;
  return SLF_OK;
}

void drawing_read(drawing *d, uint8_t *rgba) {
  size_t row_nbytes = (size_t)d->width_px * 4;
  gl.BindFramebuffer(GL_FRAMEBUFFER, d->picture.framebuffer);
  gl.ReadPixels(0, 0, d->width_px, d->height_px, GL_RGBA, GL_UNSIGNED_BYTE, rgba);
  for (int y = 0; y < d->height_px / 2; y++) { /* GL counts rows from below */
    uint8_t *a = rgba + (size_t)y * row_nbytes;
    uint8_t *b = rgba + (size_t)(d->height_px - 1 - y) * row_nbytes;
    for (size_t i = 0; i < row_nbytes; i++) {
      uint8_t swap = a[i];
      a[i] = b[i];
      b[i] = swap;
    }
  }
}

void drawing_finish(drawing *d) {
  begin_look_ahead(d);
  gl.Finish();
}

void drawing_show(drawing *d, int width_px, int height_px) {
  gl.Disable(GL_FRAMEBUFFER_SRGB); /* codes go to the window as they are */
  gl.BindFramebuffer(GL_READ_FRAMEBUFFER, d->picture.framebuffer);
  gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
  gl.BlitFramebuffer(0, 0, d->width_px, d->height_px, 0, 0, width_px, height_px,
                     GL_COLOR_BUFFER_BIT, GL_NEAREST);
  begin_look_ahead(d);
}

water *drawing_water(drawing *d, uint32_t surface_index) {
  return surface_index < d->surface_count ? d->surfaces[surface_index].water : NULL;
}

const slf_file *drawing_file(const drawing *d) {
  return d->file;
}

block_cache *drawing_cache(drawing *d) {
  end_look_ahead(d);
  return d->cache;
}
