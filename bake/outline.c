#include "outline.h"

#include <stdlib.h>
#include <string.h>

#include "fail.h"

/* Whether the height of a texel beside (i, j) is of another thing. */
static bool is_outline(const surface *self, const uint8_t *codes, uint32_t i, uint32_t j) {
  const int code = codes[(size_t)j * self->u_count + i];
  for (int k = 0; k < 9; k++) {
    const int64_t at = surface_texel(self, (int64_t)i + k % 3 - 1, (int64_t)j + k / 3 - 1);
    if (at >= 0 && abs(codes[at] - code) > SLF_THING_CODES) return true;
  }
  return false;
}

outline_list outlines_find(const surface *self, const float *heights, size_t stride,
                           uint32_t slice_count) {
  const uint32_t texel_count = self->u_count * self->v_count;
  uint8_t *codes = allocate(texel_count, 1, self->name);
  outline_list found = {
      0, allocate((size_t)texel_count * slice_count + 1, sizeof *found.texels, self->name)};
  for (uint32_t k = 0; k < slice_count; k++) {
    for (uint32_t i = 0; i < texel_count; i++)
      codes[i] = slf_code_from_height(heights[k * stride + 3 * (size_t)i], (float)self->layers);
    for (uint32_t i = 0; i < texel_count; i++)
      if (is_outline(self, codes, i % self->u_count, i / self->u_count))
        found.texels[found.count++] = (outline_texel){k, i};
  }
  free(codes);
  return found;
}

outline_list outlines_read(const char *path, const surface *self, uint32_t slice_count) {
  const uint32_t texel_count = self->u_count * self->v_count;
  const size_t most = (size_t)texel_count * slice_count;
  outline_list read = {0, allocate(most + 1, sizeof *read.texels, path)};
  FILE *file = fopen(path, "rb");
  if (!file) fail("%s: cannot be read", path);
  read.count = (uint32_t)fread(read.texels, sizeof *read.texels, most, file);
  if (ferror(file) || fgetc(file) != EOF) fail("%s: expected at most %zu texels", path, most);
  fclose(file);
  for (uint32_t i = 0; i < read.count; i++)
    if (read.texels[i].slice >= slice_count || read.texels[i].texel >= texel_count)
      fail("%s: texel %u of slice %u", path, read.texels[i].texel, read.texels[i].slice);
  return read;
}

void outlines_write(const outline_list *self, FILE *to, const char *name) {
  if (fwrite(self->texels, sizeof *self->texels, self->count, to) != self->count || fflush(to))
    fail("surface '%s': its outlines cannot be written", name);
}

uint32_t outline_frame_height(const outline_list *self, uint32_t rays) {
  const uint64_t pixel_count = 1 + (uint64_t)self->count * rays;
  return (uint32_t)((pixel_count + OUTLINE_FRAME_WIDTH - 1) / OUTLINE_FRAME_WIDTH) + 1;
}
