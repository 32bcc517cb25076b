/* block_source.h - where the four-tap mix gets its U-Blocks from: the block cache over a .slf file,
 * an uncompressed table, or a closed form in a test. */
#ifndef BLOCK_SOURCE_H
#define BLOCK_SOURCE_H

#include <stddef.h>
#include <stdint.h>

/* A block of 8x8 texels is mixed out of at most 64 cells of (S,T), four slices each. */
enum { BLOCK_MAX_SLICES = 256 };

/* A slice, s_index << 8 | t_index. */
typedef uint16_t slice_index;

/* What a U-Block holds: 8 rows of 8 texels R G B X; half floats for a layer with SLF_CURVE_DWA. */
typedef enum {
  U_BLOCK_CODES, /* sRGB codes, SLF_BLOCK_NBYTES */
  U_BLOCK_HALF   /* linear radiance as half floats, non-negative and finite, U_BLOCK_HALF_NBYTES */
} u_block_format;

enum { U_BLOCK_HALF_NBYTES = 512 };

/* fetch: sets u_blocks[i] to the U-Block of slices[i] at block (block_u, block_v) of the source's
 * layer, for i < count <= BLOCK_MAX_SLICES. The slices differ from each other. The addresses stay
 * valid until the call after the next one, so that one block can be fetched while the block before
 * it is mixed.
 *
 * fetch_later (NULL: the source has nothing to gain from it): the same, but what is at the
 * addresses is there only after `finish`, which makes all of it at once. At most BLOCK_MAX_SLICES
 * slices in all may be asked for until then, each once, and nothing else of what the source shares
 * its blocks with. The addresses stay valid until the next fetch_later or fetch after `finish`. */
typedef struct {
  void (*fetch)(void *context, uint32_t block_u, uint32_t block_v, const slice_index *slices,
                size_t count, const uint8_t **u_blocks);
  void *context;
  void (*fetch_later)(void *context, uint32_t block_u, uint32_t block_v, const slice_index *slices,
                      size_t count, const uint8_t **u_blocks);
  void (*finish)(void *context);
} block_source;

#endif
