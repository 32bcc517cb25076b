#include "viewer/ripple_script.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_NUMBERS = 8 };

typedef enum { SPEED, DAMPING, OBSTACLE, DROP, STROKE, BALL, RAIN, STOP, VERB_COUNT } verb;

static const struct {
  const char *name;
  int number_count;
} verbs[VERB_COUNT] = {
    [SPEED] = {"speed", 1}, [DAMPING] = {"damping", 1}, [OBSTACLE] = {"obstacle", 3},
    [DROP] = {"drop", 4},   [STROKE] = {"stroke", 7},   [BALL] = {"ball", 8},
    [RAIN] = {"rain", 4},   [STOP] = {"stop", 0},
};

typedef struct {
  verb verb;
  unsigned line;
  double time_s, duration_s;
  float number[MAX_NUMBERS];
} event;

struct ripple_script {
  char path[256];
  event *events;
  size_t count;
  double end_s;
  bool stops;
};

static slf_result complain(slf_error *error, slf_result result, const char *path, unsigned line,
                           const char *what) {
  if (error) {
    if (line > 0)
      snprintf(error->message, sizeof error->message, "%.256s:%u: %s", path, line, what);
    else
      snprintf(error->message, sizeof error->message, "%.256s: %s", path, what);
  }
  return result;
}

/* A finite number; *text moves behind it. */
static bool read_number(char **text, double *value) {
  char *end;
  *value = strtod(*text, &end);
  if (end == *text || !isfinite(*value)) return false;
  *text = end;
  return true;
}

/* NULL, or what is wrong with the line. */
static const char *read_event(char *text, event *e) {
  char word[16];
  int length = 0;
  if (!read_number(&text, &e->time_s) || e->time_s < 0)
    return "expected a time in seconds, 0 or more";
  if (sscanf(text, " %15s%n", word, &length) != 1) return "expected what happens after the time";
  int v = 0;
  while (v < VERB_COUNT && strcmp(word, verbs[v].name) != 0) v++;
  if (v == VERB_COUNT)
    return "expected speed, damping, obstacle, drop, stroke, ball, rain or stop after the time";
  e->verb = (verb)v;
  text += length;
  for (int i = 0; i < verbs[v].number_count; i++) {
    double value;
    if (!read_number(&text, &value)) return "too few numbers, or one that is not finite";
    e->number[i] = (float)value;
  }
  if (sscanf(text, " %15s", word) == 1) return "more numbers than expected";
  if (v == STROKE || v == BALL) e->duration_s = e->number[verbs[v].number_count - 1];
  return e->duration_s < 0 ? "expected a duration of 0 seconds or more" : NULL;
}

static slf_result add_event(ripple_script *script, const event *e, slf_error *error) {
  event *events = realloc(script->events, (script->count + 1) * sizeof *events);
  if (!events) return complain(error, SLF_ERROR_MEMORY, script->path, e->line, "out of memory");
  script->events = events;
  events[script->count++] = *e;
  return SLF_OK;
}

static slf_result read_lines(ripple_script *script, FILE *file, slf_error *error) {
  char text[1024];
  for (unsigned line = 1; fgets(text, sizeof text, file); line++) {
    if (!strchr(text, '\n') && !feof(file))
      return complain(error, SLF_ERROR_FORMAT, script->path, line, "longer than 1022 characters");
    text[strcspn(text, "#\n")] = 0;
    if (text[strspn(text, " \t\r")] == 0) continue;
    event e = {.line = line};
    const char *wrong = read_event(text, &e);
    if (wrong) return complain(error, SLF_ERROR_FORMAT, script->path, line, wrong);
    const slf_result result = add_event(script, &e, error);
    if (result != SLF_OK) return result;
  }
  if (ferror(file)) return complain(error, SLF_ERROR_IO, script->path, 0, strerror(errno));
  return SLF_OK;
}

slf_result ripple_script_read(const char *path, ripple_script **out, slf_error *error) {
  *out = NULL;
  FILE *file = fopen(path, "r");
  if (!file) return complain(error, SLF_ERROR_IO, path, 0, strerror(errno));
  ripple_script *script = calloc(1, sizeof *script);
  slf_result result = SLF_ERROR_MEMORY;
  if (script) {
    snprintf(script->path, sizeof script->path, "%s", path);
    result = read_lines(script, file, error);
  } else {
    complain(error, result, path, 0, "out of memory");
  }
  fclose(file);
  if (result != SLF_OK) {
    ripple_script_free(script);
    return result;
  }
  for (size_t i = 0; i < script->count; i++) {
    const event *e = &script->events[i];
    if (e->verb == STOP) {
      script->end_s = script->stops ? fmin(script->end_s, e->time_s) : e->time_s;
      script->stops = true;
    } else if (!script->stops) {
      script->end_s = fmax(script->end_s, e->time_s + e->duration_s + 1);
    }
  }
  *out = script;
  return SLF_OK;
}

void ripple_script_free(ripple_script *script) {
  if (!script) return;
  free(script->events);
  free(script);
}

double ripple_script_end_s(const ripple_script *script) {
  return script->end_s;
}

bool ripple_script_stops(const ripple_script *script) {
  return script->stops;
}

static bool add_pillar(ripple *pond, float u, float v, float radius) {
  const ripple_options *o = ripple_get_options(pond);
  uint8_t *closed = malloc((size_t)o->u_count * o->v_count);
  if (!closed) return false;
  for (uint32_t j = 0; j < o->v_count; j++)
    for (uint32_t i = 0; i < o->u_count; i++) {
      const float x = (((float)i + 0.5f) / (float)o->u_count - u) * o->u_length;
      const float y = (((float)j + 0.5f) / (float)o->v_count - v) * o->v_length;
      closed[(size_t)j * o->u_count + i] = hypotf(x, y) <= radius;
    }
  const bool added = ripple_add_obstacle(pond, closed);
  free(closed);
  return added;
}

static float between(float from, float to, double fraction) {
  return (float)(from + (to - from) * fraction);
}

/* The part of an event from `begin` to `end`, fractions of its duration. */
static bool apply_part(const event *e, ripple *pond, double begin, double end) {
  const float *n = e->number;
  switch (e->verb) {
  case SPEED:
    return ripple_tune(pond, n[0], ripple_get_options(pond)->damping_per_s, NULL) == SLF_OK;
  case DAMPING:
    return ripple_tune(pond, ripple_get_options(pond)->wave_speed, n[0], NULL) == SLF_OK;
  case OBSTACLE:
    return add_pillar(pond, n[0], n[1], n[2]);
  case DROP:
    return ripple_drop(pond, n[0], n[1], n[2], n[3]);
  case STROKE:
    return ripple_stroke(pond, between(n[0], n[2], begin), between(n[1], n[3], begin),
                         between(n[0], n[2], end), between(n[1], n[3], end), n[4], n[5]);
  case BALL: {
    const ripple_ball from = {between(n[0], n[3], begin), between(n[1], n[4], begin),
                              between(n[2], n[5], begin)};
    const ripple_ball to = {between(n[0], n[3], end), between(n[1], n[4], end),
                            between(n[2], n[5], end)};
    return ripple_move_ball(pond, from, to, n[6]);
  }
  case RAIN:
    return n[3] >= 0 && ripple_rain(pond, n[0], n[1], n[2], (uint64_t)n[3]);
  default:
    return true;
  }
}

slf_result ripple_script_apply(const ripple_script *script, ripple *pond, double begin_s,
                               double end_s, slf_error *error) {
  for (size_t i = 0; i < script->count; i++) {
    const event *e = &script->events[i];
    if (e->time_s >= end_s || e->time_s + e->duration_s < begin_s) continue;
    double begin = 0, end = 1;
    if (e->duration_s > 0) {
      begin = fmax((begin_s - e->time_s) / e->duration_s, 0);
      end = fmin((end_s - e->time_s) / e->duration_s, 1);
      if (begin >= end) continue;
    }
    if (!apply_part(e, pond, begin, end))
      return complain(error, SLF_ERROR_ARGUMENT, script->path, e->line,
                      "the pond refuses these numbers (see ripple.h)");
  }
  return SLF_OK;
}
