/* write.c - assembling a file: chunks in a scratch file, then one pass to a temporary and a rename.
 */
#include "codec/encode.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

typedef struct {
  uint32_t type, surface, layer;
  encoded_chunk content;
  bool matte; /* of a layer of one slice */
} written_chunk;

typedef struct {
  char name[SLF_NAME_NBYTES];
  uint32_t flags, layer_count, vertex_count, triangle_count;
} written_surface;

struct slf_writer {
  char *path, *temporary;
  int descriptor;
  scratch_file scratch; /* the chunks' bytes, in the order in which they came */
  float background[3];
  slf_view *views;
  uint32_t view_count;
  written_surface *surfaces;
  uint32_t surface_count;
  written_chunk *chunks;
  uint32_t chunk_count;
};

/* ---- Begin and end ------------------------------------------------------------------------- */

static void writer_free(slf_writer *writer) {
  scratch_close(&writer->scratch);
  free(writer->chunks);
  free(writer->surfaces);
  free(writer->views);
  free(writer->path);
  free(writer->temporary);
  free(writer);
}

slf_result slf_writer_create(const char *path, slf_writer **writer, slf_error *error) {
  *writer = NULL;
  slf_writer *w = calloc(1, sizeof *w);
  if (!w) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", path);
  w->descriptor = w->scratch.descriptor = -1;
  w->path = strdup(path);
  /* Beside the file, so that the rename stays in one file system; O_EXCL makes the name ours. */
  if (!w->path || asprintf(&w->temporary, "%s.%ld.part", path, (long)getpid()) < 0) {
    w->temporary = NULL;
    writer_free(w);
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", path);
  }
  w->descriptor = open(w->temporary, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (w->descriptor < 0) {
    slf_result result = slf_fail(error, SLF_ERROR_IO, "%s: %s", w->temporary, strerror(errno));
    writer_free(w);
    return result;
  }
  slf_result result = scratch_open(path, &w->scratch, error);
  if (result == SLF_OK)
    *writer = w;
  else
    slf_writer_abort(w);
  return result;
}

void slf_writer_abort(slf_writer *writer) {
  if (!writer) return;
  if (writer->descriptor >= 0) close(writer->descriptor);
  unlink(writer->temporary);
  writer_free(writer);
}

/* ---- Adding -------------------------------------------------------------------------------- */

static slf_result no_memory(const slf_writer *writer, slf_error *error) {
  return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", writer->path);
}

static slf_result add_chunk(slf_writer *writer, uint32_t type, uint32_t layer,
                            encoded_chunk content, slf_error *error) {
  written_chunk *chunks = realloc(writer->chunks, (writer->chunk_count + 1) * sizeof *chunks);
  if (!chunks) return no_memory(writer, error);
  writer->chunks = chunks;
  uint32_t surface = writer->surface_count ? writer->surface_count - 1 : 0;
  chunks[writer->chunk_count++] = (written_chunk){type, surface, layer, content, false};
  return SLF_OK;
}

/* The same for bytes at hand. */
static slf_result add_bytes(slf_writer *writer, uint32_t type, const uint8_t *bytes,
                            uint64_t nbytes, slf_error *error) {
  encoded_chunk content = {writer->scratch.nbytes, nbytes};
  scratch_write(&writer->scratch, content.offset, bytes, nbytes);
  return add_chunk(writer, type, 0, content, error);
}

static bool name_is_valid(const char *name) {
  size_t length = strnlen(name, SLF_NAME_NBYTES);
  for (size_t i = 0; i < length; i++)
    if ((unsigned char)name[i] < ' ' || name[i] == 0x7f) return false;
  return length < SLF_NAME_NBYTES;
}

static bool all_finite(const float *values, size_t count) {
  for (size_t i = 0; i < count; i++)
    if (!isfinite(values[i])) return false;
  return true;
}

slf_result slf_writer_add_view(slf_writer *writer, const slf_view *view, slf_error *error) {
  if (!name_is_valid(view->name) || !all_finite(view->location, 3) ||
      !all_finite(view->look_at, 3) || !(view->angle_deg > 0 && view->angle_deg < 180) ||
      writer->view_count == MAX_VIEWS)
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: view %u: bad name, numbers or angle %g",
                    writer->path, writer->view_count, view->angle_deg);
  slf_view *views = realloc(writer->views, (writer->view_count + 1) * sizeof *views);
  if (!views) return no_memory(writer, error);
  writer->views = views;
  views[writer->view_count++] = *view;
  return SLF_OK;
}

void slf_writer_set_background(slf_writer *writer, const float linear_rgb[3]) {
  for (int c = 0; c < 3; c++) writer->background[c] = isfinite(linear_rgb[c]) ? linear_rgb[c] : 0;
}

static uint8_t *put_floats(uint8_t *p, const float *values, size_t count) {
  for (size_t i = 0; i < count; i++, p += 4) put_f32(p, values[i]);
  return p;
}

static slf_result check_mesh(const slf_writer *writer, const slf_surface *surface,
                             slf_error *error) {
  const slf_mesh *mesh = &surface->mesh;
  if (mesh->vertex_count > MAX_VERTICES || mesh->triangle_count > MAX_TRIANGLES)
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: surface %s: %u vertices, %u triangles",
                    writer->path, surface->name, mesh->vertex_count, mesh->triangle_count);
  for (uint32_t i = 0; i < mesh->vertex_count; i++) {
    const slf_vertex *v = &mesh->vertices[i];
    if (!all_finite(v->position, 3) || !all_finite(v->normal, 3) || !all_finite(v->tangent_u, 3) ||
        !all_finite(v->tangent_v, 3) || !isfinite(v->u) || !isfinite(v->v))
      return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: surface %s: vertex %u is not finite",
                      writer->path, surface->name, i);
  }
  for (uint32_t i = 0; i < 3 * mesh->triangle_count; i++)
    if (mesh->triangles[i] >= mesh->vertex_count)
      return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: surface %s: a triangle names vertex %u of %u",
                      writer->path, surface->name, mesh->triangles[i], mesh->vertex_count);
  return SLF_OK;
}

slf_result slf_writer_add_surface(slf_writer *writer, const slf_surface *surface,
                                  slf_error *error) {
  if (!name_is_valid(surface->name) || surface->flags > 7 || !slab_is_valid(&surface->slab) ||
      writer->surface_count == SLF_MAX_SURFACES)
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: surface %u: bad name, flags %#x or slab",
                    writer->path, writer->surface_count, surface->flags);
  slf_result result = check_mesh(writer, surface, error);
  if (result != SLF_OK) return result;
  const slf_mesh *mesh = &surface->mesh;
  written_surface *surfaces =
      realloc(writer->surfaces, (writer->surface_count + 1) * sizeof *surfaces);
  if (!surfaces) return no_memory(writer, error);
  writer->surfaces = surfaces;
  written_surface *s = &surfaces[writer->surface_count];
  *s = (written_surface){.flags = surface->flags,
                         .vertex_count = mesh->vertex_count,
                         .triangle_count = mesh->triangle_count};
  memcpy(s->name, surface->name, strlen(surface->name));
  uint64_t nbytes = (uint64_t)mesh->vertex_count * VERTEX_NBYTES +
                    (uint64_t)mesh->triangle_count * TRIANGLE_NBYTES;
  uint8_t *bytes = malloc(nbytes + 1), *p = bytes;
  if (!bytes) return no_memory(writer, error);
  for (uint32_t i = 0; i < mesh->vertex_count; i++) {
    const slf_vertex *v = &mesh->vertices[i];
    p = put_floats(p, v->position, 3);
    p = put_floats(p, v->normal, 3);
    p = put_floats(p, v->tangent_u, 3);
    p = put_floats(p, v->tangent_v, 3);
    p = put_floats(p, &v->u, 1);
    p = put_floats(p, &v->v, 1);
  }
  for (uint32_t i = 0; i < 3 * mesh->triangle_count; i++, p += 4) put_u32(p, mesh->triangles[i]);
  writer->surface_count++;
  result = add_bytes(writer, CHUNK_MESH, bytes, nbytes, error);
  if (result == SLF_OK && surface->slab.thickness > 0) {
    uint8_t slab[SLAB_NBYTES];
    put_f32(slab, surface->slab.thickness);
    put_f32(slab + 4, surface->slab.ior);
    result = add_bytes(writer, CHUNK_SLAB, slab, sizeof slab, error);
    if (result != SLF_OK) writer->chunk_count--;
  }
  if (result != SLF_OK) writer->surface_count--;
  free(bytes);
  return result;
}

/* Encodes until the target is met to 0.02 dB or 0.2 %, or the qualities end. PSNR and the logarithm
 * of the ratio are nearly straight lines over quality, so secants find it in a few turns. */
static slf_result encode_for_target(const slf_layer_options *options, const slf_source *source,
                                    scratch_file *scratch, const char *name, encoded_layer *encoded,
                                    slf_error *error) {
  enum { TURNS = 8 };
  uint64_t begin = scratch->nbytes;
  bool by_ratio = options->target_ratio > 0;
  double target = by_ratio ? log(options->target_ratio) : options->target_psnr;
  double tolerance = by_ratio ? 0.002 : 0.02, slope = by_ratio ? -0.09 : 0.6;
  double quality = 75, before = 0, value_before = 0;
  for (int turn = 0;; turn++) {
    slf_layer_options o = *options;
    o.quality = (float)quality;
    slf_result result = encode_layer(&o, source, scratch, name, encoded, error);
    if (result != SLF_OK) return result;
    double value = by_ratio ? log(encoded->ratio) : encoded->psnr;
    double missing = target - value;
    if (turn && fabs(quality - before) > 1e-3 && fabs(value - value_before) > 1e-4)
      slope = (value - value_before) / (quality - before);
    double next = fmax(1, fmin(100, quality + missing / slope));
    if (fabs(missing) <= tolerance || turn + 1 == TURNS || fabs(next - quality) < 1e-3)
      return SLF_OK;
    scratch_truncate(scratch, begin);
    before = quality;
    value_before = value;
    quality = next;
  }
}

slf_result slf_writer_add_layer(slf_writer *writer, const slf_layer_options *options,
                                const slf_source *source, slf_error *error) {
  written_surface *surface =
      writer->surface_count ? &writer->surfaces[writer->surface_count - 1] : NULL;
  if (!surface || surface->layer_count == SLF_MAX_LAYERS)
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: %s", writer->path,
                    surface ? "a surface has at most 8 layers" : "a layer needs a surface first");
  char name[256];
  snprintf(name, sizeof name, "%s: %s", writer->path, surface->name);
  encoded_layer encoded;
  bool searches = options->target_psnr > 0 || options->target_ratio > 0;
  slf_result result =
      searches ? encode_for_target(options, source, &writer->scratch, name, &encoded, error)
               : encode_layer(options, source, &writer->scratch, name, &encoded, error);
  if (result != SLF_OK) return result;
  uint32_t layer = surface->layer_count, chunk_count = writer->chunk_count;
  result = add_chunk(writer, CHUNK_LAYER, layer, encoded.header, error);
  for (int kind = 0; kind < STREAM_COUNT && result == SLF_OK; kind++)
    if (encoded.streams[kind].nbytes)
      result = add_chunk(writer, slf_stream_chunks[kind], layer, encoded.streams[kind], error);
  for (uint32_t i = chunk_count; i < writer->chunk_count; i++)
    writer->chunks[i].matte = options->s_count == 1 && options->t_count == 1;
  if (result == SLF_OK)
    surface->layer_count++;
  else
    writer->chunk_count = chunk_count;
  return result;
}

/* ---- Writing out --------------------------------------------------------------------------- */

static slf_result add_scene(slf_writer *writer, slf_error *error) {
  uint64_t nbytes = 20 + (uint64_t)writer->view_count * VIEW_NBYTES +
                    (uint64_t)writer->surface_count * SURFACE_NBYTES;
  uint8_t *bytes = calloc(1, nbytes), *p = bytes;
  if (!bytes) return no_memory(writer, error);
  p = put_floats(p, writer->background, 3);
  put_u32(p, writer->view_count);
  put_u32(p + 4, writer->surface_count);
  p += 8;
  for (uint32_t i = 0; i < writer->view_count; i++) {
    const slf_view *v = &writer->views[i];
    memcpy(p, v->name, strlen(v->name));
    p = put_floats(p + SLF_NAME_NBYTES, v->location, 3);
    p = put_floats(p, v->look_at, 3);
    p = put_floats(p, &v->angle_deg, 1);
  }
  for (uint32_t i = 0; i < writer->surface_count; i++, p += SURFACE_NBYTES) {
    const written_surface *s = &writer->surfaces[i];
    memcpy(p, s->name, SLF_NAME_NBYTES);
    put_u32(p + SLF_NAME_NBYTES, s->flags);
    put_u32(p + SLF_NAME_NBYTES + 4, s->layer_count);
    put_u32(p + SLF_NAME_NBYTES + 8, s->vertex_count);
    put_u32(p + SLF_NAME_NBYTES + 12, s->triangle_count);
  }
  uint32_t surface_count = writer->surface_count;
  writer->surface_count = 0; /* the chunk belongs to none */
  slf_result result = add_bytes(writer, CHUNK_SCENE, bytes, nbytes, error);
  free(bytes);
  writer->surface_count = surface_count;
  return result;
}

/* What is needed first stands first: the scene, the meshes, the layers' tables; the base of all and
 * matte layers, the keys, the rest. */
static int chunk_place(const written_chunk *c) {
  static const uint32_t order[] = {CHUNK_SCENE, CHUNK_MESH, CHUNK_SLAB, CHUNK_LAYER,
                                   CHUNK_BASE,  CHUNK_KEYS, CHUNK_REST};
  uint32_t type = c->type == CHUNK_REST && c->matte ? CHUNK_BASE : c->type;
  int place = 0;
  while (order[place] != type) place++;
  return place;
}

static int chunk_order(const void *a, const void *b) {
  const written_chunk *x = a, *y = b;
  int difference = chunk_place(x) - chunk_place(y);
  if (difference) return difference;
  if (x->surface != y->surface) return x->surface < y->surface ? -1 : 1;
  return (x->layer > y->layer) - (x->layer < y->layer);
}

/* Copies a chunk to its offset in the file; its CRC at *crc. */
static bool copy_chunk(const slf_writer *writer, const encoded_chunk *content, uint64_t offset,
                       uint32_t *crc) {
  uint8_t buffer[1 << 16];
  *crc = 0;
  for (uint64_t done = 0; done < content->nbytes;) {
    uint64_t left = content->nbytes - done;
    ssize_t count =
        pread(writer->scratch.descriptor, buffer, left < sizeof buffer ? left : sizeof buffer,
              (off_t)(content->offset + done));
    if (count < 0 && errno == EINTR) continue;
    if (count == 0) errno = EIO; /* the scratch file ends early */
    if (count <= 0 || !write_at(writer->descriptor, offset + done, buffer, (uint64_t)count))
      return false;
    *crc = slf_crc32_more(*crc, buffer, (size_t)count);
    done += (uint64_t)count;
  }
  return true;
}

/* The chunks, and then, as their CRCs are known, the head. */
static bool write_file(slf_writer *writer, uint8_t *head, uint64_t head_nbytes) {
  uint64_t offset = head_nbytes;
  errno = writer->scratch.error_number;
  if (errno) return false;
  for (uint32_t i = 0; i < writer->chunk_count; i++) {
    const written_chunk *c = &writer->chunks[i];
    uint8_t *e = head + HEADER_NBYTES + (size_t)i * CHUNK_ENTRY_NBYTES;
    uint32_t crc;
    if (!copy_chunk(writer, &c->content, offset, &crc)) return false;
    put_u32(e, c->type);
    put_u16(e + 4, c->surface);
    put_u16(e + 6, c->layer);
    put_u32(e + 8, crc);
    put_u64(e + 16, offset);
    put_u64(e + 24, c->content.nbytes);
    offset += c->content.nbytes;
  }
  memcpy(head, slf_magic, sizeof slf_magic);
  put_u16(head + 8, VERSION_MAJOR);
  put_u16(head + 10, VERSION_MINOR);
  put_u32(head + 12, writer->chunk_count);
  put_u64(head + 16, offset);
  put_u32(head + 24, slf_crc32(head + HEADER_NBYTES, head_nbytes - HEADER_NBYTES));
  put_u32(head + 28, slf_crc32(head, 28));
  if (!write_at(writer->descriptor, 0, head, head_nbytes)) return false;
  int descriptor = writer->descriptor;
  writer->descriptor = -1;
  return close(descriptor) == 0 && rename(writer->temporary, writer->path) == 0;
}

slf_result slf_writer_finish(slf_writer *writer, slf_error *error) {
  slf_result result = add_scene(writer, error);
  if (result == SLF_OK) {
    qsort(writer->chunks, writer->chunk_count, sizeof *writer->chunks, chunk_order);
    uint64_t head_nbytes = HEADER_NBYTES + (uint64_t)writer->chunk_count * CHUNK_ENTRY_NBYTES;
    uint8_t *head = calloc(1, head_nbytes);
    if (!head)
      result = no_memory(writer, error);
    else if (!write_file(writer, head, head_nbytes))
      result = slf_fail(error, SLF_ERROR_IO, "%s: %s", writer->path, strerror(errno));
    free(head);
  }
  if (result == SLF_OK)
    writer_free(writer);
  else
    slf_writer_abort(writer);
  return result;
}
