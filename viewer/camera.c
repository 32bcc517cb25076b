#include "camera.h"

#include <math.h>
#include <string.h>

static float dot(const float a[3], const float b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static float held(float x) {
  if (!(x > -CAMERA_FAR)) return isnan(x) ? 0 : -CAMERA_FAR;
  return x < CAMERA_FAR ? x : CAMERA_FAR;
}

/* In double: look_at - location of far cameras would lose the direction in float. */
static bool unit(const double v[3], float out[3]) {
  double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  if (!(length > 1e-30)) return false;
  for (int k = 0; k < 3; k++) out[k] = (float)(v[k] / length);
  return true;
}

camera camera_of_view(const slf_view *view, int width_px, int height_px) {
  camera c = {.angle_deg = 0};
  double forward[3];
  for (int k = 0; k < 3; k++) {
    c.location[k] = held(view->location[k]);
    forward[k] = (double)held(view->look_at[k]) - c.location[k];
  }
  if (!unit(forward, c.forward)) memcpy(c.forward, (float[3]){0, 0, 1}, sizeof c.forward);
  /* right = sky x forward, in the left-handed sense of POV-Ray */
  if (!unit((double[3]){c.forward[2], 0, -c.forward[0]}, c.right) ||
      hypotf(c.forward[0], c.forward[2]) < 1e-6f)
    memcpy(c.right, (float[3]){1, 0, 0}, sizeof c.right);
  for (int k = 0; k < 3; k++) {
    int a = (k + 1) % 3, b = (k + 2) % 3;
    c.up[k] = c.forward[a] * c.right[b] - c.forward[b] * c.right[a];
  }
  c.angle_deg = view->angle_deg > 0.01f ? view->angle_deg : 0.01f; /* NaN too */
  if (c.angle_deg > 179) c.angle_deg = 179;
  c.tan_x = tanf(c.angle_deg * (float)(M_PI / 360));
  c.tan_y = c.tan_x * (float)height_px / (float)width_px;
  return c;
}

void camera_clip_matrix(const camera *c, float z_near, float z_far, float matrix[16]) {
  const float *axes[3] = {c->right, c->up, c->forward};
  float view[3][4];
  for (int row = 0; row < 3; row++) {
    memcpy(view[row], axes[row], 3 * sizeof(float));
    view[row][3] = -dot(axes[row], c->location);
  }
  double depth = (double)z_far - z_near;
  for (int column = 0; column < 4; column++) {
    float z = view[2][column];
    matrix[4 * column] = view[0][column] / c->tan_x;
    matrix[4 * column + 1] = view[1][column] / c->tan_y;
    matrix[4 * column + 2] = (float)(((double)z_far + z_near) / depth * z);
    if (column == 3) matrix[14] -= (float)(2.0 * z_far * z_near / depth);
    matrix[4 * column + 3] = z;
  }
}

uint8_t camera_outside(const camera *c, const float point[3]) {
  float d[3];
  for (int k = 0; k < 3; k++) d[k] = point[k] - c->location[k];
  float x = dot(d, c->right), y = dot(d, c->up), z = dot(d, c->forward);
  return (uint8_t)((z < 0) | (x > c->tan_x * z) << 1 | (-x > c->tan_x * z) << 2 |
                   (y > c->tan_y * z) << 3 | (-y > c->tan_y * z) << 4);
}

/* A direction turned by yaw about +y and by pitch, which stops 1 degree short of the sky. */
static void turn(double d[3], float yaw_rad, float pitch_rad) {
  double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
  if (!(length > 0)) return;
  const double limit = M_PI / 2 - M_PI / 180;
  double yaw = atan2(d[0], d[2]) + yaw_rad;
  double pitch = atan2(d[1], hypot(d[0], d[2])) + pitch_rad;
  pitch = pitch > limit ? limit : pitch < -limit ? -limit : pitch;
  d[0] = length * cos(pitch) * sin(yaw);
  d[1] = length * sin(pitch);
  d[2] = length * cos(pitch) * cos(yaw);
}

static void from_to(const float a[3], const float b[3], double d[3]) {
  for (int k = 0; k < 3; k++) d[k] = (double)b[k] - a[k];
}

void view_turn(slf_view *view, float yaw_rad, float pitch_rad) {
  double d[3];
  from_to(view->location, view->look_at, d);
  turn(d, yaw_rad, pitch_rad);
  for (int k = 0; k < 3; k++) view->look_at[k] = held((float)(view->location[k] + d[k]));
}

void view_walk(slf_view *view, float right, float up, float forward) {
  camera c = camera_of_view(view, 1, 1);
  for (int k = 0; k < 3; k++) {
    float step = right * c.right[k] + up * c.up[k] + forward * c.forward[k];
    view->location[k] = held(view->location[k] + step);
    view->look_at[k] = held(view->look_at[k] + step);
  }
}

void view_orbit(slf_view *view, float yaw_rad, float pitch_rad) {
  double d[3];
  from_to(view->location, view->look_at, d);
  turn(d, yaw_rad, pitch_rad);
  for (int k = 0; k < 3; k++) view->location[k] = held((float)(view->look_at[k] - d[k]));
}

slf_view view_ahead(const slf_view *view, const slf_view *before) {
  slf_view ahead = *view;
  for (int k = 0; k < 3; k++) {
    ahead.location[k] = held(2 * view->location[k] - before->location[k]);
    ahead.look_at[k] = held(2 * view->look_at[k] - before->look_at[k]);
  }
  return ahead;
}

void view_approach(slf_view *view, float factor) {
  double d[3];
  from_to(view->location, view->look_at, d);
  double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
  if (length * factor < 1e-4) return; /* never onto look_at, where there is no direction */
  for (int k = 0; k < 3; k++) view->location[k] = held((float)(view->look_at[k] - factor * d[k]));
}
