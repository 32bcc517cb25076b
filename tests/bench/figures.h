/* figures.h - clocks, medians and the flat JSON object of named numbers that a bench prints. */
#ifndef SLF_FIGURES_H
#define SLF_FIGURES_H

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static inline double clock_s(clockid_t clock) {
  struct timespec t;
  clock_gettime(clock, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Of the clock, of the processor by all threads together, and by this one. */
static inline double now_s(void) {
  return clock_s(CLOCK_MONOTONIC);
}
static inline double cpu_s(void) {
  return clock_s(CLOCK_PROCESS_CPUTIME_ID);
}
static inline double thread_s(void) {
  return clock_s(CLOCK_THREAD_CPUTIME_ID);
}

static inline int by_value(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

/* Sorts the values. */
static inline double median(double *values, size_t count) {
  qsort(values, count, sizeof *values, by_value);
  return values[count / 2];
}

/* "key" or "key_name", then its value; the first call opens the object, end_figures closes it. */
static inline void print_figure(const char *key, const char *name, double value) {
  static bool first = true;
  printf("%s\n  \"%s%s%s\": %.4g", first ? "{" : ",", key, *name ? "_" : "", name, value);
  fflush(stdout);
  first = false;
}
static inline void end_figures(void) {
  puts("\n}");
}

#endif
