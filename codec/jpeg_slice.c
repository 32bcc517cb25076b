#include "codec/jpeg_slice.h"

#include "codec/file.h"
#include "codec/kernel.h"

#include <errno.h>
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>

#include <jpeglib.h>

typedef struct {
  struct jpeg_error_mgr base;
  jmp_buf leave;
} jpeg_failure;

static void leave(j_common_ptr c) {
  longjmp(((jpeg_failure *)c->err)->leave, 1);
}

/* Levels of a block: channels in JPEG's row-major order. */
static void read_levels(const layer_state *layer, uint32_t s, uint32_t t, uint64_t place,
                        JCOEF levels[3][COEFFICIENTS]) {
  entry_site site = site_of_slice(layer, s, t, place);
  const block_stream *blocks = &site.stream->blocks;
  bit_reader reader;
  entry_state state = {0};
  entry_begin(&state, site.stream->dc_begin);
  reader_begin(&reader, blocks, site.entry, layer->kernel->find(blocks, site.entry));
  for (unsigned i = 0; i <= site.number; i++)
    layer->kernel->parse(site.stream->tables, &reader, 0, i, i % site.slice_count == 0, NULL,
                         &state);
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < COEFFICIENTS; i++)
      levels[c][i] = entry_levels(&state)->levels[c][8 * (i % 8) + i / 8];
}

static void set_tables(struct jpeg_compress_struct *c, const layer_state *layer) {
  for (int channel = 0; channel < 3; channel++) {
    unsigned steps[COEFFICIENTS];
    for (int i = 0; i < COEFFICIENTS; i++)
      steps[i] = layer->steps[channel][8 * (i % 8) + i / 8] / STEP_ONE;
    jpeg_add_quant_table(c, channel, steps, 100, FALSE);
    c->comp_info[channel].quant_tbl_no = channel;
    c->comp_info[channel].h_samp_factor = c->comp_info[channel].v_samp_factor = 1;
  }
}

static void put_slice(struct jpeg_compress_struct *c, const layer_state *layer, uint32_t s,
                      uint32_t t) {
  const slf_layer *p = &layer->public;
  jvirt_barray_ptr arrays[3];
  c->image_width = p->u_count;
  c->image_height = p->v_count;
  c->input_components = 3;
  c->in_color_space = JCS_YCbCr;
  jpeg_set_defaults(c);
  set_tables(c, layer);
  c->optimize_coding = TRUE;
  for (int channel = 0; channel < 3; channel++)
    arrays[channel] = c->mem->request_virt_barray((j_common_ptr)c, JPOOL_IMAGE, TRUE,
                                                  p->block_u_count, p->block_v_count, 1);
  jpeg_write_coefficients(c, arrays);
  for (uint32_t v = 0; v < p->block_v_count; v++) {
    JBLOCKARRAY rows[3];
    for (int channel = 0; channel < 3; channel++)
      rows[channel] = c->mem->access_virt_barray((j_common_ptr)c, arrays[channel], v, 1, TRUE);
    for (uint32_t u = 0; u < p->block_u_count; u++) {
      JCOEF levels[3][COEFFICIENTS];
      read_levels(layer, s, t, (uint64_t)v * p->block_u_count + u, levels);
      for (int channel = 0; channel < 3; channel++)
        memcpy(rows[channel][0][u], levels[channel], sizeof levels[channel]);
    }
  }
  jpeg_finish_compress(c);
}

slf_result write_jpeg_slice(const slf_file *file, uint32_t surface_index, uint32_t layer_index,
                            uint32_t s_index, uint32_t t_index, const char *path,
                            slf_error *error) {
  const layer_state *layer = &file->surfaces[surface_index].layers[layer_index];
  if (layer->public.angular != SLF_ANGULAR_NONE || layer->public.curve != SLF_CURVE_SRGB ||
      layer->own_colours)
    return slf_fail(error, SLF_ERROR_ARGUMENT,
                    "%s: a JPEG can hold slices that were coded as angular none in sRGB only",
                    file->name);
  if (!layer_has_slice(layer, s_index, t_index))
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: no slice (%u, %u)", file->name, s_index,
                    t_index);
  char temporary[4096];
  snprintf(temporary, sizeof temporary, "%s.part", path);
  FILE *to = fopen(temporary, "wb");
  if (!to) return slf_fail(error, SLF_ERROR_IO, "%s: %s", temporary, strerror(errno));
  struct jpeg_compress_struct c;
  jpeg_failure failure;
  c.err = jpeg_std_error(&failure.base);
  failure.base.error_exit = leave;
  jpeg_create_compress(&c);
  slf_result result = SLF_OK;
  if (setjmp(failure.leave)) {
    char message[JMSG_LENGTH_MAX];
    c.err->format_message((j_common_ptr)&c, message);
    result = slf_fail(error, SLF_ERROR_IO, "%s: %s", path, message);
  } else {
    jpeg_stdio_dest(&c, to);
    put_slice(&c, layer, s_index, t_index);
  }
  jpeg_destroy_compress(&c);
  bool closed = fclose(to) == 0;
  if (result == SLF_OK && (!closed || rename(temporary, path) != 0))
    result = slf_fail(error, SLF_ERROR_IO, "%s: %s", path, strerror(errno));
  if (result != SLF_OK) remove(temporary);
  return result;
}
