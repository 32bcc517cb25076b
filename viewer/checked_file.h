/* checked_file.h - an open .slf file whose blocks are being checked in the background.
 *
 * slf_open checks the structure at once; the checksums of all C-Blocks take as long as reading the
 * whole file, so a thread of its own does that while the first frames are drawn. */
#ifndef CHECKED_FILE_H
#define CHECKED_FILE_H

#include "slf.h"

typedef struct checked_file checked_file;

/* *out is NULL on failure. `coming`: the file may be the first bytes of one that is still to come
 * (slf_open_prefix), whose check ends with SLF_ERROR_PARTIAL. Closing waits for the check; it
 * accepts NULL. */
slf_result checked_file_open(const char *path, bool coming, checked_file **out, slf_error *error);
void checked_file_close(checked_file *c);

const slf_file *checked_file_get(const checked_file *c);
const char *checked_file_path(const checked_file *c);
/* Whether the check is over; if so *result and *error say how it ended. Does not wait. */
bool checked_file_done(const checked_file *c, slf_result *result, slf_error *error);
/* Waits for the check and gives its result. */
slf_result checked_file_wait(checked_file *c, slf_error *error);

#endif
