/* The motion of the skin: see estimation/skin_motion.py. Sums over neighbours in single precision. */

#include "small_matrices.h"

#define MOTIONS 6
#define SUMS 3  /* of a bead's neighbours: x and y times the weight, the weight */

struct skin_motion {
    int32_t beads, padded_beads;
    const float *neighbours; /* (beads, 2, padded beads): of each bead to all, as averaged, without itself */
    const float *dented; /* (beads, padded beads): of each bead to all in the average of a dent */
    const double *modes; /* (beads, 2, 6): displacements that a moved camera makes */
    const double *reference_px; /* (beads, 2) */
    const double *moved_rest_px; /* (beads, 2): with the drift */
    const double *without_slopes; /* (beads, 2, 2): of displacements, to those without the drift */
    const double *spacing_px; /* (beads,) */
    const double *exact_variance; /* (beads,): of the average with all beads exact */
    const double *position_px; /* (beads, 2) */
    const double *weight; /* (beads,) */
    const uint8_t *found; /* (beads,) */
    float *columns; /* (3, beads) */
    float *sums; /* (3, 2, padded beads) */
    float *squared_sums; /* (padded beads,) */
    double *moved_px; /* (4, beads, 2): place and displacement without the drift, common part, dent */
    double *motion; /* (4,): size_px, roughness, noise, size of the dent in px */
};

static inline double at_least(double value, double least) { return value < least ? least : value; }

/* The places and displacements as they would be without the drift. */
static void compensate(const struct skin_motion *skin, double *restrict place, double *restrict moved) {
    for (int32_t b = 0; b < skin->beads; b++) {
        const double *slopes = skin->without_slopes + 4 * b, *rest = skin->reference_px + 2 * b;
        const double x = skin->position_px[2 * b] - skin->moved_rest_px[2 * b];
        const double y = skin->position_px[2 * b + 1] - skin->moved_rest_px[2 * b + 1];
        for (int axis = 0; axis < 2; axis++) {
            moved[2 * b + axis] = slopes[2 * axis] * x + slopes[2 * axis + 1] * y;
            place[2 * b + axis] = rest[axis] + moved[2 * b + axis];
        }
    }
}

/* Three columns of numbers that are summed over neighbours. */
static void weigh(const struct skin_motion *skin, const double *vectors) {
    int32_t beads = skin->beads;
    float *restrict columns = skin->columns;
    for (int32_t b = 0; b < beads; b++) {
        const double weight = skin->weight[b];
        columns[b] = (float)(vectors[2 * b] * weight);
        columns[beads + b] = (float)(vectors[2 * b + 1] * weight);
        columns[2 * beads + b] = (float)weight;
    }
}

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

/* Size, roughness and noise of the displacement. */
static void measure(const struct skin_motion *skin, const double *moved, int32_t all_exact) {
    int32_t beads = skin->beads, row = skin->padded_beads, found = 0;
    const float *average = skin->sums, *others = skin->sums + row;
    double share_sum = 0.0, size = 0.0, roughness = 0.0;
    weigh(skin, moved);
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
            double away = moved[2 * b + axis] - (double)others[2 * axis * row + b] / others_total;
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
}

/* The common part of the displacement, by weighted least squares, and the dent of the found beads. */
static void split(const struct skin_motion *skin, const double *moved, double *common, double *dent) {
    double normal[MOTIONS * MOTIONS] = {0.0}, amounts[MOTIONS] = {0.0};
    for (int32_t k = 0; k < 2 * skin->beads; k++) {
        const double *mode = skin->modes + (int64_t)k * MOTIONS;
        for (int i = 0; i < MOTIONS; i++) {
            double weighted = skin->weight[k / 2] * mode[i];
            amounts[i] += weighted * moved[k];
            for (int j = i; j < MOTIONS; j++)
                normal[i * MOTIONS + j] += weighted * mode[j];
        }
    }
    factorise(normal, MOTIONS);
    solve_factorised(normal, MOTIONS, amounts);
    for (int32_t k = 0; k < 2 * skin->beads; k++) {
        common[k] = dot(skin->modes + (int64_t)k * MOTIONS, amounts, MOTIONS);
        dent[k] = skin->found[k / 2] ? moved[k] - common[k] : 0.0;
    }
}

/* The root mean square, over the found beads, of the dent averaged over their neighbours. */
static void measure_dent(const struct skin_motion *skin, const double *dent) {
    int32_t beads = skin->beads, row = skin->padded_beads, found = 0;
    double square = 0.0;
    weigh(skin, dent);
    multiply(skin->dented, beads, row, skin->columns, beads, skin->sums, row, SUMS);
    for (int32_t b = 0; b < beads; b++) {
        if (!skin->found[b])
            continue;
        found++;
        const float *sums = skin->sums + b;
        double x = (double)sums[0], y = (double)sums[row];
        double total = at_least((double)sums[2 * row], 1e-12);
        square += (x * x + y * y) / (total * total);
    }
    skin->motion[3] = found ? __builtin_sqrt(square / found) : 0.0;
}

/* all_exact: whether all beads are found and exact: then each average counts the same. */
KERNEL int skin_motion(const struct skin_motion *skin, int32_t all_exact) {
    const int64_t numbers = 2 * (int64_t)skin->beads;
    double *place = skin->moved_px, *moved = place + numbers, *common = moved + numbers,
           *dent = common + numbers;
    compensate(skin, place, moved);
    measure(skin, moved, all_exact);
    split(skin, moved, common, dent);
    measure_dent(skin, dent);
    return 0;
}
