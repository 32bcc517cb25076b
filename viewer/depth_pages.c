#include "depth_pages.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { MOST_PAGES = 1 << 18 /* 85 MB */ };

static uint32_t smaller(uint32_t a, uint32_t b) {
  return a < b ? a : b;
}

/* Slices begin on pages of the system, to be given back one by one; an odd number of those apart,
 * so that the same texels of all slices do not fall on the same lines of a cache. */
static uint64_t spread_slices(uint64_t nbytes) {
  const uint64_t of_system = (uint64_t)sysconf(_SC_PAGESIZE);
  return ((nbytes + of_system - 1) / of_system | 1) * of_system;
}

static uint64_t block_count_of(const slf_layer *light) {
  return (uint64_t)((light->u_count + 7) / 8) * ((light->v_count + 7) / 8);
}

static uint64_t slice_nbytes_of(const slf_layer *light) {
  return spread_slices(block_count_of(light) * PAGE_WITH_COVERAGE_NBYTES);
}

static uint32_t slice_count_of(const slf_layer *light) {
  return (light->s_count + 1) * (light->t_count + 1);
}

bool depth_pages_fit(const slf_layer *light) {
  return slice_count_of(light) * (slice_nbytes_of(light) / 4) < INT32_MAX;
}

bool depth_pages_create(depth_pages *p, const depth_sources *sources) {
  const slf_layer *light = sources->light.layer, *heights = sources->heights.layer;
  *p = (depth_pages){.u_count = light->u_count,
                     .v_count = light->v_count,
                     .block_u_count = (light->u_count + 7) / 8,
                     .block_v_count = (light->v_count + 7) / 8,
                     .height_u_count = heights->u_count,
                     .height_v_count = heights->v_count,
                     .s_count = light->s_count,
                     .t_count = light->t_count,
                     .light = sources->light.blocks,
                     .heights = sources->heights.blocks,
                     .coverage = sources->coverage.blocks};
  for (int code = 0; code < 256; code++)
    p->root[code] = (uint8_t)(255 * sqrtf(slf_linear_from_srgb((uint8_t)code)) + 0.5f);
  p->most_pages = MOST_PAGES;
  p->slice_count = slice_count_of(light);
  const uint64_t slice_nbytes = slice_nbytes_of(light);
  p->slice_texels = (uint32_t)(slice_nbytes / 4);
  p->coverage_offset = (uint32_t)(block_count_of(light) * PAGE_NBYTES);
  p->slices = calloc(p->slice_count, sizeof *p->slices);
  if (!p->slices) return false;
  p->nbytes = (size_t)(p->slice_count * slice_nbytes);
  void *range = mmap(NULL, p->nbytes, PROT_READ | PROT_WRITE,
                     MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (range == MAP_FAILED) return false;
  p->bytes = range;
  return true;
}

void depth_pages_free(depth_pages *p) {
  if (p->bytes) munmap(p->bytes, p->nbytes);
  free(p->slices);
  *p = (depth_pages){0};
}

void depth_pages_make_room(depth_pages *p) {
  while (p->page_count > p->most_pages) {
    uint32_t oldest = UINT32_MAX;
    for (uint32_t i = 0; i < p->slice_count; i++)
      if (p->slices[i].page_count > 0 &&
          (oldest == UINT32_MAX || p->slices[i].used < p->slices[oldest].used))
        oldest = i;
    const size_t nbytes = (size_t)p->slice_texels * 4;
    /* What the system takes back reads as zeros. */
    if (madvise(p->bytes + oldest * nbytes, nbytes, MADV_DONTNEED))
      memset(p->bytes + oldest * nbytes, 0, nbytes);
    p->page_count -= p->slices[oldest].page_count;
    p->slices[oldest].page_count = 0;
  }
}

static void fetch_block(block_source source, slice_index slice, uint32_t block_u, uint32_t block_v,
                        uint8_t *texels) {
  const uint8_t *u_block;
  source.fetch(source.context, block_u, block_v, &slice, 1, &u_block);
  memcpy(texels, u_block, SLF_BLOCK_NBYTES);
}

/* 9 x 9 texels of a layer from texel (8 block_u, 8 block_v) on; those beyond its edge repeat it. */
static void fetch_texels(block_source source, slice_index slice, uint32_t block_u, uint32_t block_v,
                         uint32_t u_count, uint32_t v_count, uint8_t texels[9][9][4]) {
  uint8_t blocks[4][SLF_BLOCK_NBYTES];
  bool right = 8 * block_u + 8 < u_count, below = 8 * block_v + 8 < v_count;
  uint32_t last_u = smaller(8, u_count - 1 - 8 * block_u);
  uint32_t last_v = smaller(8, v_count - 1 - 8 * block_v);
  for (uint32_t k = 0; k < 4; k++)
    if ((right || !(k & 1)) && (below || !(k & 2)))
      fetch_block(source, slice, block_u + (k & 1), block_v + (k >> 1), blocks[k]);
  for (uint32_t y = 0; y < 9; y++) {
    const uint32_t j = smaller(y, last_v), k = 2 * (j / 8);
    const uint8_t *row = blocks[k] + 32 * (j % 8), *last = row + 4 * smaller(last_u, 7);
    memcpy(texels[y], row, 32);
    for (uint32_t x = last_u + 1; x < 9; x++) memcpy(texels[y][x], last, 4);
    if (right) memcpy(texels[y][8], blocks[k + 1] + 32 * (j % 8), 4);
  }
}

/* The same of heights, or of their coverage, which may have fewer texels than the light. */
static void fetch_heights(const depth_pages *p, block_source source, slice_index slice,
                          uint32_t block_u, uint32_t block_v, uint8_t texels[9][9][4]) {
  if (p->height_u_count == p->u_count && p->height_v_count == p->v_count) {
    fetch_texels(source, slice, block_u, block_v, p->u_count, p->v_count, texels);
    return;
  }
  uint8_t u_block[SLF_BLOCK_NBYTES];
  uint32_t at_u = UINT32_MAX, at_v = UINT32_MAX;
  for (uint32_t y = 0; y < 9; y++)
    for (uint32_t x = 0; x < 9; x++) {
      uint64_t u = smaller(8 * block_u + x, p->u_count - 1);
      uint64_t v = smaller(8 * block_v + y, p->v_count - 1);
      uint32_t i = (uint32_t)((2 * u + 1) * p->height_u_count / (2 * p->u_count));
      uint32_t j = (uint32_t)((2 * v + 1) * p->height_v_count / (2 * p->v_count));
      if (i / 8 != at_u || j / 8 != at_v)
        fetch_block(source, slice, at_u = i / 8, at_v = j / 8, u_block);
      memcpy(texels[y][x], u_block + (j % 8 * 8 + i % 8) * 4, 4);
    }
}

void depth_pages_load(depth_pages *p, uint32_t texel) {
  const uint32_t number = texel / p->slice_texels, block = texel % p->slice_texels / PAGE_TEXELS;
  uint8_t *slice = p->bytes + 4 * (size_t)number * p->slice_texels;
  uint8_t *page = slice + block * PAGE_NBYTES;
  uint8_t *coverage = slice + p->coverage_offset + block * PAGE_TEXELS;
  if (page[3]) return;
  uint8_t light[9][9][4], heights[9][9][4], coverages[9][9][4];
  const slice_index index =
      (slice_index)(number / (p->t_count + 1) << 8 | number % (p->t_count + 1));
  const uint32_t block_u = block % p->block_u_count, block_v = block / p->block_u_count;
  fetch_texels(p->light, index, block_u, block_v, p->u_count, p->v_count, light);
  fetch_heights(p, p->heights, index, block_u, block_v, heights);
  memset(coverages, SLF_COVERED_BY_NONE, sizeof coverages);
  if (p->coverage.fetch) fetch_heights(p, p->coverage, index, block_u, block_v, coverages);
  for (int y = 0; y < 9; y++)
    for (int x = 0; x < 9; x++, page += 4) {
      const uint8_t *code = light[y][x], height = heights[y][x][1];
      page[0] = p->root[code[0]], page[1] = p->root[code[1]], page[2] = p->root[code[2]];
      page[3] = height > 0 ? height : 1;
      *coverage++ = coverages[y][x][1];
    }
  p->slices[number].page_count++, p->page_count++;
}
