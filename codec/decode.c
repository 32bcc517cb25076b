/* decode.c - from a block's address to its texels. Compiled for each kernel: see kernel.h. */
#include "codec/kernel.h"

#include <stdatomic.h>

/* ---- Entries ------------------------------------------------------------------------------- */

/* An entry that is being read. What follows in it goes on from here. */
typedef struct {
  const layer_stream *stream; /* NULL: none */
  uint64_t entry;
  uint32_t next;   /* number of the block at the reader */
  bool has_levels; /* state.levels are those of block next - 1, which was not passed over */
  bit_reader reader;
  entry_state state;
} entry_reader;

static inline void begin_at(entry_reader *r, const entry_site *site, uint64_t bit) {
  r->stream = site->stream;
  r->entry = site->entry;
  r->next = 0;
  r->has_levels = false;
  reader_begin(&r->reader, &site->stream->blocks, bit);
  entry_begin(&r->state);
}

/* Passes over blocks up to a block, or if that leans on them, back to the one it stands on. Where
 * nothing passed over is such a one, it is the block read last, whose levels are at hand. */
static bool skip_to(entry_reader *r, const entry_site *site) {
  const block_tables *tables = r->stream->tables;
  uint32_t number = site->number, place_begin = number - number % site->slice_count;
  r->has_levels = false;
  if (!tables->may_lean) place_begin = number;
  if (r->next < place_begin) {
    uint32_t count = place_begin - r->next;
    r->next = place_begin;
    if (!blocks_pass(tables, &r->reader, &r->state, count)) return false;
  }
  entry_reader mark;
  mark.next = r->next;
  mark.reader = r->reader;
  memcpy(mark.state.intra_dc, r->state.intra_dc, sizeof mark.state.intra_dc);
  while (r->next < number) {
    if (!blocks_pass(tables, &r->reader, &r->state, 1)) return false;
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

/* Reads up to a block; a damaged entry ends early, with what was read. */
static inline void read_up_to(entry_reader *r, const entry_site *site) {
  /* One block on, with its predecessor's levels at hand: just read it. */
  if (!(r->has_levels || site->number == 0) || r->next != site->number) {
    if (!skip_to(r, site)) {
      r->stream = NULL;
      memset(r->state.levels, 0, sizeof r->state.levels);
      return;
    }
  }
  while (r->next <= site->number) {
    uint32_t number = r->next++;
    r->has_levels = true;
    if (!block_parse(site->stream->tables, &r->reader, number, number % site->slice_count == 0,
                     &r->state)) {
      r->stream = NULL;
      return;
    }
  }
}

static void read_block(entry_reader *r, const entry_site *site) {
  if (r->stream != site->stream || r->entry != site->entry || r->next > site->number)
    begin_at(r, site, stream_find(&site->stream->blocks, site->entry));
  read_up_to(r, site);
}

/* ---- Predictions --------------------------------------------------------------------------- */

static inline int16_t wrap(uint32_t value) {
  return (int16_t)(uint16_t)value;
}

/* fine = prediction (or nothing) + gain * levels. */
static void add_levels(const int16_t prediction[3][COEFFICIENTS], const entry_state *state,
                       uint32_t gain, fine_block fine) {
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < COEFFICIENTS; i++)
      fine[c][i] = wrap((prediction ? (uint32_t)prediction[c][i] : 0) +
                        gain * (uint32_t)state->levels[c][i]);
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
  add_levels(NULL, &reader.state, layer->gains[STREAM_BASE], *scratch);
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
  add_levels(base ? *base : NULL, &reader->state, layer->gains[STREAM_KEYS], fine);
}

static void decode_key(const layer_state *layer, uint32_t group, uint64_t place, fine_block fine) {
  entry_reader reader;
  reader.stream = NULL;
  read_key(layer, group, place, &reader, fine);
}

/* Keys that were decoded last, and where: neighbours want the same, and next places come next. A
 * group has its own slot in any 4x4 groups. */
enum { KEY_MEMO = 16 };
typedef struct {
  uint64_t tags[KEY_MEMO]; /* 0: empty */
  fine_block keys[KEY_MEMO];
  entry_reader readers[KEY_MEMO];
} key_memo;

static void memo_begin(key_memo *memo) {
  memset(memo->tags, 0, sizeof memo->tags);
  for (int i = 0; i < KEY_MEMO; i++) memo->readers[i].stream = NULL;
}

static const fine_block *get_key(const layer_state *layer, uint32_t group, uint64_t place,
                                 key_memo *memo) {
  uint64_t at = layer->group_ranks[group] * layer_place_count(layer) + place;
  if (layer->keys.blocks) {
    const fine_block *stored = stored_block(&layer->keys, at);
    if (stored) return stored;
  }
  uint64_t tag = (place << 12 | group) + 1; /* there are at most 64 x 64 groups */
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

static void key_difference(const layer_state *layer, uint32_t group, uint64_t place, key_memo *memo,
                           float channels[3][COEFFICIENTS]) {
  static const entry_state nothing = {.ac_flags = 7};
  fine_block difference, scratch;
  const int16_t *key = &(*get_key(layer, group, place, memo))[0][0];
  const int16_t *base = &(*get_base(layer, place, &scratch))[0][0];
  for (int k = 0; k < 3 * COEFFICIENTS; k++)
    (&difference[0][0])[k] = wrap((uint32_t)key[k] - (uint32_t)base[k]);
  levels_to_channels(layer, (const int16_t(*)[COEFFICIENTS])difference, &nothing, 0, channels);
}

static void shift_difference(const layer_state *layer, uint32_t group, uint64_t place, int du,
                             int dv, key_memo *memo, float channels[3][COEFFICIENTS]) {
  const slf_layer *p = &layer->public;
  int32_t u0 = (int32_t)(place % p->block_u_count) * 8 + du;
  int32_t v0 = (int32_t)(place / p->block_u_count) * 8 + dv;
  int32_t width = (int32_t)p->block_u_count * 8, height = (int32_t)p->block_v_count * 8;
  int32_t u_split = 8 - (u0 & 7), v_split = 8 - (v0 & 7);
  uint64_t have = UINT64_MAX;
  float block[3][COEFFICIENTS];
  /* Place by place, the part of the shifted block that lies there; beyond the slice its edge
   * repeats. */
  for (int part = 0; part < 4; part++) {
    int32_t x_begin = part & 1 ? u_split : 0, x_end = part & 1 ? 8 : u_split;
    int32_t y_begin = part & 2 ? v_split : 0, y_end = part & 2 ? 8 : v_split;
    for (int32_t y = y_begin; y < y_end; y++)
      for (int32_t x = x_begin; x < x_end; x++) {
        int32_t u = u0 + x, v = v0 + y;
        u = u < 0 ? 0 : u >= width ? width - 1 : u;
        v = v < 0 ? 0 : v >= height ? height - 1 : v;
        uint64_t at = (uint64_t)(v / 8) * p->block_u_count + (uint64_t)(u / 8);
        if (at != have) key_difference(layer, group, have = at, memo, block);
        for (int c = 0; c < 3; c++) channels[c][8 * y + x] = block[c][8 * (v & 7) + (u & 7)];
      }
  }
}

static void decode_shifted(const layer_state *layer, uint32_t group, uint64_t place, int du, int dv,
                           float channels[3][COEFFICIENTS]) {
  key_memo memo;
  memo_begin(&memo);
  shift_difference(layer, group, place, du, dv, &memo, channels);
}

/* ---- Blocks -------------------------------------------------------------------------------- */

/* What a run of blocks shares. */
typedef struct {
  const layer_state *layer;
  entry_reader rest;
  key_memo memo;
} decoder;

static void decoder_begin(decoder *d, const layer_state *layer) {
  d->layer = layer;
  d->rest.stream = NULL;
  memo_begin(&d->memo);
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
                                        uint64_t place, uint32_t *group, fine_block *scratch) {
  const layer_state *layer = d->layer;
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
    levels_to_channels(layer, NULL, &reader.state, layer->gains[STREAM_REST], channels);
    if (moves) add_channels(channels, shifted);
  }
}

/* A block whose entry was read up to it. Codes where u_block is not NULL, else channels. */
static void finish_block(decoder *d, const entry_site *site, uint32_t s, uint32_t t, uint64_t place,
                         uint8_t *u_block, float channels[3][COEFFICIENTS]) {
  const layer_state *layer = d->layer;
  fine_block scratch;
  uint32_t group = 0, gain = layer->gains[STREAM_REST];
  const fine_block *found = get_prediction(d, site, s, t, place, &group, &scratch);
  const int16_t(*prediction)[COEFFICIENTS] =
      found ? (const int16_t(*)[COEFFICIENTS]) * found : NULL;
  if (u_block && !is_shifted(d)) {
    levels_to_codes(layer, prediction, &d->rest.state, gain, u_block);
    return;
  }
  levels_to_channels(layer, prediction, &d->rest.state, gain, channels);
  if (is_shifted(d)) {
    float moved[3][COEFFICIENTS];
    shift_difference(layer, group, place, d->rest.state.shift_u, d->rest.state.shift_v, &d->memo,
                     moved);
    add_channels(channels, moved);
  }
  if (u_block) channels_to_codes(layer, channels, u_block);
}

/* Any existing block, in codes or channels; site is its own, bit where its entry begins. */
static void decode_at(decoder *d, uint32_t s, uint32_t t, uint64_t place, const entry_site *site,
                      uint64_t bit, uint8_t *u_block, float channels[3][COEFFICIENTS]) {
  static const entry_state nothing = {.ac_flags = 7};
  const layer_state *layer = d->layer;
  if (site->stream == &layer->streams[STREAM_KEYS]) {
    const fine_block *key = get_key(layer, layer_group(layer, s, t), place, &d->memo);
    const int16_t(*fine)[COEFFICIENTS] = (const int16_t(*)[COEFFICIENTS]) * key;
    if (u_block)
      levels_to_codes(layer, fine, &nothing, 0, u_block);
    else
      levels_to_channels(layer, fine, &nothing, 0, channels);
    return;
  }
  if (d->rest.stream == NULL || d->rest.entry != site->entry || d->rest.next > site->number)
    begin_at(&d->rest, site, bit);
  read_up_to(&d->rest, site);
  finish_block(d, site, s, t, place, u_block, channels);
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
  decode_at(&d, s, t, place, &site, stream_find(&site.stream->blocks, site.entry), NULL, channels);
}

/* ---- Batches ------------------------------------------------------------------------------- */

/* How far ahead of decoding a block's index and bits are asked for: a miss takes some 80 ns, about
 * as long as a block; three dependent ones stand before the bits. */
enum { AHEAD_DIRECTORY = 12, AHEAD_SEGMENT = 8, AHEAD_BITS = 4, RING = 16 };

typedef struct {
  entry_site site;
  uint64_t place, bit;
  bool exists;
  bool follows; /* in the entry of the block before */
} pending_block;

static void make_pending(const layer_state *layer, slf_block_address a, const pending_block *before,
                         pending_block *p) {
  const slf_layer *l = &layer->public;
  p->exists = a.block_u < l->block_u_count && a.block_v < l->block_v_count &&
              layer_has_slice(layer, a.s, a.t);
  p->follows = false;
  if (!p->exists) return;
  p->place = (uint64_t)a.block_v * l->block_u_count + a.block_u;
  p->site = site_of_slice(layer, a.s, a.t, p->place);
  p->follows = before && before->exists && before->site.stream == p->site.stream &&
               before->site.entry == p->site.entry;
  if (!p->follows) stream_prefetch_directory(&p->site.stream->blocks, p->site.entry);
}

static void find_pending(const pending_block *before, pending_block *p) {
  const block_stream *blocks = &p->site.stream->blocks;
  if (p->follows) {
    p->bit = before->bit;
    return;
  }
  p->bit = stream_find(blocks, p->site.entry);
  __builtin_prefetch(blocks->bytes + p->bit / 8);
  __builtin_prefetch(blocks->bytes + p->bit / 8 + 64);
}

static inline void look_ahead(const layer_state *layer, const slf_block_address *addresses,
                              size_t count, size_t i, pending_block ring[RING]) {
  size_t far = i + AHEAD_DIRECTORY, middle = i + AHEAD_SEGMENT, near = i + AHEAD_BITS;
  if (far < count)
    make_pending(layer, addresses[far], far ? &ring[(far - 1) % RING] : NULL, &ring[far % RING]);
  const pending_block *p = &ring[middle % RING];
  if (middle < count && p->exists && !p->follows)
    stream_prefetch_segment(&p->site.stream->blocks, p->site.entry);
  if (near < count && ring[near % RING].exists)
    find_pending(&ring[(near - 1) % RING], &ring[near % RING]);
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

static void decode_batch(const layer_state *layer, const slf_block_address *addresses, size_t count,
                         uint8_t *const *u_blocks) {
  if (layer->public.angular == SLF_ANGULAR_MOTION) {
    for (size_t i = 0; i < count; i++) decode_chained(layer, addresses[i], u_blocks[i]);
    return;
  }
  decoder d;
  pending_block ring[RING];
  float channels[3][COEFFICIENTS];
  decoder_begin(&d, layer);
  for (size_t before = AHEAD_DIRECTORY; before; before--)
    look_ahead(layer, addresses, count, (size_t)0 - before, ring);
  for (size_t i = 0; i < count; i++) {
    look_ahead(layer, addresses, count, i, ring);
    const pending_block *p = &ring[i % RING];
    if (p->exists)
      decode_at(&d, addresses[i].s, addresses[i].t, p->place, &p->site, p->bit, u_blocks[i],
                channels);
    else
      memset(u_blocks[i], 0, SLF_BLOCK_NBYTES);
  }
}

const kernel KERNEL(kernel) = {.name = SLF_KERNEL_NAME,
                               .check_stream = stream_check,
                               .find = stream_find,
                               .begin = reader_begin,
                               .parse = block_parse,
                               .inverse_dct = inverse_dct,
                               .plain_inverse_dct = plain_inverse_dct,
                               .forward_dct = forward_dct,
                               .channels_to_codes = channels_to_codes,
                               .base = decode_base,
                               .key = decode_key,
                               .keys = decode_keys,
                               .shifted = decode_shifted,
                               .channels = decode_channels,
                               .blocks = decode_batch};
