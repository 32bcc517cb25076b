/* layer.h - a layer as the decoder holds it: FORMAT.md, "Layers" and "C-Blocks". */
#ifndef SLF_LAYER_H
#define SLF_LAYER_H

#include "codec/block_code.h"
#include "codec/stream.h"

enum {
  STEP_ONE = 16, /* steps are stored in sixteenths */
  MAX_GAIN = 8,  /* fine levels in a level: the base and the keys are finer than the rest */
  LAYER_FIXED_NBYTES = 32 + 3 * 4,
  COLOUR_ONE = 1 << 14, /* what 1 is in a layer's own colours */
  COLOURS_NBYTES = 9 * 2,
  STREAM_HEADER_NBYTES = 18,
  MAX_RUN_LOG2 = 6,
  MAX_PARTS_LOG2 = 2,
  GROUP_SIDE = 4, /* directions along a side of the group that shares a key */
  QUAD_SLICES_LOG2 = 2,
  QUAD_SLICES = 1 << QUAD_SLICES_LOG2,
  MOTION_CHAIN = 8, /* every eighth slice along S is a key of the motion scheme */
  MAX_SHIFT = 7,
  MAX_STORED_KEYS = 1 << 18 /* of a layer: twice 96 MiB, touched as they are asked for */
};

/* Differences of channels, key - base, in fixed point: 64 steps to a code, of DWA's 4096 codes 4.
 */
enum { DIFFERENCE_ONE = 64, DIFFERENCE_ONE_DWA = 4 };

/* A layer's C-Blocks are in up to three streams, each useful with those before it. A stream's
 * blocks belong to units: the base is one unit, the keys one for each group of 4x4 directions, the
 * rest one for each quad of 2x2 directions. */
typedef enum { STREAM_BASE, STREAM_KEYS, STREAM_REST, STREAM_COUNT } stream_kind;

typedef struct {
  block_stream blocks;
  uint32_t unit_count;
  uint32_t run_log2, run_places; /* block places that an entry spans, and their logarithm */
  uint32_t parts_log2;           /* or, of the rest, entries that a place's quad is cut into */
  uint64_t entries_per_unit;
  uint64_t payload_bits;
  int16_t dc_begin[3]; /* what the first DC of INTRA in an entry is added to */
  block_codes codes;
  block_tables *tables; /* NULL: the layer has no such stream */
  bool partial;         /* blocks are the first bytes of it only, or NULL */
} layer_stream;

/* The steps of a channel: a line over the sum of the frequencies. */
typedef struct {
  uint32_t first; /* in sixteenths, at least STEP_ONE */
  uint32_t slope; /* in sixteenths of a sixteenth */
} step_line;

/* The slices of a quad in the order of their C-Blocks, a round trip: each is next to the one
 * before. */
static inline unsigned quad_place(uint32_t s, uint32_t t) {
  return (t & 1) ? 3 - (s & 1) : (s & 1);
}

/* Blocks of 16-bit numbers, made when first asked for: 0 absent, 1 being written, 2 there. */
typedef struct {
  int16_t (*blocks)[3][COEFFICIENTS]; /* NULL: there is no store */
  _Atomic uint8_t *states;
} block_store;

/* Where a C-Block is. */
typedef struct {
  const layer_stream *stream;
  uint64_t entry;
  uint32_t number;      /* of the block in its entry, */
  uint32_t place_first; /* and of its place's first */
  uint32_t slice_count; /* blocks a place in this entry, */
  uint32_t first_slice; /* the first of them in the unit */
} entry_site;

typedef struct kernel kernel;

typedef struct {
  slf_layer public;
  bool partial; /* a stream is */
  const kernel *kernel;
  step_line step_lines[3];
  uint16_t steps[3][COEFFICIENTS]; /* column-major */
  float scales[3][COEFFICIENTS];   /* of a fine level: steps and AAN's factors */
  float level_shift;               /* what codes are coded around */
  bool own_colours;                /* to_rgb is the layer's, not JFIF's */
  float to_rgb[3][3];              /* [R G B][channel] */
  float *linear;                   /* HDR: radiance of each code */
  uint32_t gains[STREAM_COUNT];    /* fine levels in a level of each stream */
  uint8_t *slices;                 /* [t][s]: 1 where the slice exists */
  uint32_t quad_s_count, quad_t_count;
  uint32_t *quad_ranks; /* [t][s]: units before, and */
  uint8_t *quad_slices; /* [t][s]: bit quad_place(s, t) set where the rest has the slice */
  uint32_t group_s_count, group_t_count;
  uint32_t *group_ranks; /* [t][s]: units before */
  uint32_t *group_keys; /* [t][s]: t << 16 | s of the key slice, NO_KEY if the group has no slice */
  layer_stream streams[STREAM_COUNT];
  float difference_one; /* steps of a difference in a code */
  /* What many blocks lean on stays decoded: the base, and as far as there is room, by unit and
   * place, the keys, and their differences from the base as channels in fixed point, row-major. */
  block_store base, keys, differences;
} layer_state;

#define NO_KEY UINT32_MAX

/* AAN's factors: cos(k pi / 16) sqrt(2), 1 for k = 0 (Arai, Agui, Nakajima 1988). */
extern const double slf_aan[8];

static inline uint64_t layer_place_count(const layer_state *layer) {
  return (uint64_t)layer->public.block_u_count * layer->public.block_v_count;
}

static inline bool layer_has(const layer_state *layer, stream_kind kind) {
  switch (layer->public.angular) {
  case SLF_ANGULAR_IDENTICAL:
    return kind != STREAM_KEYS;
  case SLF_ANGULAR_LAYERED:
    return true;
  default:
    return kind == STREAM_REST;
  }
}

/* Fills what follows from public's dimensions and angular: block counts, slices, units. */
slf_result layer_make_units(layer_state *layer, const char *name, slf_error *error);
void layer_set_run(layer_state *layer, stream_kind kind, uint32_t run_log2, uint32_t parts_log2);
void layer_set_curve(layer_state *layer); /* level_shift, difference_one, from public's curve */
void layer_set_jfif_colours(layer_state *layer);
void layer_set_own_colours(layer_state *layer, const int16_t to_rgb[3][3]); /* in COLOUR_ONEs */
slf_result layer_make_linear(layer_state *layer, const char *name, slf_error *error);
bool layer_make_steps(layer_state *layer);  /* from their lines; false if one is out of range */
void layer_make_scales(layer_state *layer); /* from steps and gains */
slf_result layer_make_base(layer_state *layer, const char *name, slf_error *error);
slf_result layer_make_keys(layer_state *layer, const char *name, slf_error *error);
void layer_free(layer_state *layer);

/* Channels to codes R G B of 64 texels, clamped to what the curve has. */
void layer_codes(const layer_state *layer, float channels[3][COEFFICIENTS],
                 uint16_t codes[COEFFICIENTS][3]);

/* The HDR curve (OpenEXR's DWA): x^(1/2.2) up to 1, 1 + ln(x) / 2.2 above; a half's largest value,
 * 65504, is 6.041. In codes of 12 bits, 1 is DWA_SCALE. */
enum { DWA_SCALE = 677, DWA_CODES = 4096 };
uint16_t dwa_from_linear(float radiance); /* NaN and below 0 give 0 */
float linear_from_dwa(uint16_t code);

/* The keys around a slice and their weights, which sum to 16: bilinear in the groups' centres, the
 * groups without a slice left out. Returns how many (1 .. 4). */
typedef struct {
  uint32_t group;
  int32_t weight;
} key_tap;
int layer_key_taps(const layer_state *layer, uint32_t s, uint32_t t, key_tap taps[4]);

static inline bool layer_has_slice(const layer_state *layer, uint32_t s, uint32_t t) {
  return s < layer->public.s_count && t < layer->public.t_count &&
         layer->slices[t * layer->public.s_count + s];
}

static inline uint32_t layer_group(const layer_state *layer, uint32_t s, uint32_t t) {
  return t / GROUP_SIDE * layer->group_s_count + s / GROUP_SIDE;
}

static inline bool layer_is_key(const layer_state *layer, uint32_t s, uint32_t t) {
  return layer->public.angular == SLF_ANGULAR_LAYERED &&
         layer->group_keys[layer_group(layer, s, t)] == (t << 16 | s);
}

/* The block of slice number `slice` of the slice_count that the unit has at each place. */
static inline entry_site site_in_unit(const layer_stream *stream, uint32_t unit, uint64_t place,
                                      uint32_t slice_count, uint32_t slice) {
  uint32_t width_log2 = QUAD_SLICES_LOG2 - stream->parts_log2, width = 1u << width_log2;
  uint32_t part = slice >> width_log2, first = part << width_log2;
  uint32_t run = (uint32_t)place & (stream->run_places - 1);
  uint32_t left = slice_count - first, count = left < width ? left : width;
  uint64_t group = place >> stream->run_log2;
  return (entry_site){stream,
                      unit * stream->entries_per_unit + (group << stream->parts_log2) + part,
                      run * count + slice - first,
                      run * count,
                      count,
                      first};
}

/* The block of a slice that exists. */
static inline entry_site site_of_slice(const layer_state *layer, uint32_t s, uint32_t t,
                                       uint64_t place) {
  if (layer_is_key(layer, s, t)) {
    uint32_t group = layer_group(layer, s, t);
    return site_in_unit(&layer->streams[STREAM_KEYS], layer->group_ranks[group], place, 1, 0);
  }
  uint32_t quad = t / 2 * layer->quad_s_count + s / 2;
  unsigned slices = layer->quad_slices[quad];
  return site_in_unit(&layer->streams[STREAM_REST], layer->quad_ranks[quad], place,
                      (uint32_t)__builtin_popcount(slices),
                      (uint32_t)__builtin_popcount(slices & ((1u << quad_place(s, t)) - 1)));
}

/* First slice of the motion chain that slice s of row t belongs to. */
uint32_t layer_chain_start(const layer_state *layer, uint32_t s, uint32_t t);

#endif
