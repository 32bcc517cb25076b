/* depth_pages.h - blocks of a light field unpacked for bilinear reads anywhere, colour beside
 * height.
 *
 * A page holds one block of one slice and the first texels of the blocks to its right and below, so
 * that a bilinear read never leaves it. Neighbouring texels of a mirror read a slice several texels
 * apart, so what a read costs is how many cache lines it touches: a texel is four bytes, and its
 * height lies beside its colour. Coverage, which only outlines ask for, lies behind all pages of a
 * slice, a byte a texel. All pages have a place in one range of addresses, so that where
 * one is needs no look-up; those that are not there are zeros, which no height is, so that whether
 * one is there is seen in what was read. Slices that were not read for longest make room for
 * others. A set of pages belongs to one thread at a time, but for `used`: while nobody loads pages
 * or makes room, any number of threads may read them and say so. */
#ifndef DEPTH_PAGES_H
#define DEPTH_PAGES_H

#include <stdatomic.h>
#include <stdbool.h>

#include "block_source.h"
#include "slf.h"

enum {
  PAGE_ROW_TEXELS = 9, /* of R G B H; 9 rows */
  PAGE_TEXELS = 81,
  PAGE_NBYTES = 4 * PAGE_TEXELS,
  PAGE_WITH_COVERAGE_NBYTES = 5 * PAGE_TEXELS
};

/* R, G and B are 255 times the root of the radiance: their square is linear, and their steps are
 * never wider than 1.5 steps of the display codes they come from. H is the code of the height, but
 * 1 for 0. */
#define PAGE_WHITE (255 * 255)

typedef struct {
  _Atomic uint64_t used; /* when it was read last, about */
  uint32_t page_count;
} depth_slice;

typedef struct {
  uint32_t u_count, v_count, block_u_count, block_v_count; /* of the light */
  bool wrap_u;                                             /* u = 1 continues at u = 0 */
  uint32_t height_u_count, height_v_count;
  uint32_t s_count, t_count;
  block_source light, heights, coverage; /* of the last, fetch may be NULL: there is none */
  uint8_t *bytes;                        /* of slice after slice, of block after block of each */
  size_t nbytes;
  uint32_t slice_texels;    /* from slice to slice, in sizes of a texel's light and height */
  uint32_t coverage_offset; /* from a slice's first byte to the coverage of its first texel */
  /* Of each slice, number s_index * (t_count + 1) + t_index: what follows the last one of a row or
   * column has a number, but does not exist. */
  depth_slice *slices;
  uint32_t slice_count;
  uint64_t now;
  uint32_t page_count, most_pages;
  uint8_t root[256]; /* of a code */
} depth_pages;

/* Whether a light field is small enough: addresses in it are of 31 bits. */
bool depth_pages_fit(const slf_layer *light);

/* A layer of a surface, and where its blocks come from. */
typedef struct {
  const slf_layer *layer; /* NULL: there is none */
  block_source blocks;
} depth_source;

/* What is mixed by depth: reflected light, its heights, which may have fewer texels, and how much
 * of each of those what is lower covers, as many of them; that may be missing. */
typedef struct {
  depth_source light, heights, coverage;
} depth_sources;

/* The sources must outlive the pages and always give the same; the layers need not. The light fits.
 * False if memory ran out. */
bool depth_pages_create(depth_pages *p, const depth_sources *sources);
void depth_pages_free(depth_pages *p);

/* Brings the page that a texel, counted from the first one of all, belongs to, unless it is
 * there. */
void depth_pages_load(depth_pages *p, uint32_t texel);

/* Forgets slices if there are many pages. */
void depth_pages_make_room(depth_pages *p);

#endif
