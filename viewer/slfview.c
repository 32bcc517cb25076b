/* slfview - shows a .slf file in a window, or writes a picture of it. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "checked_file.h"
#include "context.h"
#include "draw.h"
#include "image.h"
#include "path.h"
#include "video.h"
#include "window.h"

enum { EXIT_USAGE = 2, BACKEND_AUTO = BACKEND_COUNT };

static const char help[] =
    "usage: slfview FILE.slf... [options]\n"
    "\n"
    "Shows surface light fields. In the window: drag with the left button to orbit, with the "
    "right\n"
    "one to look around, the wheel approaches, W A S D walk, H shows all keys, Escape ends.\n"
    "\n"
    "  --output FILE.png   write a picture instead of opening a window\n"
    "  --size WxH          pixels (default 640x480)\n"
    "  --view NAME         start at a view of the file (default: its first)\n"
    "  --camera LX,LY,LZ,AX,AY,AZ,ANGLE\n"
    "                      location, look_at and angle in degrees, as POV-Ray means them\n"
    "  --backend NAME      glfw, egl, osmesa or auto (default): glfw for a window; for a picture\n"
    "                      osmesa, or egl where osmesa is not installed\n"
    "  --cache N           blocks that stay decompressed (default 65536)\n"
    "  --samples N         N x N samples a pixel, box filter in linear light (default 1)\n"
    "  --ripple-script FILE\n"
    "                      disturb the water as the file says (viewer/ripple_script.h); a picture\n"
    "                      shows it at the script's end\n"
    "  --water LOOK        rippled (default), split: the half with u < 0.5 stays flat, or "
    "normals:\n"
    "                      red and green are the slopes along u and v, 0.5 for none\n"
    "  --fresnel           water over a tinted bottom instead of a pure mirror\n"
    "  --frames N          N pictures of moving water; the name in --output then holds a %d or\n"
    "                      %04d, which becomes 0 to N-1, or is a video's: .mp4 .mkv .webm .gif\n"
    "  --fps F             such pictures a second of water time (default 30)\n"
    "  --mask SURFACE      paint that surface white and everything else black\n"
    "  --mix NAME          depth (default): reflections that know how far away things are are "
    "mixed\n"
    "                      where the slices see the same point; four-tap: always the paper's way\n"
    "  --dice N            polygons are diced to N texels (default 8)\n"
    "  --detail N          angular level of detail: 2^N x 2^N slices in one, from four taps "
    "(default 0)\n"
    "  --exposure EV       radiance is multiplied by 2^EV (default 0)\n"
    "  --tone-map          x / (1 + x): what is brighter than white stays distinct\n"
    "  --scene \"FILE.pov [povray options]\"\n"
    "                      the scene of the file, for comparison with POV-Ray (F5)\n"
    "  --path FILE         a camera path to play (viewer/path.h); with --output its pictures\n"
    "  --watch             reload the file when it is baked again, or more of it has come\n"
    "  --bench N           draw N frames along the path, or in orbit by one degree each, without\n"
    "                      writing them; print what a frame cost as one JSON object\n"
    "  --filter NAME       trilinear, anisotropic or auto (default): anisotropic, but trilinear in "
    "a\n"
    "                      window that is drawn in software, where it is twice as fast\n"
    "  --list-bindings     what keys and mouse do in the window\n"
    "  -h, --help          this text\n"
    "\n"
    "examples:\n"
    "  slfview build/floor.slf\n"
    "  slfview build/floor.slf --output floor.png --size 1280x720 --samples 4\n"
    "  slfview build/floor.slf --output top.png --camera 0,5,0.1,0,0,0,60 --backend egl\n"
    "  slfview build/pond.slf --ripple-script viewer/demo.ripples\n"
    "  slfview build/pond.slf --ripple-script viewer/demo.ripples --frames 300 \\\n"
    "          --output /tmp/pond-%03d.png\n";

typedef struct {
  char *const *files; /* file_count of them; a picture is made of the first */
  int file_count;
  const char *path, *output, *view_name, *mask, *ripple_script, *scene, *path_file;
  const char *filter;
  bool watch;
  drawing_look look;
  slf_view camera;
  bool has_camera;
  int width_px, height_px, samples, frame_count,
      bench_count; /* frame_count 0: one picture, at the end */
  double frames_per_s;
  bool fresnel;
  water_display display;
  int backend;
  drawing_options drawing;
} options;

static int complain(const char *name, const char *message) {
  fprintf(stderr, "slfview: %s%s%s\n", name ? name : "", name ? ": " : "", message);
  return EXIT_FAILURE;
}

static int misuse(const char *option, const char *value, const char *expected) {
  fprintf(stderr, "slfview: --%s %s: expected %s\n", option, value, expected);
  return EXIT_USAGE;
}

/* A whole number of the range, and nothing after it. */
static bool read_count(const char *text, long low, long high, long *value) {
  char *end;
  *value = strtol(text, &end, 10);
  return end != text && *end == 0 && *value >= low && *value <= high;
}

static bool read_number(const char *text, double low, double high, double *value) {
  char *end;
  *value = strtod(text, &end);
  return end != text && *end == 0 && *value >= low && *value <= high;
}

/* Where the one %d, %4d or %04d of a name begins, or NULL; *end is behind it. */
static const char *frame_number(const char *name, const char **end) {
  const char *percent = strchr(name, '%');
  if (!percent) return NULL;
  *end = percent + 1 + strspn(percent + 1, "0123456789");
  if (*end - percent > 3 || **end != 'd' || strchr(*end, '%')) return NULL;
  ++*end;
  return percent;
}

static bool read_size(const char *text, int *width_px, int *height_px) {
  char rest;
  return sscanf(text, "%dx%d%c", width_px, height_px, &rest) == 2 && *width_px >= 1 &&
         *height_px >= 1 && *width_px <= 16384 && *height_px <= 16384;
}

static bool read_camera(const char *text, slf_view *view) {
  float *l = view->location, *a = view->look_at;
  char rest;
  if (sscanf(text, "%f,%f,%f,%f,%f,%f,%f%c", &l[0], &l[1], &l[2], &a[0], &a[1], &a[2],
             &view->angle_deg, &rest) != 7)
    return false;
  for (int k = 0; k < 3; k++)
    if (!isfinite(l[k]) || !isfinite(a[k])) return false;
  return view->angle_deg > 0 && view->angle_deg < 180;
}

/* 0, or the exit code of a wrong command line, complained about. */
static int read_options(int argc, char **argv, options *o) {
  enum {
    OUTPUT = 256,
    SIZE,
    VIEW,
    CAMERA,
    BACKEND,
    CACHE,
    SAMPLES,
    MASK,
    DICE,
    RIPPLES,
    WATER,
    FRESNEL,
    FRAMES,
    FPS,
    DETAIL,
    EXPOSURE,
    TONE_MAP,
    SCENE,
    PATH,
    WATCH,
    LIST_BINDINGS,
    BENCH,
    FILTER,
    MIX
  };
  static const struct option known[] = {{"output", required_argument, NULL, OUTPUT},
                                        {"size", required_argument, NULL, SIZE},
                                        {"view", required_argument, NULL, VIEW},
                                        {"camera", required_argument, NULL, CAMERA},
                                        {"backend", required_argument, NULL, BACKEND},
                                        {"cache", required_argument, NULL, CACHE},
                                        {"samples", required_argument, NULL, SAMPLES},
                                        {"mask", required_argument, NULL, MASK},
                                        {"ripple-script", required_argument, NULL, RIPPLES},
                                        {"water", required_argument, NULL, WATER},
                                        {"fresnel", no_argument, NULL, FRESNEL},
                                        {"frames", required_argument, NULL, FRAMES},
                                        {"fps", required_argument, NULL, FPS},
                                        {"detail", required_argument, NULL, DETAIL},
                                        {"exposure", required_argument, NULL, EXPOSURE},
                                        {"tone-map", no_argument, NULL, TONE_MAP},
                                        {"scene", required_argument, NULL, SCENE},
                                        {"path", required_argument, NULL, PATH},
                                        {"watch", no_argument, NULL, WATCH},
                                        {"list-bindings", no_argument, NULL, LIST_BINDINGS},
                                        {"bench", required_argument, NULL, BENCH},
                                        {"filter", required_argument, NULL, FILTER},
                                        {"mix", required_argument, NULL, MIX},
                                        {"dice", required_argument, NULL, DICE},
                                        {"help", no_argument, NULL, 'h'},
                                        {NULL, 0, NULL, 0}};
  long count;
  double number;
  int code;
  *o = (options){.width_px = 640,
                 .height_px = 480,
                 .samples = 1,
                 .frames_per_s = 30,
                 .backend = BACKEND_AUTO,
                 .filter = "auto",
                 .drawing = {.cache_blocks = BLOCK_CACHE_DEFAULT, .dice_px = UV_DICE_PX}};
  opterr = 0;
  while ((code = getopt_long(argc, argv, ":h", known, NULL)) != -1) {
    switch (code) {
    case OUTPUT:
      o->output = optarg;
      break;
    case VIEW:
      o->view_name = optarg;
      break;
    case MASK:
      o->mask = optarg;
      break;
    case RIPPLES:
      o->ripple_script = optarg;
      break;
    case WATER:
      for (count = 0; count < WATER_DISPLAY_COUNT; count++)
        if (!strcmp(optarg, water_display_names[count])) break;
      if (count == WATER_DISPLAY_COUNT) return misuse("water", optarg, "rippled, split or normals");
      o->display = (water_display)count;
      break;
    case FRESNEL:
      o->fresnel = true;
      break;
    case FRAMES:
      if (!read_count(optarg, 1, 1000000, &count)) return misuse("frames", optarg, "1 to 1000000");
      o->frame_count = (int)count;
      break;
    case FPS:
      if (!read_number(optarg, 1, 1000, &o->frames_per_s))
        return misuse("fps", optarg, "pictures a second, 1 to 1000");
      break;
    case SIZE:
      if (!read_size(optarg, &o->width_px, &o->height_px))
        return misuse("size", optarg, "WIDTHxHEIGHT, each 1 to 16384");
      break;
    case CAMERA:
      if (!read_camera(optarg, &o->camera))
        return misuse("camera", optarg, "seven finite numbers, the angle between 0 and 180");
      o->has_camera = true;
      break;
    case BACKEND:
      o->backend = 0;
      while (o->backend < BACKEND_COUNT && strcmp(optarg, backend_names[o->backend])) o->backend++;
      if (o->backend == BACKEND_COUNT && strcmp(optarg, "auto"))
        return misuse("backend", optarg, "auto, glfw, egl or osmesa");
      break;
    case CACHE:
      if (!read_count(optarg, 0, 1 << 26, &count))
        return misuse("cache", optarg, "a number of blocks, 0 to 67108864");
      o->drawing.cache_blocks = (size_t)count;
      break;
    case SAMPLES:
      if (!read_count(optarg, 1, 64, &count)) return misuse("samples", optarg, "1 to 64");
      o->samples = (int)count;
      break;
    case MIX:
      if (strcmp(optarg, "depth") && strcmp(optarg, "four-tap"))
        return misuse("mix", optarg, "depth or four-tap");
      o->look.mix = optarg[0] == 'd' ? MIX_DEPTH : MIX_FOUR_TAP;
      break;
    case DICE:
      if (!read_count(optarg, 1, SLF_MAX_TEXELS, &count))
        return misuse("dice", optarg, "a number of texels, 1 to 16384");
      o->drawing.dice_px = (uint32_t)count;
      break;
    case DETAIL:
      if (!read_count(optarg, 0, 8, &count)) return misuse("detail", optarg, "a level, 0 to 8");
      o->look.detail = (uint32_t)count;
      break;
    case EXPOSURE:
      if (!read_number(optarg, -16, 16, &number))
        return misuse("exposure", optarg, "stops, -16 to 16");
      o->look.exposure_ev = (float)number;
      break;
    case TONE_MAP:
      o->look.tone_map = true;
      break;
    case SCENE:
      o->scene = optarg;
      break;
    case PATH:
      o->path_file = optarg;
      break;
    case WATCH:
      o->watch = true;
      break;
    case BENCH:
      if (!read_count(optarg, 1, 1000000, &count)) return misuse("bench", optarg, "1 to 1000000");
      o->bench_count = (int)count;
      break;
    case FILTER:
      if (strcmp(optarg, "auto") && strcmp(optarg, "trilinear") && strcmp(optarg, "anisotropic"))
        return misuse("filter", optarg, "trilinear, anisotropic or auto");
      o->filter = optarg;
      break;
    case LIST_BINDINGS:
      window_print_bindings(stdout);
      exit(EXIT_SUCCESS);
    case 'h':
      fputs(help, stdout);
      exit(EXIT_SUCCESS);
    case ':':
      fprintf(stderr, "slfview: %s: expected a value\n", argv[optind - 1]);
      return EXIT_USAGE;
    default:
      fprintf(stderr, "slfview: %s: no such option; slfview --help lists them\n", argv[optind - 1]);
      return EXIT_USAGE;
    }
  }
  o->files = argv + optind;
  o->file_count = argc - optind;
  if (o->file_count < 1 || (o->output && o->file_count > 1)) {
    complain(NULL, o->output ? "expected one FILE.slf with --output; slfview --help shows how"
                             : "expected FILE.slf...; slfview --help shows how");
    return EXIT_USAGE;
  }
  o->path = o->files[0];
  const bool headless = o->output || o->bench_count;
  if (headless && o->backend == BACKEND_GLFW)
    return misuse("backend", "glfw", "egl or osmesa with --output and --bench");
  if (!headless && (o->backend == BACKEND_EGL || o->backend == BACKEND_OSMESA))
    return misuse("backend", backend_names[o->backend], "glfw, or --output FILE.png");
  const char *end;
  if ((o->frame_count > 0 || (o->path_file && o->output)) &&
      (!o->output || !(frame_number(o->output, &end) || video_is_name(o->output))))
    return misuse("output", o->output ? o->output : "",
                  "a name with one %d or %04d, or .mp4 .mkv .webm .gif, for --frames and --path");
  if (o->mask && !o->output) return misuse("mask", o->mask, "--output FILE.png beside it");
  return 0;
}

/* ---- The view ---------------------------------------------------------------------------------
 */

static slf_result choose_view(const options *o, const slf_file *file, slf_view *view,
                              slf_error *error) {
  if (o->has_camera) {
    *view = o->camera;
    return SLF_OK;
  }
  if (slf_view_count(file) == 0) {
    snprintf(error->message, sizeof error->message, "has no views; give --camera");
    return SLF_ERROR_ARGUMENT;
  }
  if (!o->view_name) {
    *view = *slf_get_view(file, 0);
    return SLF_OK;
  }
  int written =
      snprintf(error->message, sizeof error->message, "no view '%.60s'; it has", o->view_name);
  for (uint32_t i = 0; i < slf_view_count(file); i++) {
    const slf_view *v = slf_get_view(file, i);
    if (!strcmp(v->name, o->view_name)) {
      *view = *v;
      return SLF_OK;
    }
    if ((size_t)written < sizeof error->message)
      written += snprintf(error->message + written, sizeof error->message - (size_t)written, " %s",
                          v->name);
  }
  return SLF_ERROR_ARGUMENT;
}

static slf_result find_surface(const slf_file *file, const char *name, int *index,
                               slf_error *error) {
  for (uint32_t i = 0; i < slf_surface_count(file); i++)
    if (!strcmp(slf_get_surface(file, i)->name, name)) {
      *index = (int)i;
      return SLF_OK;
    }
  snprintf(error->message, sizeof error->message, "no surface '%.60s' among its %u", name,
           slf_surface_count(file));
  return SLF_ERROR_ARGUMENT;
}

/* ---- Picture and window ------------------------------------------------------------------------
 */

static slf_result open_headless(int wanted, slf_error *error) {
  if (wanted == BACKEND_EGL) return context_open_egl(error);
  slf_result result = context_open_osmesa(error);
  if (result == SLF_OK || wanted == BACKEND_OSMESA) return result;
  fprintf(stderr, "slfview: %s; using EGL\n", error->message);
  return context_open_egl(error);
}

/* Gives every water of the file its script and look. */
static slf_result prepare_water(const options *o, const slf_file *file, drawing *d,
                                const ripple_script *script, slf_error *error) {
  bool found = false;
  for (uint32_t i = 0; i < slf_surface_count(file); i++) {
    water *w = drawing_water(d, i);
    if (!w) continue;
    w->script = script;
    w->fresnel = o->fresnel;
    w->display = o->display;
    found = true;
  }
  if (found || !(script || o->fresnel || o->display)) return SLF_OK;
  snprintf(error->message, sizeof error->message, "%.256s: none of its surfaces is water", o->path);
  return SLF_ERROR_ARGUMENT;
}

/* Steps every water until its time is time_s. */
static slf_result move_water(const slf_file *file, drawing *d, double time_s, slf_error *error) {
  for (uint32_t i = 0; i < slf_surface_count(file); i++) {
    water *w = drawing_water(d, i);
    if (!w) continue;
    const double step_s = ripple_get_options(w->pond)->step_s;
    for (uint64_t left = (uint64_t)llround(time_s / step_s) - w->step_index; left > 0; left--) {
      const slf_result result = water_step(w, error);
      if (result != SLF_OK) return result;
    }
  }
  return SLF_OK;
}

typedef struct {
  uint8_t *rgba, *reduced;
} picture;

/* Draws a picture into p->reduced. */
static slf_result make_picture(const options *o, const slf_view *view, drawing *d, int mask,
                               const picture *p, slf_error *error) {
  const slf_result result =
      drawing_render(d, view, o->width_px * o->samples, o->height_px * o->samples, mask, error);
  if (result != SLF_OK) return result;
  drawing_read(d, p->rgba);
  image_reduce(p->rgba, o->width_px, o->height_px, o->samples, p->reduced);
  return SLF_OK;
}

static slf_result write_picture(const options *o, const slf_view *view, drawing *d, int mask,
                                const picture *p, slf_error *error) {
  const slf_result result = make_picture(o, view, d, mask, p, error);
  if (result != SLF_OK) return result;
  return image_write_png(o->output, p->reduced, o->width_px, o->height_px, error);
}

/* Writes picture i of several under its own name. */
static slf_result write_numbered(const options *o, int i, const picture *p, slf_error *error) {
  const char *end, *number = frame_number(o->output, &end);
  const int digits = number[1] == 'd' ? 1 : atoi(number + 1);
  char path[4096];
  const int length = snprintf(path, sizeof path, "%.*s%0*d%s", (int)(number - o->output), o->output,
                              digits, i, end);
  if (length < 0 || (size_t)length >= sizeof path) {
    snprintf(error->message, sizeof error->message, "--output: longer than %zu characters",
             sizeof path - 1);
    return SLF_ERROR_ARGUMENT;
  }
  return image_write_png(path, p->reduced, o->width_px, o->height_px, error);
}

/* A camera path gives each picture its view, and how many there are. */
static int picture_count(const options *o, const camera_path *flight) {
  if (o->frame_count > 0 || flight->count == 0) return o->frame_count;
  return (int)floor(path_end_s(flight) * o->frames_per_s) + 1;
}

static slf_result write_frames(const options *o, const slf_file *file, const slf_view *view,
                               const camera_path *flight, drawing *d, int mask, const picture *p,
                               slf_error *error) {
  video *film = NULL;
  slf_result result = SLF_OK;
  if (video_is_name(o->output))
    result = video_start(o->output, o->width_px, o->height_px, o->frames_per_s, &film, error);
  const int count = picture_count(o, flight);
  for (int i = 0; i < count && result == SLF_OK; i++) {
    const slf_view at = flight->count ? path_at(flight, i / o->frames_per_s) : *view;
    result = move_water(file, d, i / o->frames_per_s, error);
    if (result == SLF_OK) result = make_picture(o, &at, d, mask, p, error);
    if (result == SLF_OK)
      result = film ? video_add(film, p->reduced, error) : write_numbered(o, i, p, error);
  }
  if (film && result == SLF_OK) return video_finish(film, error);
  video_abort(film);
  return result;
}

/* A picture takes its time; a window in software should rather be quick. */
static bool is_anisotropic(const options *o, const drawing *d, bool is_picture) {
  if (!strcmp(o->filter, "auto")) return is_picture || !drawing_is_software(d);
  return !strcmp(o->filter, "anisotropic");
}

static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Frames drawn and waited for one by one: what a frame costs in all, what of it is ours, what goes
 * to handing textures over, and what the driver takes to draw. The first frame is not counted. */
static slf_result bench(const options *o, const slf_file *file, const slf_view *view,
                        const camera_path *flight, drawing *d, slf_error *error) {
  slf_view at = *view;
  double start_s = 0, resample_s = 0, upload_s = 0, texel_count = 0, lookups = 0, hits = 0;
  double decoded = 0, again = 0;
  depth_mix_counts depth = {0};
  for (int i = 0; i <= o->bench_count; i++) {
    if (i == 1) start_s = now_s();
    if (flight->count)
      at = path_at(flight, path_end_s(flight) * i / o->bench_count);
    else
      view_orbit(&at, (float)M_PI / 180, 0);
    slf_result result = move_water(file, d, i / o->frames_per_s, error);
    if (result == SLF_OK)
      result =
          drawing_render(d, &at, o->width_px * o->samples, o->height_px * o->samples, -1, error);
    if (result != SLF_OK) return result;
    drawing_finish(d);
    drawing_cost cost = drawing_get_cost(d);
    if (i == 0) continue;
    resample_s += cost.resample_s;
    upload_s += cost.upload_s;
    texel_count += (double)cost.texel_count;
    depth.texel_count += cost.depth.texel_count;
    depth.four_tap_count += cost.depth.four_tap_count;
    const block_cache_counts *counts = block_cache_get_counts(drawing_cache(d));
    lookups += (double)counts->frame_lookups;
    hits += (double)counts->frame_hits;
    decoded += (double)counts->frame_decompressions;
    again += (double)counts->frame_decompressions_again;
  }
  struct rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  double count = o->bench_count, frame_s = (now_s() - start_s) / count;
  printf("{\n  \"width\": %d,\n  \"height\": %d,\n  \"frames\": %d,\n"
         "  \"frames_per_s\": %.4g,\n  \"frame_ms\": %.4g,\n  \"resample_ms\": %.4g,\n"
         "  \"upload_ms\": %.4g,\n  \"driver_ms\": %.4g,\n  \"texels_per_frame\": %.6g,\n"
         "  \"lookups_per_frame\": %.6g,\n  \"hit_rate\": %.4g,\n"
         "  \"decompressions_per_frame\": %.4g,\n"
         "  \"decompressions_again_per_frame\": %.4g,\n  \"peak_rss_mb\": %.4g",
         o->width_px, o->height_px, o->bench_count, 1 / frame_s, frame_s * 1e3,
         resample_s * 1e3 / count, upload_s * 1e3 / count,
         (frame_s - (resample_s + upload_s) / count) * 1e3, texel_count / count, lookups / count,
         lookups > 0 ? hits / lookups : 1, decoded / count, again / count,
         (double)usage.ru_maxrss / 1024);
  if (depth.texel_count > 0)
    printf(",\n  \"texels_by_depth_per_frame\": %.6g,\n  \"four_tap_share_by_depth\": %.4g",
           (double)depth.texel_count / count,
           (double)depth.four_tap_count / (double)depth.texel_count);
  puts("\n}");
  return SLF_OK;
}

static slf_result write_pictures(const options *o, const slf_file *file, const slf_view *view,
                                 const ripple_script *script, checked_file *checked,
                                 slf_error *error) {
  drawing *d = NULL;
  camera_path flight = {0};
  const int width_px = o->width_px * o->samples, height_px = o->height_px * o->samples;
  int mask = -1;
  const picture p = {malloc((size_t)width_px * (size_t)height_px * 4),
                     malloc((size_t)o->width_px * (size_t)o->height_px * 4)};
  slf_result result = SLF_ERROR_MEMORY;
  if (!p.rgba || !p.reduced) {
    snprintf(error->message, sizeof error->message, "out of memory for %dx%d pixels", width_px,
             height_px);
    goto done;
  }
  if (o->mask && (result = find_surface(file, o->mask, &mask, error)) != SLF_OK) goto done;
  if ((result = open_headless(o->backend, error)) != SLF_OK) goto done;
  if ((result = drawing_create(file, o->drawing, &d, error)) != SLF_OK) goto done;
  if ((result = prepare_water(o, file, d, script, error)) != SLF_OK) goto done;
  drawing_look look = o->look;
  look.anisotropic = is_anisotropic(o, d, o->output != NULL);
  drawing_set_look(d, &look);
  if (o->path_file && (result = path_read(o->path_file, &flight, error)) != SLF_OK) goto done;
  if ((result = checked_file_wait(checked, error)) != SLF_OK) goto done;
  if (o->bench_count > 0) {
    result = bench(o, file, view, &flight, d, error);
  } else if (picture_count(o, &flight) > 0) {
    result = write_frames(o, file, view, &flight, d, mask, &p, error);
  } else {
    result = move_water(file, d, script ? ripple_script_end_s(script) : 0, error);
    if (result == SLF_OK) result = write_picture(o, view, d, mask, &p, error);
  }
done:
  path_clear(&flight);
  drawing_free(d);
  context_close_egl();
  context_close_osmesa();
  free(p.rgba);
  free(p.reduced);
  return result;
}

typedef struct {
  const options *o;
  const ripple_script *script;
} window_water;

static slf_result prepare_window(void *context, const slf_file *file, drawing *d,
                                 slf_error *error) {
  const window_water *x = context;
  drawing_look look = drawing_get_look(d);
  look.anisotropic = is_anisotropic(x->o, d, false);
  drawing_set_look(d, &look);
  return prepare_water(x->o, file, d, x->script, error);
}

static slf_result show_window(const options *o, const slf_view *view, const ripple_script *script,
                              checked_file *checked, slf_error *error) {
  window_water water_options = {o, script};
  const window_options shown = {.files = o->files,
                                .file_count = o->file_count,
                                .drawing = o->drawing,
                                .look = o->look,
                                .view = o->has_camera || o->view_name ? view : NULL,
                                .scene = o->scene,
                                .path_file = o->path_file,
                                .watch = o->watch,
                                .prepare = prepare_window,
                                .context = &water_options};
  slf_result result = window_open(o->path, o->width_px, o->height_px, error);
  if (result == SLF_OK)
    result = window_run(&shown, checked, error);
  else
    checked_file_close(checked);
  window_close();
  return result;
}

int main(int argc, char **argv) {
  options o;
  int misused = read_options(argc, argv, &o);
  if (misused) return misused;

  checked_file *checked = NULL;
  slf_error error = {{0}};
  slf_view view;
  ripple_script *script = NULL;
  slf_result result = SLF_OK;
  if (o.ripple_script) result = ripple_script_read(o.ripple_script, &script, &error);
  if (result == SLF_OK) result = checked_file_open(o.path, o.watch, &checked, &error);
  if (result == SLF_OK && (result = choose_view(&o, checked_file_get(checked), &view, &error))) {
    checked_file_close(checked);
  } else if (result == SLF_OK && (o.output || o.bench_count)) {
    result = write_pictures(&o, checked_file_get(checked), &view, script, checked, &error);
    checked_file_close(checked);
  } else if (result == SLF_OK) {
    result = show_window(&o, &view, script, checked, &error);
  }
  if (result != SLF_OK && error.message[0]) complain(NULL, error.message);
  ripple_script_free(script);
  return result == SLF_OK ? EXIT_SUCCESS : EXIT_FAILURE;
}
