/* ripple_script.h - disturbances written down, so that a pond can be replayed.
 *
 * A text file; an event a line, # begins a comment. First the time in seconds of water time (the
 * pond at rest is time 0), then what happens, then its numbers. u and v are the surface's
 * parameters in [0,1]; lengths are in scene units; heights are negative for a dent.
 *
 *     0.0  speed    C                                waves travel at C scene units a second
 *     0.0  damping  D                                energy falls as exp(-D t)
 *     0.0  obstacle U V RADIUS                       a round pillar; the surfaces that stand in
 *                                                    the water are found without being named
 *     0.5  drop     U V RADIUS HEIGHT
 *     1.0  stroke   U0 V0 U1 V1 RADIUS HEIGHT SECONDS  a finger, drawn that long
 *     2.0  ball     U0 V0 DEPTH0 U1 V1 DEPTH1 RADIUS SECONDS  pushed through the water that long
 *     3.0  rain     DROPS_PER_S RADIUS HEIGHT SEED   until `rain 0 1 0 0`
 *     9.0  stop                                      the water stands still from here on
 *
 * Steps are fixed, and an event belongs to the step in whose time it falls, so that a replay is the
 * same at any frame rate. Without `stop`, the script ends a second after its last event: then its
 * ripples can be seen. */
#ifndef SLF_RIPPLE_SCRIPT_H
#define SLF_RIPPLE_SCRIPT_H

#include "viewer/ripple.h"

typedef struct ripple_script ripple_script;

/* *out is NULL on failure: the file and line are named. ripple_script_free accepts NULL. */
slf_result ripple_script_read(const char *path, ripple_script **out, slf_error *error);
void ripple_script_free(ripple_script *script);

/* When it ends; and whether it has a `stop`, after which the water does not move. */
double ripple_script_end_s(const ripple_script *script);
bool ripple_script_stops(const ripple_script *script);

/* Applies what falls into the step from begin_s up to, not including, end_s. An event that ripple.h
 * refuses is an error that names its line. */
slf_result ripple_script_apply(const ripple_script *script, ripple *pond, double begin_s,
                               double end_s, slf_error *error);

#endif
