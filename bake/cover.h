/* cover.h - where a surface is, and what stands in for samples where it is not: a hole that a wrap
 * spans, a part that was clipped away. A ray covers the surface if POV-Ray finds an object within a
 * few times the distance from which rays start. */
#ifndef BAKE_COVER_H
#define BAKE_COVER_H

#include <stdint.h>

#include "surface.h"

/* Rays that test for cover end this many times their starting distance away. */
#define COVER_REACH 4.0

/* Reads FOLDER/NAME/cover: for each texel, for each ray, 1 or 0; from it, for each ray of each
 * texel the one to take in its place, texel x rays + ray: itself if it covers, else one of the same
 * texel, else one of the nearest texel that has any. *hole_count receives the texels that have
 * none. Returns NULL where every ray covers; else the caller frees the list. The file has
 * table_rays a texel, of which one, the middle one, is asked for where rays is 1. */
uint32_t *cover_sources(const char *folder, const surface *, uint32_t table_rays, uint32_t rays,
                        uint32_t *hole_count);

#endif
