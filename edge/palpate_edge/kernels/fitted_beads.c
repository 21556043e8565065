/* Beads at their centres of symmetry, and which of them are beads: vision/bead_fit.py has the rules. */

#include "neighbourhood.h"
#include "symmetric_steps.h"

struct fitted_beads {
    struct symmetric_fit *fit;
    struct neighbourhood *neighbours;
    int32_t beads, binning; /* binning: pixels, along an axis, of one of the fit's */
    float max_noise, max_faint_noise, sure_noise, min_explained, min_white;
    double sigma_px;        /* of the reference's beads */
    double max_step_squared, max_predicted_squared, min_apart_squared; /* px^2 */
    const double *diameter_px; /* (beads) */
    double *position_px;       /* (beads, 2) input: places of the found beads; result: of all */
    uint8_t *found;            /* (beads) input and result */
    float *noise;              /* (beads) result */
    uint8_t *lost;             /* (beads) scratch: that were not found before */
};

static double in_pixels(const struct fitted_beads *s, double place) {
    return place * s->binning + 0.5 * (s->binning - 1);
}

/* Put beads that were not found where their neighbours predict them. */
static void predict_lost(const struct fitted_beads *s) {
    const struct neighbourhood *neighbours = s->neighbours;
    const int32_t missing = predict_missing(neighbours, s->position_px, s->found);
    for (int32_t bead = 0; bead < s->beads; bead++)
        s->lost[bead] = !s->found[bead];
    for (int32_t i = 0; i < missing; i++) {
        const int64_t bead = neighbours->missing[i];
        s->position_px[2 * bead] = neighbours->predicted_px[2 * i];
        s->position_px[2 * bead + 1] = neighbours->predicted_px[2 * i + 1];
    }
}

/* Return whether a bead is where its neighbours predicted it, and certain or in white light. */
static int is_predicted_bead(const struct fitted_beads *s, int32_t bead, double step_squared) {
    const float noise = s->noise[bead];
    const int is_white = s->fit->explained[bead] > s->min_explained && s->fit->clipped[bead] > s->min_white &&
                         noise < s->max_faint_noise;
    return (is_white || noise < s->sure_noise) && step_squared < s->max_predicted_squared;
}

/* Return whether another found bead is near. */
static int is_beside(const struct fitted_beads *s, int32_t bead) {
    for (int32_t other = 0; other < s->beads; other++) {
        if (other != bead && s->found[other] &&
            !(squared_between(s->fit->position_px + 2 * bead, s->fit->position_px + 2 * other) >
              s->min_apart_squared))
            return 1;
    }
    return 0;
}

/* Fit all beads; accepts_lost: whether beads that were not found may be found now. */
KERNEL int fit_beads(const struct fitted_beads *s, int32_t accepts_lost) {
    const struct symmetric_fit *fit = s->fit;
    predict_lost(s);
    for (int32_t bead = 0; bead < s->beads; bead++) {
        fit->which[bead] = bead;
        for (int a = 2 * bead; a < 2 * bead + 2; a++)
            fit->position_px[a] = (s->position_px[a] - 0.5 * (s->binning - 1)) / s->binning;
    }
    symmetric_fit_measure(fit, s->beads);
    for (int32_t bead = 0; bead < s->beads; bead++) {
        double *centre = fit->position_px + 2 * bead;
        centre[0] = in_pixels(s, centre[0]);
        centre[1] = in_pixels(s, centre[1]);
        const double squared = squared_between(centre, s->position_px + 2 * bead);
        s->noise[bead] = larger((float)(fit->sigma[bead] * s->diameter_px[bead] / s->sigma_px), 1.0f);
        if (s->lost[bead])
            s->found[bead] = accepts_lost && is_predicted_bead(s, bead, squared);
        else
            s->found[bead] = squared < s->max_step_squared && s->noise[bead] < s->max_noise;
    }
    for (int32_t bead = 0; bead < s->beads; bead++) {
        if (s->lost[bead] && s->found[bead])
            s->lost[bead] = (uint8_t)is_beside(s, bead);
        else
            s->lost[bead] = !s->found[bead];
    }
    for (int32_t bead = 0; bead < s->beads; bead++) {
        s->found[bead] = !s->lost[bead];
        if (s->lost[bead]) {
            s->noise[bead] = 1.0f;
            continue;
        }
        s->position_px[2 * bead] = fit->position_px[2 * bead];
        s->position_px[2 * bead + 1] = fit->position_px[2 * bead + 1];
    }
    return 0;
}
