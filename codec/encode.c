/* encode.c - from slices to C-Blocks. */
#include "codec/encode.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>

enum {
  SAMPLED_QUADS = 48, /* the tables are made from as many quads, spread over all */
  ENTRY_BITS = 240    /* an entry's bits are worth its index: 10 of them */
};

typedef struct {
  layer_state layer;
  const slf_source *source;
  const char *name;
  float inverse_steps[3][COEFFICIENTS];
  huffman_encoder encoders[CODE_COUNT];
  uint64_t counts[CODE_COUNT][256]; /* of symbols, while sampling */
  float *rgb;                       /* one slice */
  uint8_t *slices[QUAD_SLICES];     /* 8-bit, R G B */
} layer_encoder;

/* ---- Quality ------------------------------------------------------------------------------------
 */

/* Steps are whole numbers, so that a slice can leave as a JPEG with the same coefficients. The
 * error of a texel depends on the step alone, whatever the frequency; the slight slope keeps all 64
 * from jumping to the next whole number at the same quality. */
static void make_steps(layer_state *layer) {
  double base = exp2((100 - layer->public.quality) / 8.0);
  for (int channel = 0; channel < 3; channel++)
    for (int i = 0; i < COEFFICIENTS; i++) {
      double step = base * (0.94 + 0.008 * (i / 8 + i % 8));
      step = fmax(1, fmin(4000, floor(step + 0.5)));
      layer->steps[channel][i] = (uint16_t)(step * STEP_ONE);
    }
  layer_make_scales(layer);
}

/* ---- Coefficients -------------------------------------------------------------------------------
 */

/* Texels beyond the slice's edge repeat the edge. */
static void quantise_block(const layer_encoder *e, const uint8_t *slice, uint32_t block_u,
                           uint32_t block_v, int16_t levels[3][COEFFICIENTS]) {
  const slf_layer *p = &e->layer.public;
  float texels[3][COEFFICIENTS];
  for (uint32_t i = 0; i < COEFFICIENTS; i++) {
    uint32_t u = block_u * SLF_BLOCK_SIDE + i % 8, v = block_v * SLF_BLOCK_SIDE + i / 8;
    u = u < p->u_count ? u : p->u_count - 1;
    v = v < p->v_count ? v : p->v_count - 1;
    const uint8_t *rgb = slice + 3 * ((size_t)v * p->u_count + u);
    float r = rgb[0], g = rgb[1], b = rgb[2];
    texels[0][i] = 0.299f * r + 0.587f * g + 0.114f * b - 128;
    texels[1][i] = -0.168735892f * r - 0.331264108f * g + 0.5f * b;
    texels[2][i] = 0.5f * r - 0.418687589f * g - 0.081312411f * b;
  }
  for (int channel = 0; channel < 3; channel++) {
    float coefficients[COEFFICIENTS];
    forward_dct(texels[channel], coefficients);
    for (int i = 0; i < COEFFICIENTS; i++) {
      float x = coefficients[i] * e->inverse_steps[channel][i];
      /* Small AC levels cost more bits than they gain: round them down from a little above half. */
      float magnitude = floorf(fabsf(x) + (i == 0 ? 0.5f : 0.4f));
      magnitude = magnitude < MAX_LEVEL ? magnitude : MAX_LEVEL;
      levels[channel][i] = (int16_t)(x < 0 ? -magnitude : magnitude);
    }
  }
}

/* ---- Symbols ------------------------------------------------------------------------------------
 */

/* A symbol goes to the counts while bits is NULL, else out. */
typedef struct {
  layer_encoder *encoder;
  bit_string *bits;
} symbol_sink;

static void put_symbol(const symbol_sink *sink, int code, unsigned symbol) {
  if (sink->bits) {
    const huffman_encoder *h = &sink->encoder->encoders[code];
    bits_put(sink->bits, h->codes[symbol], h->bits[symbol]);
  } else {
    sink->encoder->counts[code][symbol]++;
  }
}

static unsigned level_size(int level) {
  unsigned magnitude = (unsigned)abs(level);
  return magnitude ? 32 - (unsigned)__builtin_clz(magnitude) : 0;
}

static void put_level(const symbol_sink *sink, int level, unsigned size) {
  if (sink->bits)
    bits_put(sink->bits, (uint32_t)(level < 0 ? level - 1 : level) & ((1u << size) - 1), size);
}

/* An AC level behind `run` zeros; what the tables have no code for escapes. */
static void put_run_level(const symbol_sink *sink, int code, unsigned run, int level) {
  unsigned size = level_size(level);
  const huffman_encoder *h = &sink->encoder->encoders[code];
  unsigned tail = (run & 15) << 4 | size;
  bool coded = !sink->bits || (h->bits[tail] && (run < 16 || h->bits[SYMBOL_RUN_16]));
  if (coded) {
    for (; run > 15; run -= 16) put_symbol(sink, code, SYMBOL_RUN_16);
    put_symbol(sink, code, tail);
    put_level(sink, level, size);
  } else {
    put_symbol(sink, code, SYMBOL_ESCAPE);
    bits_put(sink->bits, run, 6);
    bits_put(sink->bits, (uint16_t)level, 16);
  }
}

static void put_block(const symbol_sink *sink, int16_t levels[3][COEFFICIENTS]) {
  for (int channel = 0; channel < 3; channel++) {
    int chroma = channel > 0;
    unsigned size = level_size(levels[channel][0]), run = 0;
    put_symbol(sink, CODE_DC_LUMA + chroma, size);
    put_level(sink, levels[channel][0], size);
    for (int k = 1; k < COEFFICIENTS; k++) {
      int level = levels[channel][slf_zigzag[k]];
      if (level) put_run_level(sink, CODE_AC_LUMA + chroma, run, level);
      run = level ? 0 : run + 1;
    }
    put_symbol(sink, CODE_AC_LUMA + chroma, SYMBOL_END);
  }
}

/* ---- Slices -------------------------------------------------------------------------------------
 */

static slf_result read_quad(layer_encoder *e, uint32_t quad, slf_error *error) {
  const slf_layer *p = &e->layer.public;
  uint32_t s0 = quad % e->layer.quad_s_count * 2, t0 = quad / e->layer.quad_s_count * 2;
  size_t samples = 3 * (size_t)p->u_count * p->v_count;
  for (uint32_t i = 0; i < QUAD_SLICES; i++) {
    if (!(e->layer.quad_slices[quad] >> i & 1)) continue;
    uint32_t s = s0 + (i & 1), t = t0 + (i >> 1);
    slf_result result = e->source->read_slice(e->source->context, s, t, e->rgb, error);
    if (result != SLF_OK) return result;
    for (size_t k = 0; k < samples; k++) {
      if (!isfinite(e->rgb[k]))
        return slf_fail(error, SLF_ERROR_ARGUMENT,
                        "%s: slice (%u, %u): texel (%zu, %zu) is not finite", e->name, s, t,
                        k / 3 % p->u_count, k / 3 / p->u_count);
      e->slices[i][k] = slf_srgb_from_linear(e->rgb[k]);
    }
  }
  return SLF_OK;
}

static void put_place(layer_encoder *e, const symbol_sink *sink, uint32_t quad, uint64_t block) {
  uint32_t block_u = (uint32_t)(block % e->layer.public.block_u_count);
  uint32_t block_v = (uint32_t)(block / e->layer.public.block_u_count);
  for (int i = 0; i < QUAD_SLICES; i++) {
    if (!(e->layer.quad_slices[quad] >> i & 1)) continue;
    int16_t levels[3][COEFFICIENTS];
    quantise_block(e, e->slices[i], block_u, block_v, levels);
    put_block(sink, levels);
  }
}

static void report(const layer_encoder *e, double fraction) {
  if (e->source->progress) e->source->progress(e->source->context, fraction);
}

/* Counts the symbols of some quads, makes the codes, and chooses how many places share an entry. */
static slf_result make_codes(layer_encoder *e, slf_error *error) {
  layer_state *layer = &e->layer;
  uint64_t blocks = (uint64_t)layer->public.block_u_count * layer->public.block_v_count;
  uint32_t stride = (layer->quad_count + SAMPLED_QUADS - 1) / SAMPLED_QUADS, sampled = 0;
  symbol_sink sink = {e, NULL};
  for (uint32_t quad = 0, seen = 0; quad < layer->quad_s_count * layer->quad_t_count; quad++) {
    if (!layer->quad_slices[quad] || seen++ % stride != stride / 2) continue;
    slf_result result = read_quad(e, quad, error);
    if (result != SLF_OK) return result;
    for (uint64_t block = 0; block < blocks; block++) put_place(e, &sink, quad, block);
    sampled++;
  }
  uint64_t bits = 0;
  for (int code = 0; code < CODE_COUNT; code++) {
    /* What the sample lacks the rest may have: every size of DC, and the way out for AC. */
    if (code <= CODE_DC_CHROMA) {
      for (int size = 0; size < 16; size++) e->counts[code][size]++;
    } else {
      e->counts[code][SYMBOL_END]++;
      e->counts[code][SYMBOL_ESCAPE]++;
      e->counts[code][SYMBOL_RUN_16]++;
    }
    huffman_build(e->counts[code], &layer->huffman[code]);
    huffman_make_encoder(&layer->huffman[code], &e->encoders[code]);
    for (int s = 0; s < 256; s++)
      bits += e->counts[code][s] * (e->encoders[code].bits[s] + (s & 15u));
  }
  double bits_a_place = (double)bits / ((double)sampled * (double)blocks);
  unsigned log2 = 0;
  while (log2 < MAX_RUN_LOG2 && bits_a_place * (1u << log2) < ENTRY_BITS) log2++;
  layer->run_blocks = 1u << log2;
  layer->entries_per_quad = (blocks + layer->run_blocks - 1) / layer->run_blocks;
  layer->stream.entry_count = layer->entries_per_quad * layer->quad_count;
  return SLF_OK;
}

static slf_result put_quads(layer_encoder *e, stream_writer *stream, slf_error *error) {
  layer_state *layer = &e->layer;
  uint64_t blocks = (uint64_t)layer->public.block_u_count * layer->public.block_v_count;
  uint32_t quads = layer->quad_s_count * layer->quad_t_count;
  bit_string entry = {0};
  symbol_sink sink = {e, &entry};
  slf_result result = SLF_OK;
  for (uint32_t quad = 0; quad < quads && result == SLF_OK; quad++) {
    if (!layer->quad_slices[quad]) continue;
    result = read_quad(e, quad, error);
    for (uint64_t block = 0; block < blocks && result == SLF_OK; block++) {
      put_place(e, &sink, quad, block);
      if ((block + 1) % layer->run_blocks && block + 1 < blocks) continue;
      stream_put(stream, &entry);
      if (entry.bytes) memset(entry.bytes, 0, entry.capacity_nbytes);
      entry.bit_count = 0;
    }
    report(e, (layer->quad_ranks[quad] + 1.0) / layer->quad_count);
  }
  bits_free(&entry);
  return result;
}

static slf_result put_header(const layer_state *layer, uint64_t payload_bits,
                             encoded_layer *encoded, const char *name, slf_error *error) {
  uint8_t *b = calloc(1, LAYER_FIXED_NBYTES + CODE_COUNT * HUFFMAN_MAX_NBYTES);
  if (!b) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", name);
  const slf_layer *p = &layer->public;
  b[0] = (uint8_t)p->role;
  b[1] = (uint8_t)p->curve;
  b[2] = (uint8_t)p->angular;
  b[3] = (uint8_t)__builtin_ctz(layer->run_blocks);
  put_u32(b + 4, p->u_count);
  put_u32(b + 8, p->v_count);
  put_u32(b + 12, p->s_count);
  put_u32(b + 16, p->t_count);
  put_f32(b + 20, p->quality);
  put_u64(b + 24, payload_bits);
  for (int channel = 0; channel < 3; channel++)
    for (int k = 0; k < COEFFICIENTS; k++)
      put_u16(b + 32 + 2 * (channel * COEFFICIENTS + k), layer->steps[channel][slf_zigzag[k]]);
  uint64_t at = LAYER_FIXED_NBYTES;
  for (int i = 0; i < CODE_COUNT; i++) at += huffman_put(&layer->huffman[i], b + at);
  encoded->header = b;
  encoded->header_nbytes = at;
  return SLF_OK;
}

static slf_result check_options(const slf_layer_options *o, const char *name, slf_error *error) {
  if (o->u_count - 1 >= SLF_MAX_TEXELS || o->v_count - 1 >= SLF_MAX_TEXELS ||
      o->s_count - 1 >= SLF_MAX_DIRECTIONS || o->t_count - 1 >= SLF_MAX_DIRECTIONS)
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: %ux%u texels, %ux%u directions", name,
                    o->u_count, o->v_count, o->s_count, o->t_count);
  if (!(o->quality >= 1 && o->quality <= 100))
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: quality %g, expected 1 to 100", name,
                    o->quality);
  if (o->curve != SLF_CURVE_SRGB)
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: curve %d is not known", name, o->curve);
  return SLF_OK;
}

slf_result encode_layer(const slf_layer_options *options, const slf_source *source,
                        const char *name, encoded_layer *encoded, slf_error *error) {
  *encoded = (encoded_layer){0};
  slf_result result = check_options(options, name, error);
  if (result != SLF_OK) return result;
  layer_encoder *e = calloc(1, sizeof *e);
  if (!e) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", name);
  stream_writer stream = {0};
  e->source = source;
  e->name = name;
  e->layer.run_blocks = 1;
  e->layer.public = (slf_layer){.role = options->role,
                                .curve = options->curve,
                                .angular = SLF_ANGULAR_NONE,
                                .u_count = options->u_count,
                                .v_count = options->v_count,
                                .s_count = options->s_count,
                                .t_count = options->t_count,
                                .quality = options->quality};
  size_t samples = 3 * (size_t)options->u_count * options->v_count;
  bool allocated = (e->rgb = malloc(samples * sizeof *e->rgb)) != NULL;
  for (int i = 0; i < QUAD_SLICES; i++) allocated = (e->slices[i] = malloc(samples)) && allocated;
  make_steps(&e->layer);
  for (int channel = 0; channel < 3; channel++)
    for (int i = 0; i < COEFFICIENTS; i++)
      e->inverse_steps[channel][i] = (float)STEP_ONE / e->layer.steps[channel][i];

  if (!allocated)
    result =
        slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for slices of %zu samples", name, samples);
  if (result == SLF_OK) result = layer_make_quads(&e->layer, name, error);
  if (result == SLF_OK) result = make_codes(e, error);
  if (result == SLF_OK) result = put_quads(e, &stream, error);
  uint64_t payload_bits = stream.payload_bit_count;
  if (result == SLF_OK)
    result = stream_finish(&stream, &encoded->blocks, &encoded->blocks_nbytes, error);
  if (result == SLF_OK) result = put_header(&e->layer, payload_bits, encoded, name, error);
  if (result != SLF_OK) {
    free(encoded->blocks);
    *encoded = (encoded_layer){0};
  }
  stream_writer_free(&stream);
  for (int i = 0; i < QUAD_SLICES; i++) free(e->slices[i]);
  free(e->rgb);
  layer_free(&e->layer);
  free(e);
  return result;
}
