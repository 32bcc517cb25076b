/* decode.c - from a block's address to its texels. Compiled for each kernel: see kernel.h. */
#include "codec/kernel.h"

#include <stdatomic.h>

/* ---- Entries ------------------------------------------------------------------------------- */

/* An entry that is being read. What follows in it goes on from here. */
typedef struct {
  const layer_stream *stream; /* NULL: none */
  uint64_t entry;
  uint32_t next;   /* number of the block at the reader */
  bool has_levels; /* the state's levels are those of block next - 1, which was not passed over */
  bit_reader reader;
  entry_state state;
} entry_reader;

static inline void reader_is_nowhere(entry_reader *r) {
  r->stream = NULL;
}

static inline void begin_at(entry_reader *r, const entry_site *site, uint64_t byte) {
  r->stream = site->stream;
  r->entry = site->entry;
  r->next = 0;
  r->has_levels = false;
  reader_begin(&r->reader, &site->stream->blocks, site->entry, byte);
  entry_begin(&r->state, site->stream->dc_begin);
}

/* How many blocks of its entry stand before a block and before all that it may lean on. */
static inline uint32_t blocks_before(const entry_site *site) {
  return site->stream->tables->may_lean ? site->place_first : site->number;
}

/* Passes over blocks up to a block, or if that leans on them, back to the one it stands on. Where
 * nothing passed over is such a one, it is the block read last, whose levels are at hand. */
static bool skip_to(entry_reader *r, const entry_site *site) {
  const block_tables *tables = r->stream->tables;
  uint32_t number = site->number, before = blocks_before(site);
  r->has_levels = false;
  if (r->next < before) {
    uint32_t count = before - r->next;
    r->next = before;
    if (!blocks_pass(tables, &r->reader, r->state.intra_dc, count)) return false;
  }
  if (r->next == number) return true;
  entry_reader mark;
  mark.next = r->next;
  mark.reader = r->reader;
  memcpy(mark.state.intra_dc, r->state.intra_dc, sizeof mark.state.intra_dc);
  while (r->next < number) {
    if (!blocks_pass(tables, &r->reader, r->state.intra_dc, 1)) return false;
    r->next++;
    if (block_leans_on_previous(tables, &r->reader)) continue;
    mark.next = r->next;
    mark.reader = r->reader;
    memcpy(mark.state.intra_dc, r->state.intra_dc, sizeof mark.state.intra_dc);
  }
  if (mark.next == r->next) return true;
  r->next = mark.next;
  r->reader = mark.reader;
  memcpy(r->state.intra_dc, mark.state.intra_dc, sizeof mark.state.intra_dc);
  return true;
}

static void give_up(entry_reader *r) {
  r->stream = NULL;
  r->state.block = (block_levels){0};
}

/* Reads up to a block; a damaged entry ends early, with what was read. `meanwhile` (or NULL), of
 * the block before, is finished. */
static inline void read_up_to(entry_reader *r, const entry_site *site, texels_maker *meanwhile) {
  const block_tables *tables = site->stream->tables;
  uint32_t passed = 0;
  if (blocks_before(site) == site->number) {
    passed = site->number - r->next;
    r->next = site->number;
  } else if ((r->next != site->number || !r->has_levels) && !skip_to(r, site)) {
    texels_finish(meanwhile);
    give_up(r);
    return;
  }
  r->has_levels = true;
  for (; r->next <= site->number; r->next++, passed = 0) {
    bool first = r->next == site->place_first;
    if (!block_parse(tables, &r->reader, passed, r->next, first, meanwhile, &r->state)) {
      r->stream = NULL;
      return;
    }
  }
}

static void read_block(entry_reader *r, const entry_site *site) {
  if (r->stream != site->stream || r->entry != site->entry || r->next > site->number)
    begin_at(r, site, stream_find(&site->stream->blocks, site->entry));
  read_up_to(r, site, NULL);
}

/* ---- Predictions --------------------------------------------------------------------------- */

static inline int16_t wrap(uint32_t value) {
  return (int16_t)(uint16_t)value;
}

/* fine = prediction (or nothing) + gain * levels. */
static void add_levels(const int16_t prediction[3][COEFFICIENTS], const block_levels *block,
                       uint32_t gain, fine_block fine) {
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < COEFFICIENTS; i++)
      fine[c][i] = wrap((prediction ? (uint32_t)prediction[c][i] : 0) +
                        gain * (uint32_t)block->levels[c][i]);
}

static const fine_block *stored_block(const block_store *store, uint64_t i) {
  return atomic_load_explicit(&store->states[i], memory_order_acquire) == 2
             ? (const fine_block *)&store->blocks[i]
             : NULL;
}

static void store_block(const block_store *store, uint64_t i, const fine_block *block) {
  uint8_t absent = 0; /* where another thread came first, it writes the same */
  if (!atomic_compare_exchange_strong(&store->states[i], &absent, 1)) return;
  memcpy(store->blocks[i], *block, sizeof *block);
  atomic_store_explicit(&store->states[i], 2, memory_order_release);
}

/* The base's block: the layer's own copy, or if that is not there yet, scratch. */
static const fine_block *get_base(const layer_state *layer, uint64_t place, fine_block *scratch) {
  const fine_block *stored = stored_block(&layer->base, place);
  if (stored) return stored;
  entry_reader reader = {0};
  entry_site site = site_in_unit(&layer->streams[STREAM_BASE], 0, place, 1, 0);
  read_block(&reader, &site);
  add_levels(NULL, entry_levels(&reader.state), layer->gains[STREAM_BASE], *scratch);
  store_block(&layer->base, place, (const fine_block *)scratch);
  return scratch;
}

static void decode_base(const layer_state *layer, uint64_t place, fine_block fine) {
  fine_block scratch;
  memcpy(fine, get_base(layer, place, &scratch), sizeof(fine_block));
}

static void read_key(const layer_state *layer, uint32_t group, uint64_t place, entry_reader *reader,
                     fine_block fine) {
  entry_site site =
      site_in_unit(&layer->streams[STREAM_KEYS], layer->group_ranks[group], place, 1, 0);
  fine_block scratch;
  const fine_block *base = NULL;
  read_block(reader, &site);
  if (reader->state.predictor == PREDICT_BASE) base = get_base(layer, place, &scratch);
  add_levels(base ? *base : NULL, entry_levels(&reader->state), layer->gains[STREAM_KEYS], fine);
}

static void decode_key(const layer_state *layer, uint32_t group, uint64_t place, fine_block fine) {
  entry_reader reader;
  reader_is_nowhere(&reader);
  read_key(layer, group, place, &reader, fine);
}

/* Keys that were decoded last, and where: neighbours want the same, and next places come next. A
 * group has its own slot in any 4x4 groups. */
enum { KEY_MEMO = 16 };
typedef struct {
  uint64_t tags[KEY_MEMO]; /* 0: empty */
  fine_block keys[KEY_MEMO];
  entry_reader readers[KEY_MEMO];
  uint64_t difference_tags[KEY_MEMO];
  fine_block differences[KEY_MEMO]; /* of 2x2 groups at 2x2 places */
} key_memo;

static void memo_begin(key_memo *memo) {
  for (int i = 0; i < KEY_MEMO; i++) {
    memo->tags[i] = memo->difference_tags[i] = 0;
    reader_is_nowhere(&memo->readers[i]);
  }
}

static uint64_t key_number(const layer_state *layer, uint32_t group, uint64_t place) {
  return layer->group_ranks[group] * layer_place_count(layer) + place;
}

static uint64_t key_tag(uint32_t group, uint64_t place) {
  return (place << 12 | group) + 1; /* there are at most 64 x 64 groups */
}

static const fine_block *get_key(const layer_state *layer, uint32_t group, uint64_t place,
                                 key_memo *memo) {
  uint64_t at = key_number(layer, group, place), tag = key_tag(group, place);
  if (layer->keys.blocks) {
    const fine_block *stored = stored_block(&layer->keys, at);
    if (stored) return stored;
  }
  uint32_t slot = group % layer->group_s_count % 4 + group / layer->group_s_count % 4 * 4;
  if (memo->tags[slot] != tag) {
    memo->tags[slot] = tag;
    read_key(layer, group, place, &memo->readers[slot], memo->keys[slot]);
    if (layer->keys.blocks) store_block(&layer->keys, at, (const fine_block *)&memo->keys[slot]);
  }
  return (const fine_block *)&memo->keys[slot];
}

static void mix_keys(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                     key_memo *memo, fine_block fine) {
  key_tap taps[4];
  int count = layer_key_taps(layer, s, t, taps);
  int32_t sum[3 * COEFFICIENTS];
  for (int k = 0; k < 3 * COEFFICIENTS; k++) sum[k] = 8;
  for (int i = 0; i < count; i++) {
    const int16_t *key = &(*get_key(layer, taps[i].group, place, memo))[0][0];
    for (int k = 0; k < 3 * COEFFICIENTS; k++) sum[k] += taps[i].weight * key[k];
  }
  for (int k = 0; k < 3 * COEFFICIENTS; k++) (&fine[0][0])[k] = wrap((uint32_t)(sum[k] >> 4));
}

static void decode_keys(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                        fine_block fine) {
  key_memo memo;
  memo_begin(&memo);
  mix_keys(layer, s, t, place, &memo, fine);
}

/* ---- Shifts -------------------------------------------------------------------------------- */

static void make_difference(const layer_state *layer, uint32_t group, uint64_t place,
                            key_memo *memo, fine_block difference) {
  fine_block fine, scratch;
  const int16_t *key = &(*get_key(layer, group, place, memo))[0][0];
  const int16_t *base = &(*get_base(layer, place, &scratch))[0][0];
  for (int k = 0; k < 3 * COEFFICIENTS; k++)
    (&fine[0][0])[k] = wrap((uint32_t)key[k] - (uint32_t)base[k]);
  levels_to_difference(layer, (const int16_t(*)[COEFFICIENTS])fine, difference);
}

static const fine_block *get_difference(const layer_state *layer, uint32_t group, uint32_t block_u,
                                        uint32_t block_v, key_memo *memo) {
  uint64_t place = (uint64_t)block_v * layer->public.block_u_count + block_u;
  uint64_t at = key_number(layer, group, place), tag = key_tag(group, place);
  if (layer->differences.blocks) {
    const fine_block *stored = stored_block(&layer->differences, at);
    if (stored) return stored;
  }
  uint32_t slot = block_u % 2 + block_v % 2 * 2 + group % layer->group_s_count % 2 * 4 +
                  group / layer->group_s_count % 2 * 8;
  fine_block *difference = &memo->differences[slot];
  if (memo->difference_tags[slot] != tag) {
    memo->difference_tags[slot] = tag;
    make_difference(layer, group, place, memo, *difference);
    if (layer->differences.blocks)
      store_block(&layer->differences, at, (const fine_block *)difference);
  }
  return (const fine_block *)difference;
}

/* The texels of a place; beyond the slice its edge repeats. */
static void copy_edge(const fine_block from, bool left, bool right, bool above, bool below,
                      int16_t *to) {
  const int first = below ? 8 * 7 : 0, step = (above | below) ? 0 : 8;
  for (int c = 0; c < 3; c++)
#pragma GCC unroll 8
    for (int y = 0; y < 8; y++) {
      const int16_t *row = from[c] + first + step * y;
      int16_t *row_to = to + c * WINDOW_CHANNEL + y * WINDOW_ROW;
      if (left | right) {
        const int16_t edge = row[left ? 0 : 7];
        for (int x = 0; x < 8; x++) row_to[x] = edge;
      } else {
        memcpy(row_to, row, 8 * sizeof *row);
      }
    }
}

static inline void copy_texels(const fine_block from, int16_t *to) {
  for (int c = 0; c < 3; c++)
#pragma GCC unroll 8
    for (int y = 0; y < 8; y++)
      memcpy(to + c * WINDOW_CHANNEL + y * WINDOW_ROW, from[c] + 8 * y, 8 * sizeof *to);
}

static inline int32_t clamp(int32_t x, int32_t last) {
  return x < 0 ? 0 : x > last ? last : x;
}

/* Place by place, what lies where the block is shifted to. */
static void fill_window(const layer_state *layer, uint32_t group, uint32_t block_u,
                        uint32_t block_v, int du, int dv, key_memo *memo, shift_window *window) {
  const slf_layer *p = &layer->public;
  int32_t u_last = (int32_t)p->block_u_count - 1, v_last = (int32_t)p->block_v_count - 1;
  /* Shifts are -16 at least. */
  int32_t u0 = (int32_t)block_u + (int32_t)((uint32_t)(du + 16) / 8) - 2;
  int32_t v0 = (int32_t)block_v + (int32_t)((uint32_t)(dv + 16) / 8) - 2;
  int32_t x0 = (int32_t)((uint32_t)(du + 16) % 8), y0 = (int32_t)((uint32_t)(dv + 16) % 8);
  window->begin = (uint32_t)(y0 * WINDOW_ROW + x0);
  for (int32_t j = 0; j < 1 + (y0 > 0); j++)
    for (int32_t i = 0; i < 1 + (x0 > 0); i++) {
      int32_t u = clamp(u0 + i, u_last), v = clamp(v0 + j, v_last);
      const fine_block *from = get_difference(layer, group, (uint32_t)u, (uint32_t)v, memo);
      int16_t *to = window->channels + 8 * (j * WINDOW_ROW + i);
      if (u == u0 + i && v == v0 + j)
        copy_texels(*from, to);
      else
        copy_edge(*from, u0 + i<u, u0 + i> u, v0 + j<v, v0 + j> v, to);
    }
}

static void decode_shifted(const layer_state *layer, uint32_t group, uint64_t place, int du, int dv,
                           float channels[3][COEFFICIENTS]) {
  key_memo memo;
  shift_window window;
  memo_begin(&memo);
  uint32_t block_u = (uint32_t)place % layer->public.block_u_count;
  uint32_t block_v = (uint32_t)place / layer->public.block_u_count;
  fill_window(layer, group, block_u, block_v, du, dv, &memo, &window);
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < COEFFICIENTS; i++) {
      uint32_t at = window.begin + (uint32_t)(c * WINDOW_CHANNEL + i / 8 * WINDOW_ROW + i % 8);
      channels[c][i] = (float)window.channels[at] / layer->difference_one;
    }
}

/* ---- Blocks -------------------------------------------------------------------------------- */

/* What a run of blocks shares. */
typedef struct {
  const layer_state *layer;
  entry_reader rest;
  key_memo memo;
  /* The texels of the block read last, and what they are made of beside its levels. */
  texels_maker texels;
  fine_block scratch;
  shift_window window;
} decoder;

static void decoder_begin(decoder *d, const layer_state *layer) {
  d->layer = layer;
  reader_is_nowhere(&d->rest);
  d->texels.step = TEXELS_MADE;
  if (layer_has(layer, STREAM_KEYS)) memo_begin(&d->memo);
}

/* The slice of the block that the entry's state stands on. */
static void anchor_slice(const layer_state *layer, const entry_reader *r, const entry_site *site,
                         uint32_t *s, uint32_t *t) {
  unsigned left = layer->quad_slices[*t / 2 * layer->quad_s_count + *s / 2];
  for (unsigned i = site->first_slice + r->state.anchor % site->slice_count; i; i--)
    left &= left - 1;
  unsigned q = (unsigned)__builtin_ctz(left);
  *s = (*s & ~1u) + (q == 1 || q == 2);
  *t = (*t & ~1u) + (q >= 2);
}

/* What the rest's state at slice (s, t) is added to: NULL for nothing. A shift wants the base, and
 * what it moves in channels on top; *group is its key's. */
static const fine_block *get_prediction(decoder *d, const entry_site *site, uint32_t s, uint32_t t,
                                        uint64_t place, uint32_t *group) {
  const layer_state *layer = d->layer;
  fine_block *scratch = &d->scratch;
  predictor how = d->rest.state.predictor;
  if (how == PREDICT_INTRA || !layer_has(layer, STREAM_BASE)) return NULL;
  if (how == PREDICT_BASE) return get_base(layer, place, scratch);
  if (!layer_has(layer, STREAM_KEYS)) return NULL;
  anchor_slice(layer, &d->rest, site, &s, &t);
  *group = layer_group(layer, s, t);
  if (how == PREDICT_SHIFT) return get_base(layer, place, scratch);
  if (how == PREDICT_KEY) return get_key(layer, *group, place, &d->memo);
  mix_keys(layer, s, t, place, &d->memo, *scratch);
  return (const fine_block *)scratch;
}

static inline bool is_shifted(const decoder *d) {
  return d->rest.state.predictor == PREDICT_SHIFT && layer_has(d->layer, STREAM_KEYS);
}

static void add_channels(float channels[3][COEFFICIENTS], float more[3][COEFFICIENTS]) {
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < COEFFICIENTS; i++) channels[c][i] += more[c][i];
}

/* The motion scheme: from the chain's first slice on, each block shifts the one before. */
static void decode_chain(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                         float channels[3][COEFFICIENTS]) {
  memset(channels, 0, 3 * sizeof *channels);
  for (uint32_t at = layer_chain_start(layer, s, t); at <= s; at++) {
    entry_reader reader = {0};
    float shifted[3][COEFFICIENTS];
    entry_site site = site_of_slice(layer, at, t, place);
    read_block(&reader, &site);
    bool moves = reader.state.predictor == PREDICT_SHIFT;
    if (moves) shift_channels(channels, reader.state.shift_u, reader.state.shift_v, shifted);
    levels_to_channels(layer, NULL, entry_levels(&reader.state), layer->gains[STREAM_REST], NULL,
                       channels);
    if (moves) add_channels(channels, shifted);
  }
}

/* A block whose entry was read up to it. Codes, which are begun, where u_block is not NULL, else
 * channels. */
static void finish_block(decoder *d, const entry_site *site, slf_block_address a, uint8_t *u_block,
                         float channels[3][COEFFICIENTS]) {
  const layer_state *layer = d->layer;
  uint32_t group = 0, gain = layer->gains[STREAM_REST];
  const uint64_t place = (uint64_t)a.block_v * layer->public.block_u_count + a.block_u;
  const fine_block *found = get_prediction(d, site, a.s, a.t, place, &group);
  const int16_t(*prediction)[COEFFICIENTS] =
      found ? (const int16_t(*)[COEFFICIENTS]) * found : NULL;
  shift_window *shifted = NULL;
  if (is_shifted(d)) {
    shifted = &d->window;
    fill_window(layer, group, a.block_u, a.block_v, d->rest.state.shift_u, d->rest.state.shift_v,
                &d->memo, shifted);
  }
  if (u_block)
    texels_begin(&d->texels, layer, prediction, entry_levels(&d->rest.state), gain, shifted,
                 u_block);
  else
    levels_to_channels(layer, prediction, entry_levels(&d->rest.state), gain, shifted, channels);
}

/* A block of the keys. */
static void decode_key_slice(decoder *d, uint32_t s, uint32_t t, uint64_t place, uint8_t *u_block,
                             float channels[3][COEFFICIENTS]) {
  static const block_levels nothing = {.ac_flags = 7};
  const layer_state *layer = d->layer;
  const fine_block *key = get_key(layer, layer_group(layer, s, t), place, &d->memo);
  const int16_t(*fine)[COEFFICIENTS] = (const int16_t(*)[COEFFICIENTS]) * key;
  if (u_block)
    levels_to_codes(layer, fine, &nothing, 0, NULL, u_block);
  else
    levels_to_channels(layer, fine, &nothing, 0, NULL, channels);
}

static void decode_channels(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                            float channels[3][COEFFICIENTS]) {
  if (layer->public.angular == SLF_ANGULAR_MOTION) {
    decode_chain(layer, s, t, place, channels);
    return;
  }
  decoder d;
  decoder_begin(&d, layer);
  entry_site site = site_of_slice(layer, s, t, place);
  if (site.stream == &layer->streams[STREAM_KEYS]) {
    decode_key_slice(&d, s, t, place, NULL, channels);
    return;
  }
  read_block(&d.rest, &site);
  slf_block_address a = {.s = (uint16_t)s,
                         .t = (uint16_t)t,
                         .block_u = (uint16_t)(place % layer->public.block_u_count),
                         .block_v = (uint16_t)(place / layer->public.block_u_count)};
  finish_block(&d, &site, a, NULL, channels);
}

/* ---- Batches ------------------------------------------------------------------------------- */

/* What comes before a block's bits is done for blocks that follow, a step for each of two: a miss
 * takes some 80 ns, about as long as a block, and dependent ones stand before the bits. */
enum { FIND_AHEAD = 8, MAKE_AHEAD = 16, RING = 32 };

typedef struct {
  entry_site site;
  uint64_t place, byte; /* at first of the segment, then of the entry */
  bool exists;
  bool is_key;
  bool follows; /* in the entry of the block before */
} pending_block;

static inline void make_pending(const layer_state *layer, slf_block_address a,
                                const pending_block *before, pending_block *p) {
  const slf_layer *l = &layer->public;
  p->follows = false;
  p->exists = a.block_u < l->block_u_count && a.block_v < l->block_v_count &&
              layer_has_slice(layer, a.s, a.t);
  if (!p->exists) return;
  p->place = (uint64_t)a.block_v * l->block_u_count + a.block_u;
  p->site = site_of_slice(layer, a.s, a.t, p->place);
  p->is_key = p->site.stream == &layer->streams[STREAM_KEYS];
  p->follows = before && (before->exists & (before->site.stream == p->site.stream) &
                          (before->site.entry == p->site.entry));
  if (!p->follows) p->byte = stream_prefetch_segment(&p->site.stream->blocks, p->site.entry);
}

static inline void find_pending(const pending_block *before, pending_block *p) {
  if (!p->exists) return;
  const block_stream *blocks = &p->site.stream->blocks;
  if (p->follows) {
    p->byte = before->byte;
    return;
  }
  p->byte = stream_find_in_segment(blocks, p->site.entry, p->byte);
  /* As numbers: what precedes the bytes may be asked for, but has no pointer. */
  uintptr_t begin = (uintptr_t)blocks->bytes + p->byte, backwards = p->site.entry % 2;
  __builtin_prefetch((const void *)(begin - 8 * backwards));
  __builtin_prefetch((const void *)(begin + 64 - 136 * backwards));
}

/* A run of blocks of one layer. */
typedef struct {
  const layer_state *layer;
  const slf_block_address *addresses;
  size_t count;
  pending_block ring[RING];
} batch;

static inline void make_ahead(batch *b, size_t i) {
  if (i < b->count)
    make_pending(b->layer, b->addresses[i], i ? &b->ring[(i - 1) % RING] : NULL,
                 &b->ring[i % RING]);
}

static inline void find_ahead(batch *b, size_t i) {
  if (i < b->count) find_pending(&b->ring[(i - 1) % RING], &b->ring[i % RING]);
}

static inline void read_pending(decoder *d, const pending_block *p) {
  entry_reader *r = &d->rest;
  if (!p->exists || p->is_key) {
    texels_finish(&d->texels);
    return;
  }
  if (r->stream == NULL || r->entry != p->site.entry || r->next > p->site.number)
    begin_at(r, &p->site, p->byte);
  read_up_to(r, &p->site, &d->texels);
}

/* A block that was read: its texels are begun, if not made. */
static inline void finish_pending(decoder *d, const pending_block *p, slf_block_address a,
                                  uint8_t *u_block) {
  if (!p->exists)
    memset(u_block, 0, SLF_BLOCK_NBYTES);
  else if (p->is_key)
    decode_key_slice(d, a.s, a.t, p->place, u_block, NULL);
  else if (d->layer->public.angular == SLF_ANGULAR_NONE)
    texels_begin(&d->texels, d->layer, NULL, entry_levels(&d->rest.state),
                 d->layer->gains[STREAM_REST], NULL, u_block);
  else
    finish_block(d, &p->site, a, u_block, NULL);
}

static void decode_chained(const layer_state *layer, slf_block_address a, uint8_t *u_block) {
  const slf_layer *l = &layer->public;
  if (a.block_u >= l->block_u_count || a.block_v >= l->block_v_count ||
      !layer_has_slice(layer, a.s, a.t)) {
    memset(u_block, 0, SLF_BLOCK_NBYTES);
    return;
  }
  float channels[3][COEFFICIENTS];
  decode_chain(layer, a.s, a.t, (uint64_t)a.block_v * l->block_u_count + a.block_u, channels);
  channels_to_codes(layer, channels, u_block);
}

/* Each look at AC levels waits for the one before: where there are many, none should wait for
 * memory too. */
enum { MANY_BLOCKS = 64 };
static void prefetch_ac_tables(const block_tables *tables) {
  for (int i = 0; i < 4; i++) {
    for (size_t at = 0; at < sizeof tables->first_ac[i].taken; at += 64)
      __builtin_prefetch(tables->first_ac[i].taken + at);
    for (size_t at = 0; at < sizeof tables->later_ac[i].taken; at += 64)
      __builtin_prefetch(tables->later_ac[i].taken + at);
  }
}

static void decode_batch(const layer_state *layer, const slf_block_address *addresses, size_t count,
                         uint8_t *const *u_blocks) {
  if (layer->public.angular == SLF_ANGULAR_MOTION) {
    for (size_t i = 0; i < count; i++) decode_chained(layer, addresses[i], u_blocks[i]);
    return;
  }
  decoder d;
  batch b;
  b.layer = layer;
  b.addresses = addresses;
  b.count = count;
  decoder_begin(&d, layer);
  if (count >= MANY_BLOCKS) prefetch_ac_tables(layer->streams[STREAM_REST].tables);
  for (size_t i = 0; i < MAKE_AHEAD; i++) make_ahead(&b, i);
  for (size_t i = 0; i < FIND_AHEAD; i++) find_ahead(&b, i);
  for (size_t i = 0; i < count; i++) {
    const pending_block *p = &b.ring[i % RING];
    read_pending(&d, p);
    /* Between the two, so that the levels' narrow stores have come to the cache when the
     * transform's wide loads ask for them. */
    make_ahead(&b, i + MAKE_AHEAD);
    find_ahead(&b, i + FIND_AHEAD);
    finish_pending(&d, p, addresses[i], u_blocks[i]);
  }
  texels_finish(&d.texels);
}

const kernel KERNEL(kernel) = {.name = SLF_KERNEL_NAME,
                               .check_stream = stream_check,
                               .find = stream_find,
                               .parse = block_parse,
                               .inverse_dct = inverse_dct,
                               .plain_inverse_dct = plain_inverse_dct,
                               .forward_dct = forward_dct,
                               .channels_to_codes = channels_to_codes,
                               .levels_to_codes = levels_to_codes,
                               .base = decode_base,
                               .key = decode_key,
                               .keys = decode_keys,
                               .shifted = decode_shifted,
                               .channels = decode_channels,
                               .blocks = decode_batch};
