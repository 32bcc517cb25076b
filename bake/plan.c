/* plan - cuts a described scene into what make bakes: a folder for each surface with the surface's
 * own description, touched only when that changes, and the list of chunks as make rules. Says what
 * the bake will take. */
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

/* The lines of the description from "surface NAME" to the next surface or the scene's own lines. */
static void write_surface(const char *folder, const surface *self, const char *text) {
  char *head = format_text("surface %s ", self->name);
  char *path = format_text("%s/%s", folder, self->name);
  char *file = format_text("%s/surface.txt", path);
  const char *begin = strstr(text, head), *end = begin;
  do {
    end = strchr(end, '\n');
    end = end ? end + 1 : begin + strlen(begin);
  } while (*end && strncmp(end, "surface ", 8) && strncmp(end, "water ", 6) &&
           strncmp(end, "background ", 11));
  if (mkdir(path, 0777) && errno != EEXIST) fail("%s: cannot be made: %s", path, strerror(errno));
  write_text_if_changed(file, begin, (size_t)(end - begin));
  free(file);
  free(path);
  free(head);
}

static void write_rules(FILE *out, const char *folder, const surface *self, uint32_t rays) {
  char *path = format_text("%s/%s", folder, self->name);
  uint32_t part_count = surface_ray_part_count(self, rays);
  for (uint32_t i = 0; i < part_count; i++)
    fprintf(out, "RAY_PARTS += %s/rays.%04u\n%s/rays.made: %s/rays.%04u\n", path, i, path, path, i);
  if (part_count) fprintf(out, "RAY_TABLES += %s/rays\n", path);
  for (uint32_t i = 0, chunk_count = surface_chunk_count(self, rays); i < chunk_count; i++)
    fprintf(out, "CHUNKS += %s/%04u.exr\n%s/%04u.exr: %s/surface.txt%s%s%s\n", path, i, path, i,
            path, part_count ? " " : "", part_count ? path : "", part_count ? "/rays" : "");
  free(path);
}

int main(int argc, char **argv) {
  if (argc != 4) {
    fputs("usage: plan SCENE.txt FOLDER RAYS > PLAN.mk\n", stderr);
    return 2;
  }
  const char *folder = argv[2];
  uint32_t rays = (uint32_t)atoi(argv[3]);
  if (!sample_count_is_valid(rays)) fail("RAYS=%s: expected 1, 9, 25, 49 or 121", argv[3]);
  scene *whole = scene_read(argv[1]);
  if (!whole->surface_count) fail("the scene names no surface: see bake/slf.inc");
  char *text = read_text(argv[1]);
  for (uint32_t i = 0; i < whole->surface_count; i++) {
    write_surface(folder, &whole->surfaces[i], text);
    write_rules(stdout, folder, &whole->surfaces[i], rays);
  }
  free(text);
  scene_free(whole);
  if (fflush(stdout) || ferror(stdout)) fail("%s: the plan cannot be written", folder);
  return 0;
}
