/* Any bytes as a file, and their first part as a prefix: refused, or verified and decoded
 * somewhere. Checksums are set right first, or nothing would get past them. */
#include "codec/format.h"

#include <stdlib.h>

static void put_crcs(uint8_t *bytes, size_t nbytes) {
  if (nbytes < HEADER_NBYTES) return;
  memcpy(bytes, slf_magic, sizeof slf_magic);
  put_u16(bytes + 8, VERSION_MAJOR);
  put_u64(bytes + 16, nbytes);
  uint64_t count = get_u32(bytes + 12) & 63, table = count * CHUNK_ENTRY_NBYTES;
  put_u32(bytes + 12, (uint32_t)count);
  if (table <= nbytes - HEADER_NBYTES) {
    for (uint64_t i = 0; i < count; i++) {
      uint8_t *entry = bytes + HEADER_NBYTES + i * CHUNK_ENTRY_NBYTES;
      uint64_t offset = get_u64(entry + 16), chunk_nbytes = get_u64(entry + 24);
      if (offset <= nbytes && chunk_nbytes <= nbytes - offset)
        put_u32(entry + 8, slf_crc32(bytes + offset, chunk_nbytes));
    }
    put_u32(bytes + 24, slf_crc32(bytes + HEADER_NBYTES, table));
  }
  put_u32(bytes + 28, slf_crc32(bytes, 28));
}

static void decode_some(const slf_file *file, uint32_t surface, uint32_t layer_index) {
  const slf_layer *layer = &slf_get_surface(file, surface)->layers[layer_index];
  uint8_t block[SLF_BLOCK_NBYTES];
  for (uint32_t i = 0; i < 64; i++) {
    slf_block_address a = {(uint16_t)(i * 37 % layer->s_count), (uint16_t)(i * 61 % layer->t_count),
                           (uint16_t)(i * 17 % layer->block_u_count),
                           (uint16_t)(i * 29 % layer->block_v_count)};
    slf_decode_block(file, surface, layer_index, a, block);
  }
}

static void decode_prefix(const uint8_t *bytes, size_t nbytes) {
  uint8_t *copy = malloc(nbytes + 1);
  slf_file *file;
  slf_error error;
  memcpy(copy, bytes, nbytes);
  if (slf_open_prefix_memory(copy, nbytes, "fuzz", &file, &error) == SLF_OK)
    for (uint32_t i = 0; i < slf_surface_count(file); i++)
      for (uint32_t k = 0; k < slf_get_surface(file, i)->layer_count; k++) decode_some(file, i, k);
  slf_close(file);
  free(copy);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t nbytes);
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t nbytes) {
  uint8_t *copy = malloc(nbytes + 1);
  slf_file *file;
  slf_error error;
  memcpy(copy, bytes, nbytes);
  put_crcs(copy, nbytes);
  if (slf_open_memory(copy, nbytes, "fuzz", &file, &error) == SLF_OK) {
    for (uint32_t i = 0; i < slf_surface_count(file); i++)
      for (uint32_t k = 0; k < slf_get_surface(file, i)->layer_count; k++) decode_some(file, i, k);
    if (slf_file_nbytes(file) < 4096) slf_verify(file, &error);
  }
  slf_close(file);
  if (nbytes) decode_prefix(copy, nbytes * bytes[nbytes - 1] / 255);
  free(copy);
  return 0;
}
