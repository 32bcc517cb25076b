/* video.h - pictures one after the other into a video file, encoded by the ffmpeg program. */
#ifndef VIDEO_H
#define VIDEO_H

#include "slf.h"

typedef struct video video;

/* Whether the name's ending is one of a video: .mp4 .mkv .webm .gif */
bool video_is_name(const char *path);

/* Starts ffmpeg, which writes a temporary file beside `path`. *out is NULL on failure. */
slf_result video_start(const char *path, int width_px, int height_px, double frames_per_s,
                       video **out, slf_error *error);
/* A picture of that size: rows of R G B A from the top. */
slf_result video_add(video *v, const uint8_t *rgba, slf_error *error);
/* Waits for ffmpeg and renames the file. Frees v, as video_abort does, which removes the file and
 * accepts NULL. */
slf_result video_finish(video *v, slf_error *error);
void video_abort(video *v);

#endif
