/* The displacement that a moved camera makes, and the dent: see estimation/camera_motion.py. */

#include "small_matrices.h"

#define MOTIONS 6
#define SUMS 3  /* of a bead's neighbours: dent x and y times the weight, the weight */

struct camera_motion {
    int32_t beads, padded_beads;
    const double *modes;     /* (beads, 2, 6) */
    const float *neighbours; /* (beads, padded beads): weights of each bead to all in their averages */
    const double *displacement_px; /* (beads, 2) */
    const double *weight;    /* (beads,) */
    const uint8_t *found;    /* (beads,) */
    float *columns;          /* (3, beads) */
    float *sums;             /* (3, padded beads) */
    double *common_px;       /* (beads, 2) */
    double *dent_px;         /* (beads, 2) */
    double *size_px;         /* (1,): of the averaged dent */
};

/* The common part of the displacement, by weighted least squares, and the dent of the found beads. */
KERNEL int camera_motion(const struct camera_motion *motion) {
    double normal[MOTIONS * MOTIONS] = {0.0}, amounts[MOTIONS] = {0.0};
    for (int32_t k = 0; k < 2 * motion->beads; k++) {
        const double *mode = motion->modes + (int64_t)k * MOTIONS;
        for (int i = 0; i < MOTIONS; i++) {
            double weighted = motion->weight[k / 2] * mode[i];
            amounts[i] += weighted * motion->displacement_px[k];
            for (int j = i; j < MOTIONS; j++)
                normal[i * MOTIONS + j] += weighted * mode[j];
        }
    }
    factorise(normal, MOTIONS);
    solve_factorised(normal, MOTIONS, amounts);
    for (int32_t k = 0; k < 2 * motion->beads; k++) {
        double common = dot(motion->modes + (int64_t)k * MOTIONS, amounts, MOTIONS);
        motion->common_px[k] = common;
        motion->dent_px[k] = motion->found[k / 2] ? motion->displacement_px[k] - common : 0.0;
    }
    return 0;
}

/* The root mean square, over the found beads, of the dent averaged over their neighbours. */
KERNEL int dent_size(const struct camera_motion *motion) {
    int32_t beads = motion->beads, row = motion->padded_beads, found = 0;
    double square = 0.0;
    for (int32_t b = 0; b < beads; b++) {
        float weight = (float)motion->weight[b];
        motion->columns[b] = (float)(motion->dent_px[2 * b] * (double)weight);
        motion->columns[beads + b] = (float)(motion->dent_px[2 * b + 1] * (double)weight);
        motion->columns[2 * beads + b] = weight;
    }
    multiply(motion->neighbours, beads, row, motion->columns, beads, motion->sums, row, SUMS);
    for (int32_t b = 0; b < beads; b++) {
        if (!motion->found[b])
            continue;
        found++;
        const float *sums = motion->sums + b;
        double x = (double)sums[0], y = (double)sums[row], total = (double)sums[2 * row];
        total = total < 1e-12 ? 1e-12 : total;
        square += (x * x + y * y) / (total * total);
    }
    motion->size_px[0] = found ? __builtin_sqrt(square / found) : 0.0;
    return 0;
}
