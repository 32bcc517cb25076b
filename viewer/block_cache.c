#include "block_cache.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "codec/parallel.h"
#include "half.h"

enum { PINNED_COUNT = 2 * BLOCK_MAX_SLICES };

/* key: (layer number << 4 | level) << 38 | block number << 16 | slice. Blocks number at most 2^22 a
 * layer, layers at most 2^15. */
typedef struct {
  uint64_t key;
  uint32_t slot;
  uint32_t stamp; /* the fetch that returned it last, or 0: the clock's hand has passed since */
} table_entry;

static const uint64_t no_key = UINT64_MAX;

/* A layer at one of its angular levels. */
typedef struct {
  block_cache *cache;
  uint32_t surface, layer, level;
  uint32_t block_u_count, s_count, t_count; /* of level 0 */
  uint64_t key_base;
  u_block_format format;
  uint8_t *decompressed; /* a bit for each C-Block that ever was; level 0's, shared */
} cached_layer;

enum { LEVEL_COUNT = ANGULAR_MAX_LEVEL + 1 };

/* A run of missing slices of one place, to be decompressed ahead. */
typedef struct {
  cached_layer *layer;
  uint16_t block_u, block_v;
  uint32_t first, count; /* of announced_slices */
} announced_run;

/* Linear light back to codes, in steps that are 1/5 of the darkest code's. */
enum { CODES_COUNT = 16384 };

struct block_cache {
  const slf_file *file;
  float linear[256];          /* of a code, and */
  uint8_t codes[CODES_COUNT]; /* back; both filled when a coarser level is asked for */
  size_t capacity, slot_count, resident;
  uint8_t *u_blocks;     /* slot_count blocks of u_block_nbytes */
  size_t u_block_nbytes; /* of the largest format that a layer of the file has */
  uint64_t *slot_keys;   /* no_key when free */
  uint32_t *slot_frames; /* the frame that decompressed it */
  uint32_t *free_slots;
  size_t free_count;
  table_entry *table; /* open addressing, linear probing */
  uint64_t table_mask;
  size_t hand;
  uint32_t stamp;        /* of the latest fetch */
  size_t latest_count;   /* its blocks: pinned while the next fetch runs */
  bool is_fetching;      /* from fetch_later to finish: one fetch */
  cached_layer *layers;  /* LEVEL_COUNT for each layer */
  uint32_t *first_layer; /* of each surface */
  uint32_t layer_count;
  uint32_t frame;
  block_cache_counts counts;
  /* What fetch_later found missing. */
  const cached_layer *missing_layer;
  slf_block_address missing_addresses[BLOCK_MAX_SLICES];
  uint8_t *missing_targets[BLOCK_MAX_SLICES];
  size_t missing_count;
  /* What was announced and is missing; room for announced_capacity of each. */
  announced_run *runs;
  slice_index *announced_slices;
  uint8_t **announced_targets;
  size_t announced_capacity, run_count, announced_count, asked_count;
  size_t waiting_count; /* since the frame began, decompressed for frames to come */
};

/* The slices of a small (S,T) group of one block hash to the same run of entries, so that the look-
 * ups of one block of texels touch one or two cache lines of the table. */
static uint64_t home_of(const block_cache *cache, uint64_t key) {
  uint64_t group = key >> 16 << 16 | (key >> 9 & 0x7f) << 8 | (key >> 1 & 0x7f);
  uint64_t within = (key >> 7 & 2) | (key & 1);
  return ((group * 0x9e3779b97f4a7c15u >> 20 << 2) + within) & cache->table_mask;
}

static uint64_t find_from(const block_cache *cache, uint64_t home, uint64_t key) {
  while (cache->table[home].key != key && cache->table[home].key != no_key)
    home = (home + 1) & cache->table_mask;
  return home;
}

static uint64_t find_entry(const block_cache *cache, uint64_t key) {
  return find_from(cache, home_of(cache, key), key);
}

/* Removes an entry and closes the gap, so that no probe sequence is broken. */
static void remove_entry(block_cache *cache, uint64_t hole) {
  for (uint64_t i = (hole + 1) & cache->table_mask; cache->table[i].key != no_key;
       i = (i + 1) & cache->table_mask) {
    uint64_t home = home_of(cache, cache->table[i].key);
    bool reachable = ((i - home) & cache->table_mask) < ((i - hole) & cache->table_mask);
    if (reachable) continue;
    cache->table[hole] = cache->table[i];
    hole = i;
  }
  cache->table[hole].key = no_key;
}

static void evict_slot(block_cache *cache, uint32_t slot) {
  remove_entry(cache, find_entry(cache, cache->slot_keys[slot]));
  cache->slot_keys[slot] = no_key;
  cache->free_slots[cache->free_count++] = slot;
  cache->resident--;
}

/* Evicts the next unpinned block that was not used since the hand passed it before. */
static void evict_one(block_cache *cache) {
  for (;;) {
    uint32_t slot = (uint32_t)cache->hand;
    cache->hand = cache->hand + 1 < cache->slot_count ? cache->hand + 1 : 0;
    if (cache->slot_keys[slot] == no_key) continue;
    table_entry *entry = &cache->table[find_entry(cache, cache->slot_keys[slot])];
    if (entry->stamp == 0) {
      evict_slot(cache, slot);
      return;
    }
    if (entry->stamp < cache->stamp - 1) entry->stamp = 0;
  }
}

/* Evicts what the capacity does not hold, but nothing of the fetch before this one. */
static void begin_fetch(block_cache *cache, size_t count) {
  if (++cache->stamp == UINT32_MAX) { /* once in 2^32 fetches: all are old, none is forgotten */
    for (uint64_t i = 0; i <= cache->table_mask; i++) cache->table[i].stamp = 1;
    cache->stamp = 4;
  }
  while (cache->resident > cache->capacity + cache->latest_count) evict_one(cache);
  cache->latest_count = count;
}

/* ---- Decompression -----------------------------------------------------------------------------
 */

static slf_block_address address_of(slice_index slice, uint32_t block_u, uint32_t block_v) {
  return (slf_block_address){.s = slice >> 8,
                             .t = slice & 0xff,
                             .block_u = (uint16_t)block_u,
                             .block_v = (uint16_t)block_v};
}

static void count_samples(cached_layer *layer, uint64_t block, const slice_index *slices,
                          size_t count) {
  block_cache_counts *counts = &layer->cache->counts;
  const uint64_t first = block * layer->s_count * layer->t_count;
  uint8_t *decompressed = layer->decompressed;
  uint64_t again = 0;
  for (size_t i = 0; i < count; i++) {
    uint64_t number = first + (slices[i] >> 8) * layer->t_count + (slices[i] & 0xff);
    uint8_t *byte = &decompressed[number / 8], before = *byte;
    again += before >> number % 8 & 1;
    *byte = (uint8_t)(before | 1u << number % 8);
  }
  counts->decompressions += count;
  counts->frame_decompressions += count;
  counts->decompressions_again += again;
  counts->frame_decompressions_again += again;
}

static void store_half(const float rgb[3 * 64], uint8_t *u_block) {
  uint16_t *out = (uint16_t *)(void *)u_block;
  for (int k = 0; k < 64; k++, out += 4) {
    for (int c = 0; c < 3; c++) out[c] = half_from_float(half_range(rgb[3 * k + c]));
    out[3] = HALF_ONE;
  }
}

static void decode_half(const cached_layer *layer, const slf_block_address *addresses, size_t count,
                        uint8_t *const *targets) {
  for (size_t i = 0; i < count; i++) {
    float rgb[3 * 64];
    slf_decode_block_linear(layer->cache->file, layer->surface, layer->layer, addresses[i], rgb);
    store_half(rgb, targets[i]);
  }
}

/* The sums of `count` blocks of codes in linear light. */
static void sum_codes(const cached_layer *layer, const slf_block_address *addresses, size_t count,
                      float sum[3 * 64]) {
  const block_cache *cache = layer->cache;
  uint8_t blocks[ANGULAR_MAX_SAMPLES][SLF_BLOCK_NBYTES], *targets[ANGULAR_MAX_SAMPLES];
  for (size_t i = 0; i < count; i++) targets[i] = blocks[i];
  slf_decode_blocks(cache->file, layer->surface, layer->layer, addresses, count, targets);
  for (size_t i = 0; i < count; i++)
    for (int k = 0; k < 64; k++)
      for (int c = 0; c < 3; c++) sum[3 * k + c] += cache->linear[blocks[i][4 * k + c]];
}

static void sum_half(const cached_layer *layer, const slf_block_address *addresses, size_t count,
                     float sum[3 * 64]) {
  float rgb[3 * 64];
  for (size_t i = 0; i < count; i++) {
    slf_decode_block_linear(layer->cache->file, layer->surface, layer->layer, addresses[i], rgb);
    for (int k = 0; k < 3 * 64; k++) sum[k] += rgb[k];
  }
}

/* A block of a coarser level: the mean of its samples. */
static void decode_mean(const cached_layer *layer, slf_block_address a, uint8_t *target) {
  slice_index samples[ANGULAR_MAX_SAMPLES];
  slf_block_address addresses[ANGULAR_MAX_SAMPLES];
  float mean[3 * 64] = {0};
  size_t count = angular_samples(layer->s_count, layer->t_count, layer->level,
                                 (slice_index)(a.s << 8 | a.t), samples);
  for (size_t i = 0; i < count; i++) addresses[i] = address_of(samples[i], a.block_u, a.block_v);
  if (layer->format == U_BLOCK_CODES)
    sum_codes(layer, addresses, count, mean);
  else
    sum_half(layer, addresses, count, mean);
  for (int k = 0; k < 3 * 64; k++) mean[k] /= (float)count;
  if (layer->format == U_BLOCK_HALF) {
    store_half(mean, target);
    return;
  }
  const uint8_t *codes = layer->cache->codes;
  for (int k = 0; k < 64; k++) {
    for (int c = 0; c < 3; c++)
      target[4 * k + c] = codes[(int)(mean[3 * k + c] * (CODES_COUNT - 1) + 0.5f)];
    target[4 * k + 3] = 255;
  }
}

/* ---- Fetching ----------------------------------------------------------------------------------
 */

/* Slices in the order in which slf_decode_blocks reads them fastest: 2x2 of them after each other,
 * in a round trip. */
static int16_t decoding_order(slice_index slice) {
  uint32_t s = slice >> 8, t = slice & 0xff, place = (s & 1) ^ (t & 1) * 3;
  return (int16_t)((int32_t)(t / 2 << 9 | s / 2 << 2 | place) + INT16_MIN);
}

/* How many of the slices each comes behind: many comparisons at once and no branch beat fewer
 * comparisons, as long as there are few. */
static void rank_for_decoding(const slice_index *slices, size_t count,
                              int16_t ranks[BLOCK_MAX_SLICES]) {
  enum { AT_ONCE = 8 };
  typedef int16_t some_orders __attribute__((vector_size(2 * AT_ONCE)));
  int16_t orders[BLOCK_MAX_SLICES + AT_ONCE];
  for (size_t i = 0; i < count; i++) orders[i] = decoding_order(slices[i]);
  memset(orders + count, 0, AT_ONCE * sizeof *orders);
  for (size_t i = 0; i < count; i += AT_ONCE) {
    some_orders some, rank = {0};
    memcpy(&some, orders + i, sizeof some);
    for (size_t k = 0; k < count; k++) rank -= orders[k] < some;
    memcpy(ranks + i, &rank, sizeof rank);
  }
}

static void count_decompressions(cached_layer *layer, uint32_t block_u, uint32_t block_v,
                                 const slice_index *slices, size_t count) {
  const uint64_t block = (uint64_t)block_v * layer->block_u_count + block_u;
  if (layer->level == 0) {
    count_samples(layer, block, slices, count);
    return;
  }
  for (size_t i = 0; i < count; i++) {
    slice_index samples[ANGULAR_MAX_SAMPLES];
    size_t sample_count =
        angular_samples(layer->s_count, layer->t_count, layer->level, slices[i], samples);
    count_samples(layer, block, samples, sample_count);
  }
}

/* Any thread. */
static void decompress(const cached_layer *layer, const slf_block_address *addresses,
                       uint8_t *const *targets, size_t count) {
  if (layer->level > 0)
    for (size_t i = 0; i < count; i++) decode_mean(layer, addresses[i], targets[i]);
  else if (layer->format == U_BLOCK_CODES)
    slf_decode_blocks(layer->cache->file, layer->surface, layer->layer, addresses, count, targets);
  else
    decode_half(layer, addresses, count, targets);
}

/* The addresses of a place's slices, put in order, and where they go. */
static void order_place(uint32_t block_u, uint32_t block_v, const slice_index *slices,
                        uint8_t *const *targets, size_t count, slf_block_address *addresses,
                        uint8_t **ordered_targets) {
  int16_t ranks[BLOCK_MAX_SLICES];
  rank_for_decoding(slices, count, ranks);
  for (size_t i = 0; i < count; i++) {
    addresses[ranks[i]] = address_of(slices[i], block_u, block_v);
    ordered_targets[ranks[i]] = targets[i];
  }
}

/* A slot for a block that is missing. */
static uint32_t take_slot(block_cache *cache, table_entry *entry, uint64_t key) {
  uint32_t slot = cache->free_slots[--cache->free_count];
  *entry = (table_entry){.key = key, .slot = slot, .stamp = cache->stamp};
  cache->slot_keys[slot] = key;
  cache->slot_frames[slot] = cache->frame;
  cache->resident++;
  return slot;
}

static uint64_t place_key(const cached_layer *layer, uint32_t block_u, uint32_t block_v) {
  return layer->key_base | ((uint64_t)block_v * layer->block_u_count + block_u) << 16;
}

/* Takes slots for what is missing, and says what is. */
static size_t look_up(cached_layer *layer, uint32_t block_u, uint32_t block_v,
                      const slice_index *slices, size_t count, const uint8_t **u_blocks,
                      slice_index *missing, uint8_t **targets) {
  block_cache *cache = layer->cache;
  table_entry *const table = cache->table;
  uint8_t *const first_u_block = cache->u_blocks;
  const size_t u_block_nbytes = cache->u_block_nbytes;
  const uint32_t stamp = cache->stamp;
  size_t missing_count = 0;
  uint64_t base = place_key(layer, block_u, block_v), homes[BLOCK_MAX_SLICES];
  for (size_t i = 0; i < count; i++) {
    homes[i] = home_of(cache, base | slices[i]);
    __builtin_prefetch(&table[homes[i]]);
  }
  for (size_t i = 0; i < count; i++) {
    uint64_t key = base | slices[i];
    table_entry *entry = &table[find_from(cache, homes[i], key)];
    uint32_t slot = entry->slot;
    if (entry->key != key) {
      slot = take_slot(cache, entry, key);
      missing[missing_count] = slices[i];
      targets[missing_count++] = first_u_block + slot * u_block_nbytes;
    }
    entry->stamp = stamp;
    u_blocks[i] = first_u_block + slot * u_block_nbytes;
  }
  cache->counts.lookups += count;
  cache->counts.frame_lookups += count;
  cache->counts.hits += count - missing_count;
  cache->counts.frame_hits += count - missing_count;
  if (missing_count > 0) count_decompressions(layer, block_u, block_v, missing, missing_count);
  return missing_count;
}

static void fetch_blocks(void *context, uint32_t block_u, uint32_t block_v,
                         const slice_index *slices, size_t count, const uint8_t **u_blocks) {
  cached_layer *layer = context;
  slice_index missing[BLOCK_MAX_SLICES];
  uint8_t *targets[BLOCK_MAX_SLICES], *ordered_targets[BLOCK_MAX_SLICES];
  slf_block_address addresses[BLOCK_MAX_SLICES];
  assert(count <= BLOCK_MAX_SLICES && !layer->cache->is_fetching);
  begin_fetch(layer->cache, count);
  size_t missing_count =
      look_up(layer, block_u, block_v, slices, count, u_blocks, missing, targets);
  if (missing_count == 0) return;
  order_place(block_u, block_v, missing, targets, missing_count, addresses, ordered_targets);
  decompress(layer, addresses, ordered_targets, missing_count);
}

static void fetch_blocks_later(void *context, uint32_t block_u, uint32_t block_v,
                               const slice_index *slices, size_t count, const uint8_t **u_blocks) {
  cached_layer *layer = context;
  block_cache *cache = layer->cache;
  slice_index missing[BLOCK_MAX_SLICES];
  uint8_t *targets[BLOCK_MAX_SLICES];
  if (cache->is_fetching) {
    assert(cache->missing_layer == layer && cache->latest_count + count <= BLOCK_MAX_SLICES);
    cache->latest_count += count;
  } else {
    begin_fetch(cache, count);
    cache->is_fetching = true;
    cache->missing_layer = layer;
    cache->missing_count = 0;
  }
  size_t missing_count =
      look_up(layer, block_u, block_v, slices, count, u_blocks, missing, targets);
  if (missing_count == 0) return;
  order_place(block_u, block_v, missing, targets, missing_count,
              cache->missing_addresses + cache->missing_count,
              cache->missing_targets + cache->missing_count);
  cache->missing_count += missing_count;
}

static void finish_fetch(void *context) {
  block_cache *cache = ((cached_layer *)context)->cache;
  if (cache->is_fetching && cache->missing_count > 0)
    decompress(cache->missing_layer, cache->missing_addresses, cache->missing_targets,
               cache->missing_count);
  cache->is_fetching = false;
}

/* ---- Ahead -------------------------------------------------------------------------------------
 */

void block_cache_announce(void *context, uint32_t block_u, uint32_t block_v,
                          const slice_index *slices, size_t count) {
  cached_layer *layer = context;
  block_cache *cache = layer->cache;
  uint64_t base = place_key(layer, block_u, block_v);
  uint32_t first = (uint32_t)cache->announced_count;
  cache->asked_count += count;
  const size_t most = cache->announced_capacity - cache->waiting_count;
  for (size_t i = 0; i < count && cache->announced_count < most; i++)
    if (cache->table[find_entry(cache, base | slices[i])].key == no_key)
      cache->announced_slices[cache->announced_count++] = slices[i];
  if (cache->announced_count > first)
    cache->runs[cache->run_count++] =
        (announced_run){.layer = layer,
                        .block_u = (uint16_t)block_u,
                        .block_v = (uint16_t)block_v,
                        .first = first,
                        .count = (uint32_t)cache->announced_count - first};
}

void block_cache_forget_announced(block_cache *cache, size_t *announced_count,
                                  size_t *missing_count) {
  *announced_count = cache->asked_count;
  *missing_count = cache->announced_count;
  cache->run_count = cache->announced_count = cache->asked_count = 0;
}

static void decompress_run(void *context, uint64_t i) {
  block_cache *cache = context;
  const announced_run *run = &cache->runs[i];
  slf_block_address addresses[BLOCK_MAX_SLICES];
  uint8_t *targets[BLOCK_MAX_SLICES];
  order_place(run->block_u, run->block_v, cache->announced_slices + run->first,
              cache->announced_targets + run->first, run->count, addresses, targets);
  decompress(run->layer, addresses, targets, run->count);
}

void block_cache_decompress_announced(block_cache *cache, uint32_t thread_count, bool in_frame) {
  begin_fetch(cache, 0);
  begin_fetch(cache, 0); /* nothing is pinned */
  while (cache->resident > 0 && cache->resident + cache->announced_count > cache->capacity)
    evict_one(cache);
  for (size_t i = 0; i < cache->run_count; i++) {
    const announced_run *run = &cache->runs[i];
    uint64_t base = place_key(run->layer, run->block_u, run->block_v);
    for (uint32_t k = run->first; k < run->first + run->count; k++) {
      uint64_t key = base | cache->announced_slices[k];
      uint32_t slot = take_slot(cache, &cache->table[find_entry(cache, key)], key);
      cache->announced_targets[k] = cache->u_blocks + slot * cache->u_block_nbytes;
    }
    count_decompressions(run->layer, run->block_u, run->block_v,
                         cache->announced_slices + run->first, run->count);
  }
  if (in_frame) { /* the fetches to come will find them; what counts is that they were missing */
    cache->counts.hits -= cache->announced_count;
    cache->counts.frame_hits -= cache->announced_count;
  } else {
    cache->waiting_count += cache->announced_count;
  }
  parallel_for(thread_count, cache->run_count, decompress_run, cache);
  cache->run_count = cache->announced_count = cache->asked_count = 0;
}

void block_cache_clear(block_cache *cache) {
  cache->free_count = 0;
  for (size_t i = 0; i < cache->slot_count; i++) {
    cache->slot_keys[i] = no_key;
    cache->free_slots[cache->free_count++] = (uint32_t)(cache->slot_count - 1 - i);
  }
  for (uint64_t i = 0; i <= cache->table_mask; i++) cache->table[i].key = no_key;
  cache->latest_count = cache->resident = cache->hand = 0;
  cache->is_fetching = false;
  cache->stamp = 1;
}

static bool number_layers(block_cache *cache) {
  uint32_t surface_count = slf_surface_count(cache->file);
  cache->first_layer = calloc(surface_count + (size_t)1, sizeof *cache->first_layer);
  if (!cache->first_layer) return false;
  for (uint32_t i = 0; i < surface_count; i++)
    cache->first_layer[i + 1] =
        cache->first_layer[i] + slf_get_surface(cache->file, i)->layer_count;
  cache->layer_count = cache->first_layer[surface_count];
  cache->layers = calloc(LEVEL_COUNT * (size_t)cache->layer_count + 1, sizeof *cache->layers);
  if (!cache->layers) return false;
  for (uint32_t i = 0; i < surface_count; i++)
    for (uint32_t k = 0; k < slf_get_surface(cache->file, i)->layer_count; k++) {
      uint32_t number = cache->first_layer[i] + k;
      const slf_layer *shape = &slf_get_surface(cache->file, i)->layers[k];
      u_block_format format = shape->curve == SLF_CURVE_DWA ? U_BLOCK_HALF : U_BLOCK_CODES;
      uint64_t block_count = (uint64_t)shape->block_u_count * shape->block_v_count;
      uint8_t *decompressed = calloc(block_count * shape->s_count * shape->t_count / 8 + 1, 1);
      if (!decompressed) return false;
      if (format == U_BLOCK_HALF) cache->u_block_nbytes = U_BLOCK_HALF_NBYTES;
      for (uint32_t level = 0; level < LEVEL_COUNT; level++)
        cache->layers[LEVEL_COUNT * number + level] =
            (cached_layer){.cache = cache,
                           .surface = i,
                           .layer = k,
                           .level = level,
                           .block_u_count = shape->block_u_count,
                           .s_count = shape->s_count,
                           .t_count = shape->t_count,
                           .key_base = ((uint64_t)number << 4 | level) << 38,
                           .format = format,
                           .decompressed = decompressed};
    }
  return true;
}

block_cache *block_cache_create(const slf_file *file, size_t capacity) {
  if (capacity > UINT32_MAX / 4) return NULL;
  block_cache *cache = calloc(1, sizeof *cache);
  if (!cache) return NULL;
  cache->file = file;
  cache->capacity = capacity;
  cache->slot_count = capacity + PINNED_COUNT;
  uint64_t table_count = 4;
  while (table_count < 2 * cache->slot_count) table_count *= 2;
  cache->table_mask = table_count - 1;
  cache->u_block_nbytes = SLF_BLOCK_NBYTES;
  if (number_layers(cache))
    cache->u_blocks = aligned_alloc(64, cache->slot_count * cache->u_block_nbytes);
  cache->slot_keys = malloc(cache->slot_count * sizeof *cache->slot_keys);
  cache->slot_frames = malloc(cache->slot_count * sizeof *cache->slot_frames);
  cache->free_slots = malloc(cache->slot_count * sizeof *cache->free_slots);
  cache->table = aligned_alloc(64, table_count * sizeof *cache->table);
  cache->announced_capacity = capacity / 4;
  cache->runs = malloc((cache->announced_capacity + 1) * sizeof *cache->runs);
  cache->announced_slices =
      malloc((cache->announced_capacity + 1) * sizeof *cache->announced_slices);
  cache->announced_targets =
      malloc((cache->announced_capacity + 1) * sizeof *cache->announced_targets);
  if (!cache->u_blocks || !cache->slot_keys || !cache->slot_frames || !cache->free_slots ||
      !cache->table || !cache->runs || !cache->announced_slices || !cache->announced_targets) {
    block_cache_free(cache);
    return NULL;
  }
  block_cache_clear(cache);
  return cache;
}

void block_cache_free(block_cache *cache) {
  if (!cache) return;
  free(cache->u_blocks);
  free(cache->slot_keys);
  free(cache->slot_frames);
  free(cache->free_slots);
  free(cache->table);
  free(cache->runs);
  free(cache->announced_slices);
  free(cache->announced_targets);
  for (uint32_t i = 0; i < cache->layer_count && cache->layers; i++)
    free(cache->layers[LEVEL_COUNT * i].decompressed);
  free(cache->layers);
  free(cache->first_layer);
  free(cache);
}

void block_cache_begin_frame(block_cache *cache) {
  cache->frame++;
  cache->waiting_count = 0;
  block_cache_counts *counts = &cache->counts;
  counts->frame_lookups = counts->frame_hits = 0;
  counts->frame_decompressions = counts->frame_decompressions_again = 0;
}

static cached_layer *layer_at(const block_cache *cache, uint32_t surface_index,
                              uint32_t layer_index, uint32_t level) {
  uint32_t number = cache->first_layer[surface_index] + layer_index;
  assert(number < cache->first_layer[surface_index + 1] && level < LEVEL_COUNT);
  return &cache->layers[LEVEL_COUNT * number + level];
}

block_source block_cache_layer(block_cache *cache, uint32_t surface_index, uint32_t layer_index) {
  return block_cache_level(cache, surface_index, layer_index, 0);
}

block_source block_cache_level(block_cache *cache, uint32_t surface_index, uint32_t layer_index,
                               uint32_t level) {
  if (level > 0 && cache->codes[CODES_COUNT - 1] == 0) {
    for (int i = 0; i < 256; i++) cache->linear[i] = slf_linear_from_srgb((uint8_t)i);
    for (int i = 0; i < CODES_COUNT; i++)
      cache->codes[i] = slf_srgb_from_linear((float)i / (CODES_COUNT - 1));
  }
  return (block_source){.fetch = fetch_blocks,
                        .context = layer_at(cache, surface_index, layer_index, level),
                        .fetch_later = fetch_blocks_later,
                        .finish = finish_fetch};
}

const block_cache_counts *block_cache_get_counts(const block_cache *cache) {
  return &cache->counts;
}

size_t block_cache_resident(const block_cache *cache) {
  return cache->resident;
}

size_t block_cache_nbytes(const block_cache *cache) {
  return sizeof *cache +
         cache->slot_count * (cache->u_block_nbytes + sizeof *cache->slot_keys +
                              sizeof *cache->slot_frames + sizeof *cache->free_slots) +
         (cache->table_mask + 1) * sizeof *cache->table +
         cache->announced_capacity * (sizeof *cache->runs + sizeof *cache->announced_slices +
                                      sizeof *cache->announced_targets);
}

void block_cache_visit(const block_cache *cache, uint32_t surface_index, uint32_t layer_index,
                       void (*visit)(void *context, slf_block_address address, bool fresh),
                       void *context) {
  const cached_layer *layer = layer_at(cache, surface_index, layer_index, 0);
  for (size_t i = 0; i < cache->slot_count; i++) {
    uint64_t key = cache->slot_keys[i];
    if (key == no_key || key >> 38 != layer->key_base >> 38) continue;
    uint32_t block = (uint32_t)(key >> 16) & 0x3fffff;
    slf_block_address address = {.s = (uint16_t)(key >> 8 & 0xff),
                                 .t = (uint16_t)(key & 0xff),
                                 .block_u = (uint16_t)(block % layer->block_u_count),
                                 .block_v = (uint16_t)(block / layer->block_u_count)};
    visit(context, address, cache->slot_frames[i] == cache->frame);
  }
}
