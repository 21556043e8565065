/* The motion of the skin: see estimation/skin_motion.py. Sums over neighbours in single precision. */

#include "small_matrices.h"

#define SUMS 3  /* of a bead's neighbours: displacement x and y times the weight, the weight */

struct skin_motion {
    int32_t beads, padded_beads;
    const float *neighbours; /* (beads, 2, padded beads): of each bead to all, as averaged, without itself */
    const double *reference_px; /* (beads, 2) */
    const double *spacing_px; /* (beads,) */
    const double *exact_variance; /* (beads,): of the average with all beads exact */
    const double *position_px; /* (beads, 2) */
    const double *weight; /* (beads,) */
    const uint8_t *found; /* (beads,) */
    float *columns; /* (3, beads) */
    float *sums; /* (3, 2, padded beads) */
    float *squared_sums; /* (padded beads,) */
    double *displacement_px; /* (beads, 2) */
    double *motion; /* (3,): size_px, roughness, noise */
};

static inline double at_least(double value, double least) { return value < least ? least : value; }

/* Sums over a bead's neighbours of their squared weights in the average times their own. */
static void sum_squares(const struct skin_motion *skin) {
    int32_t row = skin->padded_beads;
    float *restrict sums = skin->squared_sums;
    for (int32_t i = 0; i < row; i++)
        sums[i] = 0.0f;
    for (int32_t b = 0; b < skin->beads; b++) {
        const float *restrict average = skin->neighbours + 2 * (int64_t)b * row;
        float weight = (float)skin->weight[b];
        for (int32_t i = 0; i < row; i++)
            sums[i] += weight * average[i] * average[i];
    }
}

/* all_exact: whether all beads are found and exact: then each average counts the same. */
KERNEL int skin_motion(const struct skin_motion *skin, int32_t all_exact) {
    int32_t beads = skin->beads, row = skin->padded_beads, found = 0;
    const float *average = skin->sums, *others = skin->sums + row;
    double share_sum = 0.0, size = 0.0, roughness = 0.0, *displacement = skin->displacement_px;
    for (int32_t b = 0; b < beads; b++) {
        float weight = (float)skin->weight[b];
        for (int axis = 0; axis < 2; axis++) {
            displacement[2 * b + axis] = skin->position_px[2 * b + axis] - skin->reference_px[2 * b + axis];
            skin->columns[axis * beads + b] = (float)(displacement[2 * b + axis] * (double)weight);
        }
        skin->columns[2 * beads + b] = weight;
    }
    multiply(skin->neighbours, beads, 2 * row, skin->columns, beads, skin->sums, 2 * row, SUMS);
    if (!all_exact)
        sum_squares(skin);
    for (int32_t b = 0; b < beads; b++) {
        if (!skin->found[b])
            continue;
        found++;
        double total = at_least((double)average[4 * row + b], 1e-12);
        double others_total = at_least((double)others[4 * row + b], 1e-12), square = 0.0, rough = 0.0;
        for (int axis = 0; axis < 2; axis++) {
            double mean = (double)average[2 * axis * row + b] / total;
            double away = displacement[2 * b + axis] - (double)others[2 * axis * row + b] / others_total;
            square += mean * mean;
            rough += away * away;
        }
        double share = 1.0;
        if (!all_exact) {
            double sum = at_least((double)average[4 * row + b], 1e-9);
            share = skin->exact_variance[b] * sum * sum / at_least((double)skin->squared_sums[b], 1e-12);
            share = share > 1.0 ? 1.0 : share;
        }
        share_sum += share;
        size += share * square;
        roughness += rough * skin->weight[b] / (skin->spacing_px[b] * skin->spacing_px[b]);
    }
    skin->motion[0] = found ? __builtin_sqrt(size / share_sum) : 0.0;
    skin->motion[1] = found ? __builtin_sqrt(roughness / found) : 0.0;
    skin->motion[2] = found ? at_least(__builtin_sqrt(found / share_sum), 1.0) : 1.0;
    return 0;
}
