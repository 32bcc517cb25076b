/* slow - preloaded into slfview: each turn of its event loop takes 0.4 s at least, so that a test
 * sees every frame. */
#include <X11/Xlib.h>
#include <dlfcn.h>
#include <string.h>
#include <time.h>

__attribute__((visibility("default"))) int XPending(Display *display) {
  int (*xlib)(Display *);
  void *found = dlsym(RTLD_NEXT, "XPending");
  memcpy(&xlib, &found, sizeof xlib);
  nanosleep(&(struct timespec){.tv_nsec = 400000000}, NULL);
  return xlib(display);
}
