/* Weighted centroids of beads, each in a small window: centroids.c. */

#ifndef PALPATE_CENTROIDS_H
#define PALPATE_CENTROIDS_H

#include "halving.h"

struct plane {
    const struct halving *source; /* that makes the pixels, NULL where all are there */
    const void *pixels;           /* (height, width), bytes or floats */
    int32_t is_bytes, height, width;
};

struct centroid_finder {
    struct plane plane;
    int32_t side, reach, stride; /* of the windows; stride: side, up to a multiple of AT_ONCE */
    int32_t per_bead;            /* whether each bead has weights of its own */
    int32_t is_shaded;           /* by a light: then `unlit` and `slope` count */
    int32_t pixels_reach;        /* of all pixels about a bead that are read */
    float gate, unlit, darkest_skin;
    double max_step;             /* bead diameters */
    const int32_t *circles;      /* (beads, CIRCLE, 2), steps (column, row): to the skin, in the bead */
    const float *ranks; /* (2, SKIN_PIXELS): weights of the skin's sorted pixels in its grey, its variation */
    const float *added; /* (beads or 1, side, stride), to the weights of a window's pixels */
    const float *slope; /* (beads, 2), of the skin's grey over the contrast */
    const double *slope_shift; /* (beads, 2), which the slope adds to the centroid */
    const float *half_area; /* (beads) */
    const float *max_unevenness; /* (beads); from more on the skin's slope in the frame is subtracted */
    const double *diameter; /* (beads) */
    float *window; /* (side, stride), memory to work in; 0 beyond the side */
    int32_t *which; /* (beads), the beads that are looked for, where, and what is found: */
    double *start; /* (beads, 2) */
    float *min_contrast; /* (beads) */
    double *place; /* (beads, 2) */
    float *contrast, *area, *unevenness;
    uint8_t *converged;
    int32_t *windows;
    uint8_t *levelled; /* whether the skin's slope was subtracted */
};

int find_centroids(const struct centroid_finder *finder, int32_t count, int32_t max_steps, int32_t max_faint,
                   double converged_step);

#endif
