/* slf_command.c - slf: looks into .slf files. */
#include "codec/jpeg_slice.h"
#include "codec/slf.h"
#include "codec/slice_image.h"

#include <dirent.h>
#include <errno.h>
#include <getopt.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { EXIT_USAGE = 2 };

static const char usage[] =
    "usage: slf VERB [options] FILE ...\n"
    "\n"
    "  slf info FILE                        what is in it\n"
    "  slf verify FILE                      check every checksum and C-Block\n"
    "  slf slice FILE SURFACE S T OUT       one slice as a picture: OUT.png, or OUT.exr, linear\n"
    "     --layer=N                         of layer N (0)\n"
    "     --jpeg                            OUT.jpg with the very same coefficients (angular "
    "none)\n"
    "  slf decode FILE SURFACE FOLDER       every slice, FOLDER/SSS_TTT.png\n"
    "     --layer=N\n"
    "     --exr                             FOLDER/SSS_TTT.exr, linear\n"
    "  slf encode IN OUT.slf                code again what IN.slf decodes to; or a folder of "
    "slices,\n"
    "                                       IN/SSS_TTT.exr or .png, as one surface without a mesh\n"
    "     --surface=NAME                    its name (surface)\n"
    "     --hdr                             radiance above 1 is kept\n"
    "     --angular=none|identical|motion|layered (layered)\n"
    "     --quality=1..100 (75) | --target-psnr=DB | --target-ratio=R\n"
    "     --threads=N                       (all processors)\n"
    "  slf compare A B                      PSNR of every slice of B against A, and of all; files, "
    "or\n"
    "                                       folders of slices beside one layer\n"
    "     --surface=S --layer=N             of this layer only (of a folder's other side 0, 0)\n"
    "  slf bench FILE                       time of a block, in order and at random\n"
    "\n"
    "SURFACE is a name or a number from 0. S and T count directions from 0.\n"
    "\n"
    "  slf info build/floor.slf\n"
    "  slf slice build/floor.slf floor 8 8 floor.png\n"
    "  slf encode --target-psnr=40 build/floor.slf small.slf\n"
    "  slf decode --exr build/floor.slf floor slices && slf encode slices floor.slf\n"
    "  slf compare slices floor.slf\n";

static int failed(const slf_error *error) {
  fprintf(stderr, "slf: %s\n", error->message);
  return EXIT_FAILURE;
}

static int wrong_usage(const char *what, const char *word) {
  fprintf(stderr, "slf: %s%s%s; `slf --help` shows how\n", what, word ? ": " : "",
          word ? word : "");
  return EXIT_USAGE;
}

/* ---- info ---------------------------------------------------------------------------------- */

static const char *layer_role(const slf_layer *layer) {
  static const char *names[] = {"full", "own", "reflected", "height", "coverage"};
  return names[layer->role];
}

static const char *const angular_names[] = {"none", "identical", "motion", "layered"};

static void print_layer(const slf_layer *l, uint32_t index) {
  uint64_t stored = l->payload_nbytes + l->index_nbytes;
  printf("  layer %u  %s, %s, %ux%u texels, ", index, layer_role(l),
         l->curve == SLF_CURVE_SRGB ? "sRGB" : "HDR", l->u_count, l->v_count);
  if (l->slice_count == 1)
    printf("matte");
  else
    printf("%ux%u directions (%u slices), angular %s", l->s_count, l->t_count, l->slice_count,
           angular_names[l->angular]);
  printf(", quality %g, %.2f dB\n", l->quality, l->psnr);
  printf("           %.3f MB of %.3f MB, %.1f : 1; index %.1f %% of the C-Blocks\n",
         (double)stored / 1e6, (double)l->raw_nbytes / 1e6, (double)l->raw_nbytes / (double)stored,
         l->payload_nbytes ? 100.0 * (double)l->index_nbytes / (double)l->payload_nbytes : 0.0);
}

static int info(int argc, char **argv) {
  if (argc != 2) return wrong_usage("info takes one file", NULL);
  slf_error error;
  slf_file *file;
  if (slf_open(argv[1], &file, &error) != SLF_OK) return failed(&error);
  uint64_t raw = 0;
  for (uint32_t i = 0; i < slf_surface_count(file); i++) {
    const slf_surface *s = slf_get_surface(file, i);
    for (uint32_t j = 0; j < s->layer_count; j++) raw += s->layers[j].raw_nbytes;
  }
  float background[3];
  slf_get_background(file, background);
  printf("%s: %.3f MB, %.1f : 1\n", argv[1], (double)slf_file_nbytes(file) / 1e6,
         (double)raw / (double)slf_file_nbytes(file));
  printf("background %g %g %g\n", background[0], background[1], background[2]);
  for (uint32_t i = 0; i < slf_view_count(file); i++) {
    const slf_view *v = slf_get_view(file, i);
    printf("view %s  from %g,%g,%g to %g,%g,%g, %g degrees\n", v->name, v->location[0],
           v->location[1], v->location[2], v->look_at[0], v->look_at[1], v->look_at[2],
           v->angle_deg);
  }
  for (uint32_t i = 0; i < slf_surface_count(file); i++) {
    const slf_surface *s = slf_get_surface(file, i);
    printf("surface %u %s  %u vertices, %u triangles%s%s%s", i, s->name, s->mesh.vertex_count,
           s->mesh.triangle_count, s->flags & SLF_SURFACE_WRAP_U ? ", wraps in u" : "",
           s->flags & SLF_SURFACE_WRAP_V ? ", wraps in v" : "",
           s->flags & SLF_SURFACE_WATER ? ", water" : "");
    if (s->slab.thickness > 0) printf(", a slab of %g, index %g", s->slab.thickness, s->slab.ior);
    putchar('\n');
    for (uint32_t j = 0; j < s->layer_count; j++) print_layer(&s->layers[j], j);
  }
  slf_close(file);
  return EXIT_SUCCESS;
}

/* ---- verify -------------------------------------------------------------------------------- */

static int verify(int argc, char **argv) {
  if (argc != 2) return wrong_usage("verify takes one file", NULL);
  slf_error error;
  slf_file *file;
  if (slf_open(argv[1], &file, &error) != SLF_OK) return failed(&error);
  slf_result result = slf_verify(file, &error);
  slf_close(file);
  if (result != SLF_OK) return failed(&error);
  printf("%s: good\n", argv[1]);
  return EXIT_SUCCESS;
}

/* ---- slice --------------------------------------------------------------------------------- */

/* A whole number below limit, or false. */
static bool parse_count(const char *word, uint32_t limit, uint32_t *value) {
  char *end;
  errno = 0;
  unsigned long number = strtoul(word, &end, 10);
  if (*word < '0' || *word > '9' || *end || errno || number >= limit) return false;
  *value = (uint32_t)number;
  return true;
}

static bool find_surface(const slf_file *file, const char *word, uint32_t *index) {
  for (*index = 0; *index < slf_surface_count(file); ++*index)
    if (strcmp(slf_get_surface(file, *index)->name, word) == 0) return true;
  return parse_count(word, slf_surface_count(file), index);
}

/* What most verbs begin with: FILE SURFACE, and --layer. */
typedef struct {
  slf_file *file;
  uint32_t surface, layer;
  const slf_surface *self;
  const slf_layer *of;
} chosen_layer;

static bool choose_layer(const char *path, const char *word, uint32_t layer, chosen_layer *chosen) {
  slf_error error;
  *chosen = (chosen_layer){.layer = layer};
  if (slf_open(path, &chosen->file, &error) != SLF_OK) return failed(&error), false;
  if (!find_surface(chosen->file, word, &chosen->surface)) {
    fprintf(stderr, "slf: %s: no surface %s among %u\n", path, word,
            slf_surface_count(chosen->file));
    return false;
  }
  chosen->self = slf_get_surface(chosen->file, chosen->surface);
  if (layer < chosen->self->layer_count) {
    chosen->of = &chosen->self->layers[layer];
    return true;
  }
  fprintf(stderr, "slf: %s: %s has no layer %u, only %u\n", path, chosen->self->name, layer,
          chosen->self->layer_count);
  return false;
}

static bool write_slice(const chosen_layer *c, uint32_t s, uint32_t t, const char *path) {
  slf_error error;
  float *rgb = malloc((size_t)c->of->u_count * c->of->v_count * 3 * sizeof *rgb);
  bool written = false;
  if (!rgb)
    fprintf(stderr, "slf: %s: no memory for a slice of %ux%u\n", path, c->of->u_count,
            c->of->v_count);
  else if (slf_decode_slice(c->file, c->surface, c->layer, s, t, rgb, &error) != SLF_OK ||
           slice_image_write(path, rgb, c->of->u_count, c->of->v_count, &error) != SLF_OK)
    failed(&error);
  else
    written = true;
  free(rgb);
  return written;
}

static int slice(int argc, char **argv) {
  static const struct option options[] = {
      {"layer", required_argument, NULL, 'l'}, {"jpeg", no_argument, NULL, 'j'}, {0}};
  uint32_t layer = 0, s, t;
  bool as_jpeg = false;
  opterr = 0;
  for (int option; (option = getopt_long(argc, argv, ":", options, NULL)) != -1;) {
    if (option == 'j')
      as_jpeg = true;
    else if (option != 'l' || !parse_count(optarg, SLF_MAX_LAYERS, &layer))
      return wrong_usage("expected --layer=N or --jpeg", argv[optind - 1]);
  }
  argv += optind;
  if (argc - optind != 5) return wrong_usage("slice takes FILE SURFACE S T OUT", NULL);
  if (!parse_count(argv[2], SLF_MAX_DIRECTIONS, &s)) return wrong_usage("not an S", argv[2]);
  if (!parse_count(argv[3], SLF_MAX_DIRECTIONS, &t)) return wrong_usage("not a T", argv[3]);
  chosen_layer c;
  slf_error error;
  bool done = choose_layer(argv[0], argv[1], layer, &c);
  if (done && as_jpeg) {
    if (write_jpeg_slice(c.file, c.surface, c.layer, s, t, argv[4], &error) != SLF_OK)
      done = (failed(&error), false);
  } else if (done) {
    done = write_slice(&c, s, t, argv[4]);
  }
  slf_close(c.file);
  return done ? EXIT_SUCCESS : EXIT_FAILURE;
}

/* ---- decode -------------------------------------------------------------------------------- */

static int decode(int argc, char **argv) {
  static const struct option options[] = {
      {"layer", required_argument, NULL, 'l'}, {"exr", no_argument, NULL, 'e'}, {0}};
  uint32_t layer = 0;
  const char *ending = "png";
  opterr = 0;
  for (int option; (option = getopt_long(argc, argv, ":", options, NULL)) != -1;)
    if (option == 'e')
      ending = "exr";
    else if (option != 'l' || !parse_count(optarg, SLF_MAX_LAYERS, &layer))
      return wrong_usage("expected --layer=N or --exr", argv[optind - 1]);
  argv += optind;
  if (argc - optind != 3) return wrong_usage("decode takes FILE SURFACE FOLDER", NULL);
  chosen_layer c;
  bool done = choose_layer(argv[0], argv[1], layer, &c);
  if (done && mkdir(argv[2], 0777) != 0 && errno != EEXIST) {
    fprintf(stderr, "slf: %s: %s\n", argv[2], strerror(errno));
    done = false;
  }
  for (uint32_t i = 0; done && i < c.of->s_count * c.of->t_count; i++) {
    uint32_t s = i % c.of->s_count, t = i / c.of->s_count;
    char path[4096];
    if (!slf_slice_exists(c.of->s_count, c.of->t_count, s, t)) continue;
    snprintf(path, sizeof path, "%s/%03u_%03u.%s", argv[2], s, t, ending);
    done = write_slice(&c, s, t, path);
  }
  slf_close(c.file);
  return done ? EXIT_SUCCESS : EXIT_FAILURE;
}

/* ---- encode -------------------------------------------------------------------------------- */

static slf_result read_decoded(void *context, uint32_t s, uint32_t t, float *rgb,
                               slf_error *error) {
  const chosen_layer *c = context;
  return slf_decode_slice(c->file, c->surface, c->layer, s, t, rgb, error);
}

static void show_progress(void *context, double fraction) {
  const chosen_layer *c = context;
  fprintf(stderr, "\r%s %3.0f %%%s", c->self->name, 100 * fraction, fraction < 1 ? "" : "\r\033[K");
}

static slf_result encode_file(slf_file *file, slf_writer *writer, slf_layer_options options,
                              slf_error *error) {
  float background[3];
  slf_result result = SLF_OK;
  slf_get_background(file, background);
  slf_writer_set_background(writer, background);
  for (uint32_t i = 0; result == SLF_OK && i < slf_view_count(file); i++)
    result = slf_writer_add_view(writer, slf_get_view(file, i), error);
  for (uint32_t i = 0; result == SLF_OK && i < slf_surface_count(file); i++) {
    const slf_surface *surface = slf_get_surface(file, i);
    result = slf_writer_add_surface(writer, surface, error);
    for (uint32_t k = 0; result == SLF_OK && k < surface->layer_count; k++) {
      const slf_layer *l = &surface->layers[k];
      chosen_layer c = {file, i, k, surface, l};
      slf_source source = {read_decoded, &c, isatty(STDERR_FILENO) ? show_progress : NULL};
      options.role = l->role;
      options.curve = l->curve;
      options.height_unit = l->height_unit;
      options.u_count = l->u_count;
      options.v_count = l->v_count;
      options.s_count = l->s_count;
      options.t_count = l->t_count;
      result = slf_writer_add_layer(writer, &options, &source, error);
    }
  }
  return result;
}

/* A folder of slices as a source. */
typedef struct {
  const char *folder, *ending;
  slf_layer_options options;
} slice_folder;

static slf_result read_folder_slice(void *context, uint32_t s, uint32_t t, float *rgb,
                                    slf_error *error) {
  const slice_folder *f = context;
  char path[4096];
  float *read;
  uint32_t u, v;
  snprintf(path, sizeof path, "%s/%03u_%03u.%s", f->folder, s, t, f->ending);
  slf_result result = slice_image_read(path, &read, &u, &v, error);
  if (result != SLF_OK) return result;
  if (u == f->options.u_count && v == f->options.v_count) {
    memcpy(rgb, read, (size_t)u * v * 3 * sizeof *rgb);
  } else {
    snprintf(error->message, sizeof error->message, "%.400s: %ux%u texels, another slice has %ux%u",
             path, u, v, f->options.u_count, f->options.v_count);
    result = SLF_ERROR_ARGUMENT;
  }
  free(read);
  return result;
}

/* Directions from the names, texels from one of the slices. */
static slf_result open_folder(slice_folder *f, slf_error *error) {
  DIR *folder = opendir(f->folder);
  if (!folder) {
    snprintf(error->message, sizeof error->message, "%.400s: %s", f->folder, strerror(errno));
    return SLF_ERROR_IO;
  }
  char any[4096] = "";
  for (struct dirent *entry; (entry = readdir(folder));) {
    unsigned s, t;
    int end = 0;
    if (sscanf(entry->d_name, "%3u_%3u.%n", &s, &t, &end) != 2 || !end) continue;
    const char *ending = entry->d_name + end;
    if (strcmp(ending, "exr") != 0 && strcmp(ending, "png") != 0) continue;
    f->ending = strcmp(ending, "exr") == 0 ? "exr" : "png";
    if (s >= f->options.s_count) f->options.s_count = s + 1;
    if (t >= f->options.t_count) f->options.t_count = t + 1;
    snprintf(any, sizeof any, "%s/%s", f->folder, entry->d_name);
  }
  closedir(folder);
  if (!*any) {
    snprintf(error->message, sizeof error->message, "%.400s: no slices SSS_TTT.exr or .png",
             f->folder);
    return SLF_ERROR_ARGUMENT;
  }
  float *rgb;
  slf_result result = slice_image_read(any, &rgb, &f->options.u_count, &f->options.v_count, error);
  free(rgb);
  return result;
}

static slf_result encode_folder(const char *path, const char *name, slf_writer *writer,
                                const slf_layer_options *options, slf_error *error) {
  slice_folder folder = {.folder = path, .options = *options};
  slf_surface surface = {.name = ""};
  snprintf(surface.name, sizeof surface.name, "%s", name);
  slf_result result = open_folder(&folder, error);
  if (result == SLF_OK) result = slf_writer_add_surface(writer, &surface, error);
  if (result != SLF_OK) return result;
  slf_source source = {read_folder_slice, &folder, NULL};
  return slf_writer_add_layer(writer, &folder.options, &source, error);
}

static bool parse_number(const char *word, float low, float high, float *value) {
  char *end;
  *value = strtof(word, &end);
  return end != word && !*end && *value >= low && *value <= high;
}

static bool parse_angular(const char *word, slf_angular *angular) {
  for (int i = 0; i < 4; i++)
    if (strcmp(word, angular_names[i]) == 0) {
      *angular = (slf_angular)i;
      return true;
    }
  return false;
}

static int encode(int argc, char **argv) {
  static const struct option options[] = {{"angular", required_argument, NULL, 'a'},
                                          {"quality", required_argument, NULL, 'q'},
                                          {"target-psnr", required_argument, NULL, 'p'},
                                          {"target-ratio", required_argument, NULL, 'r'},
                                          {"threads", required_argument, NULL, 't'},
                                          {"surface", required_argument, NULL, 's'},
                                          {"hdr", no_argument, NULL, 'h'},
                                          {0}};
  const char *name = "surface";
  slf_layer_options o = {.angular = SLF_ANGULAR_LAYERED, .quality = 75};
  opterr = 0;
  for (int option; (option = getopt_long(argc, argv, ":", options, NULL)) != -1;) {
    bool good = (option == 'a' && parse_angular(optarg, &o.angular)) ||
                (option == 'q' && parse_number(optarg, 1, 100, &o.quality)) ||
                (option == 'p' && parse_number(optarg, 10, 100, &o.target_psnr)) ||
                (option == 'r' && parse_number(optarg, 1, 10000, &o.target_ratio)) ||
                (option == 's' && *(name = optarg)) ||
                (option == 'h' && (o.curve = SLF_CURVE_DWA) == SLF_CURVE_DWA) ||
                (option == 't' && parse_count(optarg, 257, &o.thread_count));
    if (!good) return wrong_usage("wrong option", argv[optind - 1]);
  }
  argv += optind;
  if (argc - optind != 2) return wrong_usage("encode takes IN OUT.slf", NULL);
  slf_error error;
  slf_file *file = NULL;
  slf_writer *writer;
  struct stat status;
  bool folder = stat(argv[0], &status) == 0 && S_ISDIR(status.st_mode);
  if (!folder && slf_open(argv[0], &file, &error) != SLF_OK) return failed(&error);
  slf_result result = slf_writer_create(argv[1], &writer, &error);
  if (result == SLF_OK) {
    result = folder ? encode_folder(argv[0], name, writer, &o, &error)
                    : encode_file(file, writer, o, &error);
    if (result == SLF_OK)
      result = slf_writer_finish(writer, &error);
    else
      slf_writer_abort(writer);
  }
  slf_close(file);
  return result == SLF_OK ? EXIT_SUCCESS : failed(&error);
}

/* ---- compare ------------------------------------------------------------------------------- */

static double psnr_of(double squares, double count) {
  return squares > 0 ? 10 * log10(255 * 255 * count / squares) : INFINITY;
}

/* One side of a comparison: a layer, or a folder of slices. */
typedef struct {
  const char *name;
  uint32_t layer, u_count, v_count, s_count, t_count;
  slf_source source;
} light_field;

static light_field field_of_layer(chosen_layer *c) {
  return (light_field){c->self->name,  c->layer,       c->of->u_count,         c->of->v_count,
                       c->of->s_count, c->of->t_count, {read_decoded, c, NULL}};
}

static slf_result field_of_folder(slice_folder *f, light_field *field, slf_error *error) {
  slf_result result = open_folder(f, error);
  const slf_layer_options *o = &f->options;
  *field = (light_field){
      f->folder, 0, o->u_count, o->v_count, o->s_count, o->t_count, {read_folder_slice, f, NULL}};
  return result;
}

typedef struct {
  double squares, count;
} error_sum;

/* PSNR of each slice; the sum goes on. */
static slf_result compare_fields(const light_field *a, const light_field *b, error_sum *all,
                                 slf_error *error) {
  if (a->u_count != b->u_count || a->v_count != b->v_count || a->s_count != b->s_count ||
      a->t_count != b->t_count) {
    snprintf(error->message, sizeof error->message,
             "%.200s: %ux%u texels, %ux%u directions; %.200s has %ux%u, %ux%u", b->name, b->u_count,
             b->v_count, b->s_count, b->t_count, a->name, a->u_count, a->v_count, a->s_count,
             a->t_count);
    return SLF_ERROR_ARGUMENT;
  }
  size_t samples = 3 * (size_t)a->u_count * a->v_count;
  float *x = malloc(samples * sizeof *x), *y = malloc(samples * sizeof *y);
  slf_result result = SLF_OK;
  if (!x || !y) {
    snprintf(error->message, sizeof error->message, "%.400s: no memory", a->name);
    result = SLF_ERROR_MEMORY;
  }
  for (uint32_t i = 0; result == SLF_OK && i < a->s_count * a->t_count; i++) {
    uint32_t s = i % a->s_count, t = i / a->s_count;
    double sum = 0;
    if (!slf_slice_exists(a->s_count, a->t_count, s, t)) continue;
    result = a->source.read_slice(a->source.context, s, t, x, error);
    if (result == SLF_OK) result = b->source.read_slice(b->source.context, s, t, y, error);
    if (result != SLF_OK) break;
    for (size_t k = 0; k < samples; k++) {
      double d = (double)slf_srgb_from_linear(x[k]) - slf_srgb_from_linear(y[k]);
      sum += d * d;
    }
    printf("%s %u %u %u  %.2f dB\n", a->name, a->layer, s, t, psnr_of(sum, (double)samples));
    all->squares += sum;
    all->count += (double)samples;
  }
  free(x);
  free(y);
  return result;
}

/* All layers of two files. */
static slf_result compare_files(slf_file *a, slf_file *b, const char *path, error_sum *all,
                                slf_error *error) {
  bool alike = slf_surface_count(a) == slf_surface_count(b);
  slf_result result = SLF_OK;
  for (uint32_t i = 0; alike && result == SLF_OK && i < slf_surface_count(a); i++) {
    const slf_surface *x = slf_get_surface(a, i), *y = slf_get_surface(b, i);
    alike = x->layer_count == y->layer_count;
    for (uint32_t k = 0; alike && result == SLF_OK && k < x->layer_count; k++) {
      chosen_layer of_a = {a, i, k, x, &x->layers[k]}, of_b = {b, i, k, y, &y->layers[k]};
      light_field field_a = field_of_layer(&of_a), field_b = field_of_layer(&of_b);
      result = compare_fields(&field_a, &field_b, all, error);
    }
  }
  if (alike) return result;
  snprintf(error->message, sizeof error->message, "%.400s: other surfaces than the first file",
           path);
  return SLF_ERROR_ARGUMENT;
}

static bool is_folder(const char *path) {
  struct stat status;
  return stat(path, &status) == 0 && S_ISDIR(status.st_mode);
}

/* A side that is a folder, or the one layer of a file that a folder stands beside. */
typedef struct {
  slice_folder folder;
  chosen_layer chosen;
  light_field field;
} compared_side;

static bool open_side(const char *path, const char *surface, uint32_t layer, compared_side *side) {
  slf_error error;
  *side = (compared_side){.folder = {.folder = path}};
  if (!is_folder(path)) {
    if (!choose_layer(path, surface, layer, &side->chosen)) return false;
    side->field = field_of_layer(&side->chosen);
    return true;
  }
  if (field_of_folder(&side->folder, &side->field, &error) == SLF_OK) return true;
  failed(&error);
  return false;
}

static int compare_sides(char **paths, const char *surface, uint32_t layer) {
  compared_side a = {0}, b = {0};
  slf_error error;
  error_sum all = {0};
  bool done = open_side(paths[0], surface, layer, &a) && open_side(paths[1], surface, layer, &b);
  if (done && compare_fields(&a.field, &b.field, &all, &error) != SLF_OK)
    done = (failed(&error), false);
  if (done) printf("all  %.2f dB\n", psnr_of(all.squares, all.count));
  slf_close(a.chosen.file);
  slf_close(b.chosen.file);
  return done ? EXIT_SUCCESS : EXIT_FAILURE;
}

static int compare(int argc, char **argv) {
  static const struct option options[] = {
      {"surface", required_argument, NULL, 's'}, {"layer", required_argument, NULL, 'l'}, {0}};
  const char *surface = NULL;
  uint32_t layer = 0;
  opterr = 0;
  for (int option; (option = getopt_long(argc, argv, ":", options, NULL)) != -1;) {
    if (option == 's')
      surface = optarg;
    else if (option != 'l' || !parse_count(optarg, SLF_MAX_LAYERS, &layer))
      return wrong_usage("expected --surface=S or --layer=N", argv[optind - 1]);
  }
  argv += optind;
  if (argc - optind != 2) return wrong_usage("compare takes A and B", NULL);
  if (surface || layer || is_folder(argv[0]) || is_folder(argv[1]))
    return compare_sides(argv, surface ? surface : "0", layer);
  slf_error error;
  slf_file *a, *b;
  if (slf_open(argv[0], &a, &error) != SLF_OK) return failed(&error);
  if (slf_open(argv[1], &b, &error) != SLF_OK) return slf_close(a), failed(&error);
  error_sum all = {0};
  slf_result result = compare_files(a, b, argv[1], &all, &error);
  slf_close(a);
  slf_close(b);
  if (result != SLF_OK) return failed(&error);
  printf("all  %.2f dB\n", psnr_of(all.squares, all.count));
  return EXIT_SUCCESS;
}

/* ---- bench --------------------------------------------------------------------------------- */

static double cpu_s(void) {
  struct timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Time of a block over all blocks of a layer; stride 1 is the order of slices. */
static double time_layer(const chosen_layer *c, uint64_t stride) {
  enum { BATCH = 512 };
  static uint8_t blocks[BATCH][SLF_BLOCK_NBYTES];
  slf_block_address addresses[BATCH];
  uint8_t *pointers[BATCH];
  const slf_layer *l = c->of;
  uint64_t places = (uint64_t)l->block_u_count * l->block_v_count;
  uint64_t all = places * l->s_count * l->t_count, done = 0;
  double spent = 0;
  size_t count = 0;
  for (int i = 0; i < BATCH; i++) pointers[i] = blocks[i];
  for (uint64_t i = 0; i < all; i++) {
    uint64_t at = i * stride % all, place = at % places;
    uint32_t s = (uint32_t)(at / places % l->s_count), t = (uint32_t)(at / places / l->s_count);
    if (slf_slice_exists(l->s_count, l->t_count, s, t))
      addresses[count++] =
          (slf_block_address){(uint16_t)s, (uint16_t)t, (uint16_t)(place % l->block_u_count),
                              (uint16_t)(place / l->block_u_count)};
    if (count < BATCH && i + 1 < all) continue;
    double begin = cpu_s();
    slf_decode_blocks(c->file, c->surface, c->layer, addresses, count, pointers);
    spent += cpu_s() - begin;
    done += count;
    count = 0;
  }
  return spent / (double)done * 1e9;
}

static int bench(int argc, char **argv) {
  if (argc != 2) return wrong_usage("bench takes one file", NULL);
  slf_error error;
  slf_file *file;
  if (slf_open(argv[1], &file, &error) != SLF_OK) return failed(&error);
  for (uint32_t i = 0; i < slf_surface_count(file); i++) {
    const slf_surface *surface = slf_get_surface(file, i);
    for (uint32_t k = 0; k < surface->layer_count; k++) {
      chosen_layer c = {file, i, k, surface, &surface->layers[k]};
      /* A prime far from any size of ours walks through all blocks in no order that helps. */
      printf("%s %u  %.0f ns a block in order, %.0f ns at random\n", surface->name, k,
             time_layer(&c, 1), time_layer(&c, 2654435761u));
    }
  }
  slf_close(file);
  return EXIT_SUCCESS;
}

/* ---- main ---------------------------------------------------------------------------------- */

int main(int argc, char **argv) {
  static const struct {
    const char *name;
    int (*run)(int argc, char **argv);
  } verbs[] = {{"info", info},     {"verify", verify},   {"slice", slice}, {"decode", decode},
               {"encode", encode}, {"compare", compare}, {"bench", bench}};
  for (int i = 1; i < argc; i++)
    if (strcmp(argv[i], "-h") == 0 || strcmp(argv[i], "--help") == 0) {
      fputs(usage, stdout);
      return EXIT_SUCCESS;
    }
  if (argc > 1 && strcmp(argv[1], "--version") == 0) {
    printf("slf %s\n", slf_version());
    return EXIT_SUCCESS;
  }
  if (argc < 2) return wrong_usage("expected a verb", NULL);
  for (size_t i = 0; i < sizeof verbs / sizeof *verbs; i++)
    if (strcmp(argv[1], verbs[i].name) == 0) return verbs[i].run(argc - 1, argv + 1);
  return wrong_usage("no such verb", argv[1]);
}
