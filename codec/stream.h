/* stream.h - a chunk of C-Blocks: runs of bits, found by their number.
 *
 * A stream is a list of entries, each some bits long, in pairs: the first one's bytes go up from
 * where the pair begins, the second one's down from where it ends. 128 pairs make a segment: their
 * offsets in Elias-Fano form, then their bytes. A directory of 6 bytes a segment finds the
 * segments. FORMAT.md, "Block streams". */
#ifndef SLF_STREAM_H
#define SLF_STREAM_H

#include "codec/scratch.h"

enum {
  SEGMENT_PAIRS = 128,
  DIRECTORY_ENTRY_NBYTES = 6,
  STREAM_PAD_NBYTES = 16 /* zeros at the end, so that a reader may load 8 bytes anywhere before */
};

typedef struct {
  const uint8_t *bytes;
  uint64_t nbytes;      /* at least STREAM_PAD_NBYTES */
  uint64_t entry_count; /* even */
} block_stream;

static inline uint64_t stream_segment_count(const block_stream *stream) {
  return (stream->entry_count / 2 + SEGMENT_PAIRS - 1) / SEGMENT_PAIRS;
}

/* A growing string of bits, most significant first. After an allocation failed it takes no more and
 * says so: `failed` is asked once, at the end. */
typedef struct {
  uint8_t *bytes;
  size_t capacity_nbytes;
  uint64_t bit_count;
  bool failed;
} bit_string;

void bits_put(bit_string *bits, uint32_t value, unsigned count); /* count 0 .. 32 */
void bits_append(bit_string *bits, const bit_string *more);
void bits_free(bit_string *bits);

/* Writes a stream to the end of a scratch file, a segment at a time. */
typedef struct {
  scratch_file *to;
  uint64_t begin, directory_nbytes; /* the stream's place in the file, its directory's size */
  uint64_t directory_at;            /* where in the file the directory goes on, */
  bit_string directory;             /* with these whole bytes */
  uint64_t segments_nbytes;         /* so far */
  bit_string segment;               /* the entries of the segment that is being filled */
  uint64_t offsets[SEGMENT_PAIRS];  /* of its pairs, in bytes */
  uint64_t entry_count;
  uint64_t payload_bit_count;
} stream_writer;

/* Begins a stream with the entry_count of `stream`. */
void stream_begin(stream_writer *writer, scratch_file *to, const block_stream *stream);

/* Appends an entry, in order. */
void stream_put(stream_writer *writer, const bit_string *entry);

/* Ends the stream: it is the last *nbytes of the scratch file. */
slf_result stream_finish(stream_writer *writer, const char *name, uint64_t *nbytes,
                         slf_error *error);
void stream_writer_free(stream_writer *writer);

#endif
