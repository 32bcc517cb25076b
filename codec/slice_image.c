#include "codec/slice_image.h"

#include "codec/format.h"

#include <errno.h>
#include <openexr.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>

static bool ends_in(const char *path, const char *ending) {
  size_t length = strlen(path), tail = strlen(ending);
  return length >= tail && strcmp(path + length - tail, ending) == 0;
}

static slf_result no_memory(const char *path, slf_error *error) {
  return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", path);
}

/* ---- OpenEXR ------------------------------------------------------------------------------- */

/* The library would print what it has to say. */
static void keep_quiet(exr_const_context_t context, exr_result_t code, const char *message) {
  (void)context, (void)code, (void)message;
}

static exr_context_initializer_t initializer(void) {
  exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
  init.error_handler_fn = keep_quiet;
  return init;
}

static slf_result exr_failed(exr_result_t code, const char *path, slf_error *error) {
  return slf_fail(error, SLF_ERROR_IO, "%s: %s", path, exr_get_default_error_message(code));
}

static void encode_from(exr_encode_pipeline_t *encode, const float *row, uint32_t width) {
  for (int i = 0; i < encode->channel_count; i++) {
    exr_coding_channel_info_t *channel = &encode->channels[i];
    size_t place = (size_t)(strchr("RGB", channel->channel_name[0]) - "RGB");
    channel->encode_from_ptr = (const uint8_t *)(row + place);
    channel->user_data_type = EXR_PIXEL_FLOAT;
    channel->user_bytes_per_element = sizeof(float);
    channel->user_pixel_stride = 3 * sizeof(float);
    channel->user_line_stride = (int32_t)(width * 3 * sizeof(float));
  }
}

/* Uncompressed: the C core of OpenEXR 3.1.5 writes rows that ZIP does not make smaller as noise. */
static exr_result_t put_exr(exr_context_t context, const float *rgb, uint32_t width,
                            uint32_t height) {
  int part;
  exr_result_t code = exr_add_part(context, NULL, EXR_STORAGE_SCANLINE, &part);
  if (code == EXR_ERR_SUCCESS)
    code = exr_initialize_required_attr_simple(context, part, (int32_t)width, (int32_t)height,
                                               EXR_COMPRESSION_NONE);
  for (const char *name = "BGR"; *name && code == EXR_ERR_SUCCESS; name++)
    code = exr_add_channel(context, part, (char[]){*name, 0}, EXR_PIXEL_HALF,
                           EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
  if (code == EXR_ERR_SUCCESS) code = exr_write_header(context);
  exr_encode_pipeline_t encode = EXR_ENCODE_PIPELINE_INITIALIZER;
  for (uint32_t row = 0; row < height && code == EXR_ERR_SUCCESS; row++) {
    exr_chunk_info_t info;
    code = exr_write_scanline_chunk_info(context, part, (int)row, &info);
    if (code == EXR_ERR_SUCCESS)
      code = row == 0 ? exr_encoding_initialize(context, part, &info, &encode)
                      : exr_encoding_update(context, part, &info, &encode);
    if (code != EXR_ERR_SUCCESS) break;
    encode_from(&encode, rgb + (size_t)row * width * 3, width);
    if (row == 0) code = exr_encoding_choose_default_routines(context, part, &encode);
    if (code == EXR_ERR_SUCCESS) code = exr_encoding_run(context, part, &encode);
  }
  exr_encoding_destroy(context, &encode);
  return code;
}

static slf_result write_exr(const char *path, const float *rgb, uint32_t width, uint32_t height,
                            slf_error *error) {
  exr_context_t context;
  exr_context_initializer_t init = initializer();
  exr_result_t code = exr_start_write(&context, path, EXR_WRITE_FILE_DIRECTLY, &init);
  if (code == EXR_ERR_SUCCESS) {
    code = put_exr(context, rgb, width, height);
    exr_result_t closed = exr_finish(&context);
    if (code == EXR_ERR_SUCCESS) code = closed;
  }
  return code == EXR_ERR_SUCCESS ? SLF_OK : exr_failed(code, path, error);
}

/* All channels are decoded, each to a plane of its own: the C core of OpenEXR 3.1.5 crashes when
 * some are left out. */
static exr_result_t get_chunk(exr_context_t context, const exr_chunk_info_t *info, uint32_t width,
                              float *rgb, bool found[3]) {
  exr_decode_pipeline_t decode = EXR_DECODE_PIPELINE_INITIALIZER;
  exr_result_t code = exr_decoding_initialize(context, 0, info, &decode);
  if (code != EXR_ERR_SUCCESS) return code;
  size_t plane_count = (size_t)info->height * width;
  float *planes = malloc(plane_count * (size_t)decode.channel_count * sizeof *planes);
  if (!planes) code = EXR_ERR_OUT_OF_MEMORY;
  for (int i = 0; planes && i < decode.channel_count; i++) {
    exr_coding_channel_info_t *channel = &decode.channels[i];
    channel->decode_to_ptr = (uint8_t *)(planes + (size_t)i * plane_count);
    channel->user_data_type = EXR_PIXEL_FLOAT;
    channel->user_bytes_per_element = sizeof(float);
    channel->user_pixel_stride = sizeof(float);
    channel->user_line_stride = (int32_t)(width * sizeof(float));
  }
  if (code == EXR_ERR_SUCCESS) code = exr_decoding_choose_default_routines(context, 0, &decode);
  if (code == EXR_ERR_SUCCESS) code = exr_decoding_run(context, 0, &decode);
  for (int i = 0; code == EXR_ERR_SUCCESS && i < decode.channel_count; i++) {
    const char *name = decode.channels[i].channel_name, *place = strchr("RGB", name[0]);
    if (!name[0] || name[1] || !place) continue;
    found[place - "RGB"] = true;
    for (size_t k = 0; k < plane_count; k++)
      rgb[3 * k + (size_t)(place - "RGB")] = planes[(size_t)i * plane_count + k];
  }
  free(planes);
  exr_decoding_destroy(context, &decode);
  return code;
}

static slf_result get_exr(exr_context_t context, const char *path, float **rgb, uint32_t *width,
                          uint32_t *height, slf_error *error) {
  exr_storage_t storage;
  exr_attr_box2i_t window;
  exr_result_t code = exr_get_storage(context, 0, &storage);
  if (code == EXR_ERR_SUCCESS) code = exr_get_data_window(context, 0, &window);
  if (code != EXR_ERR_SUCCESS) return exr_failed(code, path, error);
  int64_t across = (int64_t)window.max.x - window.min.x + 1;
  int64_t down = (int64_t)window.max.y - window.min.y + 1;
  if (storage != EXR_STORAGE_SCANLINE || across < 1 || down < 1 || across > SLF_MAX_TEXELS ||
      down > SLF_MAX_TEXELS)
    return slf_fail(error, SLF_ERROR_ARGUMENT,
                    "%s: expected scan lines of at most %d x %d, found %s of %lld x %lld", path,
                    SLF_MAX_TEXELS, SLF_MAX_TEXELS,
                    storage == EXR_STORAGE_SCANLINE ? "some" : "another storage", (long long)across,
                    (long long)down);
  *width = (uint32_t)across;
  *height = (uint32_t)down;
  *rgb = malloc((size_t)across * (size_t)down * 3 * sizeof **rgb);
  if (!*rgb) return no_memory(path, error);
  bool found[3] = {false, false, false};
  for (int32_t y = window.min.y; y <= window.max.y;) {
    exr_chunk_info_t info;
    code = exr_read_scanline_chunk_info(context, 0, y, &info);
    if (code == EXR_ERR_SUCCESS)
      code = get_chunk(context, &info, *width,
                       *rgb + (size_t)(info.start_y - window.min.y) * *width * 3, found);
    if (code != EXR_ERR_SUCCESS) return exr_failed(code, path, error);
    y = info.start_y + info.height;
  }
  if (found[0] && found[1] && found[2]) return SLF_OK;
  return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: has no channels R, G and B", path);
}

static slf_result read_exr(const char *path, float **rgb, uint32_t *width, uint32_t *height,
                           slf_error *error) {
  exr_context_t context;
  exr_context_initializer_t init = initializer();
  exr_result_t code = exr_start_read(&context, path, &init);
  if (code != EXR_ERR_SUCCESS) return exr_failed(code, path, error);
  slf_result result = get_exr(context, path, rgb, width, height, error);
  exr_finish(&context);
  return result;
}

/* ---- PNG ----------------------------------------------------------------------------------- */

static slf_result write_png(const char *path, const float *rgb, uint32_t width, uint32_t height,
                            slf_error *error) {
  size_t samples = (size_t)width * height * 3;
  uint8_t *bytes = malloc(samples);
  if (!bytes) return no_memory(path, error);
  for (size_t i = 0; i < samples; i++) bytes[i] = slf_srgb_from_linear(rgb[i]);
  png_image image = {
      .version = PNG_IMAGE_VERSION, .width = width, .height = height, .format = PNG_FORMAT_RGB};
  bool written = png_image_write_to_file(&image, path, 0, bytes, 0, NULL);
  free(bytes);
  return written ? SLF_OK : slf_fail(error, SLF_ERROR_IO, "%s: %s", path, image.message);
}

static slf_result read_png(const char *path, float **rgb, uint32_t *width, uint32_t *height,
                           slf_error *error) {
  png_image image = {.version = PNG_IMAGE_VERSION};
  if (!png_image_begin_read_from_file(&image, path))
    return slf_fail(error, SLF_ERROR_IO, "%s: %s", path, image.message);
  image.format = PNG_FORMAT_RGB;
  *width = image.width;
  *height = image.height;
  size_t samples = (size_t)image.width * image.height * 3;
  uint8_t *bytes = malloc(samples);
  *rgb = malloc(samples * sizeof **rgb);
  slf_result result = SLF_OK;
  if (!bytes || !*rgb)
    result = no_memory(path, error);
  else if (!png_image_finish_read(&image, NULL, bytes, 0, NULL))
    result = slf_fail(error, SLF_ERROR_IO, "%s: %s", path, image.message);
  for (size_t i = 0; result == SLF_OK && i < samples; i++)
    (*rgb)[i] = slf_linear_from_srgb(bytes[i]);
  png_image_free(&image);
  free(bytes);
  return result;
}

/* ---- Either -------------------------------------------------------------------------------- */

slf_result slice_image_write(const char *path, const float *rgb, uint32_t u_count, uint32_t v_count,
                             slf_error *error) {
  bool exr = ends_in(path, ".exr");
  if (!exr && !ends_in(path, ".png"))
    return slf_fail(error, SLF_ERROR_ARGUMENT, "%s: expected .exr or .png", path);
  char temporary[4096];
  snprintf(temporary, sizeof temporary, "%s.part", path);
  slf_result result = exr ? write_exr(temporary, rgb, u_count, v_count, error)
                          : write_png(temporary, rgb, u_count, v_count, error);
  if (result == SLF_OK && rename(temporary, path) != 0)
    result = slf_fail(error, SLF_ERROR_IO, "%s: %s", path, strerror(errno));
  if (result != SLF_OK) remove(temporary);
  return result;
}

slf_result slice_image_read(const char *path, float **rgb, uint32_t *u_count, uint32_t *v_count,
                            slf_error *error) {
  *rgb = NULL;
  slf_result result;
  if (ends_in(path, ".exr"))
    result = read_exr(path, rgb, u_count, v_count, error);
  else if (ends_in(path, ".png"))
    result = read_png(path, rgb, u_count, v_count, error);
  else
    result = slf_fail(error, SLF_ERROR_ARGUMENT, "%s: expected .exr or .png", path);
  if (result == SLF_OK) return SLF_OK;
  free(*rgb);
  *rgb = NULL;
  return result;
}
