#include "viewer/ripple.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

/* Rows solved side by side along u, and the unit that every row's stride is a multiple of. */
enum { LANES = 16 };

/* Where cubic B-spline weights of a texel start, and how many rows beyond a border they reach. */
enum { SPLINE_REACH = 2 };

/* The factors of one tridiagonal matrix: forward y_i = x_i pivot_i + below_i y_{i-1}, backward
 * x_i = y_i + below_i x_{i+1}. Off-diagonals are all -a, hence below_i = a pivot_i in both. */
typedef struct {
  double *pivot, *below;
} factors;

typedef struct {
  uint32_t cell, water; /* an obstacle's cell and the open cell whose height it shows */
} shore;

typedef struct {
  float u, v, radius, height;
} drop;

struct ripple {
  ripple_options options;
  size_t stride; /* numbers from row to row; the last column is never open, so that the left
                    neighbour of column 0 is a closed cell of the row above */
  size_t cell_count;
  double spacing_u, spacing_v;
  double r_u, r_v, tau, friction, border_u, border_v; /* g, and sqrt(r) at absorbing borders */
  factors along_u, along_v;

  /* Planes of v_count rows, with a closed row of zeros above and below. */
  double *height, *velocity, *open, *change;
  double *tile, *strip; /* LANES rows while they are solved along u */
  float *spline_row;    /* two rows of a texel row's spline, with their reach */
  shore *shores;
  size_t shore_count;
  size_t open_count;
  void *memory;

  /* Of the last step, and disturbances since: sums of h and v, the largest |h| and |v|. */
  double height_sum, velocity_sum;
  double height_peak, velocity_peak;

  double backlog_s;
  float rain_per_step;
  drop rain;
  uint64_t rain_state;
  bool calm, plain, keep_denormals;
};

/* ---- Denormals ---------------------------------------------------------------------------------
 * Ahead of a front the solves leave exponential tails, which would sink into denormals within some
 * tens of cells and slow each operation on them by an order of magnitude. */

#if defined(__x86_64__)
enum { FLUSH = 0x8040 }; /* flush to zero, denormals are zero */
static uint64_t flush_denormals(void) {
  unsigned mode = _mm_getcsr();
  _mm_setcsr(mode | FLUSH);
  return mode;
}
static void restore_denormals(uint64_t mode) {
  _mm_setcsr((unsigned)mode);
}
#elif defined(__aarch64__)
static uint64_t flush_denormals(void) {
  uint64_t mode;
  __asm__ volatile("mrs %0, fpcr" : "=r"(mode));
  __asm__ volatile("msr fpcr, %0" ::"r"(mode | (1u << 24)));
  return mode;
}
static void restore_denormals(uint64_t mode) {
  __asm__ volatile("msr fpcr, %0" ::"r"(mode));
}
#else
static uint64_t flush_denormals(void) {
  return 0;
}
static void restore_denormals(uint64_t mode) {
  (void)mode;
}
#endif

/* ---- The step ----------------------------------------------------------------------------------
 */

static inline double larger(double a, double b) {
  return a > b ? a : b;
}

/* The right-hand side K (h + tau v) + G v of one row. Closed cells beyond the borders make the
 * flux through them zero without a special case. `drift` is the mean of v, zero but for rounding:
 * M leaves constants as they are, so here is where taking it out costs least. */
static inline __attribute__((always_inline)) void
right_hand_side(const ripple *pond, size_t row, double drift, double *restrict out) {
  const size_t stride = pond->stride, start = row * stride;
  const double *restrict h = pond->height + start, *restrict v = pond->velocity + start;
  const double *restrict open = pond->open + start;
  const double r_u = pond->r_u, r_v = pond->r_v, tau = pond->tau, friction = pond->friction;
  for (size_t i = 0; i < stride; i++) {
    const ptrdiff_t at = (ptrdiff_t)i, up = at - (ptrdiff_t)stride, down = at + (ptrdiff_t)stride;
    const double level = h[at] + tau * v[at];
    const double west = open[at - 1] * (level - (h[at - 1] + tau * v[at - 1]));
    const double east = open[at + 1] * (level - (h[at + 1] + tau * v[at + 1]));
    const double north = open[up] * (level - (h[up] + tau * v[up]));
    const double south = open[down] * (level - (h[down] + tau * v[down]));
    out[i] = open[at] * (r_u * (west + east) + r_v * (north + south)) + friction * v[at] + drift;
  }
  const size_t last = pond->options.u_count - 1;
  out[0] += pond->border_u * v[0];
  out[last] += pond->border_u * v[last];
  if (pond->border_v > 0 && (row == 0 || row == pond->options.v_count - 1))
    for (size_t i = 0; i < stride; i++) out[i] += pond->border_v * v[i];
}

/* LANES rows at once: the recursion runs along u, and what is independent lies side by side. */
static inline __attribute__((always_inline)) void solve_along_u(ripple *pond, size_t first_row,
                                                                double drift) {
  const size_t stride = pond->stride, u_count = pond->options.u_count;
  const size_t rows = pond->options.v_count - first_row;
  const size_t row_count = rows < LANES ? rows : LANES;
  double *restrict tile = pond->tile, *restrict strip = pond->strip;
  const double *restrict pivot = pond->along_u.pivot, *restrict below = pond->along_u.below;

  for (size_t j = 0; j < row_count; j++)
    right_hand_side(pond, first_row + j, drift, tile + j * stride);
  for (size_t i = 0; i < u_count; i++)
    for (size_t j = 0; j < LANES; j++) strip[i * LANES + j] = tile[j * stride + i];

  for (size_t j = 0; j < LANES; j++) strip[j] *= pivot[0];
  for (size_t i = 1; i < u_count; i++) {
    double *restrict y = strip + i * LANES;
    for (size_t j = 0; j < LANES; j++)
      y[j] = y[j] * pivot[i] + below[i] * strip[(i - 1) * LANES + j];
  }
  for (size_t i = u_count - 1; i-- > 0;) {
    double *restrict y = strip + i * LANES;
    for (size_t j = 0; j < LANES; j++) y[j] += below[i] * strip[(i + 1) * LANES + j];
  }

  double *restrict change = pond->change + first_row * stride;
  for (size_t j = 0; j < row_count; j++)
    for (size_t i = 0; i < u_count; i++) change[j * stride + i] = strip[i * LANES + j];
}

static inline __attribute__((always_inline)) void forward_along_v(ripple *pond) {
  const size_t stride = pond->stride;
  const double *restrict pivot = pond->along_v.pivot, *restrict below = pond->along_v.below;
  double *restrict first = pond->change;
  for (size_t i = 0; i < stride; i++) first[i] *= pivot[0];
  for (size_t j = 1; j < pond->options.v_count; j++) {
    double *restrict y = pond->change + j * stride;
    const double *restrict above = y - stride;
    for (size_t i = 0; i < stride; i++) y[i] = y[i] * pivot[j] + below[j] * above[i];
  }
}

/* Back substitution, and with it h and v of each row; sums in LANES parts, so that their order,
 * and the last bit, is the same however wide the processor's vectors are. */
static inline __attribute__((always_inline)) void backward_along_v(ripple *pond) {
  const size_t stride = pond->stride, v_count = pond->options.v_count;
  const double *restrict below = pond->along_v.below;
  double height_sum = 0, velocity_sum = 0;
  double height_peak[LANES] = {0}, velocity_peak[LANES] = {0};
  for (size_t j = v_count; j-- > 0;) {
    double *restrict change = pond->change + j * stride;
    double *restrict h = pond->height + j * stride, *restrict v = pond->velocity + j * stride;
    const double *restrict open = pond->open + j * stride;
    if (j + 1 < v_count) {
      const double *restrict next = change + stride;
      for (size_t i = 0; i < stride; i++) change[i] += below[j] * next[i];
    }
    double row_height[LANES] = {0}, row_velocity[LANES] = {0};
    for (size_t i = 0; i < stride; i += LANES)
      for (size_t k = 0; k < LANES; k++) {
        const double moved = v[i + k] - change[i + k];
        const double raised = open[i + k] * (h[i + k] + moved);
        v[i + k] = moved;
        h[i + k] = raised;
        row_velocity[k] += moved;
        row_height[k] += raised;
        velocity_peak[k] = larger(velocity_peak[k], fabs(moved));
        height_peak[k] = larger(height_peak[k], fabs(raised));
      }
    for (size_t k = 0; k < LANES; k++) {
      velocity_sum += row_velocity[k];
      height_sum += row_height[k];
    }
  }
  pond->height_sum = height_sum;
  pond->velocity_sum = velocity_sum;
  pond->height_peak = pond->velocity_peak = 0;
  for (size_t k = 0; k < LANES; k++) {
    pond->height_peak = larger(pond->height_peak, height_peak[k]);
    pond->velocity_peak = larger(pond->velocity_peak, velocity_peak[k]);
  }
}

static inline __attribute__((always_inline)) void step_any(ripple *pond) {
  const bool closed = pond->options.border == RIPPLE_REFLECTING;
  const double drift = closed ? (pond->velocity_sum / (double)pond->cell_count) : 0;
  for (size_t row = 0; row < pond->options.v_count; row += LANES) solve_along_u(pond, row, drift);
  forward_along_v(pond);
  backward_along_v(pond);
}

static void step_plain(ripple *pond) {
  step_any(pond);
}

#if defined(__x86_64__)
__attribute__((target("avx2"))) static void step_avx2(ripple *pond) {
  step_any(pond);
}
#endif

static void step_fastest(ripple *pond) {
#if defined(__x86_64__)
  if (!pond->plain && __builtin_cpu_supports("avx2")) {
    step_avx2(pond);
    return;
  }
#endif
  step_plain(pond);
}

static size_t plane_count(const ripple *pond) {
  return pond->stride * pond->options.v_count;
}

static void scale_plane(double *plane, size_t count, double scale) {
  for (size_t i = 0; i < count; i++) plane[i] *= scale;
}

/* Gives back evenly what disturbances, obstacles and rounding have added. An absorbing border is
 * open: there it flows in and out by itself. */
static void keep_level(ripple *pond) {
  const double mean = pond->height_sum / (double)pond->open_count;
  if (pond->options.border == RIPPLE_ABSORBING || fabs(mean) <= 0x1p-40 * pond->height_peak) return;
  double sum = 0;
  double highest = 0;
  for (size_t at = 0; at < plane_count(pond); at++) {
    pond->height[at] = pond->open[at] * (pond->height[at] - mean);
    sum += pond->height[at];
    highest = larger(highest, fabs(pond->height[at]));
  }
  pond->height_sum = sum;
  pond->height_peak = highest;
}

static void limit_height(ripple *pond) {
  if (pond->height_peak <= pond->options.height_limit) return;
  const double scale = pond->options.height_limit / pond->height_peak;
  scale_plane(pond->height, plane_count(pond), scale);
  scale_plane(pond->velocity, plane_count(pond), scale);
  pond->height_sum *= scale;
  pond->velocity_sum *= scale;
  pond->velocity_peak *= scale;
  pond->height_peak = pond->options.height_limit;
}

static void come_to_rest(ripple *pond) {
  memset(pond->height, 0, plane_count(pond) * sizeof *pond->height);
  memset(pond->velocity, 0, plane_count(pond) * sizeof(double));
  pond->height_sum = pond->velocity_sum = 0;
  pond->height_peak = pond->velocity_peak = 0;
  pond->calm = true;
}

/* splitmix64 (Steele, Lea, Flood 2014), its top 53 bits as a number in [0, 1). */
static double next_random(uint64_t *state) {
  uint64_t z = (*state += 0x9e3779b97f4a7c15u);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

/* Knuth's Poisson: drops fall until the product of uniform numbers passes below exp(-mean). */
static void rain_once(ripple *pond) {
  if (pond->rain_per_step <= 0) return;
  const double end = exp(-(double)pond->rain_per_step);
  for (double product = next_random(&pond->rain_state); product > end;
       product *= next_random(&pond->rain_state)) {
    const float u = (float)next_random(&pond->rain_state);
    const float v = (float)next_random(&pond->rain_state);
    ripple_drop(pond, u, v, pond->rain.radius, pond->rain.height);
  }
}

void ripple_step(ripple *pond) {
  rain_once(pond);
  if (pond->calm) return;
  limit_height(pond);
  const uint64_t mode = pond->keep_denormals ? 0 : flush_denormals();
  step_fastest(pond);
  if (!pond->keep_denormals) restore_denormals(mode);
  keep_level(pond);
  const double calm = RIPPLE_CALM_SLOPE * fmin(pond->spacing_u, pond->spacing_v);
  if (pond->height_peak < calm && pond->velocity_peak < calm) come_to_rest(pond);
}

uint32_t ripple_due(ripple *pond, double elapsed_s) {
  if (!(elapsed_s > 0)) return 0;
  const double step_s = pond->options.step_s;
  pond->backlog_s = fmin(pond->backlog_s + elapsed_s, (RIPPLE_MAX_CATCH_UP + 0.5) * step_s);
  const double count = floor(pond->backlog_s / step_s);
  pond->backlog_s -= count * step_s;
  return (uint32_t)count;
}

uint32_t ripple_advance(ripple *pond, double elapsed_s) {
  const uint32_t count = ripple_due(pond, elapsed_s);
  for (uint32_t i = 0; i < count; i++) ripple_step(pond);
  return count;
}

void ripple_reset(ripple *pond) {
  come_to_rest(pond);
  pond->backlog_s = 0;
  pond->rain_per_step = 0;
}

/* ---- Creation ----------------------------------------------------------------------------------
 */

static slf_result refuse(slf_error *error, const char *option, double value, const char *expected) {
  if (error)
    snprintf(error->message, sizeof error->message, "ripple: %s is %g, expected %s", option, value,
             expected);
  return SLF_ERROR_ARGUMENT;
}

static bool positive(float x) {
  return isfinite(x) && x > 0;
}

static slf_result check_options(const ripple_options *options, slf_error *error) {
  const uint32_t counts[] = {options->u_count, options->v_count};
  for (int axis = 0; axis < 2; axis++)
    if (counts[axis] < RIPPLE_MIN_CELLS || counts[axis] > RIPPLE_MAX_CELLS)
      return refuse(error, axis ? "v_count" : "u_count", counts[axis], "8 to 512 cells");
  const struct {
    const char *name;
    float value;
    bool zero_allowed;
  } numbers[] = {{"u_length", options->u_length, false},
                 {"v_length", options->v_length, false},
                 {"step_s", options->step_s, false},
                 {"wave_speed", options->wave_speed, false},
                 {"height_limit", options->height_limit, false},
                 {"damping_per_s", options->damping_per_s, true},
                 {"viscosity", options->viscosity, true}};
  for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
    const float value = numbers[i].value;
    if (!positive(value) && !(numbers[i].zero_allowed && value == 0))
      return refuse(error, numbers[i].name, value,
                    numbers[i].zero_allowed ? "a number of at least 0" : "a number above 0");
  }
  /* So that rounding stays below 3e-9 of the energy a step: see Rounding in ripple.h. */
  const double way = (double)options->wave_speed * options->step_s;
  const double courant =
      fmax(way * options->u_count / options->u_length, way * options->v_count / options->v_length);
  if (!(courant >= 1e-4 && courant <= 1e3))
    return refuse(error, "wave_speed step_s / spacing", courant, "1e-4 to 1e3");
  const double tau = options->viscosity / ((double)options->wave_speed * way);
  if (!(tau <= 1e3)) return refuse(error, "viscosity / (wave_speed^2 step_s)", tau, "at most 1000");
  return SLF_OK;
}

/* The factors of 1 + a X + b B for n cells. */
static void factorise(factors *f, size_t n, double a, double b) {
  double pivot = 1 / (1 + a + b);
  for (size_t i = 0; i < n; i++) {
    if (i > 0) {
      const double diagonal = i + 1 < n ? 1 + 2 * a : 1 + a + b;
      pivot = 1 / (diagonal - a * a * pivot);
    }
    f->pivot[i] = pivot;
    f->below[i] = a * pivot;
  }
}

static void set_coefficients(ripple *pond) {
  const ripple_options *o = &pond->options;
  const double way = (double)o->wave_speed * o->step_s;
  const double courant_u = way / pond->spacing_u, courant_v = way / pond->spacing_v;
  const double tau = o->viscosity / (o->wave_speed * way);
  const bool absorbing = o->border == RIPPLE_ABSORBING;
  pond->r_u = courant_u * courant_u;
  pond->r_v = courant_v * courant_v;
  pond->tau = tau;
  pond->friction = -expm1(-(double)o->damping_per_s * o->step_s);
  pond->border_u = absorbing ? courant_u : 0;
  pond->border_v = absorbing ? courant_v : 0;
  factorise(&pond->along_u, o->u_count, pond->r_u * (0.25 + 0.5 * tau), pond->border_u / 2);
  factorise(&pond->along_v, o->v_count, pond->r_v * (0.25 + 0.5 * tau), pond->border_v / 2);
}

slf_result ripple_create(const ripple_options *options, ripple **out, slf_error *error) {
  *out = NULL;
  slf_result result = check_options(options, error);
  if (result != SLF_OK) return result;

  const size_t u_count = options->u_count, v_count = options->v_count;
  const size_t stride = (u_count + LANES) / LANES * LANES; /* at least one column stays closed */
  const size_t plane = (v_count + 2) * stride;
  const size_t number_count = 4 * plane + 2 * LANES * stride + 2 * (u_count + v_count);
  ripple *pond = calloc(1, sizeof *pond);
  if (pond) pond->memory = calloc(number_count, sizeof(double));
  if (pond) pond->spline_row = calloc(2 * (u_count + 2 * SPLINE_REACH), sizeof(float));
  if (pond) pond->shores = calloc(u_count * v_count, sizeof *pond->shores);
  if (!pond || !pond->memory || !pond->spline_row || !pond->shores) {
    ripple_destroy(pond);
    if (error)
      snprintf(error->message, sizeof error->message, "ripple: out of memory for %zu x %zu cells",
               u_count, v_count);
    return SLF_ERROR_MEMORY;
  }

  pond->options = *options;
  pond->stride = stride;
  pond->cell_count = pond->open_count = u_count * v_count;
  pond->spacing_u = options->u_length / (double)u_count;
  pond->spacing_v = options->v_length / (double)v_count;
  double *next = pond->memory;
  double **planes[] = {&pond->height, &pond->velocity, &pond->open, &pond->change};
  for (size_t i = 0; i < 4; i++, next += plane) *planes[i] = next + stride;
  pond->tile = next;
  pond->strip = next += LANES * stride;
  pond->along_u.pivot = next += LANES * stride;
  pond->along_u.below = next += u_count;
  pond->along_v.pivot = next += u_count;
  pond->along_v.below = next + v_count;
  for (size_t j = 0; j < v_count; j++)
    for (size_t i = 0; i < u_count; i++) pond->open[j * stride + i] = 1;
  set_coefficients(pond);
  pond->calm = true;
  *out = pond;
  return SLF_OK;
}

void ripple_destroy(ripple *pond) {
  if (!pond) return;
  free(pond->memory);
  free(pond->spline_row);
  free(pond->shores);
  free(pond);
}

const ripple_options *ripple_get_options(const ripple *pond) {
  return &pond->options;
}

slf_result ripple_tune(ripple *pond, float wave_speed, float damping_per_s, slf_error *error) {
  ripple_options options = pond->options;
  options.wave_speed = wave_speed;
  options.damping_per_s = damping_per_s;
  const slf_result result = check_options(&options, error);
  if (result != SLF_OK) return result;
  pond->options = options;
  set_coefficients(pond);
  return SLF_OK;
}

void ripple_set_reference(ripple *pond, bool plain, bool keep_denormals) {
  pond->plain = plain;
  pond->keep_denormals = keep_denormals;
}

/* ---- Disturbances ------------------------------------------------------------------------------
 */

/* Cells [first, end) of an axis whose centres may lie within `reach` of `centre` (both in cells).
 */
typedef struct {
  size_t first, end;
} span;

static span cells_near(double centre, double reach, size_t count) {
  const double first = fmin(fmax(ceil(centre - reach - 0.5), 0), (double)count);
  const double end = fmin(fmax(floor(centre + reach - 0.5) + 1, first), (double)count);
  return (span){(size_t)first, (size_t)end};
}

static void raise_cell(ripple *pond, size_t i, size_t j, double by) {
  const size_t at = j * pond->stride + i;
  const double raised = by * pond->open[at];
  pond->height[at] += raised;
  pond->height_sum += raised;
  pond->height_peak = larger(pond->height_peak, fabs(pond->height[at]));
}

static void disturbed(ripple *pond) {
  pond->calm = false;
  limit_height(pond);
}

static float clamp_height(const ripple *pond, float height) {
  return fminf(fmaxf(height, -pond->options.height_limit), pond->options.height_limit);
}

/* A Gaussian's exponent at which it has fallen below float32's last digit of its peak. */
#define GAUSSIAN_REACH 4.1f

bool ripple_drop(ripple *pond, float u, float v, float radius, float height) {
  if (!isfinite(u) || !isfinite(v) || !positive(radius) || !isfinite(height)) return false;
  const ripple_options *o = &pond->options;
  const float reach = GAUSSIAN_REACH * radius;
  const span across = cells_near((double)u * o->u_count, reach / pond->spacing_u, o->u_count);
  const span down = cells_near((double)v * o->v_count, reach / pond->spacing_v, o->v_count);
  double *column = pond->tile; /* the Gaussian is a product of one along u and one along v */
  for (size_t i = across.first; i < across.end; i++) {
    const float x = (((float)i + 0.5f) * pond->spacing_u - u * o->u_length) / radius;
    column[i] = expf(-x * x);
  }
  for (size_t j = down.first; j < down.end; j++) {
    const float y = (((float)j + 0.5f) * pond->spacing_v - v * o->v_length) / radius;
    const float row = clamp_height(pond, height) * expf(-y * y);
    for (size_t i = across.first; i < across.end; i++) raise_cell(pond, i, j, row * column[i]);
  }
  disturbed(pond);
  return true;
}

bool ripple_stroke(ripple *pond, float from_u, float from_v, float to_u, float to_v, float radius,
                   float height) {
  if (!isfinite(from_u) || !isfinite(from_v) || !isfinite(to_u) || !isfinite(to_v) ||
      !positive(radius) || !isfinite(height))
    return false;
  const ripple_options *o = &pond->options;
  const double from_x = (double)from_u * o->u_length, from_y = (double)from_v * o->v_length;
  const double way_x = (double)to_u * o->u_length - from_x;
  const double way_y = (double)to_v * o->v_length - from_y;
  const double way = hypot(way_x, way_y);
  if (way == 0) return true;
  const double along_x = way_x / way, along_y = way_y / way;
  const double reach = GAUSSIAN_REACH * radius;
  const span across = cells_near((from_x + way_x / 2) / pond->spacing_u,
                                 (fabs(way_x) / 2 + reach) / pond->spacing_u, o->u_count);
  const span down = cells_near((from_y + way_y / 2) / pond->spacing_v,
                               (fabs(way_y) / 2 + reach) / pond->spacing_v, o->v_count);
  /* The integral of a Gaussian drop per radius of way: sqrt(pi)/2 (erf(end) - erf(begin)). */
  const double crest = clamp_height(pond, height) * 0.88622692545275801;
  for (size_t j = down.first; j < down.end; j++)
    for (size_t i = across.first; i < across.end; i++) {
      const double x = ((double)i + 0.5) * pond->spacing_u - from_x;
      const double y = ((double)j + 0.5) * pond->spacing_v - from_y;
      const double along = x * along_x + y * along_y;
      const double off = (y * along_x - x * along_y) / radius;
      if (fabs(off) > GAUSSIAN_REACH) continue;
      const double passed = erf(along / radius) - erf((along - way) / radius);
      raise_cell(pond, i, j, crest * exp(-off * off) * passed);
    }
  disturbed(pond);
  return true;
}

/* Height of the part of a ball below rest level over a point `distance2` (squared) from its axis.
 */
static float submerged(float distance2, float radius, float depth) {
  const float half2 = radius * radius - distance2;
  if (half2 <= 0) return 0;
  const float half = sqrtf(half2);
  return fmaxf(0, fminf(0, half - depth) + half + depth);
}

static void displace(ripple *pond, ripple_ball ball, float radius, float sign) {
  enum { SAMPLES = 4 }; /* a side of a cell: the edge of the footprint is a step without them */
  const ripple_options *o = &pond->options;
  const float x = ball.u * o->u_length, y = ball.v * o->v_length;
  const span across =
      cells_near((double)ball.u * o->u_count, radius / pond->spacing_u + 0.5, o->u_count);
  const span down =
      cells_near((double)ball.v * o->v_count, radius / pond->spacing_v + 0.5, o->v_count);
  for (size_t j = down.first; j < down.end; j++)
    for (size_t i = across.first; i < across.end; i++) {
      float sum = 0;
      for (int b = 0; b < SAMPLES; b++)
        for (int a = 0; a < SAMPLES; a++) {
          const float dx = ((float)i + ((float)a + 0.5f) / SAMPLES) * pond->spacing_u - x;
          const float dy = ((float)j + ((float)b + 0.5f) / SAMPLES) * pond->spacing_v - y;
          sum += submerged(dx * dx + dy * dy, radius, ball.depth);
        }
      raise_cell(pond, i, j, sign * clamp_height(pond, sum / (SAMPLES * SAMPLES)));
    }
}

bool ripple_move_ball(ripple *pond, ripple_ball from, ripple_ball to, float radius) {
  const float numbers[] = {from.u, from.v, from.depth, to.u, to.v, to.depth};
  for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
    if (!isfinite(numbers[i])) return false;
  if (!positive(radius)) return false;
  displace(pond, from, radius, -1);
  displace(pond, to, radius, 1);
  disturbed(pond);
  return true;
}

bool ripple_rain(ripple *pond, float drops_per_s, float radius, float height, uint64_t seed) {
  if (!isfinite(drops_per_s) || drops_per_s < 0 || !positive(radius) || !isfinite(height))
    return false;
  pond->rain = (drop){.radius = radius, .height = height};
  pond->rain_per_step = fminf(drops_per_s * pond->options.step_s, RIPPLE_MAX_RAIN);
  pond->rain_state = seed;
  return true;
}

bool ripple_is_raining(const ripple *pond) {
  return pond->rain_per_step > 0;
}

/* ---- Obstacles ---------------------------------------------------------------------------------
 */

/* Gives the obstacle's cells that a spline can reach from the water the height of an open cell
 * nearby, ring after ring inwards, so that the surface runs level into it. */
static void find_shores(ripple *pond) {
  const size_t stride = pond->stride, v_count = pond->options.v_count;
  double *water_of = pond->change; /* 0, or 1 + index of the water that a cell shows */
  for (size_t at = 0; at < plane_count(pond); at++)
    water_of[at] = pond->open[at] > 0 ? (double)(at + 1) : 0;
  pond->shore_count = 0;
  for (int ring = 0; ring <= SPLINE_REACH; ring++) {
    const size_t known = pond->shore_count;
    for (size_t j = 0; j < v_count; j++)
      for (size_t i = 0; i < pond->options.u_count; i++) {
        const size_t at = j * stride + i;
        if (water_of[at] > 0) continue;
        const ptrdiff_t neighbours[] = {-1, 1, -(ptrdiff_t)stride, (ptrdiff_t)stride};
        for (int k = 0; k < 4; k++) {
          const double water = water_of[(ptrdiff_t)at + neighbours[k]];
          if (water <= 0) continue;
          pond->shores[pond->shore_count++] = (shore){(uint32_t)at, (uint32_t)water - 1};
          break;
        }
      }
    for (size_t k = known; k < pond->shore_count; k++)
      water_of[pond->shores[k].cell] = (double)(pond->shores[k].water + 1);
  }
  memset(water_of, 0, plane_count(pond) * sizeof *water_of);
}

bool ripple_add_obstacle(ripple *pond, const uint8_t *closed) {
  const size_t u_count = pond->options.u_count, v_count = pond->options.v_count;
  size_t open_count = 0;
  for (size_t j = 0; j < v_count; j++)
    for (size_t i = 0; i < u_count; i++)
      open_count += pond->open[j * pond->stride + i] > 0 && !closed[j * u_count + i];
  if (open_count == 0) return false;
  for (size_t j = 0; j < v_count; j++)
    for (size_t i = 0; i < u_count; i++) {
      const size_t at = j * pond->stride + i;
      if (!closed[j * u_count + i] || pond->open[at] <= 0) continue;
      pond->height_sum -= pond->height[at];
      pond->height[at] = 0;
      pond->open[at] = 0;
    }
  pond->open_count = open_count;
  find_shores(pond);
  return true;
}

/* ---- What the viewer reads ---------------------------------------------------------------------
 */

bool ripple_is_calm(const ripple *pond) {
  return pond->calm;
}

const double *ripple_heights(const ripple *pond, size_t *stride) {
  *stride = pond->stride;
  return pond->height;
}

/* Where a texel's centre lies among cells: cubic B-spline weights of 4 cells from `first` on, and
 * those of its derivative. */
typedef struct {
  int32_t first;
  float value[4], slope[4];
} spline;

static spline spline_at(size_t texel, size_t texel_count, size_t cell_count, double spacing) {
  const float x = ((float)texel + 0.5f) * (float)cell_count / (float)texel_count - 0.5f;
  const float base = floorf(x), t = x - base, s = 1 - t, scale = (float)(1 / spacing);
  return (spline){(int32_t)base - 1,
                  {s * s * s / 6, (3 * t * t * t - 6 * t * t + 4) / 6,
                   (3 * s * s * s - 6 * s * s + 4) / 6, t * t * t / 6},
                  {-0.5f * s * s * scale, (1.5f * t * t - 2 * t) * scale,
                   (2 * s - 1.5f * s * s) * scale, 0.5f * t * t * scale}};
}

/* Row or column i, mirrored at the borders; |i| reaches at most SPLINE_REACH beyond them. */
static size_t mirrored(ptrdiff_t i, size_t count) {
  if (i < 0) i = -1 - i;
  if (i >= (ptrdiff_t)count) i = 2 * (ptrdiff_t)count - 1 - i;
  return (size_t)i;
}

/* The spline along v of one row of texels: values and slopes at each column of cells. */
static void spline_rows(const ripple *pond, const spline *along_v, float *restrict value,
                        float *restrict slope) {
  const size_t u_count = pond->options.u_count;
  const double *rows[4];
  for (int k = 0; k < 4; k++)
    rows[k] = pond->height + mirrored(along_v->first + k, pond->options.v_count) * pond->stride;
  const double *restrict a = rows[0], *restrict b = rows[1], *restrict c = rows[2],
                         *restrict d = rows[3];
  const float *w = along_v->value, *g = along_v->slope;
  for (size_t i = 0; i < u_count; i++) {
    value[i] = (float)(w[0] * a[i] + w[1] * b[i] + w[2] * c[i] + w[3] * d[i]);
    slope[i] = (float)(g[0] * a[i] + g[1] * b[i] + g[2] * c[i] + g[3] * d[i]);
  }
  for (size_t i = 0; i < SPLINE_REACH; i++) {
    value[-1 - (ptrdiff_t)i] = value[i];
    slope[-1 - (ptrdiff_t)i] = slope[i];
    value[u_count + i] = value[u_count - 1 - i];
    slope[u_count + i] = slope[u_count - 1 - i];
  }
}

void ripple_slopes(ripple *pond, uint32_t u_count, uint32_t v_count, float *slope_u, float *slope_v,
                   size_t stride) {
  enum { CHUNK = 512 }; /* texels whose weights are kept at once */
  spline along_u[CHUNK];
  const uint64_t mode = flush_denormals();
  for (size_t k = 0; k < pond->shore_count; k++)
    pond->height[pond->shores[k].cell] = pond->height[pond->shores[k].water];
  float *value = pond->spline_row + SPLINE_REACH;
  float *slope = value + pond->options.u_count + 2 * SPLINE_REACH;
  for (size_t begin = 0; begin < u_count; begin += CHUNK) {
    const size_t count = u_count - begin < CHUNK ? u_count - begin : CHUNK;
    for (size_t i = 0; i < count; i++)
      along_u[i] = spline_at(begin + i, u_count, pond->options.u_count, pond->spacing_u);
    for (size_t j = 0; j < v_count; j++) {
      const spline along_v = spline_at(j, v_count, pond->options.v_count, pond->spacing_v);
      spline_rows(pond, &along_v, value, slope);
      float *out_u = slope_u + j * stride + begin, *out_v = slope_v + j * stride + begin;
      for (size_t i = 0; i < count; i++) {
        const spline *s = &along_u[i];
        const float *at = value + s->first, *g = slope + s->first;
        out_u[i] =
            s->slope[0] * at[0] + s->slope[1] * at[1] + s->slope[2] * at[2] + s->slope[3] * at[3];
        out_v[i] =
            s->value[0] * g[0] + s->value[1] * g[1] + s->value[2] * g[2] + s->value[3] * g[3];
      }
    }
  }
  restore_denormals(mode);
}

/* (1 + a X + b B) v at one cell of a line: its value, its neighbours and whether each exists. */
static long double line_operator(long double here, double before, double after, bool has_before,
                                 bool has_after, long double a, double b) {
  const long double differences = (has_before ? here - before : 0) + (has_after ? here - after : 0);
  return here + a * differences + (!has_before || !has_after ? b * here : 0);
}

/* Long double, so that what is seen is the rounding of steps and not of this sum. */
double ripple_energy(const ripple *pond) {
  const size_t u_count = pond->options.u_count, v_count = pond->options.v_count;
  const size_t stride = pond->stride;
  const double *h = pond->height, *v = pond->velocity, *open = pond->open;
  const long double tau = pond->tau;
  const long double a_u = pond->r_u * (0.25 + 0.5 * tau), a_v = pond->r_v * (0.25 + 0.5 * tau);
  long double sum = 0;
  for (size_t j = 0; j < v_count; j++)
    for (size_t i = 0; i < u_count; i++) {
      const size_t at = j * stride + i;
      const bool west = i > 0, east = i + 1 < u_count, north = j > 0, south = j + 1 < v_count;
      /* <M v, v> = <A_u v, A_v v>, as A_u is symmetric. */
      const long double along_u = line_operator(v[at], west ? v[at - 1] : 0, east ? v[at + 1] : 0,
                                                west, east, a_u, pond->border_u / 2);
      const long double along_v =
          line_operator(v[at], north ? v[at - stride] : 0, south ? v[at + stride] : 0, north, south,
                        a_v, pond->border_v / 2);
      const long double square = (long double)v[at] * v[at];
      sum += along_u * along_v - 0.5 * pond->friction * square;
      if (!west || !east) sum -= 0.5 * pond->border_u * square;
      if (!north || !south) sum -= 0.5 * pond->border_v * square;
      for (int axis = 0; axis < 2; axis++) {
        const size_t next = axis ? at + stride : at + 1;
        if (axis ? !south : !east) continue;
        const long double face = (axis ? pond->r_v : pond->r_u) * open[at] * open[next];
        const long double dh = (long double)h[next] - h[at], dv = (long double)v[next] - v[at];
        sum += face * (dh * (dh - dv) - 0.5 * tau * dv * dv);
      }
    }
  const double step_s = pond->options.step_s;
  return (double)(sum * pond->spacing_u * pond->spacing_v / (2 * step_s * step_s));
}

double ripple_mean_height(const ripple *pond) {
  double sum = 0;
  for (size_t j = 0; j < pond->options.v_count; j++)
    for (size_t i = 0; i < pond->options.u_count; i++) {
      const size_t at = j * pond->stride + i;
      sum += pond->open[at] * pond->height[at];
    }
  return sum / (double)pond->open_count;
}

double ripple_phase_speed(const ripple_options *options, double k_u, double k_v) {
  const double k = hypot(k_u, k_v);
  if (k == 0) return options->wave_speed;
  const double spacing_u = options->u_length / (double)options->u_count;
  const double spacing_v = options->v_length / (double)options->v_count;
  const double way = (double)options->wave_speed * options->step_s;
  const double half_u = way / spacing_u * sin(k_u * spacing_u / 2);
  const double half_v = way / spacing_v * sin(k_v * spacing_v / 2);
  const double q_u = half_u * half_u, q_v = half_v * half_v;
  const double sine = sqrt((q_u + q_v) / ((1 + q_u) * (1 + q_v)));
  return 2 * asin(fmin(sine, 1)) / options->step_s / k;
}
