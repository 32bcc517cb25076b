/* encode.h - from slices to a layer's chunks. */
#ifndef SLF_ENCODE_H
#define SLF_ENCODE_H

#include "codec/layer.h"

typedef struct {
  uint8_t *header, *blocks; /* malloc, the caller's */
  uint64_t header_nbytes, blocks_nbytes;
} encoded_layer;

/* `name` is for messages. On failure *encoded holds nothing. */
slf_result encode_layer(const slf_layer_options *options, const slf_source *source,
                        const char *name, encoded_layer *encoded, slf_error *error);

#endif
