/* Steps to the centres of symmetry of beads: symmetric_steps.c. */

#ifndef PALPATE_SYMMETRIC_STEPS_H
#define PALPATE_SYMMETRIC_STEPS_H

#include "halving.h"

struct image {
    const struct halving *source; /* that makes the pixels, NULL where all are there */
    const uint8_t *pixels;
    int32_t height, width, colours; /* 1 or 3 */
};

struct symmetric_fit {
    struct image image;
    int32_t samples, padded_samples; /* of the arrays; samples are padded to a multiple of 4 */
    int32_t channels;                       /* that are fitted */
    int32_t rounds;
    float noise, least_variation, clipped_grey, clipped_sigma, clipped_share, max_step, far_step;
    float reach;              /* of the samples, bead diameters */
    const float *grid;        /* (2, padded_samples), bead diameters */
    const float *diameter_px; /* (beads), pixels of the image that is read */
    const float *weights;     /* (channels, 3) of B, G, R; not read for grey images */
    const int32_t *kind;      /* (beads), of the rows and the samples that are a bead's own */
    const float *own;         /* (kinds, padded_samples), 1 or 0 */
    const float *rows;        /* (kinds, padded_samples, COLUMNS) */
    const float *per_freedom; /* (beads) */
    const float *motion_gram; /* (beads, 3, PROFILES, PROFILES), for xx, xy and yy */
    int32_t *which;     /* (beads), the beads that are measured, and what is known of them: */
    double *position_px, *sigma;   /* (beads, 2), before and after; (beads) */
    float *explained, *clipped; /* (beads) */
};

int symmetric_fit_measure(const struct symmetric_fit *fit, int32_t count);

#endif
