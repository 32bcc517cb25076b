/* encode_stream.c - the blocks of a stream, to the scratch file. */
#include "codec/encode_parts.h"

#include "codec/parallel.h"

#include <inttypes.h>
#include <stdatomic.h>
#include <stdlib.h>

enum { GROUPS_A_TASK = 16 };

/* Where a place's coefficients come from: slices that were read, or the base's own mean. */
typedef struct {
  layer_encoder *encoder;
  stream_kind kind;
  const float *mean; /* base only: R G B a texel */
  unit_slices unit;
  uint64_t entry_count; /* of the unit */
  bit_string *entries;
} unit_task;

static void put_entries(void *context, uint64_t index) {
  const unit_task *task = context;
  layer_encoder *e = task->encoder;
  uint64_t error = 0;
  uint64_t places = layer_place_count(&e->layer);
  uint32_t run = e->layer.streams[task->kind].run_places;
  uint32_t parts_log2 = e->layer.streams[task->kind].parts_log2;
  uint64_t group_count = task->entry_count >> parts_log2;
  for (uint64_t group = index * GROUPS_A_TASK;
       group < (index + 1) * GROUPS_A_TASK && group < group_count; group++) {
    symbol_sink sinks[QUAD_SLICES];
    for (uint32_t part = 0; part < 1u << parts_log2; part++)
      sinks[part] = (symbol_sink){e, NULL, NULL, &task->entries[(group << parts_log2) + part]};
    place_state state = place_begin_entry(&e->layer.streams[task->kind]);
    for (uint64_t place = group * run; place < (group + 1) * run && place < places; place++) {
      coefficients blocks[QUAD_SLICES];
      place_transform(e, &task->unit, task->mean, place, blocks);
      for (int i = 0; i < 2 && e->left[i]; i++) state.left[i] = e->left[i][place];
      bool measured = task->kind != STREAM_BASE;
      error += encode_place(e, task->kind, &task->unit, place, blocks, sinks, measured, &state);
    }
  }
  atomic_fetch_add(&e->squared_error, error);
}

static slf_result put_unit(unit_task *task, stream_writer *writer, slf_error *error) {
  layer_encoder *e = task->encoder;
  task->entry_count = e->layer.streams[task->kind].entries_per_unit;
  task->entries = calloc(task->entry_count, sizeof *task->entries);
  if (!task->entries)
    return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory for %" PRIu64 " entries", e->name,
                    task->entry_count);
  parallel_for(e->thread_count, (task->entry_count + GROUPS_A_TASK - 1) / GROUPS_A_TASK,
               put_entries, task);
  for (uint64_t i = 0; i < task->entry_count; i++) {
    stream_put(writer, &task->entries[i]);
    bits_free(&task->entries[i]);
  }
  free(task->entries);
  return SLF_OK;
}

slf_result encode_stream(layer_encoder *e, stream_kind kind, const float *mean,
                         encoded_chunk *encoded, double progress_begin, slf_error *error) {
  layer_stream *stream = &e->layer.streams[kind];
  unit_task task = {.encoder = e, .kind = kind, .mean = mean, .unit = {{0}, {0}, 1}};
  stream_writer writer = {0};
  slf_result result = codes_make(e, kind, mean, error);
  uint32_t index_count = mean ? 1 : unit_index_count(&e->layer, kind), done = 0;
  stream_begin(&writer, e->scratch, &stream->blocks);
  for (uint32_t index = 0; index < index_count && result == SLF_OK; index++) {
    if (!mean) {
      task.unit = unit_at(&e->layer, kind, index);
      if (!task.unit.slice_count) continue;
      result = unit_read(e, &task.unit, error);
    }
    if (result == SLF_OK) result = put_unit(&task, &writer, error);
    done++;
    if (e->source->progress && kind == STREAM_REST)
      e->source->progress(e->source->context,
                          progress_begin + (1 - progress_begin) * done / stream->unit_count);
  }
  stream->payload_bits = writer.payload_bit_count;
  if (result == SLF_OK) result = stream_finish(&writer, e->name, &encoded->nbytes, error);
  stream_writer_free(&writer);
  encoded->offset = writer.begin;
  if (result != SLF_OK || kind == STREAM_REST) return result;
  /* From here on the stream can be decoded: what follows is predicted from it. */
  result = scratch_map_part(e->scratch, encoded->offset, encoded->nbytes, e->name, &e->maps[kind],
                            error);
  if (result != SLF_OK) return result;
  stream->blocks.bytes = e->maps[kind].bytes;
  stream->blocks.nbytes = encoded->nbytes;
  stream->tables = malloc(sizeof *stream->tables);
  if (!stream->tables) return slf_fail(error, SLF_ERROR_MEMORY, "%s: no memory", e->name);
  block_tables_make(&stream->codes, stream->tables);
  return SLF_OK;
}
