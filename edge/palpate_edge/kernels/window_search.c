/* Beads in windows near expected places: vision/window_search.py has the method and its numbers. */

#include "centroids.h"
#include "neighbourhood.h"

struct window_search {
    struct centroid_finder *finder;
    struct neighbourhood *neighbours;
    int32_t beads, binning;
    int32_t max_windows; /* of one bead in one search */
    float min_contrast_share, min_predicted_share, min_blob_share, added_unevenness, max_levelled_glare;
    float dim, glare_noise, glare_noise_per_unevenness, max_noise;
    double max_step_squared, max_predicted_squared, max_blob_squared,
        max_faint_squared; /* squared spacings */
    double max_jumped;                    /* beads */
    double converged_step, blob_step;     /* bead diameters */
    const float *contrast;                /* (beads), in the reference; the next four likewise */
    const float *min_contrast, *min_area, *max_area, *max_unevenness;
    const double *spacing_squared;        /* (beads), px^2; the next three likewise */
    const double *jump_squared, *reach_squared, *same_squared;
    double *expected_px, *predicted_px;   /* (beads, 2) input, of all beads or of some */
    double *last_start_px;                /* (beads, 2) of the last search of all */
    double *position_px;                  /* (beads, 2) results, by bead */
    float *contrast_share, *area, *excess; /* (beads) */
    uint8_t *converged, *found, *levelled;
    int64_t *some;                        /* (beads) input: the beads that are looked for */
    float *sorted, *noise_unevenness;     /* (beads) scratch; (1): unevenness that most beads share */
    float *noise;                         /* (beads) result */
    int64_t *windows; /* (beads), measured since the start */
};

/* Measure the first `count` beads of the finder's list about its starts, in pixels. */
static void measure(const struct window_search *s, int32_t count, int32_t max_windows, int32_t max_faint,
                    double converged_step) {
    const struct centroid_finder *finder = s->finder;
    const double half = 0.5 * (s->binning - 1), per_pixel = 1.0 / s->binning;
    for (int32_t i = 0; i < 2 * count; i++)
        finder->start[i] = (finder->start[i] - half) * per_pixel;
    find_centroids(finder, count, max_windows, max_faint, converged_step);
    for (int32_t i = 0; i < 2 * count; i++)
        finder->place[i] = finder->place[i] * s->binning + half;
}

/* Keep the results of the first `count` beads of the finder's list. */
static void keep(const struct window_search *s, int32_t count) {
    const struct centroid_finder *finder = s->finder;
    for (int32_t i = 0; i < count; i++) {
        const int32_t bead = finder->which[i];
        s->position_px[2 * bead] = finder->place[2 * i];
        s->position_px[2 * bead + 1] = finder->place[2 * i + 1];
        s->contrast_share[bead] = finder->contrast[i] / s->contrast[bead];
        s->area[bead] = finder->area[i];
        s->excess[bead] = finder->unevenness[i] - s->max_unevenness[bead];
        s->converged[bead] = finder->converged[i];
        s->levelled[bead] = finder->levelled[i];
        s->windows[bead] += finder->windows[i];
    }
}

static void add_start(const struct window_search *s, int32_t *count, int32_t bead, const double *place) {
    struct centroid_finder *finder = s->finder;
    finder->which[*count] = bead;
    finder->start[2 * *count] = place[0];
    finder->start[2 * *count + 1] = place[1];
    finder->min_contrast[*count] = 0.0f;
    ++*count;
}

/* Put the number at this rank of the sorted ones there, and smaller ones before it (Hoare). */
static float value_at(float *values, int32_t count, int32_t rank) {
    int32_t low = 0, high = count - 1;
    while (low < high) {
        const float pivot = values[rank];
        int32_t i = low, j = high;
        while (i <= j) {
            while (values[i] < pivot)
                i++;
            while (pivot < values[j])
                j--;
            if (i > j)
                break;
            const float swapped = values[i];
            values[i++] = values[j];
            values[j--] = swapped;
        }
        if (j < rank)
            low = i;
        if (rank < i)
            high = j;
    }
    return values[rank];
}

/* Take from the excess of some beads (in the finder's order) what most of them share: camera noise. */
static void share_unevenness(const struct window_search *s, int32_t count) {
    int has_excess = 0;
    *s->noise_unevenness = 0.0f;
    for (int32_t i = 0; i < count; i++) {
        s->sorted[i] = s->excess[s->finder->which[i]];
        has_excess |= s->sorted[i] >= 0.0f;
    }
    if (!has_excess)
        return;
    const float middle = value_at(s->sorted, count, count / 2) + s->added_unevenness;
    *s->noise_unevenness = larger(middle, 0.0f);
    for (int32_t i = 0; i < count; i++)
        s->excess[s->finder->which[i]] -= *s->noise_unevenness;
}

static int is_there(const struct window_search *s, int32_t bead) {
    return s->contrast_share[bead] > s->min_contrast_share;
}

/* Measure the beads that were off the centres of their first windows, and the faint ones where the others
 * predict them. found: which first windows showed a bead. */
static void go_on(const struct window_search *s, int32_t faint) {
    int32_t count = 0, moving;
    for (int32_t bead = 0; bead < s->beads; bead++) {
        if (!s->found[bead] || s->converged[bead])
            continue;
        const double *expected = s->expected_px + 2 * bead, *place = s->position_px + 2 * bead;
        const double squared = squared_between(place, expected);
        const double most = s->reach_squared[bead];
        const double reach = squared > most ? __builtin_sqrt(most / squared) : 1.0;
        const double start[2] = {expected[0] + reach * (place[0] - expected[0]),
                                 expected[1] + reach * (place[1] - expected[1])};
        add_start(s, &count, bead, start);
    }
    moving = count;
    if (!moving)
        return;
    measure(s, moving, faint ? 1 : s->max_windows - 1, moving, s->converged_step);
    keep(s, moving);
    if (!faint)
        return;
    count = 0;
    for (int32_t i = 0; i < moving; i++) {
        const int32_t bead = s->finder->which[i];
        if (!s->converged[bead])
            add_start(s, &count, bead, s->position_px + 2 * bead);
    }
    const struct neighbourhood *neighbours = s->neighbours;
    const int32_t missing = predict_missing(neighbours, s->position_px, s->found);
    for (int32_t i = 0; i < missing; i++) {
        const int32_t bead = (int32_t)neighbours->missing[i];
        const double *predicted = neighbours->predicted_px + 2 * i;
        s->last_start_px[2 * bead] = predicted[0];
        s->last_start_px[2 * bead + 1] = predicted[1];
        add_start(s, &count, bead, predicted);
    }
    measure(s, count, s->max_windows, count, s->converged_step);
    keep(s, count);
}

/* Look for all beads near `expected_px`. Return 0 where the first windows show more than `max_faint` faint
 * places, or more than `max_faint_after_jump` beside beads that jumped. */
KERNEL int window_search_beads(const struct window_search *s, int32_t max_faint,
                               int32_t max_faint_after_jump) {
    int32_t count = 0, faint = 0, jumped = 0;
    for (int32_t bead = 0; bead < s->beads; bead++) {
        const double *expected = s->expected_px + 2 * bead;
        s->last_start_px[2 * bead] = expected[0];
        s->last_start_px[2 * bead + 1] = expected[1];
        add_start(s, &count, bead, expected);
        s->finder->min_contrast[bead] = s->min_contrast[bead];
    }
    measure(s, count, 1, max_faint, s->converged_step);
    keep(s, count);
    for (int32_t bead = 0; bead < s->beads; bead++) {
        s->found[bead] = (uint8_t)is_there(s, bead);
        faint += !s->found[bead];
        jumped += s->found[bead] && squared_between(s->position_px + 2 * bead, s->expected_px + 2 * bead) >
                                        s->jump_squared[bead];
    }
    if (faint > max_faint || (faint > max_faint_after_jump && jumped > s->max_jumped))
        return 0;
    go_on(s, faint);
    for (int32_t bead = 0; bead < s->beads; bead++)
        s->finder->which[bead] = bead;
    share_unevenness(s, s->beads);
    for (int32_t bead = 0; bead < s->beads; bead++) {
        const double step = squared_between(s->position_px + 2 * bead, s->expected_px + 2 * bead);
        s->found[bead] = is_there(s, bead) && s->converged[bead] && s->area[bead] > s->min_area[bead] &&
                         s->area[bead] < s->max_area[bead] && s->excess[bead] < 0.0f &&
                         step < s->max_step_squared * s->spacing_squared[bead];
    }
    return 1;
}

static int is_faint_and_off(const struct window_search *s, int32_t bead, const double *predicted_px) {
    const double step = squared_between(s->position_px + 2 * bead, predicted_px);
    return !(s->contrast_share[bead] >= s->min_contrast_share) &&
           !(step < s->max_faint_squared * s->spacing_squared[bead]);
}

/* Whether a bead has no more glare beside it than `max_glare`, or the most of a bead that was levelled. */
static int is_clear(const struct window_search *s, int32_t bead, float max_glare) {
    return s->excess[bead] < (s->levelled[bead] ? s->max_levelled_glare : max_glare);
}

/* Look for the beads that were not found where the others predict them. */
KERNEL int window_search_missing(const struct window_search *s, float max_glare) {
    const struct neighbourhood *neighbours = s->neighbours;
    const int32_t missing = predict_missing(neighbours, s->position_px, s->found);
    int32_t off = 0;
    for (int32_t i = 0; i < missing; i++) {
        const int32_t bead = (int32_t)neighbours->missing[i];
        const double *predicted = neighbours->predicted_px + 2 * i;
        if (!s->converged[bead] &&
            squared_between(s->last_start_px + 2 * bead, predicted) > s->same_squared[bead])
            add_start(s, &off, bead, predicted);
    }
    measure(s, off, s->max_windows, off, s->converged_step);
    keep(s, off);
    for (int32_t i = 0; i < off; i++)
        s->excess[s->finder->which[i]] -= *s->noise_unevenness;
    for (int32_t i = 0; i < missing; i++) {
        const int32_t bead = (int32_t)neighbours->missing[i];
        const double *predicted = neighbours->predicted_px + 2 * i;
        const double step = squared_between(s->position_px + 2 * bead, predicted);
        s->found[bead] = s->converged[bead] && s->contrast_share[bead] > s->min_predicted_share &&
                         s->area[bead] > s->min_area[bead] && s->area[bead] < s->max_area[bead] &&
                         step < s->max_predicted_squared * s->spacing_squared[bead] &&
                         !is_faint_and_off(s, bead, predicted) && is_clear(s, bead, max_glare);
    }
    return 0;
}

/* Look for the first `count` beads of `some` at their blobs, `expected_px` (count, 2), and not far from
 * `predicted_px` (count, 2), where their neighbours predict them. Return -1 where a number is that
 * of no bead. */
KERNEL int window_search_matched(const struct window_search *s, int32_t count, int32_t max_windows,
                                 float max_glare) {
    int32_t added = 0;
    for (int32_t i = 0; i < count; i++) {
        if (s->some[i] < 0 || s->some[i] >= s->beads)
            return -1;
    }
    for (int32_t i = 0; i < count; i++)
        add_start(s, &added, (int32_t)s->some[i], s->expected_px + 2 * i);
    measure(s, count, max_windows, count, s->blob_step);
    keep(s, count);
    share_unevenness(s, count);
    for (int32_t i = 0; i < count; i++) {
        const int32_t bead = (int32_t)s->some[i];
        const double step = squared_between(s->position_px + 2 * bead, s->expected_px + 2 * i);
        s->found[bead] = s->contrast_share[bead] > s->min_blob_share && s->area[bead] < s->max_area[bead] &&
                         step < s->max_blob_squared * s->spacing_squared[bead] &&
                         !is_faint_and_off(s, bead, s->predicted_px + 2 * i) && is_clear(s, bead, max_glare);
    }
    return 0;
}

/* Write the noise of each found bead. Return whether one is inexact. */
KERNEL int window_search_noise(const struct window_search *s) {
    int is_inexact = 0;
    for (int32_t bead = 0; bead < s->beads; bead++) {
        const float share = s->contrast_share[bead], excess = s->excess[bead];
        float noise = 1.0f;
        if (s->found[bead] && share < s->dim)
            noise = 1.0f / larger(share, 1e-3f);
        if (s->found[bead] && excess > 0.0f)
            noise = larger(noise, s->glare_noise + s->glare_noise_per_unevenness * excess);
        is_inexact |= s->found[bead] && (share < s->dim || excess > 0.0f);
        s->noise[bead] = smaller(noise, s->max_noise);
    }
    return is_inexact;
}
