/* block_cache.h - the last N decompressed blocks (paper, section 3.2, "block manager").
 *
 * One cache serves every layer of every surface of a file. It keeps at most N U-Blocks between
 * fetches; what the two latest fetches returned is pinned on top of that, so that any N from 0 on
 * works: N = 0 decompresses whatever a block of texels needs and keeps nothing. Replacement is
 * least-recently-used by second chance (a clock), so that a hit costs one flag and no list.
 *
 * U-Blocks are sRGB codes; those of layers with SLF_CURVE_DWA are half floats.
 *
 * Memory: (N + 512) * (256 + 16) bytes (512 + 16 if the file has a layer with SLF_CURVE_DWA), a
 * table of 16 bytes times the power of two from twice that number on, and a bit for each C-Block of
 * the file that was ever decompressed, in pages that are only touched then. A cache belongs to one
 * thread at a time; several may share a slf_file. */
#ifndef BLOCK_CACHE_H
#define BLOCK_CACHE_H

#include "angular_level.h"
#include "block_source.h"
#include "slf.h"

/* 16 MiB of U-Blocks: four times what a frame of 512 x 512 light field texels at four slices a
 * block reads; fits the last-level cache, beyond which the measured gain is nil. */
enum { BLOCK_CACHE_DEFAULT = 65536 };

/* Counts since creation. */
typedef struct {
  uint64_t lookups;        /* blocks asked for */
  uint64_t hits;           /* found decompressed */
  uint64_t decompressions; /* C-Blocks: one for each that was not found, up to 16 at coarser levels;
                              and those that wait for frames to come */
  uint64_t decompressions_again; /* of them, those that had been decompressed before */
  uint64_t frame_lookups;        /* these since block_cache_begin_frame */
  uint64_t frame_hits;
  uint64_t frame_decompressions;
  uint64_t frame_decompressions_again;
} block_cache_counts;

typedef struct block_cache block_cache;

/* A cache that keeps `capacity` blocks; NULL if memory ran out. The file must outlive it. */
block_cache *block_cache_create(const slf_file *file, size_t capacity);
void block_cache_free(block_cache *cache); /* accepts NULL */

/* Forgets every block, but counts on. */
void block_cache_clear(block_cache *cache);

/* Marks the beginning of a frame, for the counts and the cache map. */
void block_cache_begin_frame(block_cache *cache);

/* The blocks of one layer as a source; owned by the cache. The layer must exist. */
block_source block_cache_layer(block_cache *cache, uint32_t surface_index, uint32_t layer_index);
/* Those of a coarser angular level (angular_level.h), 0 .. ANGULAR_MAX_LEVEL. */
block_source block_cache_level(block_cache *cache, uint32_t surface_index, uint32_t layer_index,
                               uint32_t level);

/* Decompressing ahead, on several threads: blocks are announced, those that are missing are noted,
 * and then decompressed all at once. `context` is that of a source of this cache. What is announced
 * beyond a quarter of the capacity, or waits for later frames beyond that, is left to
 * the fetches, so that nothing is evicted unused. Each block is announced once before they are
 * decompressed. */
void block_cache_announce(void *context, uint32_t block_u, uint32_t block_v,
                          const slice_index *slices, size_t count);
/* How many were announced, and of them are missing; forgets them. */
void block_cache_forget_announced(block_cache *cache, size_t *announced_count,
                                  size_t *missing_count);
/* Not while blocks that were fetched are in use. in_frame: this frame is going to fetch them all,
 * and the first fetch of each is no hit. Otherwise it is one, if it ever comes. */
void block_cache_decompress_announced(block_cache *cache, uint32_t thread_count, bool in_frame);

const block_cache_counts *block_cache_get_counts(const block_cache *cache);
size_t block_cache_resident(const block_cache *cache); /* blocks held, pinned ones included */
size_t block_cache_nbytes(const block_cache *cache);   /* memory, tables included */

/* Calls visit for every resident block of a layer, not of its coarser levels: figure 8, the cache
 * map. fresh: decompressed in this frame. */
void block_cache_visit(const block_cache *cache, uint32_t surface_index, uint32_t layer_index,
                       void (*visit)(void *context, slf_block_address address, bool fresh),
                       void *context);

#endif
