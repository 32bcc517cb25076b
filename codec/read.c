/* read.c - opening and checking a file. FORMAT.md, "Chunks". */
#include "codec/file.h"
#include "codec/kernel.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

/* ---- Chunks -------------------------------------------------------------------------------- */

static const char *type_name(uint32_t type, char name[5]) {
  put_u32((uint8_t *)name, type);
  for (int i = 0; i < 4; i++)
    if (name[i] < ' ' || name[i] > '~') name[i] = '?';
  name[4] = 0;
  return name;
}

static slf_result check_crc(const slf_file *file, const chunk *c, slf_error *error) {
  uint32_t crc = slf_crc32(file->bytes + c->offset, c->nbytes);
  char name[5];
  if (crc == c->crc) return SLF_OK;
  return slf_fail(error, SLF_ERROR_CHECKSUM,
                  "%s: chunk %s at byte %" PRIu64 ": checksum %08x, expected %08x", file->name,
                  type_name(c->type, name), c->offset, crc, c->crc);
}

static slf_result needs_more(const slf_file *file, uint64_t nbytes, slf_error *error) {
  return slf_fail(error, SLF_ERROR_PARTIAL,
                  "%s: %" PRIu64 " bytes are there, the first %" PRIu64 " are needed", file->name,
                  file->nbytes, nbytes);
}

static slf_result read_chunk_table(slf_file *file, slf_error *error) {
  const uint8_t *p = file->bytes;
  if (file->prefix && file->nbytes < HEADER_NBYTES) return needs_more(file, HEADER_NBYTES, error);
  if (file->nbytes < HEADER_NBYTES || memcmp(p, slf_magic, sizeof slf_magic) != 0)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: not a .slf file (%" PRIu64 " bytes)", file->name,
                    file->nbytes);
  if (get_u16(p + 8) != VERSION_MAJOR)
    return slf_fail(error, SLF_ERROR_FORMAT,
                    "%s: format version %u.%u, this library reads %d.x: make it again", file->name,
                    get_u16(p + 8), get_u16(p + 10), VERSION_MAJOR);
  if (slf_crc32(p, 28) != get_u32(p + 28))
    return slf_fail(error, SLF_ERROR_CHECKSUM, "%s: header: checksum %08x, expected %08x",
                    file->name, slf_crc32(p, 28), get_u32(p + 28));
  file->whole_nbytes = get_u64(p + 16);
  if (file->prefix ? file->whole_nbytes < file->nbytes : file->whole_nbytes != file->nbytes)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: %" PRIu64 " bytes, its header says %" PRIu64,
                    file->name, file->nbytes, file->whole_nbytes);
  file->chunk_count = get_u32(p + 12);
  uint64_t table_nbytes = (uint64_t)file->chunk_count * CHUNK_ENTRY_NBYTES;
  if (file->chunk_count == 0 || file->whole_nbytes < HEADER_NBYTES ||
      table_nbytes > file->whole_nbytes - HEADER_NBYTES)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: %u chunks do not fit in %" PRIu64 " bytes",
                    file->name, file->chunk_count, file->whole_nbytes);
  if (HEADER_NBYTES + table_nbytes > file->nbytes)
    return needs_more(file, HEADER_NBYTES + table_nbytes, error);
  if (slf_crc32(p + HEADER_NBYTES, table_nbytes) != get_u32(p + 24))
    return slf_fail(error, SLF_ERROR_CHECKSUM, "%s: chunk table: checksum %08x, expected %08x",
                    file->name, slf_crc32(p + HEADER_NBYTES, table_nbytes), get_u32(p + 24));
  file->chunks = calloc(file->chunk_count, sizeof *file->chunks);
  if (!file->chunks)
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for %u chunks", file->name,
                    file->chunk_count);
  uint64_t end = HEADER_NBYTES + table_nbytes;
  for (uint32_t i = 0; i < file->chunk_count; i++) {
    const uint8_t *e = p + HEADER_NBYTES + (size_t)i * CHUNK_ENTRY_NBYTES;
    chunk *c = &file->chunks[i];
    *c = (chunk){get_u32(e),     get_u16(e + 4),  get_u16(e + 6),
                 get_u32(e + 8), get_u64(e + 16), get_u64(e + 24)};
    if (c->offset != end || c->nbytes > file->whole_nbytes - end)
      return slf_fail(error, SLF_ERROR_FORMAT,
                      "%s: chunk %u is %" PRIu64 " bytes at %" PRIu64 ", expected at %" PRIu64
                      " of %" PRIu64,
                      file->name, i, c->nbytes, c->offset, end, file->whole_nbytes);
    end += c->nbytes;
  }
  if (end != file->whole_nbytes)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: chunks end at %" PRIu64 " of %" PRIu64 " bytes",
                    file->name, end, file->whole_nbytes);
  return SLF_OK;
}

/* The one chunk of a type for a surface and layer, or NULL. */
static const chunk *look_up(const slf_file *file, uint32_t type, uint32_t surface, uint32_t layer) {
  for (uint32_t i = 0; i < file->chunk_count; i++) {
    const chunk *c = &file->chunks[i];
    if (c->type == type && c->surface == surface && c->layer == layer) return c;
  }
  return NULL;
}

/* The same where there has to be one; its checksum is checked unless it holds blocks. */
static slf_result find_chunk(const slf_file *file, uint32_t type, uint32_t surface, uint32_t layer,
                             const chunk **found, slf_error *error) {
  char name[5];
  const chunk *c = *found = look_up(file, type, surface, layer);
  if (!c)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: no chunk %s for surface %u, layer %u", file->name,
                    type_name(type, name), surface, layer);
  bool blocks = type == CHUNK_BASE || type == CHUNK_KEYS || type == CHUNK_REST;
  if (blocks) return SLF_OK;
  if (c->offset + c->nbytes > file->nbytes) return needs_more(file, c->offset + c->nbytes, error);
  return check_crc(file, c, error);
}

static slf_result bad_size(const slf_file *file, const chunk *c, uint64_t expected,
                           slf_error *error) {
  char name[5];
  return slf_fail(error, SLF_ERROR_FORMAT,
                  "%s: chunk %s at byte %" PRIu64 " has %" PRIu64 " bytes, expected %" PRIu64,
                  file->name, type_name(c->type, name), c->offset, c->nbytes, expected);
}

/* ---- Scene and meshes ---------------------------------------------------------------------- */

static bool get_name(const uint8_t *p, char name[SLF_NAME_NBYTES]) {
  memcpy(name, p, SLF_NAME_NBYTES);
  size_t length = strnlen(name, SLF_NAME_NBYTES);
  for (size_t i = 0; i < SLF_NAME_NBYTES; i++) {
    unsigned char c = (unsigned char)name[i];
    if (i < length ? c < ' ' || c == 0x7f : c != 0) return false;
  }
  return length < SLF_NAME_NBYTES;
}

static bool get_floats(const uint8_t *p, float *values, size_t count) {
  bool finite = true;
  for (size_t i = 0; i < count; i++) {
    values[i] = get_f32(p + 4 * i);
    finite = finite && isfinite(values[i]);
  }
  return finite;
}

static slf_result read_scene(slf_file *file, slf_error *error) {
  const chunk *c;
  slf_result result = find_chunk(file, CHUNK_SCENE, 0, 0, &c, error);
  if (result != SLF_OK) return result;
  const uint8_t *p = file->bytes + c->offset;
  if (c->nbytes < 20) return bad_size(file, c, 20, error);
  bool finite = get_floats(p, file->background, 3);
  file->view_count = get_u32(p + 12);
  file->surface_count = get_u32(p + 16);
  uint64_t expected = 20 + (uint64_t)file->view_count * VIEW_NBYTES +
                      (uint64_t)file->surface_count * SURFACE_NBYTES;
  if (c->nbytes != expected) return bad_size(file, c, expected, error);
  if (file->view_count > MAX_VIEWS || file->surface_count > SLF_MAX_SURFACES)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: %u views, %u surfaces; limits are %d, %d",
                    file->name, file->view_count, file->surface_count, MAX_VIEWS, SLF_MAX_SURFACES);
  /* One more, so that none of either is no special case. */
  file->views = calloc((size_t)file->view_count + 1, sizeof *file->views);
  file->surfaces = calloc((size_t)file->surface_count + 1, sizeof *file->surfaces);
  if (!file->views || !file->surfaces)
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for %u views, %u surfaces", file->name,
                    file->view_count, file->surface_count);
  p += 20;
  for (uint32_t i = 0; i < file->view_count; i++, p += VIEW_NBYTES) {
    slf_view *v = &file->views[i];
    float numbers[7];
    bool named = get_name(p, v->name);
    finite = get_floats(p + SLF_NAME_NBYTES, numbers, 7) && finite;
    memcpy(v->location, numbers, sizeof v->location);
    memcpy(v->look_at, numbers + 3, sizeof v->look_at);
    v->angle_deg = numbers[6];
    if (!named || !(v->angle_deg > 0 && v->angle_deg < 180))
      return slf_fail(error, SLF_ERROR_FORMAT, "%s: view %u: bad name or angle", file->name, i);
  }
  for (uint32_t i = 0; i < file->surface_count; i++, p += SURFACE_NBYTES) {
    slf_surface *s = &file->surfaces[i].public;
    const uint8_t *n = p + SLF_NAME_NBYTES;
    bool named = get_name(p, s->name);
    s->flags = get_u32(n);
    s->layer_count = get_u32(n + 4);
    s->mesh.vertex_count = get_u32(n + 8);
    s->mesh.triangle_count = get_u32(n + 12);
    if (!named || s->flags > 7 || s->layer_count > SLF_MAX_LAYERS)
      return slf_fail(error, SLF_ERROR_FORMAT, "%s: surface %u: bad name, flags %#x or %u layers",
                      file->name, i, s->flags, s->layer_count);
  }
  if (!finite)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: a number of the scene is not finite", file->name);
  return SLF_OK;
}

static slf_result read_mesh(slf_file *file, uint32_t index, slf_error *error) {
  surface_state *surface = &file->surfaces[index];
  slf_mesh *mesh = &surface->public.mesh;
  const chunk *c;
  slf_result result = find_chunk(file, CHUNK_MESH, index, 0, &c, error);
  if (result != SLF_OK) return result;
  uint64_t expected = (uint64_t)mesh->vertex_count * VERTEX_NBYTES +
                      (uint64_t)mesh->triangle_count * TRIANGLE_NBYTES;
  if (c->nbytes != expected) return bad_size(file, c, expected, error);
  if (mesh->vertex_count > MAX_VERTICES || mesh->triangle_count > MAX_TRIANGLES)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: surface %u: %u vertices, %u triangles",
                    file->name, index, mesh->vertex_count, mesh->triangle_count);
  surface->vertices = calloc((size_t)mesh->vertex_count + 1, sizeof *surface->vertices);
  surface->triangles = calloc(3 * (size_t)mesh->triangle_count + 1, sizeof *surface->triangles);
  if (!surface->vertices || !surface->triangles)
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for a mesh of %u vertices", file->name,
                    mesh->vertex_count);
  const uint8_t *p = file->bytes + c->offset;
  for (uint32_t i = 0; i < mesh->vertex_count; i++, p += VERTEX_NBYTES) {
    float n[14];
    if (!get_floats(p, n, 14))
      return slf_fail(error, SLF_ERROR_FORMAT, "%s: surface %u: vertex %u is not finite",
                      file->name, index, i);
    surface->vertices[i] = (slf_vertex){{n[0], n[1], n[2]},
                                        {n[3], n[4], n[5]},
                                        {n[6], n[7], n[8]},
                                        {n[9], n[10], n[11]},
                                        n[12],
                                        n[13]};
  }
  for (uint32_t i = 0; i < 3 * mesh->triangle_count; i++, p += 4) {
    surface->triangles[i] = get_u32(p);
    if (surface->triangles[i] >= mesh->vertex_count)
      return slf_fail(error, SLF_ERROR_FORMAT, "%s: surface %u: a triangle names vertex %u of %u",
                      file->name, index, surface->triangles[i], mesh->vertex_count);
  }
  mesh->vertices = surface->vertices;
  mesh->triangles = surface->triangles;
  return SLF_OK;
}

/* Few surfaces have one. */
static slf_result read_slab(slf_file *file, uint32_t index, slf_error *error) {
  slf_slab *slab = &file->surfaces[index].public.slab;
  const chunk *c;
  if (!look_up(file, CHUNK_SLAB, index, 0)) return SLF_OK;
  slf_result result = find_chunk(file, CHUNK_SLAB, index, 0, &c, error);
  if (result != SLF_OK) return result;
  if (c->nbytes != SLAB_NBYTES) return bad_size(file, c, SLAB_NBYTES, error);
  *slab = (slf_slab){get_f32(file->bytes + c->offset), get_f32(file->bytes + c->offset + 4)};
  if (slab->thickness == 0 || !slab_is_valid(slab))
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: surface %u: slab %g thick, of index %g",
                    file->name, index, slab->thickness, slab->ior);
  return SLF_OK;
}

/* ---- Layers -------------------------------------------------------------------------------- */

/* A layer being read: its chunk's bytes are taken from the front. */
typedef struct {
  slf_file *file;
  uint32_t surface, layer;
  layer_state *state;
  const uint8_t *at, *end;
  char name[sizeof((slf_file *)0)->name + 64];
} layer_reader;

static slf_result read_colours(layer_reader *r, slf_error *error) {
  int16_t to_rgb[3][3];
  if (r->end - r->at < COLOURS_NBYTES)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: its colours have %td bytes, expected %d", r->name,
                    r->end - r->at, COLOURS_NBYTES);
  for (int i = 0; i < 9; i++) to_rgb[i / 3][i % 3] = (int16_t)get_u16(r->at + 2 * i);
  layer_set_own_colours(r->state, to_rgb);
  r->at += COLOURS_NBYTES;
  return SLF_OK;
}

static slf_result read_fixed(layer_reader *r, slf_error *error) {
  slf_layer *p = &r->state->public;
  const uint8_t *b = r->at;
  if (r->end - b < LAYER_FIXED_NBYTES)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: header has %td bytes, expected %d", r->name,
                    r->end - b, LAYER_FIXED_NBYTES);
  p->role = b[0];
  p->curve = b[1];
  p->angular = b[2];
  p->u_count = get_u32(b + 4);
  p->v_count = get_u32(b + 8);
  p->s_count = get_u32(b + 12);
  p->t_count = get_u32(b + 16);
  p->quality = get_f32(b + 20);
  p->psnr = get_f32(b + 24);
  p->height_unit = get_f32(b + 28);
  if (b[0] > SLF_ROLE_COVERAGE || b[1] > SLF_CURVE_DWA || b[2] > SLF_ANGULAR_LAYERED || b[3] > 1 ||
      !isfinite(p->quality) || !isfinite(p->psnr) || !isfinite(p->height_unit) ||
      (b[0] == SLF_ROLE_HEIGHT ? !(p->height_unit > 0) : get_u32(b + 28) != 0))
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: role %u, curve %u, angular %u", r->name, b[0],
                    b[1], b[2]);
  if (p->u_count - 1 >= SLF_MAX_TEXELS || p->v_count - 1 >= SLF_MAX_TEXELS ||
      p->s_count - 1 >= SLF_MAX_DIRECTIONS || p->t_count - 1 >= SLF_MAX_DIRECTIONS)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: %ux%u texels, %ux%u directions", r->name,
                    p->u_count, p->v_count, p->s_count, p->t_count);
  for (int channel = 0; channel < 3; channel++)
    r->state->step_lines[channel] =
        (step_line){get_u16(b + 32 + 4 * channel), get_u16(b + 34 + 4 * channel)};
  if (!layer_make_steps(r->state))
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: steps are out of range", r->name);
  layer_set_curve(r->state);
  layer_set_jfif_colours(r->state);
  r->at += LAYER_FIXED_NBYTES;
  return b[3] ? read_colours(r, error) : SLF_OK;
}

/* What the symbols of their code mean, from 1 on. */
static slf_result read_whole_heads(layer_reader *r, block_codes *codes, slf_error *error) {
  const huffman_code *code = &codes->codes[CODE_WHOLE_HEAD];
  for (int i = 0; i < code->symbol_count; i++)
    if (code->symbols[i] >= code->symbol_count)
      return slf_fail(error, SLF_ERROR_FORMAT, "%s: whole head %u of %u", r->name, code->symbols[i],
                      code->symbol_count);
  for (int i = 1; i < code->symbol_count; i++, r->at += WHOLE_HEAD_NBYTES) {
    if (r->end - r->at < WHOLE_HEAD_NBYTES)
      return slf_fail(error, SLF_ERROR_FORMAT, "%s: whole head %d has %td bytes", r->name, i,
                      r->end - r->at);
    uint32_t whole = get_u16(r->at) | (uint32_t)r->at[2] << 16;
    unsigned how = whole_head_symbol(whole) >> 3;
    bool good = whole >> WHOLE_HEAD_BITS == 0 && how < PREDICTOR_COUNT;
    for (int c = 0; c < 3; c++)
      good = good && (how == PREDICT_INTRA || whole >> c & 1 || whole_head_size(whole, c) == 0);
    if (!good)
      return slf_fail(error, SLF_ERROR_FORMAT, "%s: whole head %d is %#x", r->name, i, whole);
    codes->whole_heads[i] = whole;
  }
  return SLF_OK;
}

static slf_result read_codes(layer_reader *r, layer_stream *stream, unsigned used,
                             slf_error *error) {
  for (int i = 0; i < CODE_COUNT; i++) {
    if (!(used >> i & 1)) continue;
    size_t taken = huffman_get(r->at, (size_t)(r->end - r->at), &stream->codes.codes[i]);
    if (taken == 0)
      return slf_fail(error, SLF_ERROR_FORMAT, "%s: Huffman code %d is none", r->name, i);
    r->at += taken;
  }
  slf_result result =
      used >> CODE_WHOLE_HEAD & 1 ? read_whole_heads(r, &stream->codes, error) : SLF_OK;
  if (result != SLF_OK) return result;
  stream->tables = malloc(sizeof *stream->tables);
  if (!stream->tables)
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for tables", r->name);
  block_tables_make(&stream->codes, stream->tables);
  return SLF_OK;
}

/* What is there of a stream's chunk: nothing, if that does not hold its directory. */
static void take_blocks(layer_reader *r, layer_stream *stream, const chunk *blocks) {
  uint64_t least =
      stream_segment_count(&stream->blocks) * DIRECTORY_ENTRY_NBYTES + STREAM_PAD_NBYTES;
  uint64_t there = r->file->nbytes > blocks->offset ? r->file->nbytes - blocks->offset : 0;
  stream->partial = there < blocks->nbytes;
  r->state->partial = r->state->partial || stream->partial;
  if (there < least) return;
  stream->blocks.bytes = r->file->bytes + blocks->offset;
  stream->blocks.nbytes = stream->partial ? there : blocks->nbytes;
}

static slf_result read_stream(layer_reader *r, stream_kind kind, slf_error *error) {
  layer_stream *stream = &r->state->streams[kind];
  if (r->end - r->at < STREAM_HEADER_NBYTES)
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: stream %d has no header", r->name, kind);
  const uint8_t *b = r->at;
  unsigned gain = b[0], run_log2 = b[1] & 15, parts_log2 = b[1] >> 4;
  unsigned used = get_u16(b + 2);
  stream->payload_bits = get_u64(b + 4);
  if (gain < 1 || gain > MAX_GAIN || run_log2 > MAX_RUN_LOG2 || used >> CODE_COUNT ||
      parts_log2 > MAX_PARTS_LOG2 || (parts_log2 && (run_log2 || kind != STREAM_REST)))
    return slf_fail(error, SLF_ERROR_FORMAT, "%s: stream %d: gain %u, run %u, codes %#x", r->name,
                    kind, gain, b[1], used);
  r->at += STREAM_HEADER_NBYTES;
  r->state->gains[kind] = gain;
  layer_set_run(r->state, kind, run_log2, parts_log2);
  for (int i = 0; i < 3; i++) stream->dc_begin[i] = (int16_t)get_u16(b + 12 + 2 * i);
  slf_result result = read_codes(r, stream, used, error);
  const chunk *blocks;
  if (result == SLF_OK)
    result = find_chunk(r->file, slf_stream_chunks[kind], r->surface, r->layer, &blocks, error);
  if (result != SLF_OK) return result;
  uint64_t least =
      stream_segment_count(&stream->blocks) * (DIRECTORY_ENTRY_NBYTES + 2) + STREAM_PAD_NBYTES;
  if (stream->payload_bits / 8 > blocks->nbytes || blocks->nbytes < least)
    return bad_size(r->file, blocks, least, error);
  take_blocks(r, stream, blocks);
  r->state->public.payload_nbytes += stream->payload_bits / 8;
  r->state->public.index_nbytes += blocks->nbytes - stream->payload_bits / 8;
  return SLF_OK;
}

static slf_result read_layer(slf_file *file, uint32_t surface_index, uint32_t layer_index,
                             slf_error *error) {
  layer_reader r = {
      file, surface_index, layer_index, &file->surfaces[surface_index].layers[layer_index],
      NULL, NULL,          ""};
  snprintf(r.name, sizeof r.name, "%s: surface %u, layer %u", file->name, surface_index,
           layer_index);
  const chunk *c;
  slf_result result = find_chunk(file, CHUNK_LAYER, surface_index, layer_index, &c, error);
  if (result != SLF_OK) return result;
  r.at = file->bytes + c->offset;
  r.end = r.at + c->nbytes;
  result = read_fixed(&r, error);
  if (result == SLF_OK) result = layer_make_units(r.state, r.name, error);
  for (int kind = 0; kind < STREAM_COUNT && result == SLF_OK; kind++)
    if (layer_has(r.state, kind)) result = read_stream(&r, kind, error);
  if (result == SLF_OK) layer_make_scales(r.state);
  if (result == SLF_OK && layer_has(r.state, STREAM_BASE))
    result = layer_make_base(r.state, r.name, error);
  if (result == SLF_OK && layer_has(r.state, STREAM_KEYS))
    result = layer_make_keys(r.state, r.name, error);
  if (result == SLF_OK && r.state->public.curve == SLF_CURVE_DWA)
    result = layer_make_linear(r.state, r.name, error);
  if (result == SLF_OK && r.at != r.end)
    result = slf_fail(error, SLF_ERROR_FORMAT, "%s: %td bytes too many", r.name, r.end - r.at);
  r.state->public.index_nbytes += c->nbytes;
  return result;
}

static slf_result read_layers(slf_file *file, uint32_t index, slf_error *error) {
  surface_state *surface = &file->surfaces[index];
  uint32_t count = surface->public.layer_count;
  surface->layers = calloc((size_t)count + 1, sizeof *surface->layers);
  surface->public_layers = calloc((size_t)count + 1, sizeof *surface->public_layers);
  if (!surface->layers || !surface->public_layers)
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for %u layers", file->name, count);
  for (uint32_t i = 0; i < count; i++) {
    slf_result result = read_layer(file, index, i, error);
    if (result != SLF_OK) return result;
    surface->public_layers[i] = surface->layers[i].public;
  }
  surface->public.layers = surface->public_layers;
  return SLF_OK;
}

/* ---- Open and close ------------------------------------------------------------------------ */

static slf_result read_all(slf_file *file, slf_error *error) {
  slf_result result = read_chunk_table(file, error);
  if (result == SLF_OK) result = read_scene(file, error);
  for (uint32_t i = 0; result == SLF_OK && i < file->surface_count; i++) {
    result = read_mesh(file, i, error);
    if (result == SLF_OK) result = read_slab(file, i, error);
    if (result == SLF_OK) result = read_layers(file, i, error);
  }
  return result;
}

static slf_file *new_file(const char *name) {
  slf_file *file = calloc(1, sizeof *file);
  if (file) snprintf(file->name, sizeof file->name, "%s", name);
  return file;
}

/* Reads what `opened` was given, if `result` is still well. */
static slf_result finish_open(slf_file *opened, slf_result result, slf_file **file,
                              slf_error *error) {
  if (result == SLF_OK) result = read_all(opened, error);
  if (result == SLF_OK)
    *file = opened;
  else
    slf_close(opened);
  return result;
}

static slf_result open_memory(const void *bytes, size_t nbytes, const char *name, bool prefix,
                              slf_file **file, slf_error *error) {
  *file = NULL;
  slf_file *opened = new_file(name);
  if (!opened) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", name);
  opened->bytes = bytes;
  opened->nbytes = nbytes;
  opened->prefix = prefix;
  return finish_open(opened, SLF_OK, file, error);
}

slf_result slf_open_memory(const void *bytes, size_t nbytes, const char *name, slf_file **file,
                           slf_error *error) {
  return open_memory(bytes, nbytes, name, false, file, error);
}

slf_result slf_open_prefix_memory(const void *bytes, size_t nbytes, const char *name,
                                  slf_file **file, slf_error *error) {
  return open_memory(bytes, nbytes, name, true, file, error);
}

static slf_result map_file(slf_file *file, const char *path, slf_error *error) {
  int descriptor = open(path, O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return slf_fail(error, SLF_ERROR_IO, "%s: %s", path, strerror(errno));
  struct stat status;
  slf_result result = SLF_OK;
  if (fstat(descriptor, &status) != 0) {
    result = slf_fail(error, SLF_ERROR_IO, "%s: %s", path, strerror(errno));
  } else if (!S_ISREG(status.st_mode)) {
    result = slf_fail(error, SLF_ERROR_IO, "%s: not a regular file", path);
  } else if (status.st_size < HEADER_NBYTES) {
    file->nbytes = (uint64_t)status.st_size;
    result = file->prefix ? needs_more(file, HEADER_NBYTES, error)
                          : slf_fail(error, SLF_ERROR_FORMAT, "%s: not a .slf file (%jd bytes)",
                                     path, (intmax_t)status.st_size);
  } else {
    void *bytes = mmap(NULL, (size_t)status.st_size, PROT_READ, MAP_PRIVATE, descriptor, 0);
    if (bytes == MAP_FAILED) {
      result = slf_fail(error, SLF_ERROR_IO, "%s: %s", path, strerror(errno));
    } else {
      file->bytes = bytes;
      file->nbytes = (uint64_t)status.st_size;
      file->mapped = true;
    }
  }
  close(descriptor);
  return result;
}

static slf_result open_path(const char *path, bool prefix, slf_file **file, slf_error *error) {
  *file = NULL;
  slf_file *opened = new_file(path);
  if (!opened) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", path);
  opened->prefix = prefix;
  return finish_open(opened, map_file(opened, path, error), file, error);
}

slf_result slf_open(const char *path, slf_file **file, slf_error *error) {
  return open_path(path, false, file, error);
}

slf_result slf_open_prefix(const char *path, slf_file **file, slf_error *error) {
  return open_path(path, true, file, error);
}

void slf_close(slf_file *file) {
  if (!file) return;
  for (uint32_t i = 0; file->surfaces && i < file->surface_count; i++) {
    surface_state *surface = &file->surfaces[i];
    for (uint32_t j = 0; surface->layers && j < surface->public.layer_count; j++)
      layer_free(&surface->layers[j]);
    free(surface->layers);
    free(surface->public_layers);
    free(surface->vertices);
    free(surface->triangles);
  }
  free(file->surfaces);
  free(file->views);
  free(file->chunks);
  if (file->mapped) munmap((void *)(uintptr_t)file->bytes, file->nbytes);
  free(file);
}

/* ---- What is in it ------------------------------------------------------------------------- */

uint32_t slf_surface_count(const slf_file *file) {
  return file->surface_count;
}

const slf_surface *slf_get_surface(const slf_file *file, uint32_t surface_index) {
  return surface_index < file->surface_count ? &file->surfaces[surface_index].public : NULL;
}

uint32_t slf_view_count(const slf_file *file) {
  return file->view_count;
}

const slf_view *slf_get_view(const slf_file *file, uint32_t view_index) {
  return view_index < file->view_count ? &file->views[view_index] : NULL;
}

void slf_get_background(const slf_file *file, float linear_rgb[3]) {
  memcpy(linear_rgb, file->background, sizeof file->background);
}

uint64_t slf_file_nbytes(const slf_file *file) {
  return file->nbytes;
}

/* ---- Verify -------------------------------------------------------------------------------- */

/* Every entry of a unit parses to its last block. */
static slf_result verify_unit(const layer_state *layer, stream_kind kind, uint32_t unit,
                              uint32_t slice_count, const char *name, slf_error *error) {
  const layer_stream *stream = &layer->streams[kind];
  bit_reader reader;
  entry_state state = {0};
  uint64_t entry = UINT64_MAX;
  uint32_t width = QUAD_SLICES >> stream->parts_log2;
  for (uint64_t place = 0; place < layer_place_count(layer); place++)
    for (uint32_t i = 0; i < slice_count; i++) {
      entry_site site = site_in_unit(stream, unit, place, slice_count, i);
      if (site.entry != entry) {
        entry = site.entry;
        reader_begin(&reader, &stream->blocks, entry, layer->kernel->find(&stream->blocks, entry));
        entry_begin(&state, stream->dc_begin);
      }
      if (!layer->kernel->parse(stream->tables, &reader, 0, site.number, i % width == 0, NULL,
                                &state))
        return slf_fail(error, SLF_ERROR_FORMAT,
                        "%s: stream %d: block %" PRIu64 " of unit %u does not parse", name, kind,
                        place, unit);
    }
  return SLF_OK;
}

static slf_result verify_layer(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                               slf_error *error) {
  const layer_state *layer = &file->surfaces[surface_index].layers[layer_index];
  char name[sizeof file->name + 64];
  snprintf(name, sizeof name, "%s: surface %u, layer %u", file->name, surface_index, layer_index);
  slf_result result = SLF_OK;
  for (int kind = 0; kind < STREAM_COUNT && result == SLF_OK; kind++)
    if (layer_has(layer, kind))
      result = layer->kernel->check_stream(&layer->streams[kind].blocks, name, error);
  if (result == SLF_OK && layer_has(layer, STREAM_BASE))
    result = verify_unit(layer, STREAM_BASE, 0, 1, name, error);
  for (uint32_t i = 0; layer_has(layer, STREAM_KEYS) && result == SLF_OK &&
                       i < layer->group_s_count * layer->group_t_count;
       i++)
    if (layer->group_keys[i] != NO_KEY)
      result = verify_unit(layer, STREAM_KEYS, layer->group_ranks[i], 1, name, error);
  for (uint32_t i = 0; result == SLF_OK && i < layer->quad_s_count * layer->quad_t_count; i++)
    if (layer->quad_slices[i])
      result = verify_unit(layer, STREAM_REST, layer->quad_ranks[i],
                           (uint32_t)__builtin_popcount(layer->quad_slices[i]), name, error);
  return result;
}

slf_result slf_verify(const slf_file *file, slf_error *error) {
  if (file->nbytes < file->whole_nbytes) return needs_more(file, file->whole_nbytes, error);
  for (uint32_t i = 0; i < file->chunk_count; i++) {
    slf_result result = check_crc(file, &file->chunks[i], error);
    if (result != SLF_OK) return result;
  }
  for (uint32_t i = 0; i < file->surface_count; i++)
    for (uint32_t j = 0; j < file->surfaces[i].public.layer_count; j++) {
      slf_result result = verify_layer(file, i, j, error);
      if (result != SLF_OK) return result;
    }
  return SLF_OK;
}
