/* encode.h - from slices to a layer's chunks. */
#ifndef SLF_ENCODE_H
#define SLF_ENCODE_H

#include "codec/layer.h"

typedef struct {
  uint8_t *bytes; /* malloc, the caller's */
  uint64_t nbytes;
} encoded_stream;

typedef struct {
  encoded_stream header, streams[STREAM_COUNT]; /* bytes NULL: the layer has none */
  double psnr, ratio;
} encoded_layer;

/* `name` is for messages. On failure *encoded holds nothing. */
slf_result encode_layer(const slf_layer_options *options, const slf_source *source,
                        const char *name, encoded_layer *encoded, slf_error *error);
void encoded_layer_free(encoded_layer *encoded);

#endif
