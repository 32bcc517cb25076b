/* parallel.h - the same work on many indices, by several threads. */
#ifndef SLF_PARALLEL_H
#define SLF_PARALLEL_H

#include <stdint.h>

/* Calls work(context, i) for i in 0 .. count - 1, in any order, from thread_count threads, the
 * caller's among them; returns when all are done. Where a thread cannot be made fewer do it. */
void parallel_for(uint32_t thread_count, uint64_t count, void (*work)(void *context, uint64_t i),
                  void *context);

/* As many as there are processors to run on. */
uint32_t processor_count(void);

#endif
