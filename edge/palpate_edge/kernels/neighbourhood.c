/* Missing beads displaced like their neighbours; vision/neighbourhood.py describes the method. */

#include "neighbourhood.h"

#include "exponential.h"

/* Weights of found neighbours that are all far: scaled so that the nearest has weight 1. Without any found
 * bead nothing is added. */
static void add_scaled(const struct neighbourhood *p, const double *relative, double sum[3]) {
    double nearest = __builtin_inf();
    sum[0] = sum[1] = sum[2] = 0.0;
    for (int32_t other = 0; other < p->beads; other++) {
        if (p->found[other] && relative[other] < nearest)
            nearest = relative[other];
    }
    for (int32_t other = 0; other < p->beads; other++) {
        if (!p->found[other])
            continue;
        const double exponent = 0.5 * (relative[other] * relative[other] - nearest * nearest);
        const double weight = decay8(all8((float)exponent))[0];
        for (int k = 0; k < 3; k++)
            sum[k] += weight * p->moved_px[3 * other + k];
    }
}

/* Predict the first `count` of the missing beads: where they were at rest, if no bead was found. Return -1 where
 * a number is that of no bead. */
KERNEL int neighbourhood_predict(const struct neighbourhood *p, int32_t count) {
    double *moved = p->moved_px;
    for (int32_t bead = 0; bead < p->beads; bead++) {
        const double *place = p->position_px + 2 * bead, *rest = p->reference_px + 2 * bead;
        moved[3 * bead] = p->found[bead] ? place[0] - rest[0] : 0.0;
        moved[3 * bead + 1] = p->found[bead] ? place[1] - rest[1] : 0.0;
        moved[3 * bead + 2] = p->found[bead] ? 1.0 : 0.0;
    }
    for (int32_t i = 0; i < count; i++) {
        const int64_t bead = p->missing[i];
        if (bead < 0 || bead >= p->beads)
            return -1;
        const double *weight = p->weight + bead * p->beads, *rest = p->reference_px + 2 * bead;
        double sum[3] = {0.0, 0.0, 0.0};
        for (int32_t other = 0; other < p->beads; other++) {
            for (int k = 0; k < 3; k++)
                sum[k] += weight[other] * moved[3 * other + k];
        }
        if (!(sum[2] > p->least_weight))
            add_scaled(p, p->relative + bead * p->beads, sum);
        const double total = sum[2] > 0.0 ? sum[2] : 1.0;
        p->predicted_px[2 * i] = rest[0] + sum[0] / total;
        p->predicted_px[2 * i + 1] = rest[1] + sum[1] / total;
    }
    return 0;
}

/* Write where the found beads (n) at their places (n, 2) predict the others; return how many those are. */
int32_t predict_missing(const struct neighbourhood *p, const double *position_px, const uint8_t *found) {
    int32_t missing = 0;
    for (int32_t bead = 0; bead < p->beads; bead++) {
        p->position_px[2 * bead] = position_px[2 * bead];
        p->position_px[2 * bead + 1] = position_px[2 * bead + 1];
        p->found[bead] = found[bead];
        if (!found[bead])
            p->missing[missing++] = bead;
    }
    if (missing)
        neighbourhood_predict(p, missing);
    return missing;
}
