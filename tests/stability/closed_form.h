/* closed_form.h - a light field that is known everywhere, for errors against an analytic truth.
 *
 * Suites print `# figure: NAME HARDNESS ERROR`, which the report plots: HARDNESS is what grows or
 * shrinks towards the hard end, ERROR is in linear radiance unless the suite says otherwise. */
#ifndef STABILITY_CLOSED_FORM_H
#define STABILITY_CLOSED_FORM_H

#include "tests/light_field.h"
#include "viewer/block_source.h"
#include "viewer/half.h"
#include "viewer/texture.h"

/* L = 1/2 + a cos(w s + 0.7 c) cos(w t + 2 pi u + v) for channel c: periodic in u, within 0.3 ..
 * 0.7, |L_s|, |L_t| <= a w, |L_ss|, |L_tt| <= a w^2. */
static const double wave = 3, amplitude = 0.2;

static inline double radiance(double u, double v, double s, double t, int channel) {
  return 0.5 + amplitude * cos(wave * s + 0.7 * channel) * cos(wave * t + 2 * M_PI * u + v);
}

/* The same as U-Blocks, made when first asked for. */
typedef struct {
  uint32_t u_count, v_count, s_count, t_count;
  uint32_t block_u_count;
  size_t fetches;
  uint8_t *blocks; /* [block][s][t], X = 255 where made */
} closed_form;

static inline closed_form closed_form_make(uint32_t u_count, uint32_t v_count, uint32_t s_count,
                                           uint32_t t_count) {
  closed_form f = {u_count, v_count, s_count, t_count, (u_count + 7) / 8, 0, NULL};
  f.blocks =
      calloc((size_t)f.block_u_count * ((v_count + 7) / 8) * s_count * t_count, SLF_BLOCK_NBYTES);
  assert_non_null(f.blocks);
  return f;
}

/* A block as resample_block writes it. */
typedef struct {
  uint16_t texels[64 * 4]; /* R G B A, half floats */
} mixed_block;

enum { MIXED_ROW_NBYTES = 8 * 4 * sizeof(uint16_t) };

static inline void closed_form_free(closed_form *f) {
  free(f->blocks);
}

static inline void fetch_closed_form(void *context, uint32_t block_u, uint32_t block_v,
                                     const slice_index *slices, size_t count,
                                     const uint8_t **u_blocks) {
  closed_form *f = context;
  f->fetches++;
  for (size_t i = 0; i < count; i++) {
    const uint32_t s = slices[i] >> 8, t = slices[i] & 0xff;
    /* What is not stored must never be read. */
    assert_true(slf_slice_exists(f->s_count, f->t_count, s, t));
    const size_t block = (size_t)block_v * f->block_u_count + block_u;
    uint8_t *texels = f->blocks + ((block * f->s_count + s) * f->t_count + t) * SLF_BLOCK_NBYTES;
    u_blocks[i] = texels;
    if (texels[3]) continue;
    for (uint32_t k = 0; k < 64; k++) {
      for (int c = 0; c < 3; c++)
        texels[4 * k + (uint32_t)c] = slf_srgb_from_linear((float)radiance(
            (block_u * 8 + k % 8 + 0.5) / f->u_count, (block_v * 8 + k / 8 + 0.5) / f->v_count,
            2 * (s + 0.5) / f->s_count - 1, 2 * (t + 0.5) / f->t_count - 1, c));
      texels[4 * k + 3] = 255;
    }
  }
}

static inline block_source closed_form_source(closed_form *f) {
  return (block_source){.fetch = fetch_closed_form, .context = f};
}

/* A mesh whose texture is mixed from it. */
typedef struct {
  closed_form field;
  texture texture;
} shiny;

static inline void make_shiny(shiny *x, const slf_mesh *mesh, uint32_t u_count, uint32_t v_count,
                              uint32_t directions, uint32_t dice_px) {
  x->field = closed_form_make(u_count, v_count, directions, directions);
  const slf_layer layer = {
      .u_count = u_count, .v_count = v_count, .s_count = directions, .t_count = directions};
  assert_true(texture_create(&x->texture, mesh, &layer, closed_form_source(&x->field), dice_px));
}

static inline void free_shiny(shiny *x) {
  texture_free(&x->texture);
  closed_form_free(&x->field);
}

static inline const uint16_t *texel_at(const shiny *x, uint32_t column, uint32_t row) {
  const mipmap_level *level = &x->texture.levels[0];
  return level->texels + row * level->row_nbytes / sizeof *level->texels + column * 4;
}

/* What a mix of correct taps may be off by, in linear radiance. A tap's code is half a code off,
 * the viewer's curve from code to light 0.3 codes more; at radiance 0.7 a code is 1.9/255. A half
 * float is within 2^-12 of its value. */
static const double code_error = 0.8 * 1.9 / 255 + 0.7 * 0x1p-12;

/* What the mix itself may be off by towards (s, t): linear interpolation over cells of 2 / count,
 * and constant beyond the outermost samples, which lie half a cell inside the square. */
static inline double axis_error(uint32_t count, double x) {
  const double h = 2.0 / count, beyond = fabs(x) - (1 - h / 2);
  return (count > 1 ? h * h / 8 * amplitude * wave * wave : 0) +
         (beyond > 0 ? beyond * amplitude * wave : 0);
}

static inline double mix_error(const closed_form *f, double s, double t) {
  return axis_error(f->s_count, s) + axis_error(f->t_count, t) + code_error;
}

#endif
