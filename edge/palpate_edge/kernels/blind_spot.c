/* The largest variance at a bead that is not seen exactly: see estimation/displacement_field.py. */

#include "small_matrices.h"

struct blind_spot {
    int32_t beads;
    double bead_noise;
    const double *inverse;   /* (beads, beads): of the covariance with the beads' noise, symmetric */
    const uint8_t *found;    /* (beads,) */
    const float *noise;      /* (beads,): standard deviation of each place over an exact one's */
    int32_t *some;           /* (beads,) */
    double *matrix;          /* (beads, beads) */
    double *row;             /* (beads,) */
    double *variance;        /* (1,): the largest one, with the bead's noise */
};

/* The largest number on the diagonal of the inverse: of U^-1 U'^-1 with the factor U, row by row of U^-1. */
static double largest_of_inverse(const double *factor, int32_t size, double *row) {
    double largest = 0.0;
    for (int32_t j = 0; j < size; j++) {
        double sum = 0.0;
        for (int32_t i = j; i < size; i++)
            row[i] = i == j ? 1.0 : 0.0;
        for (int32_t i = j; i < size; i++) {
            const double *below = factor + (int64_t)i * size;
            row[i] *= below[i];
            sum += row[i] * row[i];
            add_scaled(row + i + 1, below + i + 1, -row[i], size - i - 1);
        }
        largest = sum > largest ? sum : largest;
    }
    return largest;
}

/* Returns how many beads were not found or are inexact. */
KERNEL int blind_spot(const struct blind_spot *spot) {
    int32_t count = 0, *some = spot->some;
    for (int32_t b = 0; b < spot->beads; b++)
        if (!spot->found[b] || spot->noise[b] > 1.0f)
            some[count++] = b;
    for (int32_t i = 0; i < count; i++) {
        double noise = (double)spot->noise[some[i]];
        for (int32_t j = i; j < count; j++)
            spot->matrix[(int64_t)i * count + j] = spot->inverse[(int64_t)some[i] * spot->beads + some[j]];
        if (spot->found[some[i]])
            spot->matrix[(int64_t)i * count + i] += 1.0 / (spot->bead_noise * (noise * noise - 1.0) + 1e-12);
    }
    factorise(spot->matrix, count);
    spot->variance[0] = largest_of_inverse(spot->matrix, count, spot->row);
    return count;
}
