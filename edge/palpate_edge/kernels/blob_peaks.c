/* Peaks of the Hessian's determinant in a smoothed plane; vision/blob_detection.py describes the method.
 *
 * Rows of the determinant are computed from the top. As soon as the rows within reach are there, pixels are
 * compared with their four neighbours, and the few that are as high with all pixels within reach. Sums are of
 * mirrored pairs, so that mirrored planes give mirrored peaks. */

#include "kernels.h"

#pragma clang fp reassociate(off) contract(off)

#define MIN_CURVATURE 1e-12
#define SAME_PX 1.0 /* between places that two equal pixels give one maximum */
#define STRIDE 16 /* pixels that are compared at once */

struct blob_peak {
    float root; /* of the determinant */
    int32_t pixel;
};

struct blob_peaks {
    int32_t height, width;
    int32_t reach;      /* pixels, at least 1 */
    int32_t most;       /* peaks that are kept, at least 1 */
    float limit;        /* of the determinant */
    double gain;        /* of strengths: over the determinant's root */
    double pixel_px;    /* side of a pixel in the whole image */
    const float *plane; /* (height, width) smoothed */
    float *determinant; /* (height, width) scratch */
    float *sums;        /* (3, width + 2) scratch: sums along columns, with a border */
    struct blob_peak *peak; /* (most) scratch */
    double *position_px;    /* (most, 2) result: places in the whole image */
    double *strength;       /* (most) result: grey levels, the strongest first */
};

/* Second differences by Sobel's filters of three by three; beyond the edge pixels are mirrored. */
static void compute_determinant(const struct blob_peaks *p, int32_t row) {
    const int32_t width = p->width;
    const float *at = p->plane + (int64_t)row * width;
    const float *above = row > 0 ? at - width : at + width;
    const float *below = row < p->height - 1 ? at + width : at - width;
    float *smooth = p->sums + 1, *second = smooth + width + 2, *first = second + width + 2;
    float *restrict result = p->determinant + (int64_t)row * width;
    for (int32_t x = 0; x < width; x++) {
        float both = above[x] + below[x], twice = at[x] + at[x];
        smooth[x] = both + twice, second[x] = both - twice, first[x] = below[x] - above[x];
    }
    smooth[-1] = smooth[1], second[-1] = second[1], first[-1] = first[1];
    smooth[width] = smooth[width - 2], second[width] = second[width - 2], first[width] = first[width - 2];
    for (int32_t x = 0; x < width; x++) {
        float xx = (smooth[x - 1] + smooth[x + 1]) - (smooth[x] + smooth[x]);
        float yy = (second[x - 1] + second[x + 1]) + (second[x] + second[x]);
        float xy = first[x + 1] - first[x - 1];
        result[x] = larger(xx, 0.0f) * yy - xy * xy; /* bright spots have no positive determinant */
    }
}

/* Whether no pixel within reach has a higher determinant. */
static int is_highest(const struct blob_peaks *p, int32_t row, int32_t column) {
    const int32_t width = p->width, reach = p->reach;
    const int32_t last_row = row + reach < p->height ? row + reach : p->height - 1;
    const int32_t last_column = column + reach < width ? column + reach : width - 1;
    const float value = p->determinant[(int64_t)row * width + column];
    for (int32_t y = row > reach ? row - reach : 0; y <= last_row; y++)
        for (int32_t x = column > reach ? column - reach : 0; x <= last_column; x++)
            if (p->determinant[(int64_t)y * width + x] > value)
                return 0;
    return 1;
}

/* Whether one peak comes before another: the stronger, of equal ones the first in the plane. */
static inline int is_before(struct blob_peak a, struct blob_peak b) {
    return a.root > b.root || (a.root == b.root && a.pixel < b.pixel);
}

/* Put a peak at `at` of a heap whose first peak comes after all others. */
static void sink(struct blob_peak *heap, int32_t count, int32_t at, struct blob_peak peak) {
    for (int32_t below; (below = 2 * at + 1) < count; at = below) {
        if (below + 1 < count && is_before(heap[below], heap[below + 1]))
            below++;
        if (!is_before(peak, heap[below]))
            break;
        heap[at] = heap[below];
    }
    heap[at] = peak;
}

/* Add a peak to those kept; where there are too many the weakest is dropped. Return how many there are. */
static int32_t keep(const struct blob_peaks *p, int32_t count, struct blob_peak peak) {
    struct blob_peak *heap = p->peak;
    if (count == p->most) {
        if (is_before(peak, heap[0]))
            sink(heap, count, 0, peak);
        return count;
    }
    int32_t at = count;
    for (int32_t above; at > 0 && is_before(heap[above = (at - 1) / 2], peak); at = above)
        heap[at] = heap[above];
    heap[at] = peak;
    return count + 1;
}

/* Whether a pixel is above the limit and as high as those beside, above and below it. */
static inline int is_top(const float *at, int32_t width, float limit) {
    int beside = (at[0] >= at[-1]) & (at[0] >= at[1]);
    return (at[0] > limit) & beside & (at[0] >= at[-width]) & (at[0] >= at[width]);
}

static int has_top(const float *at, int32_t width, float limit) {
    int any = 0;
    for (int32_t x = 0; x < STRIDE; x++)
        any |= is_top(at + x, width, limit);
    return any;
}

/* Keep the peaks of a row, without its first and last pixel; return how many are kept of all rows so far. */
static int32_t keep_row(const struct blob_peaks *p, int32_t row, int32_t count) {
    const int32_t width = p->width, first_pixel = row * width;
    const float *values = p->determinant + first_pixel;
    for (int32_t start = 1; start < width - 1; start += STRIDE) {
        int32_t end = start + STRIDE < width - 1 ? start + STRIDE : width - 1;
        if (end - start == STRIDE && !has_top(values + start, width, p->limit))
            continue;
        for (int32_t x = start; x < end; x++)
            if (is_top(values + x, width, p->limit) && is_highest(p, row, x))
                count = keep(p, count, (struct blob_peak){__builtin_sqrtf(values[x]), first_pixel + x});
    }
    return count;
}

/* How far the top of a parabola through three pixels lies ahead of the middle one, at most half a pixel. */
static double ahead(const float *at, int32_t step) {
    double before = at[-step], middle = at[0], after = at[step];
    double curvature = 2.0 * middle - before - after;
    double shift = 0.5 * (after - before) / (curvature > MIN_CURVATURE ? curvature : MIN_CURVATURE);
    return shift > -0.5 ? (shift < 0.5 ? shift : 0.5) : -0.5;
}

/* Write places and strengths of the kept peaks, a maximum between two equal pixels once; return how many were
 * written. */
static int32_t write_peaks(const struct blob_peaks *p, int32_t count) {
    int32_t written = 0;
    const double shift_px = 0.5 * (p->pixel_px - 1.0); /* from the middle of the first pixel of the image */
    double last_x = 0.0, last_y = 0.0, last_strength = -1.0;
    for (int32_t i = 0; i < count; i++) {
        const float *at = p->determinant + p->peak[i].pixel;
        double x = (p->peak[i].pixel % p->width + ahead(at, 1)) * p->pixel_px + shift_px;
        double y = (p->peak[i].pixel / p->width + ahead(at, p->width)) * p->pixel_px + shift_px;
        double strength = p->gain * p->peak[i].root;
        int is_near = __builtin_fabs(x - last_x) < SAME_PX && __builtin_fabs(y - last_y) < SAME_PX;
        int is_repeated = is_near && strength == last_strength;
        last_x = x, last_y = y, last_strength = strength;
        if (is_repeated)
            continue;
        p->position_px[2 * written] = x, p->position_px[2 * written + 1] = y;
        p->strength[written++] = strength;
    }
    return written;
}

/* Find the peaks of the plane, which has at least three rows and columns; return how many. */
KERNEL int blob_peaks_find(const struct blob_peaks *p) {
    int32_t count = 0, computed = 0;
    for (int32_t row = 1; row < p->height - 1; row++) {
        for (; computed <= row + p->reach && computed < p->height; computed++)
            compute_determinant(p, computed);
        count = keep_row(p, row, count);
    }
    for (int32_t end = count - 1; end > 0; end--) { /* the weakest goes to the end */
        struct blob_peak weakest = p->peak[0];
        sink(p->peak, end, 0, p->peak[end]);
        p->peak[end] = weakest;
    }
    return write_peaks(p, count);
}
