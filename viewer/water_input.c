#include "viewer/water_input.h"

#include <math.h>

/* What tools of this size move stays gentle enough that few rays go below the horizon. */
static float pond_size(const water *w) {
  return fmaxf(w->rectangle.u_length, w->rectangle.v_length);
}
static float finger_radius(const water *w) {
  return pond_size(w) / 32;
}
static float ball_radius(const water *w) {
  return pond_size(w) / 16;
}

static bool pick_water(const water_input *input, const slf_view *view, double x_px, double y_px,
                       int width_px, int height_px, pick_hit *hit) {
  const camera c = camera_of_view(view, width_px, height_px);
  return pick_surface(input->file, &c, x_px, y_px, width_px, height_px, hit) &&
         drawing_water(input->drawing, hit->surface_index);
}

/* The ball is out of the water at depth -radius, and half under at 0. */
static void move_ball(const water_input *input, float u, float v, float from_depth,
                      float to_depth) {
  const ripple_ball from = {input->u, input->v, from_depth}, to = {u, v, to_depth};
  ripple_move_ball(input->held->pond, from, to, ball_radius(input->held));
}

bool water_press(water_input *input, water_tool tool, const slf_view *view, double x_px,
                 double y_px, int width_px, int height_px) {
  pick_hit hit;
  if (!pick_water(input, view, x_px, y_px, width_px, height_px, &hit)) return false;
  water *w = input->held = drawing_water(input->drawing, hit.surface_index);
  input->held_surface = hit.surface_index;
  input->tool = tool;
  input->u = hit.u;
  input->v = hit.v;
  if (tool == WATER_BALL)
    move_ball(input, hit.u, hit.v, -ball_radius(w), 0);
  else
    ripple_drop(w->pond, hit.u, hit.v, finger_radius(w), -0.6f * finger_radius(w));
  return true;
}

void water_move(water_input *input, const slf_view *view, double x_px, double y_px, int width_px,
                int height_px) {
  pick_hit hit;
  if (!input->held || !pick_water(input, view, x_px, y_px, width_px, height_px, &hit) ||
      hit.surface_index != input->held_surface)
    return;
  const water *w = input->held;
  if (input->tool == WATER_BALL)
    move_ball(input, hit.u, hit.v, 0, 0);
  else
    ripple_stroke(w->pond, input->u, input->v, hit.u, hit.v, finger_radius(w),
                  -0.25f * finger_radius(w));
  input->u = hit.u;
  input->v = hit.v;
}

void water_release(water_input *input) {
  if (input->held && input->tool == WATER_BALL)
    move_ball(input, input->u, input->v, 0, -ball_radius(input->held));
  input->held = NULL;
}

const water_key water_keys[WATER_KEY_COUNT] = {
    {' ', "pause and go on"},
    {'.', "one step of the water, while paused"},
    {'X', "level water"},
    {'[', "slower waves"},
    {']', "faster waves"},
    {'-', "less damping"},
    {'=', "more damping"},
    {'F', "mirror, or Fresnel over a tinted bottom"},
    {'N', "rippled, flat beside rippled, or slopes"},
    {'P', "rain, or none"},
};

/* A tenth of the usual speed to ten times it, and damping alike. A speed that ripple.h refuses
 * stays as it is. */
static void tune(water *w, float speed_factor, float damping_factor) {
  const ripple_options *o = ripple_get_options(w->pond);
  const float usual_speed = pond_size(w) / 5;
  const float speed =
      fminf(fmaxf(o->wave_speed * speed_factor, usual_speed / 10), usual_speed * 10);
  const float damping = fminf(fmaxf(o->damping_per_s * damping_factor, 0.02f), 20);
  ripple_tune(w->pond, speed, damping, NULL);
}

static bool press_key(water *w, char key) {
  slf_error error;
  switch (key) {
  case ' ':
    w->paused = !w->paused;
    return true;
  case '.':
    if (w->paused) water_step(w, &error);
    return true;
  case 'X':
    water_reset(w);
    return true;
  case '[':
    tune(w, 1 / 1.25f, 1);
    return true;
  case ']':
    tune(w, 1.25f, 1);
    return true;
  case '-':
    tune(w, 1, 1 / 1.5f);
    return true;
  case '=':
    tune(w, 1, 1.5f);
    return true;
  case 'F':
    w->fresnel = !w->fresnel;
    return true;
  case 'N':
    w->display = (water_display)((w->display + 1) % WATER_DISPLAY_COUNT);
    return true;
  case 'P':
    ripple_rain(w->pond, ripple_is_raining(w->pond) ? 0 : 15, finger_radius(w),
                -0.4f * finger_radius(w), 1);
    return true;
  default:
    return false;
  }
}

bool water_press_key(water_input *input, char key) {
  bool known = false;
  for (uint32_t i = 0; i < slf_surface_count(input->file); i++) {
    water *w = drawing_water(input->drawing, i);
    if (w) known |= press_key(w, key);
  }
  return known;
}
