/* depth_pages.h - blocks of a light field unpacked for bilinear reads anywhere, colour beside
 * height.
 *
 * A page holds one block of one slice and the first texels of the blocks to its right and below, so
 * that a bilinear read never leaves it. Neighbouring texels of a mirror read a slice several texels
 * apart, so what a read costs is how many cache lines it touches: a texel is four bytes, and its
 * height lies beside its colour. Pages stay until as many others have come; until then their place
 * in the slice's table says where they are. A set of pages belongs to one thread at a time. */
#ifndef DEPTH_PAGES_H
#define DEPTH_PAGES_H

#include <stdbool.h>

#include "block_source.h"
#include "slf.h"

enum {
  PAGE_ROW_NBYTES = 9 * 4, /* 9 texels of R G B H; 9 rows */
  PAGE_NBYTES = 328,       /* a multiple of 8 */
  PAGE_ABSENT = -1
};

/* R, G and B are 255 times the root of the radiance: their square is linear, and their steps are
 * never wider than 1.5 steps of the display codes they come from. H is the code of the height. */
#define PAGE_WHITE (255 * 255)

typedef struct {
  uint32_t u_count, v_count, block_u_count, block_v_count; /* of the light */
  bool wrap_u;                                             /* u = 1 continues at u = 0 */
  uint32_t height_u_count, height_v_count;
  uint32_t slice_count, t_count;
  block_source light, heights;
  uint8_t *bytes;   /* page_count of them */
  int32_t **tables; /* of each slice s_index * t_count + t_index: where each block's page begins, or
                       PAGE_ABSENT; NULL for a slice that was never read */
  int32_t **owners; /* of each page, its place in a table */
  uint32_t page_count, next;
  uint8_t root[256]; /* of a code */
} depth_pages;

/* The sources must outlive the pages and always give the same. The heights may have fewer texels.
 * False if memory ran out. */
bool depth_pages_create(depth_pages *p, const slf_layer *light, block_source light_source,
                        const slf_layer *heights, block_source heights_source);
void depth_pages_free(depth_pages *p);

/* The table of a slice; NULL if memory ran out. */
const int32_t *depth_pages_table(depth_pages *p, uint32_t s_index, uint32_t t_index);

/* Brings a block's page in, and returns where it begins. */
int32_t depth_pages_load(depth_pages *p, uint32_t s_index, uint32_t t_index, uint32_t block_u,
                         uint32_t block_v);

#endif
