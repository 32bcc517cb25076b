/* synthetic.h - light fields of a floor, traced here, for measuring the codec without a bake. */
#ifndef SLF_SYNTHETIC_H
#define SLF_SYNTHETIC_H

#include "codec/slf.h"

/* wood: a texture, the right half a mirror. mirror: a quarter mirror over the texture, in a room
 * with spheres that reflect each other (hard). gloss: broad lobes over the texture (smooth). */
typedef enum { SYNTHETIC_WOOD, SYNTHETIC_MIRROR, SYNTHETIC_GLOSS } synthetic_kind;

/* sRGB codes of all slices, those that do not exist too: [t][s][v][u][3]. */
typedef struct {
  uint32_t u_count, v_count, s_count, t_count;
  uint8_t *codes;
} light_field;

/* Traces rays_side squared rays a texel. False without memory. */
bool synthetic_make(synthetic_kind kind, uint32_t texels, uint32_t directions, uint32_t rays_side,
                    light_field *field);
void light_field_free(light_field *field);
const uint8_t *light_field_slice(const light_field *field, uint32_t s, uint32_t t);

/* A slf_source's read_slice whose context is a light_field. */
slf_result light_field_read_slice(void *context, uint32_t s_index, uint32_t t_index, float *rgb,
                                  slf_error *error);

#endif
