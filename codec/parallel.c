#include "codec/parallel.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stddef.h>

enum { MAX_THREADS = 256 };

typedef struct {
  _Atomic uint64_t next;
  uint64_t count;
  void (*work)(void *context, uint64_t i);
  void *context;
} loop;

static void *run(void *argument) {
  loop *l = argument;
  for (uint64_t i; (i = atomic_fetch_add(&l->next, 1)) < l->count;) l->work(l->context, i);
  return NULL;
}

void parallel_for(uint32_t thread_count, uint64_t count, void (*work)(void *context, uint64_t i),
                  void *context) {
  loop l = {0, count, work, context};
  pthread_t threads[MAX_THREADS];
  uint32_t made = 0;
  uint64_t wanted = thread_count < count ? thread_count : count;
  while (made + 1 < wanted && made < MAX_THREADS &&
         pthread_create(&threads[made], NULL, run, &l) == 0)
    made++;
  run(&l);
  for (uint32_t i = 0; i < made; i++) pthread_join(threads[i], NULL);
}

uint32_t processor_count(void) {
  cpu_set_t set;
  CPU_ZERO(&set);
  if (sched_getaffinity(0, sizeof set, &set) != 0) return 1;
  int count = CPU_COUNT(&set);
  return count > 0 ? (uint32_t)count : 1;
}
