/* The likeliest displacement of the beads: see estimation/field_smoothing/smoother.py.
 *
 * B' W B of all beads is that of exact ones, which is known but for a factor, and the difference that the
 * inexact beads make: few in most frames. */

#include "small_matrices.h"

struct smoothing {
    int32_t beads, fields;
    double noise_px2, noise_weight, remainder, least_signal;
    const double *field;     /* (2 beads, fields) */
    const double *gram;      /* (fields, fields): B' B */
    const double *variance;  /* (fields,) */
    const double *measured_px;   /* (beads, 2) */
    const double *weight;    /* (beads,): of each bead */
    int32_t *inexact;        /* (beads,): which are not exact */
    double *each;            /* (beads,): W, the same along x and y */
    double *normal;          /* (fields, fields) */
    double *amounts;         /* (fields,) */
    double *smoothed_px;     /* (beads, 2) */
};

/* The variance of an exact bead's place over the frame's mean square displacement an axis. */
static double relative_noise(const struct smoothing *smoothing, double total, double found) {
    double square = 0.0;
    for (int32_t b = 0; b < smoothing->beads; b++) {
        double x = smoothing->measured_px[2 * b], y = smoothing->measured_px[2 * b + 1];
        square += smoothing->weight[b] * (x * x + y * y);
    }
    square *= 0.5 / total;  // along an axis: half of both
    double signal = square - smoothing->noise_px2 * found / total, least = smoothing->least_signal * square;
    signal = signal > least ? signal : least;
    return smoothing->noise_weight * smoothing->noise_px2 / (signal > 1e-12 ? signal : 1e-12);
}

/* Solve (B' W B + 1 / variance) x = amounts in their place; exact: W of an exact bead. */
static void solve_inexact(const struct smoothing *smoothing, double exact) {
    int32_t count = smoothing->fields;
    double *normal = smoothing->normal;
    for (int32_t i = 0; i < count; i++) {
        double *row = normal + (int64_t)i * count;
        for (int32_t j = i; j < count; j++)
            row[j] = exact * smoothing->gram[(int64_t)i * count + j];
        row[i] += 1.0 / smoothing->variance[i];
    }
    int32_t inexact = 0, *beads = smoothing->inexact;
    for (int32_t b = 0; b < smoothing->beads; b++)
        if (smoothing->each[b] != exact)
            beads[inexact++] = b;
    for (int32_t k = 0; k < inexact; k += 2) {
        int32_t one = beads[k], other = k + 1 < inexact ? beads[k + 1] : one;
        double less = smoothing->each[one] - exact, too = other == one ? 0.0 : smoothing->each[other] - exact;
        const double *x = smoothing->field + 2 * (int64_t)one * count, *y = x + count;
        const double *u = smoothing->field + 2 * (int64_t)other * count, *v = u + count;
        const double *rows[4] = {x, y, u, v};
        for (int32_t i = 0; i < count; i++) {
            const double factors[4] = {less * x[i], less * y[i], too * u[i], too * v[i]};
            add_four(normal + (int64_t)i * count, rows, factors, i, count);
        }
    }
    factorise(normal, count);
    solve_factorised(normal, count, smoothing->amounts);
}

/* found: count of the beads that were found; all_exact: whether all of them are, and exact. */
KERNEL int smoothing(const struct smoothing *smoothing, double found, int32_t all_exact) {
    int32_t beads = smoothing->beads, count = smoothing->fields;
    double total = 0.0, *amounts = smoothing->amounts, *each = smoothing->each;
    for (int32_t b = 0; b < beads; b++)
        total += smoothing->weight[b];
    if (total == 0.0) {
        for (int32_t k = 0; k < 2 * beads; k++)
            smoothing->smoothed_px[k] = 0.0;
        return 0;
    }
    double noise = relative_noise(smoothing, total, found), exact = 1.0 / (noise + smoothing->remainder);
    for (int32_t k = 0; k < count; k++)
        amounts[k] = 0.0;
    for (int32_t b = 0; b < beads; b++) {
        double weight = smoothing->weight[b];
        each[b] = weight == 1.0 ? exact : weight / (noise + smoothing->remainder * weight);
        for (int axis = 0; axis < 2; axis++)
            add_scaled(amounts, smoothing->field + (2 * (int64_t)b + axis) * count,
                       each[b] * smoothing->measured_px[2 * b + axis], count);
    }
    if (all_exact)  // the typical fields are orthonormal
        for (int32_t k = 0; k < count; k++)
            amounts[k] /= exact + 1.0 / smoothing->variance[k];
    else
        solve_inexact(smoothing, exact);
    for (int32_t k = 0; k < 2 * beads; k++) {
        double likely = dot(smoothing->field + (int64_t)k * count, amounts, count);
        double left_px = smoothing->measured_px[k] - likely;
        smoothing->smoothed_px[k] = likely + smoothing->remainder * each[k / 2] * left_px;
    }
    return 0;
}
