/* file.h - an open file. */
#ifndef SLF_FILE_H
#define SLF_FILE_H

#include "codec/layer.h"

typedef struct {
  uint32_t type, surface, layer;
  uint32_t crc;
  uint64_t offset, nbytes;
} chunk;

typedef struct {
  slf_surface public;
  layer_state *layers;
  slf_layer *public_layers;
  slf_vertex *vertices;
  uint32_t *triangles;
} surface_state;

struct slf_file {
  const uint8_t *bytes;
  uint64_t nbytes;
  bool prefix;           /* bytes may be the first ones only, of */
  uint64_t whole_nbytes; /* so many */
  bool mapped;
  char name[256];
  uint32_t chunk_count, surface_count, view_count;
  chunk *chunks;
  surface_state *surfaces;
  slf_view *views;
  float background[3];
};

#endif
