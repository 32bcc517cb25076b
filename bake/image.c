#include "image.h"

#include <openexr.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fail.h"

struct image {
  exr_context_t context;
  char *path;
  uint32_t width, height;
  int32_t chunk_row_count;
  exr_decode_pipeline_t decode;
  int decode_ready;
  float *chunk; /* a plane of chunk_row_count rows for each channel */
};

/* OpenEXR's message holds the file and the numbers; it would print it itself without a handler. */
static char last_message[512];
static void keep_message(exr_const_context_t context, exr_result_t code, const char *message) {
  (void)context, (void)code;
  snprintf(last_message, sizeof last_message, "%s", message);
}

static void check(exr_result_t result, const char *path) {
  if (result == EXR_ERR_SUCCESS) return;
  fail("%s: %s", path, last_message[0] ? last_message : exr_get_default_error_message(result));
}

static exr_context_initializer_t initializer(void) {
  exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
  init.error_handler_fn = keep_message;
  return init;
}

image *image_open(const char *path) {
  image *self = allocate(1, sizeof *self, path);
  self->path = format_text("%s", path);
  exr_context_initializer_t init = initializer();
  check(exr_start_read(&self->context, path, &init), path);
  exr_storage_t storage;
  check(exr_get_storage(self->context, 0, &storage), path);
  if (storage != EXR_STORAGE_SCANLINE) fail("%s: not an image of scan lines", path);
  exr_attr_box2i_t window;
  check(exr_get_data_window(self->context, 0, &window), path);
  if (window.min.x != 0 || window.min.y != 0) fail("%s: does not begin at 0,0", path);
  self->width = (uint32_t)(window.max.x + 1);
  self->height = (uint32_t)(window.max.y + 1);
  check(exr_get_scanlines_per_chunk(self->context, 0, &self->chunk_row_count), path);
  return self;
}

uint32_t image_width(const image *self) {
  return self->width;
}

uint32_t image_height(const image *self) {
  return self->height;
}

/* All channels are decoded, each to a plane of its own: the C core of OpenEXR 3.1.5 crashes when
 * some are left out. */
static void direct_channels(image *self) {
  size_t plane_size = (size_t)self->chunk_row_count * self->width;
  for (int i = 0; i < self->decode.channel_count; i++) {
    exr_coding_channel_info_t *channel = &self->decode.channels[i];
    channel->decode_to_ptr = (uint8_t *)(self->chunk + (size_t)i * plane_size);
    channel->user_data_type = EXR_PIXEL_FLOAT;
    channel->user_bytes_per_element = sizeof(float);
    channel->user_pixel_stride = sizeof(float);
    channel->user_line_stride = (int32_t)(self->width * sizeof(float));
  }
}

static void read_chunk(image *self, const exr_chunk_info_t *info) {
  if (!self->decode_ready) {
    check(exr_decoding_initialize(self->context, 0, info, &self->decode), self->path);
    self->decode_ready = 1;
  } else {
    check(exr_decoding_update(self->context, 0, info, &self->decode), self->path);
  }
  size_t nbytes = (size_t)self->chunk_row_count * self->width * sizeof(float);
  if (!self->chunk) self->chunk = allocate((size_t)self->decode.channel_count, nbytes, self->path);
  direct_channels(self);
  check(exr_decoding_choose_default_routines(self->context, 0, &self->decode), self->path);
  check(exr_decoding_run(self->context, 0, &self->decode), self->path);
}

static const float *plane_of(const image *self, char name) {
  for (int i = 0; i < self->decode.channel_count; i++) {
    const char *channel = self->decode.channels[i].channel_name;
    if (channel[0] == name && !channel[1])
      return self->chunk + (size_t)i * (size_t)self->chunk_row_count * self->width;
  }
  fail("%s: has no channel %c", self->path, name);
}

void image_read_rows(image *self, const char *channels, uint32_t first_row, uint32_t row_count,
                     float *values) {
  size_t channel_count = strlen(channels), row_size = self->width * channel_count;
  uint32_t row = first_row;
  while (row < first_row + row_count) {
    exr_chunk_info_t info;
    check(exr_read_scanline_chunk_info(self->context, 0, (int)row, &info), self->path);
    read_chunk(self, &info);
    uint32_t chunk_end = (uint32_t)(info.start_y + info.height);
    uint32_t end = chunk_end < first_row + row_count ? chunk_end : first_row + row_count;
    size_t count = (size_t)(end - row) * self->width;
    for (size_t c = 0; c < channel_count; c++) {
      const float *from =
          plane_of(self, channels[c]) + (size_t)(row - (uint32_t)info.start_y) * self->width;
      float *to = values + (row - first_row) * row_size + c;
      for (size_t i = 0; i < count; i++) to[i * channel_count] = from[i];
    }
    row = end;
  }
}

void image_close(image *self) {
  if (!self) return;
  if (self->decode_ready) exr_decoding_destroy(self->context, &self->decode);
  exr_finish(&self->context);
  free(self->chunk);
  free(self->path);
  free(self);
}

void image_write(const char *path, uint32_t width, uint32_t height, const float *rgb) {
  exr_context_t context;
  exr_context_initializer_t init = initializer();
  check(exr_start_write(&context, path, EXR_WRITE_FILE_DIRECTLY, &init), path);
  int part;
  check(exr_add_part(context, NULL, EXR_STORAGE_SCANLINE, &part), path);
  check(exr_initialize_required_attr_simple(context, part, (int32_t)width, (int32_t)height,
                                            EXR_COMPRESSION_NONE),
        path);
  for (const char *name = "BGR"; *name; name++) {
    char channel[2] = {*name, 0};
    check(
        exr_add_channel(context, part, channel, EXR_PIXEL_HALF, EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1),
        path);
  }
  check(exr_write_header(context), path);
  exr_encode_pipeline_t encode = EXR_ENCODE_PIPELINE_INITIALIZER;
  for (uint32_t row = 0; row < height; row++) {
    exr_chunk_info_t info;
    check(exr_write_scanline_chunk_info(context, part, (int)row, &info), path);
    if (row == 0)
      check(exr_encoding_initialize(context, part, &info, &encode), path);
    else
      check(exr_encoding_update(context, part, &info, &encode), path);
    for (int i = 0; i < encode.channel_count; i++) {
      exr_coding_channel_info_t *channel = &encode.channels[i];
      size_t place = (size_t)(strchr("RGB", channel->channel_name[0]) - "RGB");
      channel->encode_from_ptr = (const uint8_t *)(rgb + (size_t)row * width * 3 + place);
      channel->user_data_type = EXR_PIXEL_FLOAT;
      channel->user_bytes_per_element = sizeof(float);
      channel->user_pixel_stride = 3 * sizeof(float);
      channel->user_line_stride = (int32_t)(width * 3 * sizeof(float));
    }
    if (row == 0) check(exr_encoding_choose_default_routines(context, part, &encode), path);
    check(exr_encoding_run(context, part, &encode), path);
  }
  check(exr_encoding_destroy(context, &encode), path);
  check(exr_finish(&context), path);
}
