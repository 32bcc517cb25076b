/* codec - measures the codec beside libjpeg-turbo on a light field; one flat JSON object on stdout.
 *
 *   codec LABEL BAKE_DIR SURFACE RAYS            a baked surface; LABEL ends its numbers' names
 *   codec LABEL                                  the synthetic mirror
 *   codec --export FILE BAKE_DIR SURFACE RAYS    its codes, for peers.py
 *   codec --layered PSNR BAKE_DIR SURFACE RAYS   the layered scheme's PSNR and ratio there
 *
 * Times are CPU time of one thread, of each part of
 * the work the least of several rounds that alternate between the codecs: ratios hold on a machine
 * that does other things too. */
#include <math.h>
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <jpeglib.h>

#include "bake/fail.h"
#include "bake/image.h"
#include "bake/surface.h"
#include "tests/bench/figures.h"
#include "tests/bench/synthetic.h"

/* ---- Light fields -------------------------------------------------------------------------- */

static light_field load_baked(const char *folder, const char *name, uint32_t rays) {
  scene *all = scene_read(folder);
  const surface *self = scene_find(all, name);
  if (!self) fail("%s: no surface %s", folder, name);
  light_field f = {self->u_count, self->v_count, self->s_count, self->t_count, NULL};
  size_t samples = (size_t)f.u_count * f.v_count * 3;
  f.codes = allocate((size_t)f.s_count * f.t_count, samples, name);
  float *rgb = allocate(samples, sizeof *rgb, name);
  uint32_t slice_count, at = 0;
  slice *slices = surface_slices(self, &slice_count);
  for (uint32_t c = 0; c < surface_chunk_count(self, rays); c++) {
    chunk_range range = surface_chunk(self, rays, c);
    char *path = format_text("%s/%s/%04u.exr", folder, name, c);
    image *chunk = image_open(path);
    for (uint32_t i = 0; i < range.count; i++, at++) {
      uint8_t *codes = f.codes + ((size_t)slices[at].t * f.s_count + slices[at].s) * samples;
      image_read_rows(chunk, "RGB", i * f.v_count, f.v_count, rgb);
      for (size_t k = 0; k < samples; k++) codes[k] = slf_srgb_from_linear(rgb[k]);
    }
    image_close(chunk);
    free(path);
  }
  free(slices);
  free(rgb);
  scene_free(all);
  return f;
}

static uint32_t count_slices(const light_field *f) {
  uint32_t count = 0;
  for (uint32_t i = 0; i < f->s_count * f->t_count; i++)
    count += slf_slice_exists(f->s_count, f->t_count, i % f->s_count, i / f->s_count);
  return count;
}

static double raw_nbytes(const light_field *f) {
  return 3.0 * f->u_count * f->v_count * count_slices(f);
}

/* ---- Ours ---------------------------------------------------------------------------------- */

typedef struct {
  double psnr, ratio, index_share, encode_s;
} coded;

static char file_path[64];

/* Encodes to file_path. The PSNR is of the decoded codes, measured by the encoder block by block.
 */
static coded encode(const light_field *f, slf_angular angular, double quality) {
  slf_error error;
  slf_writer *writer;
  slf_surface s = {.name = "bench"};
  slf_layer_options options = {.angular = angular,
                               .u_count = f->u_count,
                               .v_count = f->v_count,
                               .thread_count = 2,
                               .s_count = f->s_count,
                               .t_count = f->t_count,
                               .quality = (float)quality};
  slf_source source = {light_field_read_slice, (void *)(uintptr_t)f, NULL};
  double begin = now_s();
  if (slf_writer_create(file_path, &writer, &error) || slf_writer_add_surface(writer, &s, &error) ||
      slf_writer_add_layer(writer, &options, &source, &error) || slf_writer_finish(writer, &error))
    fail("%s", error.message);
  coded c = {.encode_s = now_s() - begin};
  slf_file *file;
  if (slf_open(file_path, &file, &error)) fail("%s", error.message);
  const slf_layer *layer = &slf_get_surface(file, 0)->layers[0];
  c.psnr = layer->psnr;
  c.ratio = raw_nbytes(f) / (double)(layer->payload_nbytes + layer->index_nbytes);
  c.index_share = (double)layer->index_nbytes / (double)layer->payload_nbytes;
  slf_close(file);
  return c;
}

/* Secant steps: PSNR is nearly a line over quality, and so is the logarithm of the ratio. */
static coded encode_at(const light_field *f, slf_angular angular, double target, bool by_ratio,
                       double *quality) {
  double q = 76, slope = by_ratio ? -0.09 : 0.5, previous_q = 0, previous = 0;
  coded best = {0};
  for (int i = 0; i < 7; i++) {
    coded c = encode(f, angular, q);
    double value = by_ratio ? log(c.ratio) : c.psnr, wanted = by_ratio ? log(target) : target;
    if (i == 0 || fabs(value - wanted) < fabs((by_ratio ? log(best.ratio) : best.psnr) - wanted)) {
      best = c;
      *quality = q;
    }
    if (fabs(value - wanted) < 0.04) break;
    if (i && fabs(q - previous_q) > 1e-6 && fabs(value - previous) > 1e-3)
      slope = (value - previous) / (q - previous_q);
    previous_q = q;
    previous = value;
    q = fmax(20, fmin(99.9, q + (wanted - value) / slope));
  }
  return best;
}

/* ---- libjpeg-turbo ------------------------------------------------------------------------- */

typedef struct {
  unsigned char **bytes;
  unsigned long *nbytes;
  uint32_t count;
  double psnr, ratio, file_ratio; /* of the scans alone; of whole files */
} jpeg_slices;

static void jpeg_free(jpeg_slices *j) {
  for (uint32_t i = 0; i < j->count; i++) free(j->bytes[i]);
  free(j->bytes);
  free(j->nbytes);
}

static void jpeg_encode(const light_field *f, const uint8_t *codes, int quality,
                        unsigned char **bytes, unsigned long *nbytes) {
  struct jpeg_compress_struct c;
  struct jpeg_error_mgr errors;
  c.err = jpeg_std_error(&errors);
  jpeg_create_compress(&c);
  *bytes = NULL;
  *nbytes = 0;
  jpeg_mem_dest(&c, bytes, nbytes);
  c.image_width = f->u_count;
  c.image_height = f->v_count;
  c.input_components = 3;
  c.in_color_space = JCS_RGB;
  jpeg_set_defaults(&c);
  jpeg_set_quality(&c, quality, FALSE);
  for (int i = 0; i < 3; i++) c.comp_info[i].h_samp_factor = c.comp_info[i].v_samp_factor = 1;
  c.optimize_coding = TRUE;
  c.write_JFIF_header = FALSE;
  jpeg_start_compress(&c, TRUE);
  while (c.next_scanline < c.image_height) {
    JSAMPROW row = (JSAMPROW)(uintptr_t)(codes + (size_t)c.next_scanline * f->u_count * 3);
    jpeg_write_scanlines(&c, &row, 1);
  }
  jpeg_finish_compress(&c);
  jpeg_destroy_compress(&c);
}

/* Decodes a slice to R G B X, libjpeg-turbo's own quickest four-byte layout. */
static void jpeg_decode(const unsigned char *bytes, unsigned long nbytes, uint8_t *rgbx) {
  struct jpeg_decompress_struct d;
  struct jpeg_error_mgr errors;
  d.err = jpeg_std_error(&errors);
  jpeg_create_decompress(&d);
  jpeg_mem_src(&d, bytes, nbytes);
  jpeg_read_header(&d, TRUE);
  d.out_color_space = JCS_EXT_RGBX;
  jpeg_start_decompress(&d);
  while (d.output_scanline < d.output_height) {
    JSAMPROW rows[8];
    for (int i = 0; i < 8; i++)
      rows[i] = rgbx + ((size_t)d.output_scanline + (size_t)i) * d.output_width * 4;
    jpeg_read_scanlines(&d, rows, d.output_height - d.output_scanline < 8 ? 1 : 8);
  }
  jpeg_finish_decompress(&d);
  jpeg_destroy_decompress(&d);
}

/* From the start of scan on. Slices are small, and a set of them could keep its headers and tables
 * once: JPEG is given them for nothing. */
static double scan_nbytes(const unsigned char *bytes, unsigned long nbytes) {
  for (unsigned long i = 2; i + 3 < nbytes && bytes[i] == 0xff;) {
    if (bytes[i + 1] == 0xda) return (double)(nbytes - i);
    i += 2 + ((unsigned long)bytes[i + 2] << 8 | bytes[i + 3]);
  }
  fail("a JPEG without a scan");
}

static jpeg_slices jpeg_encode_all(const light_field *f, int quality) {
  jpeg_slices j = {.count = count_slices(f)};
  size_t texels = (size_t)f->u_count * f->v_count;
  j.bytes = allocate(j.count, sizeof *j.bytes, "JPEG");
  j.nbytes = allocate(j.count, sizeof *j.nbytes, "JPEG");
  uint8_t *rgbx = allocate(texels + 8 * f->u_count, 4, "JPEG");
  double squared = 0, stored = 0, scans = 0;
  uint32_t i = 0;
  for (uint32_t t = 0; t < f->t_count; t++)
    for (uint32_t s = 0; s < f->s_count; s++) {
      if (!slf_slice_exists(f->s_count, f->t_count, s, t)) continue;
      const uint8_t *codes = light_field_slice(f, s, t);
      jpeg_encode(f, codes, quality, &j.bytes[i], &j.nbytes[i]);
      jpeg_decode(j.bytes[i], j.nbytes[i], rgbx);
      for (size_t k = 0; k < texels; k++)
        for (int c = 0; c < 3; c++) {
          double d = (double)rgbx[4 * k + (size_t)c] - codes[3 * k + (size_t)c];
          squared += d * d;
        }
      stored += (double)j.nbytes[i];
      scans += scan_nbytes(j.bytes[i], j.nbytes[i]);
      i++;
    }
  free(rgbx);
  j.psnr = 10 * log10(255 * 255 / (squared / raw_nbytes(f)));
  j.ratio = raw_nbytes(f) / scans;
  j.file_ratio = raw_nbytes(f) / stored;
  return j;
}

/* The JPEG quality whose PSNR is nearest to a target. */
static jpeg_slices jpeg_at(const light_field *f, double target) {
  int low = 5, high = 100;
  while (low + 1 < high) {
    int middle = (low + high) / 2;
    jpeg_slices j = jpeg_encode_all(f, middle);
    if (j.psnr < target)
      low = middle;
    else
      high = middle;
    jpeg_free(&j);
  }
  return jpeg_encode_all(f, high);
}

/* ---- Speed --------------------------------------------------------------------------------- */

typedef struct {
  slf_block_address *addresses;
  uint8_t **u_blocks;
  size_t count;
} block_list;

/* All blocks in the order of the file: quad by quad, place by place. */
static block_list list_blocks(const light_field *f) {
  uint32_t bu = (f->u_count + 7) / 8, bv = (f->v_count + 7) / 8;
  block_list l = {.addresses =
                      allocate((size_t)count_slices(f) * bu * bv, sizeof *l.addresses, "list")};
  for (uint32_t t = 0; t < f->t_count; t += 2)
    for (uint32_t s = 0; s < f->s_count; s += 2)
      for (uint32_t b = 0; b < bu * bv; b++)
        for (uint32_t q = 0; q < 4; q++) {
          uint32_t qs = s + (q == 1 || q == 2), qt = t + (q >= 2);
          if (slf_slice_exists(f->s_count, f->t_count, qs, qt))
            l.addresses[l.count++] = (slf_block_address){(uint16_t)qs, (uint16_t)qt,
                                                         (uint16_t)(b % bu), (uint16_t)(b / bu)};
        }
  /* As a block cache would have them: 2 MiB that are written again and again. */
  uint8_t *cache = aligned_alloc(SLF_BLOCK_NBYTES, 8192 * SLF_BLOCK_NBYTES);
  if (!cache) fail("no memory for 2 MiB");
  l.u_blocks = allocate(l.count, sizeof *l.u_blocks, "list");
  for (size_t i = 0; i < l.count; i++) l.u_blocks[i] = cache + i % 8192 * SLF_BLOCK_NBYTES;
  return l;
}

/* Runs of `run` blocks stay together: 4 are a quad's, what a four-tap mix asks for. */
static void shuffle(block_list *l, size_t run) {
  uint64_t x = 88172645463325252u; /* xorshift64 */
  for (size_t i = l->count / run - 1; i; i--) {
    x ^= x << 13;
    x ^= x >> 7;
    x ^= x << 17;
    size_t k = x % (i + 1);
    for (size_t r = 0; r < run; r++) {
      slf_block_address swap = l->addresses[i * run + r];
      l->addresses[i * run + r] = l->addresses[k * run + r];
      l->addresses[k * run + r] = swap;
    }
  }
}

typedef struct {
  double jpeg_ns, sequential_ns, random_ns, random_quads_ns;
} speed;

enum { BATCH = 512, ROUNDS = 15 }; /* a batch is what a frame of a slowly moving view asks for */

/* The least time of each part of the work over all rounds, summed: what stands beside us on the
 * machine rarely hits the same part each time. */
static double *make_times(size_t count) {
  double *times = allocate(count, sizeof *times, "times");
  for (size_t i = 0; i < count; i++) times[i] = 1e9;
  return times;
}

static double sum_times(double *times, size_t count, size_t block_count) {
  double sum = 0;
  for (size_t i = 0; i < count; i++) sum += times[i];
  free(times);
  return sum / (double)block_count * 1e9;
}

static void time_blocks(const slf_file *file, const block_list *l, double *times) {
  for (size_t i = 0; i < l->count; i += BATCH) {
    size_t count = l->count - i < BATCH ? l->count - i : BATCH;
    double begin = thread_s();
    slf_decode_blocks(file, 0, 0, l->addresses + i, count, l->u_blocks + i);
    times[i / BATCH] = fmin(times[i / BATCH], thread_s() - begin);
  }
}

static void time_jpegs(const jpeg_slices *j, uint8_t *rgbx, double *times) {
  for (uint32_t i = 0; i < j->count; i++) {
    double begin = thread_s();
    jpeg_decode(j->bytes[i], j->nbytes[i], rgbx);
    times[i] = fmin(times[i], thread_s() - begin);
  }
}

static void free_blocks(block_list *l) {
  free(l->u_blocks[0]); /* the cache that all point into */
  free(l->u_blocks);
  free(l->addresses);
}

/* The file beside the JPEGs. */
static speed measure_speed(const light_field *f, const jpeg_slices *j) {
  slf_error error;
  slf_file *file;
  if (slf_open(file_path, &file, &error)) fail("%s", error.message);
  enum { ORDERS = 3 };
  block_list lists[ORDERS];
  double *times[ORDERS], *jpeg_times = make_times(j->count);
  size_t count = 0;
  for (int i = 0; i < ORDERS; i++) {
    lists[i] = list_blocks(f);
    count = lists[i].count;
    times[i] = make_times(count / BATCH + 1);
  }
  shuffle(&lists[1], 1);
  shuffle(&lists[2], 4);
  /* libjpeg-turbo stores rows that begin at multiples of 32 bytes past the cache, which costs it 40
   * ns a block here: it gets rows as malloc's pages begin, 16 bytes later, and so does its best. */
  size_t rgbx_nbytes = ((size_t)f->u_count * (f->v_count + 8) * 4 + 16 + 4095) / 4096 * 4096;
  uint8_t *pages = aligned_alloc(4096, rgbx_nbytes), *rgbx = pages + 16;
  if (!pages) fail("no memory for a slice");
  for (int round = 0; round < ROUNDS; round++) {
    time_jpegs(j, rgbx, jpeg_times);
    for (int i = 0; i < ORDERS; i++) time_blocks(file, &lists[i], times[i]);
  }
  size_t batches = (count + BATCH - 1) / BATCH;
  speed s = {sum_times(jpeg_times, j->count, count), sum_times(times[0], batches, count),
             sum_times(times[1], batches, count), sum_times(times[2], batches, count)};
  for (int i = 0; i < ORDERS; i++) free_blocks(&lists[i]);
  free(pages);
  slf_close(file);
  return s;
}

/* ---- The numbers --------------------------------------------------------------------------- */

/* At 40 dB, where the display shows no more than the material's own noise. */
static const double target_psnr = 40;

/* The paper's way: independent blocks at 17:1, then at the same quality those that equal the first
 * slice's cost one bit. */
static void measure_identical(const light_field *f, const char *label) {
  double quality;
  coded none = encode_at(f, SLF_ANGULAR_NONE, 17, true, &quality);
  coded identical = encode(f, SLF_ANGULAR_IDENTICAL, quality);
  print_figure("identical_gain", label, identical.ratio / none.ratio);
  print_figure("identical_psnr_change", label, identical.psnr - none.psnr);
}

/* A figure of one of our schemes: infix names those that are not of independent blocks. */
static void print_of(const char *scheme, const char *infix, const char *rest, const char *label,
                     double value) {
  char key[96];
  snprintf(key, sizeof key, "%s%s%s", scheme, infix, rest);
  print_figure(key, label, value);
}

/* A scheme at the JPEGs' PSNR beside them; its ratio. */
static double measure_scheme(const light_field *f, slf_angular angular, const char *infix,
                             const jpeg_slices *j, const char *label) {
  double quality;
  coded c = encode_at(f, angular, j->psnr, false, &quality);
  speed s = measure_speed(f, j);
  print_of("psnr", infix, "", label, c.psnr);
  print_of("decode", infix, "_vs_libjpeg", label, s.sequential_ns / s.jpeg_ns);
  print_of("decode", infix, "_random_vs_libjpeg", label, s.random_ns / s.jpeg_ns);
  print_of("decode", infix, "_random_quads_vs_libjpeg", label, s.random_quads_ns / s.jpeg_ns);
  print_of("libjpeg", infix, "_ns", label, s.jpeg_ns);
  return c.ratio;
}

static void measure(const light_field *f, const char *label) {
  double quality;
  jpeg_slices j = jpeg_at(f, target_psnr);
  double none = measure_scheme(f, SLF_ANGULAR_NONE, "", &j, label);
  double layered = measure_scheme(f, SLF_ANGULAR_LAYERED, "_layered", &j, label);
  print_figure("ratio_jpeg", label, j.ratio);
  print_figure("ratio_none", label, none);
  print_figure("ratio_none_vs_libjpeg", label, none / j.ratio);
  print_figure("ratio_none_vs_libjpeg_files", label, none / j.file_ratio);
  print_figure("ratio_layered", label, layered);
  print_figure("ratio_layered_vs_none", label, layered / none);
  measure_identical(f, label);
  coded motion = encode_at(f, SLF_ANGULAR_MOTION, j.psnr, false, &quality);
  print_figure("motion_gain", label, motion.ratio / none);
  jpeg_free(&j);
}

/* For peers.py: u, v, s, t counts (32 bits each), [t][s] whether the slice exists, codes. */
static void export_field(const light_field *f, const char *path) {
  FILE *file = fopen(path, "wb");
  uint32_t slices = f->s_count * f->t_count,
           head[4] = {f->u_count, f->v_count, f->s_count, f->t_count};
  bool written = file && fwrite(head, sizeof head, 1, file) == 1;
  for (uint32_t i = 0; written && i < slices; i++)
    written = fputc(slf_slice_exists(f->s_count, f->t_count, i % f->s_count, i / f->s_count),
                    file) != EOF;
  size_t nbytes = (size_t)slices * f->u_count * f->v_count * 3;
  written = written && fwrite(f->codes, 1, nbytes, file) == nbytes;
  if (!file || fclose(file) || !written) fail("%s: cannot be written", path);
}

static void measure_synthetic(const char *label) {
  double quality;
  light_field f;
  if (!synthetic_make(SYNTHETIC_MIRROR, 128, 16, 3, &f)) fail("no memory for the synthetic mirror");
  measure(&f, label);
  coded at_30 = encode_at(&f, SLF_ANGULAR_NONE, 30, true, &quality);
  print_figure("index_overhead_at_30", "", at_30.index_share);
  double least_s = 1e9;
  for (int i = 0; i < 3; i++) least_s = fmin(least_s, encode(&f, SLF_ANGULAR_LAYERED, 76).encode_s);
  print_figure("encode_mtexels_per_s", "", raw_nbytes(&f) / 3e6 / least_s);
  light_field_free(&f);
}

int main(int argc, char **argv) {
  bool option = argc == 6 && strncmp(argv[1], "--", 2) == 0;
  if (argc != 2 && argc != 5 && !option)
    fail("usage: codec LABEL [BAKE_DIR SURFACE RAYS] or\n"
         "       codec --export FILE|--layered PSNR BAKE_DIR SURFACE RAYS");
  snprintf(file_path, sizeof file_path, "/tmp/slf_bench.%ld.slf", (long)getpid());
  light_field f = {0};
  if (argc > 2) f = load_baked(argv[argc - 3], argv[argc - 2], (uint32_t)atoi(argv[argc - 1]));
  if (argc == 2) {
    measure_synthetic(argv[1]);
  } else if (argc == 5) {
    measure(&f, argv[1]);
  } else if (strcmp(argv[1], "--export") == 0) {
    export_field(&f, argv[2]);
  } else {
    double quality;
    coded c = encode_at(&f, SLF_ANGULAR_LAYERED, atof(argv[2]), false, &quality);
    printf("%.3f %.4f\n", c.psnr, c.ratio);
  }
  if (argc < 6) end_figures();
  if (argc > 2) light_field_free(&f);
  remove(file_path);
  return 0;
}
