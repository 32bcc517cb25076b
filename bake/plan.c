/* plan - what make bakes of a described scene, as rules. `plan surfaces` makes a folder for each
 * surface with its own description, touched only when that changes, and lists what each surface
 * needs; `plan chunks` lists the chunks, once directions that were to be chosen are. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "fail.h"
#include "sample.h"
#include "surface.h"

static char *read_text(const char *path) {
  FILE *file = fopen(path, "rb");
  if (!file) return NULL;
  size_t nbytes = 0, room = 1 << 16;
  char *text = malloc(room);
  while (text) {
    nbytes += fread(text + nbytes, 1, room - nbytes - 1, file);
    if (nbytes + 1 < room) break;
    text = realloc(text, room *= 2);
  }
  if (!text) fail("%s: no memory for %zu bytes", path, room);
  text[nbytes] = 0;
  fclose(file);
  return text;
}

static void write_text_if_changed(const char *path, const char *text, size_t nbytes) {
  char *old = read_text(path), *part = format_text("%s.part", path);
  bool same = old && strlen(old) == nbytes && !memcmp(old, text, nbytes);
  free(old);
  if (!same) {
    FILE *file = fopen(part, "wb");
    if (!file || fwrite(text, 1, nbytes, file) != nbytes || fclose(file) || rename(part, path))
      fail("%s: cannot be written: %s", path, strerror(errno));
  }
  free(part);
}

/* Lines of the description that belong to the scene, not to the surface before them. */
static bool is_scene_line(const char *line) {
  const char *const words[] = {"surface ",    "water ",      "slab ",    "hdr ",
                               "background ", "radiosity\n", "photons\n"};
  for (size_t i = 0; i < sizeof words / sizeof *words; i++)
    if (!strncmp(line, words[i], strlen(words[i]))) return true;
  return false;
}

/* The lines of the description from "surface NAME" to the next line that is not the surface's; what
 * else its choice depends on. */
static void write_surface(const char *folder, const surface *self, const char *text) {
  char *head = format_text("surface %s ", self->name);
  char *path = format_text("%s/%s", folder, self->name);
  char *file = format_text("%s/surface.txt", path);
  const char *begin = strstr(text, head), *end = begin;
  do {
    end = strchr(end, '\n');
    end = end ? end + 1 : begin + strlen(begin);
  } while (*end && !is_scene_line(end));
  if (mkdir(path, 0777) && errno != EEXIST) fail("%s: cannot be made: %s", path, strerror(errno));
  char *own;
  size_t own_nbytes;
  FILE *lines = open_memstream(&own, &own_nbytes);
  if (!lines) fail("surface '%s': no memory for its description", self->name);
  fwrite(begin, 1, (size_t)(end - begin), lines);
  if (self->auto_layers && self->hdr) fprintf(lines, "hdr %s\n", self->name);
  if (self->auto_layers && self->slab.thickness > 0)
    fprintf(lines, "slab %s %g %g\n", self->name, self->slab.thickness, self->slab.ior);
  if (fclose(lines)) fail("surface '%s': no memory for its description", self->name);
  write_text_if_changed(file, own, own_nbytes);
  free(own);
  free(file);
  free(path);
  free(head);
}

/* What has to be known before chunks are: where a curved surface's rays are, which of them find it,
 * and how many directions it takes where that is to be chosen. */
static void write_preparations(FILE *out, const char *folder, const surface *self, uint32_t rays) {
  char *path = format_text("%s/%s", folder, self->name);
  uint32_t part_count = surface_ray_part_count(self, rays);
  for (uint32_t i = 0; i < part_count; i++)
    fprintf(out, "RAY_PARTS += %s/rays.%04u\n%s/rays.made: %s/rays.%04u\n", path, i, path, path, i);
  if (part_count) fprintf(out, "RAY_TABLES += %s/rays\n", path);
  fprintf(out, "COVERS += %s/cover\n%s/cover.made: %s/surface.txt%s%s%s\n", path, path, path,
          part_count ? " " : "", part_count ? path : "", part_count ? "/rays" : "");
  if (self->auto_error)
    fprintf(out, "CHOICES += %s/choice\n%s/choice.made: %s/surface.txt %s/cover%s%s%s\n", path,
            path, path, path, part_count ? " " : "", part_count ? path : "",
            part_count ? "/rays" : "");
  free(path);
}

static void write_chunks(FILE *out, const char *folder, const surface *self, uint32_t rays) {
  char *path = format_text("%s/%s", folder, self->name);
  bool curved = !self->planar;
  if (self->s_count * self->t_count > 1)
    fprintf(out, "COSTS += %s/cost\n%s/cost: %s/surface.txt %s/cover\n", path, path, path, path);
  /* One list for the surface: make copies what it has at every +=. */
  uint32_t chunk_count = surface_chunk_count(self, rays);
  fprintf(out, "CHUNKS +=");
  for (uint32_t i = 0; i < chunk_count; i++) fprintf(out, " %s/%04u.exr", path, i);
  fprintf(out, "\n");
  for (uint32_t i = 0; i < chunk_count; i++) fprintf(out, "%s/%04u.exr ", path, i);
  fprintf(out, ": %s/surface.txt %s/cover%s%s%s%s%s%s\n", path, path, curved ? " " : "",
          curved ? path : "", curved ? "/rays" : "", self->auto_error ? " " : "",
          self->auto_error ? path : "", self->auto_error ? "/choice" : "");
  free(path);
}

int main(int argc, char **argv) {
  if (argc != 4 || (strcmp(argv[1], "surfaces") && strcmp(argv[1], "chunks"))) {
    fputs("usage: plan surfaces|chunks FOLDER RAYS > OUT.mk\n", stderr);
    return 2;
  }
  const char *folder = argv[2];
  uint32_t rays = (uint32_t)atoi(argv[3]);
  if (!sample_count_is_valid(rays)) fail("RAYS=%s: expected 1, 9, 25, 49 or 121", argv[3]);
  scene *whole = scene_read(folder);
  if (!whole->surface_count) fail("the scene names no surface: see bake/slf.inc");
  char *path = format_text("%s/scene.txt", folder), *text = read_text(path);
  if (!strcmp(argv[1], "surfaces") && (whole->radiosity || whole->photons))
    printf("BAKE_LIGHT := %s%s\n", whole->radiosity ? "radiosity " : "",
           whole->photons ? "photons" : "");
  for (uint32_t i = 0; i < whole->surface_count; i++) {
    const surface *self = &whole->surfaces[i];
    if (!strcmp(argv[1], "surfaces")) {
      write_surface(folder, self, text);
      write_preparations(stdout, folder, self, rays);
    } else {
      write_chunks(stdout, folder, self, rays);
    }
  }
  free(text);
  free(path);
  scene_free(whole);
  if (fflush(stdout) || ferror(stdout)) fail("%s: the plan cannot be written", folder);
  return 0;
}
