/* Missing beads displaced like their neighbours; vision/neighbourhood.py describes the method. */

#include "kernels.h"

struct neighbourhood {
    int32_t beads;              /* n */
    double least_weight;        /* of all found neighbours */
    const double *reference_px; /* (n, 2) */
    const double *weight;       /* (n, n) row i: of the neighbours of bead i */
    const double *position_px;  /* (n, 2) input */
    const uint8_t *found;       /* (n) input */
    const int64_t *missing;     /* (n) input: beads to predict, the first ones of the array */
    double *moved_px;           /* (n, 3) scratch: displacements of the found beads, and 1; 0 of others */
    double *predicted_px;       /* (n, 2) result: places of the missing beads */
};

/* Predict the first `count` of the missing beads. Return how many have neighbours of too little weight, -1
 * where a number is that of no bead. */
KERNEL int neighbourhood_predict(const struct neighbourhood *p, int32_t count) {
    double *moved = p->moved_px;
    int32_t faint = 0;
    for (int32_t bead = 0; bead < p->beads; bead++) {
        const double *place = p->position_px + 2 * bead, *rest = p->reference_px + 2 * bead;
        moved[3 * bead] = p->found[bead] ? place[0] - rest[0] : 0.0;
        moved[3 * bead + 1] = p->found[bead] ? place[1] - rest[1] : 0.0;
        moved[3 * bead + 2] = p->found[bead] ? 1.0 : 0.0;
    }
    for (int32_t i = 0; i < count; i++) {
        int64_t bead = p->missing[i];
        if (bead < 0 || bead >= p->beads)
            return -1;
        const double *weight = p->weight + bead * p->beads, *rest = p->reference_px + 2 * bead;
        double along_x = 0.0, along_y = 0.0, total = 0.0;
        for (int32_t other = 0; other < p->beads; other++) {
            along_x += weight[other] * moved[3 * other];
            along_y += weight[other] * moved[3 * other + 1];
            total += weight[other] * moved[3 * other + 2];
        }
        faint += !(total > p->least_weight);
        p->predicted_px[2 * i] = rest[0] + along_x / total;
        p->predicted_px[2 * i + 1] = rest[1] + along_y / total;
    }
    return faint;
}
