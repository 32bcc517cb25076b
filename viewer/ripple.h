/* ripple.h - the height of a pond over its rest level, by implicit finite differences.
 *
 * Source: Kass and Miller 1990, "Rapid, stable fluid dynamics for computer graphics": linear
 * shallow water, h_tt = c^2 (h_xx + h_yy), stepped implicitly by one tridiagonal solve along each
 * row and one along each column, so that no step is too long. Time is centred here (Lees 1962,
 * theta = 1/4) where Kass and Miller use backward differences: theirs is the same family with
 * twice the theta and a viscosity tied to the step, so it loses energy by itself; ours loses only
 * what `damping_per_s` and `viscosity` say.
 *
 * The scheme. h is the height at a step, v = h - (h one step before). With X, Y the second
 * differences -(1, -2, 1) along u and v (no flux through a border: the end rows are 1, -1), and
 * r_u = (c step / spacing_u)^2, r_v alike:
 *
 *   M (v' - v) = -K (h + tau v) - G v          h' = h + v'
 *   M = (1 + a_u X + b_u B_u) (1 + a_v Y + b_v B_v),   a = r (1/4 + tau / 2),  b = sqrt(r) / 2
 *   K = r_u X + r_v Y, without the faces where water meets an obstacle
 *   G = g + sqrt(r_u) B_u + sqrt(r_v) B_v,  g = 1 - exp(-damping step),  tau = viscosity/(c^2 step)
 *
 * B marks the border cells if borders absorb and is zero if they reflect: dh/dn = -h_t / c
 * (Sommerfeld) lets a wave out at normal incidence.
 *
 * Stability. Let M0 = M - (tau K + G)/2. Multiplying the scheme by v' + v gives, exactly,
 *   E' - E = -1/2 <(tau K + G)(v' + v), v' + v> <= 0,     E = <M0 v, v> + <K h, h - v>,
 * and E is positive: E = <(M0 - K/4) v, v> + 1/4 <K (2h - v), 2h - v>, and M0 - K/4 >= 1 - g/2,
 * because removing faces only lowers K and the product in M only adds XY >= 0. So energy never
 * grows, for any step, speed, damping, viscosity or obstacle. X and Y commute, so no axis comes
 * first: the pond treats u and v alike, to rounding. The sum of v is kept since rows of K and
 * columns of M - 1 sum to zero (borders that reflect), and so is the volume.
 *
 * Rounding. Heights are double. A step rounds v by some 10 times 2^-53 of it, which M0 weighs with
 * at most (1 + 4a)^2; so by Cauchy and Schwarz a step without damping may add 20 (1 + 4a) 2^-53 of
 * the energy, of either sign: 3e-15 at Courant number 0.7, 2e-11 at 100, 2e-9 at the largest. It
 * adds up as its square root: after 10^6 undamped steps the energy is within 4e-12, 2e-8 and 2e-6
 * of the first. Damped as the viewer's water is (1e-3 a step), it falls at every step.
 *
 * Dispersion, undamped: a wave exp(i(k_u x + k_v y - w t)) has
 *   sin^2(w step / 2) = (q_u + q_v) / ((1 + q_u)(1 + q_v)),   q = r sin^2(k spacing / 2);
 * along an axis this is tan(w step / 2) = sqrt(r) sin(k spacing / 2): long waves travel at c, and
 * shorter ones lag, as the short ones of a real pond do. ripple_phase_speed gives it.
 *
 * An obstacle is a wall of the grid's cells; M is not told of it (that keeps its factors constant),
 * so its edge is blurred over about sqrt(r)/2 cells. What little water the blur swallows is given
 * back evenly: the constant level is invisible to K, so this changes nothing else.
 *
 * Rules, so that nothing blows up:
 *   - A disturbance with a number that is not finite, or a radius <= 0, is refused: false, and
 *     nothing changes. A height beyond height_limit is clamped to it.
 *   - No height passes height_limit: when one does, all of h and v are scaled down together, which
 *     scales every wave alike and only removes energy.
 *   - Disturbances move water and add none: their net volume is taken evenly from the whole pond
 *     at the next step.
 *   - When every |h| and |v| is below RIPPLE_CALM_SLOPE spacings the pond is set to rest exactly,
 *     and its steps cost nothing until it is disturbed. Denormals ahead of a front are flushed to
 *     zero (x86-64 and arm64) while a step runs; the caller's floating-point mode is put back.
 *
 * Positions are surface parameters u, v in [0,1]; lengths are in scene units. Cell i of N sits at
 * (i + 0.5) / N. Time and memory are linear in the number of cells; nothing is allocated after
 * ripple_create. A ripple belongs to one thread at a time. */
#ifndef SLF_RIPPLE_H
#define SLF_RIPPLE_H

#include "slf.h"

enum {
  RIPPLE_MIN_CELLS = 8,
  RIPPLE_MAX_CELLS = 512,
  RIPPLE_MAX_CATCH_UP = 30, /* steps of one ripple_advance; time beyond them is dropped */
  RIPPLE_MAX_RAIN = 100     /* drops a step, on average; heavier rain falls as this */
};
#define RIPPLE_CALM_SLOPE 1e-5f /* of a spacing: reflections turn by less than 1e-4 rad */

typedef enum { RIPPLE_REFLECTING, RIPPLE_ABSORBING } ripple_border;

typedef struct {
  uint32_t u_count, v_count; /* cells, RIPPLE_MIN_CELLS .. RIPPLE_MAX_CELLS */
  float u_length, v_length;  /* of the pond, > 0 */
  float step_s;              /* > 0 */
  float wave_speed;          /* c, scene units a second, > 0 */
  float damping_per_s;       /* energy of long waves falls as exp(-damping t), >= 0 */
  float viscosity;           /* nu, scene units^2 a second: energy falls as exp(-nu k^2 t), >= 0 */
  float height_limit;        /* > 0 */
  ripple_border border;
} ripple_options;

typedef struct ripple ripple;

/* *out is NULL on failure: SLF_ERROR_ARGUMENT with the option named, or SLF_ERROR_MEMORY.
 * ripple_destroy accepts NULL. */
slf_result ripple_create(const ripple_options *options, ripple **out, slf_error *error);
void ripple_destroy(ripple *pond);

/* Present options. ripple_tune changes wave speed and damping of moving water; refused values
 * (as in ripple_create) change nothing. */
const ripple_options *ripple_get_options(const ripple *pond);
slf_result ripple_tune(ripple *pond, float wave_speed, float damping_per_s, slf_error *error);

/* One step. */
void ripple_step(ripple *pond);

/* How many steps the time since the last call amounts to; the remainder is kept for the next, so
 * that frame rate does not change the physics. At most RIPPLE_MAX_CATCH_UP, time beyond being
 * dropped, so that after a hitch the water is late rather than slow; 0 for a time that is negative
 * or NaN. ripple_advance takes them too. */
uint32_t ripple_due(ripple *pond, double elapsed_s);
uint32_t ripple_advance(ripple *pond, double elapsed_s);

/* Still water at rest level, no backlog, no rain; obstacles stay. */
void ripple_reset(ripple *pond);

/* A drop: a Gaussian of the given height (negative: a dent) that falls to 1/e at `radius`. */
bool ripple_drop(ripple *pond, float u, float v, float radius, float height);

/* A finger drawn from one place to another: drops spread evenly along the way, one height a radius
 * of way. A way cut in parts gives the same as the whole, so frame rate does not matter. */
bool ripple_stroke(ripple *pond, float from_u, float from_v, float to_u, float to_v, float radius,
                   float height);

/* A ball of this radius, its centre `depth` under rest level (negative: above), moves: what it
 * displaces is taken from where it comes from and added where it goes to. Depths differ when it is
 * pushed in or pulled out; depth <= -radius is out of the water. */
typedef struct {
  float u, v, depth;
} ripple_ball;
bool ripple_move_ball(ripple *pond, ripple_ball from, ripple_ball to, float radius);

/* Rain: drops at random places, `drops_per_s` on average (Poisson, per step), until called with 0.
 * The same seed gives the same rain. */
bool ripple_rain(ripple *pond, float drops_per_s, float radius, float height, uint64_t seed);
bool ripple_is_raining(const ripple *pond);

/* Cells where closed (v_count rows of u_count) is not 0 hold no water from now on: obstacles, that
 * reflect. At least one cell stays open, else it is refused. */
bool ripple_add_obstacle(ripple *pond, const uint8_t *closed);

/* Whether the water is at rest exactly, so that its picture is the flat one. */
bool ripple_is_calm(const ripple *pond);

/* v_count rows of u_count heights, `*stride` numbers apart, owned by the pond. */
const double *ripple_heights(const ripple *pond, size_t *stride);

/* Slopes dh/du, dh/dv (pure numbers: height over length) at the centres of a grid of texels,
 * u_count x v_count each 1 .. SLF_MAX_TEXELS: those of the cubic B-spline that has the heights as
 * control points, which is smooth to the second derivative; the surface continues mirrored beyond
 * borders and level into obstacles. Each array holds v_count rows of u_count, `stride` floats
 * apart. The upward normal is (-slope_u, -slope_v, 1), normalised. */
void ripple_slopes(ripple *pond, uint32_t u_count, uint32_t v_count, float *slope_u, float *slope_v,
                   size_t stride);

/* E above as 1/2 integral of (h_t^2 + c^2 |grad h|^2), in scene units^4 / s^2; mean height over
 * open cells. Both for tests. */
double ripple_energy(const ripple *pond);
double ripple_mean_height(const ripple *pond);

/* Speed of an undamped plane wave with these wave numbers (radians a scene unit), by the
 * dispersion relation above; c for k = 0. */
double ripple_phase_speed(const ripple_options *options, double k_u, double k_v);

/* For tests and benches: plain C instead of AVX2 (the same bits), and denormals kept. */
void ripple_set_reference(ripple *pond, bool plain, bool keep_denormals);

#endif
