/* Blobs of one frame matched with the beads; the method is described in vision/correspondence.py. */

#include "matching.h"

struct matching {
    int32_t beads, neighbours;
    int32_t ranking_step;                  /* every so many beads rank the hypotheses */
    int32_t max_hypotheses, max_patches;   /* tried */
    int32_t min_patch;                     /* beads */
    int32_t max_rounds;                    /* of growth, over all seeds */
    float min_support;
    double cap_squared;                    /* px^2, from a hypothesis to a blob */
    double enough_left, strong;            /* shares: of the beads, of the labelled blobs' strength */
    const double *reference_px;            /* (n, 2) */
    const double *start_gate, *growth_gate, *near_squared, *smooth_squared, *lattice_squared; /* (n) px^2 */
    const int32_t *near;                   /* (n, k) neighbours of a patch; the bead itself where too far */
    const float *patch_step;               /* (n) px^2, least step between two patches */
    struct blob_grid *grid;
    const double *strength;                /* (m) of the blobs in `grid` */
    const struct local_warp *warp;
    const double *hypotheses_px;           /* (h, n, 2) where the beads may be */
    int32_t *order, *patch;                /* (max_hypotheses), (max_patches) scratch */
    double *off;                           /* (max_hypotheses) scratch */
    int32_t *label, *size, *joined;        /* (n), (n), (n, k) scratch */
    int32_t *start, *blob, *last;          /* (n) scratch: labels */
    double *gate, *squared;                /* (n) scratch */
    double *place_px;                      /* (n, 2) scratch */
    uint8_t *taken;                        /* (m) scratch */
    int32_t *best_blob;                    /* (n) result: blob or NO_BLOB */
    double *best_place_px;                 /* (n, 2) result: as the neighbours predict it */
    double doubt;                          /* result */
};

/* The places (n, 2) of a hypothesis. */
static inline const double *hypothesis(const struct matching *m, int32_t number) {
    return m->hypotheses_px + 2 * (int64_t)m->beads * number;
}

/* Write the numbers of the best hypotheses, best first, to `order` and return how many these are. */
static int32_t rank(const struct matching *m, int32_t hypotheses) {
    int32_t kept = 0;
    if (hypotheses == 1)
        m->order[kept++] = 0;
    for (int32_t h = 0; h < hypotheses && hypotheses > 1; h++) {
        const double *expected = hypothesis(m, h);
        double sum = 0.0;
        for (int32_t bead = 0; bead < m->beads; bead += m->ranking_step) {
            double squared = m->cap_squared;
            blob_grid_nearest(m->grid, expected[2 * bead], expected[2 * bead + 1], &squared);
            sum += squared;
        }
        int32_t at = kept < m->max_hypotheses ? kept++ : kept; /* ties keep the order of the hypotheses */
        for (; at > 0 && sum < m->off[at - 1]; at--)
            if (at < m->max_hypotheses)
                m->off[at] = m->off[at - 1], m->order[at] = m->order[at - 1];
        if (at < m->max_hypotheses)
            m->off[at] = sum, m->order[at] = h;
    }
    return kept;
}

/* Give the warp the displacements of the labelled beads. */
static void displace(const struct matching *m, const int32_t *blob) {
    for (int32_t bead = 0; bead < m->beads; bead++) {
        m->warp->known[bead] = blob[bead] != NO_BLOB;
        if (blob[bead] == NO_BLOB)
            continue;
        const double *place = m->grid->blob_px + 2 * blob[bead], *rest = m->reference_px + 2 * bead;
        m->warp->displacement_px[2 * bead] = place[0] - rest[0];
        m->warp->displacement_px[2 * bead + 1] = place[1] - rest[1];
    }
}

/* Write to `joined` which neighbours are displaced like each bead, the bead itself in place of the others. */
static void join(const struct matching *m) {
    const double *moved = m->warp->displacement_px;
    for (int32_t bead = 0; bead < m->beads; bead++) {
        float x = (float)moved[2 * bead], y = (float)moved[2 * bead + 1];
        for (int32_t k = 0; k < m->neighbours; k++) {
            int32_t other = m->near[m->neighbours * bead + k];
            float along_x = x - (float)moved[2 * other], along_y = y - (float)moved[2 * other + 1];
            int is_joined = m->warp->known[bead] && m->warp->known[other] &&
                            along_x * along_x + along_y * along_y < m->patch_step[bead];
            m->joined[m->neighbours * bead + k] = is_joined ? other : bead;
        }
    }
}

/* Label the beads by patch, by the lowest number in it, and write the largest patches' labels to `patch`, the
 * largest first, of equal ones the lowest. Return how many these are. */
static int32_t find_patches(const struct matching *m) {
    int32_t *label = m->label, count = 0;
    join(m);
    for (int32_t bead = 0; bead < m->beads; bead++)
        label[bead] = bead, m->size[bead] = 0;
    for (int changed = 1; changed;) { /* a patch's lowest number spreads; each sweep only lowers labels */
        changed = 0;
        for (int32_t bead = 0; bead < m->beads; bead++) {
            int32_t lowest = label[bead];
            for (int32_t k = 0; k < m->neighbours; k++) {
                int32_t other = label[m->joined[m->neighbours * bead + k]];
                lowest = other < lowest ? other : lowest;
            }
            lowest = label[lowest] < lowest ? label[lowest] : lowest;
            changed |= lowest != label[bead];
            label[bead] = lowest;
        }
    }
    for (int32_t bead = 0; bead < m->beads; bead++)
        m->size[label[bead]] += m->warp->known[bead];
    for (; count < m->max_patches; count++) {
        int32_t largest = 0;
        for (int32_t bead = 1; bead < m->beads; bead++)
            largest = m->size[bead] > m->size[largest] ? bead : largest;
        if (m->size[largest] < m->min_patch)
            break;
        m->patch[count] = largest;
        m->size[largest] = 0;
    }
    return count;
}

/* Spread the labels `last` over the skin in at most `rounds`, place_px: where the labels before predict the
 * beads. Return how many rounds are left. */
static int32_t grow(const struct matching *m, int32_t rounds) {
    const struct blob_wish wish = {m->beads,        m->place_px, m->gate,   m->last,
                                   m->near_squared, m->blob,     m->squared};
    for (int changed = 1; changed && rounds > 0; rounds--) {
        displace(m, m->last);
        local_warp_fit(m->warp);
        for (int32_t bead = 0; bead < m->beads; bead++) {
            m->place_px[2 * bead] = m->reference_px[2 * bead] + m->warp->predicted_px[2 * bead];
            m->place_px[2 * bead + 1] = m->reference_px[2 * bead + 1] + m->warp->predicted_px[2 * bead + 1];
            m->gate[bead] = m->warp->support[bead] >= m->min_support ? m->growth_gate[bead] : 0.0;
        }
        blob_grid_give(m->grid, &wish);
        changed = 0;
        for (int32_t bead = 0; bead < m->beads; bead++) {
            changed |= m->blob[bead] != m->last[bead];
            m->last[bead] = m->blob[bead];
        }
    }
    return rounds;
}

/* Whether a blob stands in the lattice or one row beside it. */
static int is_at_lattice(const struct matching *m, const double *blob_px) {
    for (int32_t bead = 0; bead < m->beads; bead++) {
        double x = m->place_px[2 * bead] - blob_px[0], y = m->place_px[2 * bead + 1] - blob_px[1];
        if (x * x + y * y < m->lattice_squared[bead])
            return 1;
    }
    return 0;
}

/* The share of the beads left over on both sides by the labels `last`, of which `found` are a blob. */
static double doubt(const struct matching *m, int32_t found) {
    int32_t missing = m->beads - found, blobs = m->grid->count, middle = -1, spare = 0;
    if (missing == 0 || found == 0)
        return missing > 0;
    for (int32_t blob = 0; blob < blobs; blob++)
        m->taken[blob] = 0;
    for (int32_t bead = 0; bead < m->beads; bead++)
        if (m->last[bead] != NO_BLOB)
            m->taken[m->last[bead]] = 1;
    for (int32_t before = found / 2; before >= 0; before -= m->taken[middle])
        middle++; /* ends at a taken blob, of which there are `found` */
    double least = m->strong * m->strength[middle];
    for (int32_t blob = 0; blob < blobs && spare < missing; blob++)
        if (!m->taken[blob] && m->strength[blob] > least)
            spare += is_at_lattice(m, m->grid->blob_px + 2 * blob);
    return (double)spare / m->beads;
}

/* Write the labels that follow from one patch to the results where they are the most yet; return how many
 * beads the results have found. */
static int32_t keep_better(struct matching *m, int32_t best) {
    int32_t found = 0;
    for (int32_t bead = 0; bead < m->beads; bead++)
        found += m->last[bead] != NO_BLOB;
    if (found <= best)
        return best;
    for (int32_t bead = 0; bead < m->beads; bead++) {
        m->best_blob[bead] = m->last[bead];
        m->best_place_px[2 * bead] = m->place_px[2 * bead];
        m->best_place_px[2 * bead + 1] = m->place_px[2 * bead + 1];
    }
    m->doubt = doubt(m, found);
    return found;
}

/* Match the `blobs` in the grid with the beads, from the first `hypotheses`, at least one. */
KERNEL int matching_match(struct matching *m, int32_t blobs, int32_t hypotheses) {
    int32_t tried = 0, best = 0, rounds = m->max_rounds;
    m->order[0] = 0;
    if (blobs >= m->min_patch) {
        blob_grid_sort(m->grid, blobs);
        tried = rank(m, hypotheses);
    }
    const double *expected = hypothesis(m, m->order[0]);
    for (int32_t bead = 0; bead < m->beads; bead++) {
        m->best_blob[bead] = NO_BLOB;
        m->best_place_px[2 * bead] = expected[2 * bead];
        m->best_place_px[2 * bead + 1] = expected[2 * bead + 1];
    }
    m->doubt = 1.0;
    for (int32_t h = 0; h < tried; h++) {
        expected = hypothesis(m, m->order[h]);
        const struct blob_wish wish = {m->beads, expected, m->start_gate, 0, 0, m->start, m->squared};
        blob_grid_give(m->grid, &wish);
        displace(m, m->start);
        int32_t patches = find_patches(m);
        for (int32_t p = 0; p < patches; p++) {
            for (int32_t bead = 0; bead < m->beads; bead++)
                m->last[bead] = m->label[bead] == m->patch[p] ? m->start[bead] : NO_BLOB;
            rounds = grow(m, rounds);
            best = keep_better(m, best);
            if (m->doubt <= m->enough_left || rounds == 0)
                return 0;
        }
    }
    return 0;
}

/* Find the patches of the beads whose displacements the warp was given; return how many. */
KERNEL int matching_patches(const struct matching *m) { return find_patches(m); }

/* Return whether each known bead is displaced as its neighbours predict. */
KERNEL int matching_is_smooth(const struct matching *m) {
    const struct local_warp *warp = m->warp;
    local_warp_fit(warp);
    for (int32_t bead = 0; bead < m->beads; bead++) {
        double x = warp->displacement_px[2 * bead] - warp->predicted_px[2 * bead];
        double y = warp->displacement_px[2 * bead + 1] - warp->predicted_px[2 * bead + 1];
        if (warp->known[bead] && !(x * x + y * y < m->smooth_squared[bead]))
            return 0;
    }
    return 1;
}
