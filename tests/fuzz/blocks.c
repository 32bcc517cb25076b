/* Any bytes as C-Blocks and index of a good layer: every block decodes to something, alone and in
 * batches alike. */
#include "codec/format.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

enum { SCHEMES = 4, SIDE = 20, DIRECTIONS = 6, MAX_BLOCKS = 36 * 9 };

static uint8_t *files[SCHEMES];
static size_t sizes[SCHEMES];

static slf_result read_slice(void *context, uint32_t s, uint32_t t, float *rgb, slf_error *error) {
  (void)context;
  (void)error;
  for (uint32_t i = 0; i < SIDE * SIDE * 3; i++)
    rgb[i] = (float)((i * i + s * 131 + t * 517) % 251) / 251;
  return SLF_OK;
}

static void make_file(int scheme) {
  char path[64];
  snprintf(path, sizeof path, "/tmp/slf_fuzz.%ld.slf", (long)getpid());
  slf_writer *writer;
  slf_error error;
  slf_surface surface = {.name = "fuzz"};
  slf_layer_options options = {.angular = (slf_angular)scheme,
                               .u_count = SIDE,
                               .v_count = SIDE,
                               .s_count = DIRECTIONS,
                               .t_count = DIRECTIONS,
                               .quality = 60};
  slf_source source = {read_slice, NULL, NULL};
  if (slf_writer_create(path, &writer, &error) ||
      slf_writer_add_surface(writer, &surface, &error) ||
      slf_writer_add_layer(writer, &options, &source, &error) || slf_writer_finish(writer, &error))
    abort();
  FILE *f = fopen(path, "rb");
  fseek(f, 0, SEEK_END);
  sizes[scheme] = (size_t)ftell(f);
  rewind(f);
  files[scheme] = malloc(sizes[scheme]);
  if (fread(files[scheme], 1, sizes[scheme], f) != sizes[scheme]) abort();
  fclose(f);
  unlink(path);
}

/* The streams' chunks are the last ones, and they end the file. */
static uint64_t streams_begin(const uint8_t *file) {
  for (uint32_t i = 0; i < get_u32(file + 12); i++) {
    const uint8_t *entry = file + HEADER_NBYTES + (size_t)i * CHUNK_ENTRY_NBYTES;
    for (int kind = 0; kind < 3; kind++)
      if (get_u32(entry) == slf_stream_chunks[kind]) return get_u64(entry + 16);
  }
  abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t nbytes);
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t nbytes) {
  if (nbytes < 2) return 0;
  int scheme = bytes[0] % SCHEMES;
  if (!files[scheme]) make_file(scheme);
  uint8_t *copy = malloc(sizes[scheme]);
  memcpy(copy, files[scheme], sizes[scheme]);
  uint64_t begin = streams_begin(copy), at = begin + bytes[1] * (sizes[scheme] - begin) / 256;
  for (size_t i = 2; i < nbytes && at < sizes[scheme]; i++, at++) copy[at] ^= bytes[i];
  slf_file *file;
  slf_error error;
  if (slf_open_memory(copy, sizes[scheme], "fuzz", &file, &error) != SLF_OK) abort();
  static uint8_t blocks[MAX_BLOCKS][SLF_BLOCK_NBYTES];
  static uint8_t *pointers[MAX_BLOCKS];
  slf_block_address addresses[MAX_BLOCKS];
  for (uint32_t i = 0; i < MAX_BLOCKS; i++) {
    uint32_t slice = i / 9 * 7 % 36;
    addresses[i] = (slf_block_address){(uint16_t)(slice % 6), (uint16_t)(slice / 6),
                                       (uint16_t)(i % 3), (uint16_t)(i / 3 % 3)};
    pointers[i] = blocks[i];
  }
  slf_decode_blocks(file, 0, 0, addresses, MAX_BLOCKS, pointers);
  for (uint32_t i = 0; i < MAX_BLOCKS; i += 5) {
    uint8_t single[SLF_BLOCK_NBYTES];
    slf_decode_block(file, 0, 0, addresses[i], single);
  }
  slf_close(file);
  free(copy);
  return 0;
}
