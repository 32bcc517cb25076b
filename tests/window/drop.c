/* drop - drops a file on an X window, as a file manager does (XDND, version 5).
 *
 *   drop WINDOW_ID /ABSOLUTE/FILE
 *
 * Exit 0 when the window says that it took it, 1 after 10 s without. */
#include <X11/Xatom.h>
#include <X11/Xlib.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static Display *display;
static Window self, target;

static Atom atom(const char *name) {
  return XInternAtom(display, name, False);
}

static void say(const char *type, long a, long b, long c, long d) {
  XEvent event = {.xclient = {.type = ClientMessage,
                              .display = display,
                              .window = target,
                              .message_type = atom(type),
                              .format = 32,
                              .data.l = {(long)self, a, b, c, d}}};
  XSendEvent(display, target, False, NoEventMask, &event);
  XFlush(display);
}

/* Gives the file's name to whom it asks for. */
static void answer(const XSelectionRequestEvent *request, const char *file) {
  char list[4096];
  int length = snprintf(list, sizeof list, "file://%s\r\n", file);
  XChangeProperty(display, request->requestor, request->property, atom("text/uri-list"), 8,
                  PropModeReplace, (const unsigned char *)list, length);
  XEvent event = {.xselection = {.type = SelectionNotify,
                                 .requestor = request->requestor,
                                 .selection = request->selection,
                                 .target = request->target,
                                 .property = request->property,
                                 .time = request->time}};
  XSendEvent(display, request->requestor, False, NoEventMask, &event);
  XFlush(display);
}

/* The next event, or exit. */
static XEvent next_event(void) {
  struct pollfd connection = {.fd = ConnectionNumber(display), .events = POLLIN};
  while (XPending(display) == 0)
    if (poll(&connection, 1, 10000) <= 0) {
      fputs("drop: no answer within 10 s\n", stderr);
      exit(1);
    }
  XEvent event;
  XNextEvent(display, &event);
  return event;
}

int main(int argc, char **argv) {
  if (argc != 3 || argv[2][0] != '/' || !(display = XOpenDisplay(NULL))) {
    fputs("usage: drop WINDOW_ID /ABSOLUTE/FILE, with a DISPLAY\n", stderr);
    return 2;
  }
  target = (Window)strtoul(argv[1], NULL, 0);
  self = XCreateSimpleWindow(display, DefaultRootWindow(display), 0, 0, 1, 1, 0, 0, 0);
  XSetSelectionOwner(display, atom("XdndSelection"), self, CurrentTime);
  say("XdndEnter", 5 << 24, (long)atom("text/uri-list"), 0, 0);
  say("XdndPosition", 0, 100 << 16 | 100, CurrentTime, (long)atom("XdndActionCopy"));
  for (;;) {
    XEvent event = next_event();
    if (event.type == SelectionRequest) answer(&event.xselectionrequest, argv[2]);
    if (event.type != ClientMessage) continue;
    if (event.xclient.message_type == atom("XdndStatus") && event.xclient.data.l[1] & 1)
      say("XdndDrop", 0, CurrentTime, 0, 0);
    if (event.xclient.message_type == atom("XdndFinished")) return 0;
  }
}
