/* depth_kernel.h - eight texels at once of the mix by depth (depth_mix.h): the inner loop, compiled
 * for plain C and for AVX2, with the same results. */
#ifndef DEPTH_KERNEL_H
#define DEPTH_KERNEL_H

#include "depth_frames.h"
#include "depth_pages.h"
#include "resample.h"

enum { LANES = 8 };

/* What is read: light, heights, and where they are seen from. */
typedef struct {
  depth_pages pages;
  depth_frame *frames; /* of a curved surface's texels; NULL for a flat one */
  float unit;          /* of the heights */
  float (*slopes)[2]; /* of each slice by number (depth_pages.h), texels a unit of height; NAN where
                         there is no slice */
  slf_slab slab;
  float (*through)[2];    /* of each slice, as slopes: texels that it passes on its way through the
                             slab;    NULL: there is none */
  float texel_u, texel_v; /* texels of light per texel mixed */
  float scale[4];         /* see flat_texel_scale */
  float sharpen;          /* outlines by so much */
  bool shared; /* with other threads: a page that is not there is noted, not brought in */
  bool missed; /* one was not there: what came out is worth nothing */
} depth_field;

/* The rays of a block's texels, 8 row + column. Slopes are as those of the slices. */
typedef struct {
  float x, y; /* of the block's first texel */
  float qx[64], qy[64];
  float through_x[64], through_y[64]; /* texels passed on the way through a slab */
  int32_t cell[64];   /* the slice before it, along S and along T: the first of the four around */
  float f[64], g[64]; /* how far it is from there to the next, along S and T */
  float code[64];     /* of the height that was found, below 0 for none, as at first */
  float score[64];    /* of that height: weight of slices that agree on it, less of those that look
                         through it */
  float met[64][4];   /* code at which the ray, where it was followed, and each of the four slices
                         around met, below 0 for not */
  uint16_t rgba[64][4]; /* linear, as half floats; A = 1 */
  /* Of what covers texels in part: its light, as much of it, how much, and the code of its height.
   */
  uint16_t front[64][4];
  float coverage[64], front_code[64];
} depth_rays;

/* How a texel was mixed. */
enum {
  SEEN_UNKNOWN, /* not yet */
  SEEN_NEAR,    /* by the four slices around */
  SEEN_WIDE,    /* by sixteen */
  SEEN_NOT      /* by none */
};

enum { NO_CODE = UINT16_MAX };

/* What was found for a block's texels. */
typedef struct {
  uint16_t code[64];  /* of the height, in 1/256 */
  uint16_t front[64]; /* of what covers it in part; NO_CODE for nothing */
  int8_t score[64];   /* in 1/100 */
  uint8_t kind[64];
} depth_memory;

/* Of a block, which its neighbours ask for. */
typedef enum { RIM_LEFT, RIM_RIGHT, RIM_ABOVE, RIM_BELOW } rim_side;
typedef struct {
  /* Of the texels along each side; NO_CODE where no slice served them. The latter are those of what
   * covers texels in part, where something does. */
  uint16_t codes[4][8], lowest[4][8];
} depth_rim;

/* Texels beside which, in their block or the next ones, something lower was found than for them, or
 * something higher, and codes of that: the lowest of each texel's own and its neighbours', with
 * what covers those in part, and the highest of its neighbours'. */
typedef struct {
  uint64_t lower, higher;
  uint16_t lowest[64], highest[64];
} depth_outline;

/* Up to eight guesses of texels' heights: codes to begin with, and the scores for which what is
 * found is taken. The first of several for a texel that is good counts. Lanes beyond `count` repeat
 * the first. */
typedef struct {
  uint8_t texels[LANES];
  int count;
  float codes[LANES], wanted[LANES];
} depth_guess;

/* Of the four slices around, bits 0 to 3, and beside them. */
enum { ALL_SLICES = 0xf, GUESS_ITSELF = 0x10 };

typedef struct {
  /* The rays of block (block_u, block_v) for its directions. */
  void (*place)(const depth_field *field, uint32_t block_u, uint32_t block_v,
                const block_directions *directions, depth_rays *rays);
  /* The texels whose height most of the slices around knew, and what lies beside texels. */
  uint64_t (*find_steady)(const depth_memory *last, const depth_rim *const around[4],
                          depth_outline *beside);
  /* The texels of that kind. */
  uint64_t (*find_kind)(const uint8_t kinds[64], uint8_t kind);
  /* Mixes those of the texels for whose height there is good evidence among the four slices around;
   * returns them. */
  uint64_t (*mix)(depth_field *field, depth_rays *rays, const depth_guess *guess);
  /* The paper's way, at the texels themselves. */
  void (*mix_four_tap)(depth_field *field, depth_rays *rays, const depth_guess *texels);
  /* As mix, but follows slices along the rays, those of the mask, and with GUESS_ITSELF judges the
   * guesses beside what they meet. */
  uint64_t (*seek)(depth_field *field, depth_rays *rays, const depth_guess *guess, unsigned slices);
  /* The same of one texel, which is to reach `wanted`, `reach` slices each way: 1 for the four
   * around, 2 for sixteen, of which the four have been followed before and the corners are only
   * asked. */
  bool (*seek_alone)(depth_field *field, depth_rays *rays, uint32_t texel, int reach, float wanted);
  /* With the sixteen slices around, at the height given, if that has the score. */
  bool (*mix_wide)(depth_field *field, depth_rays *rays, uint32_t texel, float code, float wanted);
  /* Mixes texels near the heights where they were, without regard to edges; returns those that it
   * could. All that they need is asked for before any of it is read. Other texels of the same rows
   * are overwritten. */
  uint64_t (*mix_steady)(depth_field *field, depth_rays *rays, const depth_memory *last,
                         uint64_t texels);
  /* How much of texels is covered by a thing at the heights guessed: mixes those that are wholly,
   * which it returns, from what shows the thing; keeps the thing's light for those that are
   * partly, */
  uint64_t (*cover)(depth_field *field, depth_rays *rays, const depth_guess *guess,
                    uint64_t *partly);
  /* and lays it over what they were mixed from. */
  void (*lay_over)(depth_rays *rays, uint64_t texels);
  /* Keeps what was found for the texels of the mask, of which some are covered in part. */
  void (*remember)(const depth_rays *rays, const uint8_t kinds[64], uint64_t mask, uint64_t partly,
                   depth_memory *now, depth_rim *rim);
} depth_kernel;

/* For any surface, and for flat mirrors, which have neither frames nor a slab. */
extern const depth_kernel depth_kernel_plain, depth_kernel_avx2, depth_kernel_plain_flat,
    depth_kernel_avx2_flat;

/* Thresholds, of all mixing by depth: see depth_mix.c. */
enum {
  EDGE_CODES = SLF_THING_CODES,
  STEP_TEXELS = 2,      /* that a ray is followed through a slice by, */
  MAX_STEPS = 48,       /* so many times, */
  MAX_HIDDEN_STEPS = 2, /* so many of them one after the other behind what the slice sees */
  CURVED_STEPS = 6,
  /* Of Newton's steps to where a slice of a curved surface sees a point, the longest, in texels, */
  LONGEST_STEP = 24,
  MEET_STEPS = 5 /* and how many */
};
/* Texels by which the last of them may still have moved. */
#define SETTLED_TEXELS 0.3f
/* A slice is not followed that looks so far aslant that it would not be followed to this height, in
 * units, or that has hardly any weight. */
#define LEAST_REACH 0.1f
#define LEAST_WITNESS 0.03f
/* Coverage that is interpolated between texels rises three quarters as steeply across an outline as
 * a texel's own would: by how much it is made steeper, and where finer texels are mixed. */
#define SHARPEN (4.0f / 3)
#define SHARPEN_FINER 1.7f
/* Codes by which what covers a texel lies off its guess for another look to be taken. */
#define LEAST_MOVE 0.5f
/* What covers less of a texel does not count. */
#define LEAST_COVERAGE 0.01f
/* What is lower hides what is higher if it is judged this well beside it. */
#define LOWER_SHARE 0.2f
/* A slice on the rim of the neighbourhood keeps this weight: its word on visibility counts. */
#define LEAST_WEIGHT 0.01f
/* Scores are shares of the weight of those slices that reach the place at all, or of this much:
 * what lies beyond a surface's rim has no say. */
#define LEAST_SEEING 0.5f
/* The weight of slices that must agree for no more to be asked. */
#define ALL_AGREE 0.85f
/* The weight of slices that must agree for a height to be steady. */
#define MOST_AGREE 0.3f
/* How far apart two heights may be and still be one: codes, slopes and edges are not exact. */
#define TOLERANCE_UNITS 0.005f
#define TOLERANCE_SHARE 0.03f
/* How much less than last time, or than a neighbour's, a score may be, as directions change. */
#define SCORE_SLACK 0.25f
/* Scores below which a height is none, of the four slices around and of more. */
#define LEAST_NEAR 0.15f
#define LEAST_WIDE 0.01f

#endif
