#include "cover.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fail.h"

static uint8_t *read_cover(const char *folder, const surface *self, uint32_t table_rays,
                           uint32_t rays) {
  char *path = format_text("%s/%s/cover", folder, self->name);
  size_t texel_count = (size_t)self->u_count * self->v_count, count = texel_count * table_rays;
  uint8_t *cover = allocate(count, 1, path);
  FILE *file = fopen(path, "rb");
  if (!file || fread(cover, 1, count, file) != count) fail("%s: expected %zu bytes", path, count);
  fclose(file);
  free(path);
  for (size_t texel = 0; texel < texel_count && rays < table_rays; texel++)
    cover[texel] = cover[texel * table_rays + table_rays / 2];
  return cover;
}

/* The covering ray of a texel that comes next after ray m, or -1. */
static int64_t next_covering(const uint8_t *cover, size_t texel, uint32_t rays, uint32_t m) {
  for (uint32_t k = 0; k < rays; k++) {
    size_t at = texel * rays + (m + k) % rays;
    if (cover[at]) return (int64_t)at;
  }
  return -1;
}

/* For every texel the nearest one that has a covering ray: breadth first from all of those at once.
 */
static uint32_t *nearest_covered(const surface *self, const uint8_t *cover, uint32_t rays,
                                 uint32_t *hole_count) {
  size_t texel_count = (size_t)self->u_count * self->v_count;
  uint32_t *nearest = allocate(texel_count, sizeof *nearest, self->name);
  uint32_t *queue = allocate(texel_count, sizeof *queue, self->name);
  size_t tail = 0;
  for (size_t texel = 0; texel < texel_count; texel++) {
    bool covered = next_covering(cover, texel, rays, 0) >= 0;
    nearest[texel] = covered ? (uint32_t)texel : UINT32_MAX;
    if (covered) queue[tail++] = (uint32_t)texel;
  }
  *hole_count = (uint32_t)(texel_count - tail);
  for (size_t head = 0; head < tail; head++) {
    int64_t i = queue[head] % self->u_count, j = queue[head] / self->u_count;
    const int64_t beside[4] = {surface_texel(self, i - 1, j), surface_texel(self, i + 1, j),
                               surface_texel(self, i, j - 1), surface_texel(self, i, j + 1)};
    for (int k = 0; k < 4; k++) {
      if (beside[k] < 0 || nearest[beside[k]] != UINT32_MAX) continue;
      nearest[beside[k]] = nearest[queue[head]];
      queue[tail++] = (uint32_t)beside[k];
    }
  }
  free(queue);
  return nearest;
}

uint32_t *cover_sources(const char *folder, const surface *self, uint32_t table_rays, uint32_t rays,
                        uint32_t *hole_count) {
  size_t texel_count = (size_t)self->u_count * self->v_count;
  uint8_t *cover = read_cover(folder, self, table_rays, rays);
  *hole_count = 0;
  uint32_t *sources = NULL;
  if (memchr(cover, 0, texel_count * rays)) {
    uint32_t *nearest = nearest_covered(self, cover, rays, hole_count);
    sources = allocate(texel_count * rays, sizeof *sources, self->name);
    for (size_t at = 0; at < texel_count * rays; at++)
      sources[at] = (uint32_t)next_covering(cover, nearest[at / rays], rays, (uint32_t)(at % rays));
    free(nearest);
  }
  free(cover);
  return sources;
}
