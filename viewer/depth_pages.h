/* depth_pages.h - blocks of a light field unpacked for bilinear reads anywhere, colour beside
 * height.
 *
 * A page holds one block of one slice and the first texels of the blocks to its right and below, so
 * that a bilinear read never leaves it. Neighbouring texels of a mirror read a slice several texels
 * apart, so what a read costs is how many cache lines it touches: a texel is four bytes, and its
 * height lies beside its colour. A slice's pages lie side by side, so that where one is needs no
 * look-up, and a bit says whether it is there. Slices that were not read for longest make room for
 * others. A set of pages belongs to one thread at a time. */
#ifndef DEPTH_PAGES_H
#define DEPTH_PAGES_H

#include <stdbool.h>

#include "block_source.h"
#include "slf.h"

enum {
  PAGE_ROW_NBYTES = 9 * 4, /* 9 texels of R G B H; 9 rows */
  PAGE_NBYTES = 9 * PAGE_ROW_NBYTES,
};

/* A slice's pages, block after block, row by row. */
typedef struct {
  uint8_t *bytes;  /* PAGE_NBYTES for each block; NULL if the slice was not read */
  uint32_t *there; /* of each block, a bit, 32 in a word */
  uint32_t s_index, t_index;
  uint32_t page_count; /* that are there */
  uint64_t used;       /* when it was asked for last */
} depth_slice;

/* R, G and B are 255 times the root of the radiance: their square is linear, and their steps are
 * never wider than 1.5 steps of the display codes they come from. H is the code of the height. */
#define PAGE_WHITE (255 * 255)

typedef struct {
  uint32_t u_count, v_count, block_u_count, block_v_count; /* of the light */
  bool wrap_u;                                             /* u = 1 continues at u = 0 */
  uint32_t height_u_count, height_v_count;
  uint32_t slice_count, t_count;
  block_source light, heights;
  depth_slice *slices; /* s_index * t_count + t_index */
  uint64_t now;        /* counts asking */
  uint32_t page_count, most_pages;
  uint8_t root[256]; /* of a code */
} depth_pages;

/* The sources must outlive the pages and always give the same. The heights may have fewer texels.
 * False if memory ran out. */
bool depth_pages_create(depth_pages *p, const slf_layer *light, block_source light_source,
                        const slf_layer *heights, block_source heights_source);
void depth_pages_free(depth_pages *p);

/* A slice to read from, until depth_pages_make_room; NULL if memory ran out. */
const depth_slice *depth_pages_slice(depth_pages *p, uint32_t s_index, uint32_t t_index);

/* Brings a block's page in. */
void depth_pages_load(depth_pages *p, const depth_slice *slice, uint32_t block);

/* Forgets slices if there are many pages. */
void depth_pages_make_room(depth_pages *p);

#endif
