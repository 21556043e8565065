/* Checks of the beads' numbers from frame to frame; vision/labels.py describes them. */

#include "kernels.h"

struct labels {
    int32_t beads;                /* n */
    int32_t pairs;                /* p */
    double min_overlap_squared;   /* px^2; no two beads meet where none is displaced that far */
    const double *reference_px;   /* (n, 2) */
    const double *jump_squared;   /* (n) px^2 */
    const int32_t *first, *other; /* (p) beads that can meet */
    const float *overlap_squared; /* (p) px^2 */
    const double *position_px;    /* (n, 2) input */
    const double *last_px;        /* (n, 2) input */
    const uint8_t *found;         /* (n) input */
    uint8_t *kept;                /* (n) result */
};

/* Whether a kept bead moved farther since the last frame than its limit. */
static int have_jumped(const struct labels *p) {
    for (int32_t bead = 0; bead < p->beads; bead++)
        if (p->kept[bead] &&
            squared_between(p->position_px + 2 * bead, p->last_px + 2 * bead) > p->jump_squared[bead])
            return 1;
    return 0;
}

/* Write to `kept` the found beads without those that share a place with one that came from nearer by. */
static void drop_doubles(const struct labels *p) {
    int may_meet = 0;
    for (int32_t bead = 0; bead < p->beads; bead++)
        may_meet |= !(squared_between(p->position_px + 2 * bead, p->reference_px + 2 * bead) <
                      p->min_overlap_squared);
    for (int32_t bead = 0; bead < p->beads; bead++)
        p->kept[bead] = p->found[bead];
    if (!may_meet)
        return;
    for (int32_t pair = 0; pair < p->pairs; pair++) {
        int32_t first = p->first[pair], other = p->other[pair];
        float x = (float)p->position_px[2 * first] - (float)p->position_px[2 * other];
        float y = (float)p->position_px[2 * first + 1] - (float)p->position_px[2 * other + 1];
        if (!(x * x + y * y < p->overlap_squared[pair]) || !p->found[first] || !p->found[other])
            continue;
        double step = squared_between(p->position_px + 2 * first, p->last_px + 2 * first);
        p->kept[step > squared_between(p->position_px + 2 * other, p->last_px + 2 * other) ? first : other] =
            0;
    }
}

/* Drop doubles; return twice the number of beads that are not kept, and 1 more where a kept one jumped. */
KERNEL int labels_check(const struct labels *p) {
    int32_t lost = 0;
    drop_doubles(p);
    for (int32_t bead = 0; bead < p->beads; bead++)
        lost += !p->kept[bead];
    return 2 * lost + have_jumped(p);
}
