/* camera.h - POV-Ray's perspective camera: left-handed, sky +y, `angle` across the width.
 *
 * Everything is finite for any finite input: locations are held within CAMERA_FAR of the origin, a
 * direction of no length becomes +z, a view along the sky takes right = +x. */
#ifndef CAMERA_H
#define CAMERA_H

#include <stdbool.h>
#include <stdint.h>

#include "slf.h"

#define CAMERA_FAR 1e9f

typedef struct {
  float location[3];
  float right[3], up[3], forward[3]; /* orthonormal */
  float angle_deg;                   /* across the width, (0, 180) */
  float tan_x, tan_y;                /* half the image plane's width and height at distance 1 */
} camera;

/* The camera of a view for an image of width_px x height_px (both at least 1). */
camera camera_of_view(const slf_view *view, int width_px, int height_px);

/* Column-major 4x4 clip matrix for GL; z_near and z_far are distances along forward, 0 < near <
 * far. */
void camera_clip_matrix(const camera *c, float z_near, float z_far, float matrix[16]);

/* Where a point lies outside the view's pyramid: a bit for each side plane and one for behind. */
uint8_t camera_outside(const camera *c, const float point[3]);

/* ---- Moving -----------------------------------------------------------------------------------
 */

/* Turns the view's direction: yaw_rad about the sky, to the right; pitch_rad upwards, short of the
 * sky itself. The location stays. */
void view_turn(slf_view *view, float yaw_rad, float pitch_rad);
/* Moves location and look_at along the camera's own axes (scene units). */
void view_walk(slf_view *view, float right, float up, float forward);
/* Turns the location about look_at. */
void view_orbit(slf_view *view, float yaw_rad, float pitch_rad);
/* Where a view that came from `before` will be next if it goes on so. */
slf_view view_ahead(const slf_view *view, const slf_view *before);
/* Multiplies the distance to look_at. */
void view_approach(slf_view *view, float factor);

#endif
