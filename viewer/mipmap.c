#include "mipmap.h"

#include "cpu.h"
#include "half.h"

#if defined(__x86_64__)
#include <immintrin.h>
#define HAVE_F16C 1
#endif
#define INLINE static inline __attribute__((always_inline))

/* The finer texels under texel i of `coarse` along an axis: `first` and how three of them weigh. */
typedef struct {
  uint32_t first, count;
  float weights[3];
} footprint;

INLINE footprint footprint_of(uint32_t i, uint32_t coarse, uint32_t fine) {
  if (fine == 1) return (footprint){0, 1, {1, 0, 0}};
  if (fine % 2 == 0) return (footprint){2 * i, 2, {0.5f, 0.5f, 0}};
  /* fine = 2 m + 1 texels onto m: texel i covers [i, i + 1) (2 m + 1) / m. */
  float n = (float)fine, m = (float)coarse;
  return (footprint){2 * i, 3, {(m - (float)i) / n, m / n, ((float)i + 1) / n}};
}

static const uint16_t *texel_at(const mipmap_level *level, uint32_t x, uint32_t y) {
  return (const uint16_t *)((const uint8_t *)level->texels + y * level->row_nbytes) + 4 * x;
}

mipmap_area mipmap_reached(const mipmap_level *fine, mipmap_area a) {
  uint32_t width = fine->width > 1 ? fine->width / 2 : 1;
  uint32_t height = fine->height > 1 ? fine->height / 2 : 1;
  mipmap_area reached = {a.x0 / 2, a.y0 / 2, (a.x1 + 1) / 2, (a.y1 + 1) / 2};
  /* Along an odd side a texel also serves the one before. */
  if (fine->width % 2 && reached.x0) reached.x0--;
  if (fine->height % 2 && reached.y0) reached.y0--;
  if (reached.x0 >= width) reached.x0 = width - 1;
  if (reached.y0 >= height) reached.y0 = height - 1;
  if (reached.x1 > width) reached.x1 = width;
  if (reached.y1 > height) reached.y1 = height;
  return reached;
}

void mipmap_reduce_plain(const mipmap_level *fine, const mipmap_level *coarse, mipmap_area area) {
  for (uint32_t y = area.y0; y < area.y1; y++) {
    footprint v = footprint_of(y, coarse->height, fine->height);
    for (uint32_t x = area.x0; x < area.x1; x++) {
      footprint u = footprint_of(x, coarse->width, fine->width);
      float sum[4] = {0, 0, 0, 0};
      for (uint32_t j = 0; j < v.count; j++)
        for (uint32_t i = 0; i < u.count; i++) {
          const uint16_t *texel = texel_at(fine, u.first + i, v.first + j);
          float weight = v.weights[j] * u.weights[i];
          for (int k = 0; k < 4; k++) sum[k] = sum[k] + float_from_half(texel[k]) * weight;
        }
      uint16_t *out = (uint16_t *)(uintptr_t)texel_at(coarse, x, y);
      for (int k = 0; k < 4; k++) out[k] = half_from_float(sum[k]);
    }
  }
}

#if HAVE_F16C
__attribute__((target("avx2,f16c"))) static void
reduce_f16c(const mipmap_level *fine, const mipmap_level *coarse, mipmap_area area) {
  for (uint32_t y = area.y0; y < area.y1; y++) {
    footprint v = footprint_of(y, coarse->height, fine->height);
    for (uint32_t x = area.x0; x < area.x1; x++) {
      footprint u = footprint_of(x, coarse->width, fine->width);
      __m128 sum = _mm_setzero_ps();
      for (uint32_t j = 0; j < v.count; j++) {
        const uint16_t *texel = texel_at(fine, u.first, v.first + j);
        for (uint32_t i = 0; i < u.count; i++, texel += 4) {
          __m128 c = _mm_cvtph_ps(_mm_loadl_epi64((const __m128i *)(const void *)texel));
          sum = _mm_add_ps(sum, _mm_mul_ps(c, _mm_set1_ps(v.weights[j] * u.weights[i])));
        }
      }
      _mm_storel_epi64((__m128i *)(uintptr_t)texel_at(coarse, x, y),
                       _mm_cvtps_ph(sum, _MM_FROUND_TO_NEAREST_INT));
    }
  }
}
#endif

void mipmap_add_plain(const mipmap_level *light, const mipmap_level *sum, mipmap_area area) {
  for (uint32_t y = area.y0; y < area.y1; y++)
    for (uint32_t x = area.x0; x < area.x1; x++) {
      const uint16_t *texel = texel_at(light, x, y);
      uint16_t *out = (uint16_t *)(uintptr_t)texel_at(sum, x, y);
      for (int k = 0; k < 3; k++)
        out[k] = half_from_float(float_from_half(out[k]) + float_from_half(texel[k]));
    }
}

#if HAVE_F16C
__attribute__((target("avx2,f16c"))) static void
add_f16c(const mipmap_level *light, const mipmap_level *sum, mipmap_area area) {
  for (uint32_t y = area.y0; y < area.y1; y++)
    for (uint32_t x = area.x0; x < area.x1; x++) {
      __m128i *out = (__m128i *)(uintptr_t)texel_at(sum, x, y);
      __m128 a =
          _mm_cvtph_ps(_mm_loadl_epi64((const __m128i *)(const void *)texel_at(light, x, y)));
      __m128 b = _mm_cvtph_ps(_mm_loadl_epi64(out));
      _mm_storel_epi64(
          out, _mm_cvtps_ph(_mm_blend_ps(_mm_add_ps(a, b), b, 8), _MM_FROUND_TO_NEAREST_INT));
    }
}
#endif

void mipmap_add(const mipmap_level *light, const mipmap_level *sum, mipmap_area area) {
#if HAVE_F16C
  if (cpu_has_avx2_f16c()) {
    add_f16c(light, sum, area);
    return;
  }
#endif
  mipmap_add_plain(light, sum, area);
}

void mipmap_reduce(const mipmap_level *fine, const mipmap_level *coarse, mipmap_area area) {
#if HAVE_F16C
  if (cpu_has_avx2_f16c()) {
    reduce_f16c(fine, coarse, area);
    return;
  }
#endif
  mipmap_reduce_plain(fine, coarse, area);
}
