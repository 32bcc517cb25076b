/* slf_command.c - slf: looks into .slf files. */
#include "codec/slf.h"

#include <errno.h>
#include <getopt.h>
#include <inttypes.h>
#include <math.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { EXIT_USAGE = 2 };

static const char usage[] =
    "usage: slf VERB [options] FILE ...\n"
    "\n"
    "  slf info FILE                          what is in it\n"
    "  slf verify FILE                        check every checksum and C-Block\n"
    "  slf slice FILE SURFACE S T OUT.png     one slice as a picture (LAYER 0; --layer=N for "
    "another)\n"
    "\n"
    "SURFACE is a name or a number from 0. S and T count directions from 0.\n"
    "\n"
    "  slf info build/floor.slf\n"
    "  slf slice build/floor.slf floor 8 8 floor.png\n";

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
  static const char *names[] = {"full", "own", "reflected", "height"};
  return names[layer->role];
}

static const char *layer_angular(const slf_layer *layer) {
  static const char *names[] = {"none", "identical", "motion", "layered"};
  return names[layer->angular];
}

static void print_layer(const slf_layer *l, uint32_t index) {
  uint64_t stored = l->payload_nbytes + l->index_nbytes;
  printf("  layer %u  %s, %s, %ux%u texels, ", index, layer_role(l),
         l->curve == SLF_CURVE_SRGB ? "sRGB" : "HDR", l->u_count, l->v_count);
  if (l->slice_count == 1)
    printf("matte");
  else
    printf("%ux%u directions (%u slices), angular %s", l->s_count, l->t_count, l->slice_count,
           layer_angular(l));
  printf(", quality %g\n", l->quality);
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
    printf("surface %u %s  %u vertices, %u triangles%s%s%s\n", i, s->name, s->mesh.vertex_count,
           s->mesh.triangle_count, s->flags & SLF_SURFACE_WRAP_U ? ", wraps in u" : "",
           s->flags & SLF_SURFACE_WRAP_V ? ", wraps in v" : "",
           s->flags & SLF_SURFACE_WATER ? ", water" : "");
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

static bool write_png(const char *path, const float *rgb, uint32_t width, uint32_t height) {
  size_t samples = (size_t)width * height * 3;
  uint8_t *bytes = malloc(samples);
  if (!bytes) return false;
  for (size_t i = 0; i < samples; i++) bytes[i] = slf_srgb_from_linear(rgb[i]);
  png_image image = {
      .version = PNG_IMAGE_VERSION, .width = width, .height = height, .format = PNG_FORMAT_RGB};
  char *temporary = malloc(strlen(path) + sizeof ".part");
  bool written = temporary != NULL;
  if (written) {
    strcat(strcpy(temporary, path), ".part");
    written = png_image_write_to_file(&image, temporary, 0, bytes, 0, NULL) &&
              rename(temporary, path) == 0;
    if (!written) remove(temporary);
  }
  free(temporary);
  free(bytes);
  return written;
}

static int slice(int argc, char **argv) {
  static const struct option options[] = {{"layer", required_argument, NULL, 'l'}, {0}};
  uint32_t layer_index = 0, surface_index, s, t;
  opterr = 0;
  for (int option; (option = getopt_long(argc, argv, ":", options, NULL)) != -1;)
    if (option != 'l' || !parse_count(optarg, SLF_MAX_LAYERS, &layer_index))
      return wrong_usage("expected --layer=N", argv[optind - 1]);
  argv += optind;
  if (argc - optind != 5) return wrong_usage("slice takes FILE SURFACE S T OUT.png", NULL);
  if (!parse_count(argv[2], SLF_MAX_DIRECTIONS, &s)) return wrong_usage("not an S", argv[2]);
  if (!parse_count(argv[3], SLF_MAX_DIRECTIONS, &t)) return wrong_usage("not a T", argv[3]);
  slf_error error;
  slf_file *file;
  if (slf_open(argv[0], &file, &error) != SLF_OK) return failed(&error);
  int status = EXIT_FAILURE;
  float *rgb = NULL;
  if (!find_surface(file, argv[1], &surface_index)) {
    fprintf(stderr, "slf: %s: no surface %s among %u\n", argv[0], argv[1], slf_surface_count(file));
    goto done;
  }
  const slf_surface *surface = slf_get_surface(file, surface_index);
  if (layer_index >= surface->layer_count) {
    fprintf(stderr, "slf: %s: %s has no layer %u, only %u\n", argv[0], surface->name, layer_index,
            surface->layer_count);
    goto done;
  }
  const slf_layer *layer = &surface->layers[layer_index];
  rgb = malloc((size_t)layer->u_count * layer->v_count * 3 * sizeof *rgb);
  if (!rgb) {
    fprintf(stderr, "slf: %s: no memory for a slice of %ux%u\n", argv[0], layer->u_count,
            layer->v_count);
  } else if (slf_decode_slice(file, surface_index, layer_index, s, t, rgb, &error) != SLF_OK) {
    failed(&error);
  } else if (!write_png(argv[4], rgb, layer->u_count, layer->v_count)) {
    fprintf(stderr, "slf: %s: cannot be written\n", argv[4]);
  } else {
    status = EXIT_SUCCESS;
  }
done:
  free(rgb);
  slf_close(file);
  return status;
}

/* ---- main ---------------------------------------------------------------------------------- */

int main(int argc, char **argv) {
  static const struct {
    const char *name;
    int (*run)(int argc, char **argv);
  } verbs[] = {{"info", info}, {"verify", verify}, {"slice", slice}};
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
