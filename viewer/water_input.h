/* water_input.h - what mouse and keys do to the water, whatever window they come from.
 *
 * Pressing on water lets a drop fall there; drawing on leaves a wake; with the second tool a ball
 * is held half under and pushed along, and pulled out at the end. Sizes follow the pond's. */
#ifndef SLF_WATER_INPUT_H
#define SLF_WATER_INPUT_H

#include "viewer/draw.h"
#include "viewer/pick.h"

typedef enum { WATER_FINGER, WATER_BALL } water_tool;

typedef struct {
  const slf_file *file;
  drawing *drawing;
  water *held; /* what was pressed on, until released; NULL if none */
  uint32_t held_surface;
  water_tool tool;
  float u, v; /* where the tool is */
} water_input;

/* At pixel (x_px, y_px) of a picture of width_px x height_px of this view. Press: whether water was
 * hit, which then is held. Move: the held water is disturbed as far as the mouse stays on it. */
bool water_press(water_input *input, water_tool tool, const slf_view *view, double x_px,
                 double y_px, int width_px, int height_px);
void water_move(water_input *input, const slf_view *view, double x_px, double y_px, int width_px,
                int height_px);
void water_release(water_input *input);

/* What keys do, for the key handler and for help alike. */
typedef struct {
  char key; /* as on a US keyboard, letters in capitals */
  const char *does;
} water_key;

enum { WATER_KEY_COUNT = 10 };
extern const water_key water_keys[WATER_KEY_COUNT];

/* Does it, to every water of the file. False if the key means nothing to water. */
bool water_press_key(water_input *input, char key);

#endif
