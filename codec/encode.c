/* encode.c - a layer: its options, its streams in order, its header. */
#include "codec/encode_parts.h"

#include "codec/parallel.h"

#include <math.h>
#include <stdlib.h>

/* ---- The base ------------------------------------------------------------------------------ */

/* The mean over all slices; of the identical scheme, the first slice. */
static slf_result make_mean(layer_encoder *e, float *mean, slf_error *error) {
  const slf_layer *p = &e->layer.public;
  size_t samples = 3 * (size_t)p->u_count * p->v_count;
  uint32_t count = 0;
  for (uint32_t t = 0; t < p->t_count; t++)
    for (uint32_t s = 0; s < p->s_count; s++) {
      if (!slf_slice_exists(p->s_count, p->t_count, s, t)) continue;
      if (count && p->angular == SLF_ANGULAR_IDENTICAL) continue;
      slf_result result = slice_read(e, s, t, e->slices[0], error);
      if (result != SLF_OK) return result;
      for (size_t k = 0; k < samples; k++) mean[k] += e->slices[0][k];
      count++;
      if (e->source->progress)
        e->source->progress(e->source->context, 0.1 * count / p->slice_count);
    }
  for (size_t k = 0; k < samples; k++) mean[k] /= (float)count;
  return SLF_OK;
}

static slf_result put_base(layer_encoder *e, encoded_chunk *encoded, slf_error *error) {
  const slf_layer *p = &e->layer.public;
  float *mean = calloc(3 * (size_t)p->u_count * p->v_count, sizeof *mean);
  if (!mean) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for the mean", e->name);
  slf_result result = make_mean(e, mean, error);
  if (result == SLF_OK) result = encode_stream(e, STREAM_BASE, mean, encoded, 0, error);
  if (result == SLF_OK) result = layer_make_base(&e->layer, e->name, error);
  free(mean);
  return result;
}

/* ---- The layer ----------------------------------------------------------------------------- */

static slf_result put_header(const layer_encoder *e, encoded_layer *encoded, slf_error *error) {
  const layer_state *layer = &e->layer;
  uint8_t *b =
      calloc(1, LAYER_FIXED_NBYTES + COLOURS_NBYTES +
                    STREAM_COUNT * (STREAM_HEADER_NBYTES + CODE_COUNT * HUFFMAN_MAX_NBYTES +
                                    MAX_WHOLE_HEADS * WHOLE_HEAD_NBYTES));
  if (!b) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", e->name);
  const slf_layer *p = &layer->public;
  b[0] = (uint8_t)p->role;
  b[1] = (uint8_t)p->curve;
  b[2] = (uint8_t)p->angular;
  b[3] = layer->own_colours;
  put_u32(b + 4, p->u_count);
  put_u32(b + 8, p->v_count);
  put_u32(b + 12, p->s_count);
  put_u32(b + 16, p->t_count);
  put_f32(b + 20, p->quality);
  put_f32(b + 24, p->psnr);
  put_f32(b + 28, p->height_unit);
  for (int channel = 0; channel < 3; channel++) {
    put_u16(b + 32 + 4 * channel, layer->step_lines[channel].first);
    put_u16(b + 34 + 4 * channel, layer->step_lines[channel].slope);
  }
  uint8_t *at = b + LAYER_FIXED_NBYTES;
  for (int i = 0; i < 9 && layer->own_colours; i++, at += 2)
    put_u16(at, (uint16_t)(&e->to_rgb[0][0])[i]);
  for (int kind = 0; kind < STREAM_COUNT; kind++) {
    if (!layer_has(layer, kind)) continue;
    const layer_stream *stream = &layer->streams[kind];
    at[0] = (uint8_t)layer->gains[kind];
    at[1] = (uint8_t)(stream->run_log2 | stream->parts_log2 << 4);
    unsigned used = 0;
    for (int i = 0; i < CODE_COUNT; i++)
      used |= (unsigned)(stream->codes.codes[i].symbol_count > 0) << i;
    put_u16(at + 2, used);
    put_u64(at + 4, stream->payload_bits);
    for (int i = 0; i < 3; i++) put_u16(at + 12 + 2 * i, (uint16_t)stream->dc_begin[i]);
    at += STREAM_HEADER_NBYTES;
    for (int i = 0; i < CODE_COUNT; i++)
      if (used >> i & 1) at += huffman_put(&stream->codes.codes[i], at);
    for (int i = 1; i < stream->codes.codes[CODE_WHOLE_HEAD].symbol_count;
         i++, at += WHOLE_HEAD_NBYTES) {
      put_u16(at, (uint16_t)stream->codes.whole_heads[i]);
      at[2] = (uint8_t)(stream->codes.whole_heads[i] >> 16);
    }
  }
  encoded->header = (encoded_chunk){e->scratch->nbytes, (uint64_t)(at - b)};
  scratch_write(e->scratch, encoded->header.offset, b, encoded->header.nbytes);
  free(b);
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
  if ((o->role == SLF_ROLE_HEIGHT) != (o->height_unit > 0) || !isfinite(o->height_unit))
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: a height unit of %g for role %d", name,
                    o->height_unit, o->role);
  if (o->curve != SLF_CURVE_SRGB && o->curve != SLF_CURVE_DWA)
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: curve %d is not known", name, (int)o->curve);
  if (o->angular > SLF_ANGULAR_LAYERED || o->role > SLF_ROLE_COVERAGE)
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: angular %d, role %d", name, (int)o->angular,
                    (int)o->role);
  return SLF_OK;
}

static slf_result encode_streams(layer_encoder *e, bool own_colours, encoded_layer *encoded,
                                 slf_error *error) {
  slf_result result = layer_make_units(&e->layer, e->name, error);
  if (result == SLF_OK) result = colours_choose(e, own_colours, error);
  bool base = layer_has(&e->layer, STREAM_BASE);
  if (result == SLF_OK && base) result = put_base(e, &encoded->streams[STREAM_BASE], error);
  if (result == SLF_OK && layer_has(&e->layer, STREAM_KEYS))
    result = encode_stream(e, STREAM_KEYS, NULL, &encoded->streams[STREAM_KEYS], 0, error);
  if (result == SLF_OK)
    result =
        encode_stream(e, STREAM_REST, NULL, &encoded->streams[STREAM_REST], base ? 0.15 : 0, error);
  if (result != SLF_OK) return result;
  double peak = e->layer.public.curve == SLF_CURVE_DWA ? DWA_SCALE : 255; /* of white */
  double mean = (double)e->squared_error / (double)e->layer.public.raw_nbytes;
  e->layer.public.psnr = (float)(10 * log10(peak * peak / fmax(mean, 1e-9)));
  result = put_header(e, encoded, error);
  uint64_t stored = encoded->header.nbytes;
  for (int kind = 0; kind < STREAM_COUNT; kind++) stored += encoded->streams[kind].nbytes;
  encoded->psnr = e->layer.public.psnr;
  encoded->ratio = (double)e->layer.public.raw_nbytes / (double)stored;
  return result;
}

slf_result encode_layer(const slf_layer_options *options, const slf_source *source,
                        scratch_file *scratch, const char *name, encoded_layer *encoded,
                        slf_error *error) {
  *encoded = (encoded_layer){0};
  slf_result result = check_options(options, name, error);
  if (result != SLF_OK) return result;
  layer_encoder *e = calloc(1, sizeof *e);
  if (!e) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", name);
  e->source = source;
  e->scratch = scratch;
  e->name = name;
  e->thread_count = options->thread_count ? options->thread_count : processor_count();
  bool single = options->s_count == 1 && options->t_count == 1;
  e->layer.public = (slf_layer){.role = options->role,
                                .curve = options->curve,
                                .angular = single ? SLF_ANGULAR_NONE : options->angular,
                                .u_count = options->u_count,
                                .v_count = options->v_count,
                                .s_count = options->s_count,
                                .t_count = options->t_count,
                                .quality = options->quality,
                                .height_unit = options->height_unit};
  layer_set_curve(&e->layer);
  size_t samples = 3 * (size_t)options->u_count * options->v_count;
  bool allocated = (e->rgb = malloc(samples * sizeof *e->rgb)) != NULL;
  allocated = (e->whole_heads = calloc(1u << WHOLE_HEAD_BITS, 1)) && allocated;
  for (int i = 0; i < QUAD_SLICES; i++)
    allocated = (e->slices[i] = malloc(samples * sizeof *e->slices[i])) && allocated;
  uint64_t places = ((uint64_t)options->u_count + 7) / 8 * (((uint64_t)options->v_count + 7) / 8);
  for (int i = 0; i < 2 && options->angular == SLF_ANGULAR_MOTION; i++)
    allocated = (e->left[i] = calloc(places, sizeof *e->left[i])) && allocated;
  if (allocated)
    result = encode_streams(e, options->angular == SLF_ANGULAR_LAYERED, encoded, error);
  else
    result =
        slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for slices of %zu samples", name, samples);
  for (int i = 0; i < QUAD_SLICES; i++) free(e->slices[i]);
  for (int i = 0; i < 2; i++) free(e->left[i]);
  free(e->rgb);
  free(e->whole_heads);
  layer_free(&e->layer);
  for (int kind = 0; kind < STREAM_COUNT; kind++) scratch_unmap(&e->maps[kind]);
  free(e);
  return result;
}
