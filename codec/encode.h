/* encode.h - from slices to a layer's chunks. */
#ifndef SLF_ENCODE_H
#define SLF_ENCODE_H

#include "codec/layer.h"

/* A chunk's bytes, in a scratch file. */
typedef struct {
  uint64_t offset, nbytes; /* nbytes 0: there is none */
} encoded_chunk;

typedef struct {
  encoded_chunk header, streams[STREAM_COUNT];
  double psnr, ratio;
} encoded_layer;

/* Appends a layer's chunks to the scratch file. `name` is for messages. */
slf_result encode_layer(const slf_layer_options *options, const slf_source *source,
                        scratch_file *scratch, const char *name, encoded_layer *encoded,
                        slf_error *error);

#endif
