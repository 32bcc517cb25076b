/* pack - writes a scene's surfaces, the slices that were gathered for them, and its views as .slf.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cover.h"
#include "fail.h"
#include "image.h"
#include "surface.h"

/* Whatever ends the program, no temporary file stays behind. */
static slf_writer *writer;

static void abort_writer(void) {
  slf_writer_abort(writer);
}

static void check(slf_result result, const slf_error *error) {
  if (result != SLF_OK) fail("%s", error->message);
}

/* Where the encoder reads slices: the chunks of one surface, one of them open at a time. */
typedef struct {
  const char *folder;
  const surface *self;
  uint32_t slices_per_chunk;
  uint32_t *place; /* s_count x t_count: place of a slice among those that exist */
  image *chunk;
  uint32_t chunk_index;
  uint32_t part, part_count; /* of a slice: which is read, of how many */
  uint8_t *first; /* displayed codes of the slice read first, to see whether any other differs */
  bool varies;
} slice_reader;

static void open_chunk(slice_reader *reader, uint32_t chunk_index) {
  if (reader->chunk && reader->chunk_index == chunk_index) return;
  image_close(reader->chunk);
  char *path = format_text("%s/%s/%04u.exr", reader->folder, reader->self->name, chunk_index);
  reader->chunk = image_open(path);
  reader->chunk_index = chunk_index;
  if (image_width(reader->chunk) != reader->self->u_count ||
      image_height(reader->chunk) % (reader->self->v_count * reader->part_count))
    fail("%s: %u x %u texels, expected slices of %u x %u", path, image_width(reader->chunk),
         image_height(reader->chunk), reader->self->u_count, reader->self->v_count);
  free(path);
}

/* A surface looks the same from everywhere if no displayed code changes by more than one. */
static void watch_variation(slice_reader *reader, const float *rgb) {
  size_t count = (size_t)reader->self->u_count * reader->self->v_count * 3;
  if (!reader->first) {
    reader->first = allocate(count, 1, reader->self->name);
    for (size_t i = 0; i < count; i++) reader->first[i] = slf_srgb_from_linear(rgb[i]);
  }
  for (size_t i = 0; i < count && !reader->varies; i++)
    reader->varies = abs(reader->first[i] - slf_srgb_from_linear(rgb[i])) > 1;
}

static uint8_t code_from_coverage(float coverage) {
  return (uint8_t)lrintf(SLF_COVERED_BY_NONE + 127 * coverage);
}

static slf_result read_slice(void *context, uint32_t s, uint32_t t, float *rgb, slf_error *error) {
  (void)error;
  slice_reader *reader = context;
  const surface *self = reader->self;
  uint32_t place = reader->place[t * self->s_count + s];
  open_chunk(reader, place / reader->slices_per_chunk);
  uint32_t image_index = place % reader->slices_per_chunk * reader->part_count + reader->part;
  image_read_rows(reader->chunk, "RGB", image_index * self->v_count, self->v_count, rgb);
  const size_t count = (size_t)self->u_count * self->v_count * 3;
  for (size_t i = 0; reader->part == PART_HEIGHT && i < count; i++)
    rgb[i] = slf_linear_from_srgb(slf_code_from_height(rgb[i], (float)self->layers));
  for (size_t i = 0; reader->part == PART_COVERAGE && i < count; i++)
    rgb[i] = slf_linear_from_srgb(code_from_coverage(rgb[i]));
  if (!reader->varies) watch_variation(reader, rgb);
  return SLF_OK;
}

static slice_reader open_slices(const char *folder, const surface *self, uint32_t asked_rays,
                                uint32_t part, uint32_t part_count) {
  slice_reader reader = {
      .folder = folder,
      .self = self,
      .part = part,
      .part_count = part_count,
      .slices_per_chunk = surface_slices_per_chunk(self, asked_rays),
      .place = allocate((size_t)self->s_count * self->t_count, sizeof *reader.place, self->name)};
  uint32_t slice_count;
  slice *slices = surface_slices(self, &slice_count);
  for (uint32_t i = 0; i < slice_count; i++)
    reader.place[slices[i].t * self->s_count + slices[i].s] = i;
  free(slices);
  return reader;
}

/* A cell of the grid is two triangles; at a pole one of them is empty and left out. */
static uint32_t *grid_triangles(const surface *self, uint32_t *triangle_count) {
  uint32_t columns = self->column_count, rows = self->row_count;
  uint32_t *triangles =
      allocate((size_t)(columns - 1) * (rows - 1) * 6, sizeof *triangles, self->name);
  *triangle_count = 0;
  for (uint32_t row = 0; row + 1 < rows; row++) {
    for (uint32_t column = 0; column + 1 < columns; column++) {
      uint32_t a = row * columns + column, b = a + 1, c = a + columns, d = c + 1;
      const uint32_t cell[2][3] = {{a, b, d}, {a, d, c}};
      for (int half = 0; half < 2; half++) {
        uint32_t edge_from = half ? d : a, edge_to = half ? c : b;
        if (!memcmp(self->vertices[edge_from].position, self->vertices[edge_to].position,
                    sizeof self->vertices->position))
          continue;
        memcpy(triangles + (size_t)*triangle_count * 3, cell[half], sizeof cell[half]);
        (*triangle_count)++;
      }
    }
  }
  return triangles;
}

static void write_geometry(const surface *self) {
  slf_error error;
  slf_surface out = {.flags = self->flags, .slab = self->slab};
  uint32_t *triangles = grid_triangles(self, &out.mesh.triangle_count);
  strcpy(out.name, self->name);
  out.mesh.vertices = self->vertices;
  out.mesh.vertex_count = self->column_count * self->row_count;
  out.mesh.triangles = triangles;
  check(slf_writer_add_surface(writer, &out, &error), &error);
  free(triangles);
}

static void report_holes(const char *folder, const surface *self, uint32_t asked_rays) {
  uint32_t hole_count;
  free(cover_sources(folder, self, asked_rays, surface_rays(self, asked_rays), &hole_count));
  if (hole_count)
    fprintf(stderr,
            "bake: surface '%s': %u of %u texels have no surface behind them: filled from their "
            "neighbours\n",
            self->name, hole_count, self->u_count * self->v_count);
}

static void write_layer(const char *folder, const surface *self, uint32_t asked_rays,
                        slf_role role) {
  slf_error error;
  const uint32_t part = role == SLF_ROLE_FULL ? 0 : PART_OWN + role - SLF_ROLE_OWN;
  slice_reader reader =
      open_slices(folder, self, asked_rays, part, surface_part_count(self, asked_rays));
  slf_source source = {.read_slice = read_slice, .context = &reader};
  bool hdr = self->hdr && role < SLF_ROLE_HEIGHT;
  slf_layer_options options = {.role = role,
                               .curve = hdr ? SLF_CURVE_DWA : SLF_CURVE_SRGB,
                               .angular = SLF_ANGULAR_LAYERED,
                               .u_count = self->u_count,
                               .v_count = self->v_count,
                               .s_count = self->s_count,
                               .t_count = self->t_count,
                               .quality = role == SLF_ROLE_COVERAGE ? 75 : 90,
                               .height_unit = role == SLF_ROLE_HEIGHT ? (float)self->layers : 0};
  check(slf_writer_add_layer(writer, &options, &source, &error), &error);
  if (role == SLF_ROLE_FULL && self->s_count * self->t_count > 1 && !reader.varies)
    fprintf(stderr,
            "bake: surface '%s': has %ux%u directions, and looks the same from all: Slf_Matte "
            "would do\n",
            self->name, self->s_count, self->t_count);
  image_close(reader.chunk);
  free(reader.first);
  free(reader.place);
}

/* name lx ly lz ax ay az angle_deg, one view a line; # begins a comment. */
static void write_views(const char *path) {
  slf_error error;
  FILE *file = fopen(path, "r");
  if (!file) fail("%s: %s", path, strerror(errno));
  char line[1024];
  for (int number = 1; fgets(line, sizeof line, file); number++) {
    slf_view view = {0};
    line[strcspn(line, "#\n")] = 0;
    if (!line[strspn(line, " \t\r")]) continue;
    if (sscanf(line, "%63s %f %f %f %f %f %f %f", view.name, &view.location[0], &view.location[1],
               &view.location[2], &view.look_at[0], &view.look_at[1], &view.look_at[2],
               &view.angle_deg) != 8)
      fail("%s: line %d: expected: name, location, look_at, angle", path, number);
    check(slf_writer_add_view(writer, &view, &error), &error);
  }
  fclose(file);
}

int main(int argc, char **argv) {
  if (argc != 4 && argc != 5) {
    fputs("usage: pack FOLDER RAYS [VIEWS] OUT.slf\n", stderr);
    return 2;
  }
  slf_error error;
  const char *folder = argv[1];
  uint32_t asked_rays = (uint32_t)atoi(argv[2]);
  scene *whole = scene_read(folder);
  atexit(abort_writer);
  check(slf_writer_create(argv[argc - 1], &writer, &error), &error);
  slf_writer_set_background(writer, whole->background);
  if (argc == 5) write_views(argv[3]);
  for (uint32_t i = 0; i < whole->surface_count; i++) {
    const surface *self = &whole->surfaces[i];
    write_geometry(self);
    report_holes(folder, self, asked_rays);
    const slf_role first = surface_has_layers(self) ? SLF_ROLE_OWN : SLF_ROLE_FULL;
    for (uint32_t part = 0; part < surface_part_count(self, asked_rays); part++)
      write_layer(folder, self, asked_rays, first + part);
  }
  slf_result finished = slf_writer_finish(writer, &error);
  writer = NULL; /* freed either way */
  check(finished, &error);
  scene_free(whole);
  return 0;
}
