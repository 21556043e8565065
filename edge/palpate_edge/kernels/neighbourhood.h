/* Missing beads displaced like their neighbours: neighbourhood.c. */

#ifndef PALPATE_NEIGHBOURHOOD_H
#define PALPATE_NEIGHBOURHOOD_H

#include "kernels.h"

struct neighbourhood {
    int32_t beads;              /* n */
    double least_weight;        /* of all found neighbours; with less, weights are scaled first */
    const double *reference_px; /* (n, 2) */
    const double *weight;       /* (n, n) row i: of the neighbours of bead i */
    const double *relative;     /* (n, n) row i: their distances, of which the weights are Gaussians */
    double *position_px;        /* (n, 2) input */
    uint8_t *found;             /* (n) input */
    int64_t *missing;           /* (n) input: beads to predict, the first ones of the array */
    double *moved_px;           /* (n, 3) scratch: displacements of the found beads, and 1; 0 of others */
    double *predicted_px;       /* (n, 2) result: places of the missing beads */
};

int32_t predict_missing(const struct neighbourhood *p, const double *position_px, const uint8_t *found);

#endif
