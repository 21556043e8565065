/* Steps to the centres of symmetry of beads: vision/symmetric_fit.py has the method and the matrices.
 *
 * A bead's samples are read once, as numbers above those at its centre: the constant is a part of the fit, and
 * sums of small numbers are more exact. Rows of the least squares have COLUMNS numbers, the last one 0. */

#include "kernels.h"

enum { PROFILES = 5, PLANE = 3, FITTED = PLANE + PROFILES, COLUMNS = 24, MOST_SAMPLES = 256, MOST_CHANNELS = 3 };

static const double LEAST_DETERMINANT = 1e-12, LEAST_TRACE = 1e-6;

struct symmetric_fit {
    int32_t beads, samples, padded_samples; /* of the arrays; samples are padded to a multiple of 4 */
    int32_t channels;                       /* that are fitted */
    int32_t rounds;
    float noise, least_variation, clipped_grey, clipped_sigma, clipped_share, max_step, far_step;
    const float *grid;        /* (2, padded_samples), bead diameters */
    const float *diameter;    /* (beads), pixels of the image that is read */
    const float *weights;     /* (channels, 3) of B, G, R; not read for grey images */
    const int32_t *kind;      /* (beads), of the rows and the samples that are a bead's own */
    const float *own;         /* (kinds, padded_samples), 1 or 0 */
    const float *rows;        /* (kinds, padded_samples, COLUMNS) */
    const float *per_freedom; /* (beads) */
    const float *motion_gram; /* (beads, 3, PROFILES, PROFILES), for xx, xy and yy */
    const int32_t *which;     /* (beads), the beads that are measured, and what is known of them: */
    double *centre, *sigma;   /* (beads, 2), before and after; (beads) */
    float *explained, *clipped; /* (beads) */
};

struct image {
    const uint8_t *pixels;
    int32_t height, width, colours; /* 1 or 3 */
};

struct measured {
    double step[2], sigma;
    float explained, clipped;
};

/* Where the samples about a centre lie: index of the upper left one of four pixels, and the share of the next. */
static void place_samples(const struct symmetric_fit *fit, struct image image, const double centre[2],
                          float diameter, int32_t *index, float *right, float *below) {
    const float high_x = (float)(image.width - 1), high_y = (float)(image.height - 1);
    const float x = (float)centre[0], y = (float)centre[1];
    for (int g = 0; g < fit->padded_samples; g++) {
        const float column = within(x + diameter * fit->grid[g], 0.0f, high_x);
        const float row = within(y + diameter * fit->grid[fit->padded_samples + g], 0.0f, high_y);
        int32_t left = (int32_t)column, upper = (int32_t)row;
        left = left < image.width - 2 ? left : image.width - 2;
        upper = upper < image.height - 2 ? upper : image.height - 2;
        right[g] = column - (float)left;
        below[g] = row - (float)upper;
        index[g] = (upper * image.width + left) * image.colours;
    }
}

static float4 load_pixel(const uint8_t *bytes) {
    byte4 four;
    __builtin_memcpy(&four, bytes, 4);
    return __builtin_convertvector(four, float4);
}

/* B, G, R between four pixels. The second pixel of a row is read from the byte before it, so that no byte
 * behind the image is; its colours are then in the lanes 1 to 3. */
static float4 sample_colours(const uint8_t *upper, const uint8_t *lower, float right, float below) {
    const float4 first = load_pixel(upper) + below * (load_pixel(lower) - load_pixel(upper));
    const float4 after = load_pixel(upper + 2) + below * (load_pixel(lower + 2) - load_pixel(upper + 2));
    const float4 second = __builtin_shufflevector(after, after, 1, 2, 3, 3);
    return first + right * (second - first);
}

static float sample_grey(const uint8_t *upper, const uint8_t *lower, float right, float below) {
    const float first = (float)upper[0] + right * ((float)upper[1] - (float)upper[0]);
    const float second = (float)lower[0] + right * ((float)lower[1] - (float)lower[0]);
    return first + below * (second - first);
}

/* Read the samples (channels, padded_samples) above the centre's; return the share that is clipped. */
static float read_samples(const struct symmetric_fit *fit, struct image image, const double centre[2],
                          float diameter, float values[MOST_CHANNELS][MOST_SAMPLES]) {
    int32_t index[MOST_SAMPLES];
    float right[MOST_SAMPLES], below[MOST_SAMPLES];
    place_samples(fit, image, centre, diameter, index, right, below);
    const int32_t row = image.width * image.colours, count = fit->samples;
    float clipped = 0.0f;
    if (image.colours == 1) {
        for (int g = 0; g < count; g++) {
            const uint8_t *upper = image.pixels + index[g];
            values[0][g] = sample_grey(upper, upper + row, right[g], below[g]);
        }
        for (int g = 0; g < count; g++) clipped += values[0][g] > fit->clipped_grey ? 1.0f : 0.0f;
        const float centre_grey = values[0][count / 2];
        for (int g = 0; g < count; g++) values[0][g] -= centre_grey;
        return clipped / (float)count;
    }
    float4 colours[MOST_SAMPLES], white = {0, 0, 0, 0};
    for (int g = 0; g < count; g++) {
        const uint8_t *upper = image.pixels + index[g];
        colours[g] = sample_colours(upper, upper + row, right[g], below[g]);
        white -= __builtin_convertvector(colours[g] > fit->clipped_grey, float4); /* true is -1 */
    }
    const float4 centre_colours = colours[count / 2];
    for (int c = 0; c < fit->channels; c++) {
        const float *w = fit->weights + 3 * c;
        for (int g = 0; g < count; g++) {
            const float4 above = colours[g] - centre_colours;
            values[c][g] = w[0] * above[0] + w[1] * above[1] + w[2] * above[2];
        }
    }
    return (white[0] + white[1] + white[2]) / (float)(3 * count);
}

/* The products (COLUMNS) of one channel's samples and the rows of the least squares. */
static void multiply_rows(const float *samples, const float *rows, int count, float products[COLUMNS]) {
    float8 sums[COLUMNS / 8] = {{0}};
    for (int g = 0; g < count; g++) {
        const float8 *row = (const float8 *)(rows + (int64_t)g * COLUMNS);
        for (int v = 0; v < COLUMNS / 8; v++) sums[v] += samples[g] * row[v];
    }
    __builtin_memcpy(products, sums, sizeof sums);
}

/* The inverse of a symmetric matrix of 1 to 3 rows, by its cofactors. */
static void invert(const float m[MOST_CHANNELS][MOST_CHANNELS], int size, float out[MOST_CHANNELS][MOST_CHANNELS]) {
    if (size == 1) {
        out[0][0] = 1.0f / m[0][0];
    } else if (size == 2) {
        const float per = 1.0f / (m[0][0] * m[1][1] - m[0][1] * m[1][0]);
        out[0][0] = per * m[1][1];
        out[1][1] = per * m[0][0];
        out[0][1] = out[1][0] = -per * m[0][1];
    } else {
        for (int i = 0; i < 3; i++) {
            for (int j = 0; j < 3; j++) {
                const int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
                out[i][j] = m[a][c] * m[b][d] - m[a][d] * m[b][c];
            }
        }
        const float per = 1.0f / (out[0][0] * m[0][0] + out[0][1] * m[0][1] + out[0][2] * m[0][2]);
        for (int i = 0; i < 3; i++) {
            for (int j = 0; j < 3; j++) out[i][j] *= per;
        }
    }
}

/* One step, in bead diameters, from a centre to that of symmetry. */
static struct measured measure_step(const struct symmetric_fit *fit, struct image image, int bead,
                                    const double centre[2]) {
    const int channels = fit->channels, count = fit->samples, kind = fit->kind[bead];
    const float *own = fit->own + (int64_t)kind * fit->padded_samples;
    const float *rows = fit->rows + (int64_t)kind * fit->padded_samples * COLUMNS;
    float values[MOST_CHANNELS][MOST_SAMPLES], products[MOST_CHANNELS][COLUMNS];
    struct measured out;
    out.clipped = read_samples(fit, image, centre, fit->diameter[bead], values);
    for (int c = 0; c < channels; c++) {
        for (int g = 0; g < count; g++) values[c][g] *= own[g];
        multiply_rows(values[c], rows, count, products[c]);
    }
    const float per_freedom = fit->per_freedom[bead];
    float unexplained[MOST_CHANNELS][MOST_CHANNELS], inverse[MOST_CHANNELS][MOST_CHANNELS];
    float by_profile = 0.0f, left_over = fit->least_variation * (float)channels / per_freedom;
    for (int i = 0; i < channels; i++) {
        const float *fitted = products[i] + 3 * PROFILES;
        for (int k = PLANE; k < FITTED; k++) by_profile += fitted[k] * fitted[k]; /* orthogonal to the light's */
        for (int j = 0; j <= i; j++) {
            const float *other = products[j] + 3 * PROFILES;
            float sum = 0.0f, explained = 0.0f;
            for (int g = 0; g < count; g++) sum += values[i][g] * values[j][g];
            for (int k = 0; k < FITTED; k++) explained += fitted[k] * other[k];
            unexplained[i][j] = unexplained[j][i] = (sum - explained) * per_freedom;
        }
        left_over += unexplained[i][i] / per_freedom;
        unexplained[i][i] += fit->noise;
    }
    invert(unexplained, channels, inverse);
    float force[2] = {0, 0}, contrast[PROFILES][PROFILES] = {{0}};
    for (int i = 0; i < channels; i++) {
        for (int p = 0; p < PROFILES; p++) {
            float weighted = 0.0f;
            for (int j = 0; j < channels; j++) weighted += inverse[i][j] * products[j][p];
            force[0] += products[i][PROFILES + p] * weighted;
            force[1] += products[i][2 * PROFILES + p] * weighted;
            for (int q = 0; q < PROFILES; q++) contrast[p][q] += weighted * products[i][q];
        }
    }
    double gram[3] = {0, 0, 0};
    const float *motion = fit->motion_gram + (int64_t)bead * 3 * PROFILES * PROFILES;
    for (int a = 0; a < 3; a++) {
        float sum = 0.0f;
        for (int k = 0; k < PROFILES * PROFILES; k++) sum += motion[a * PROFILES * PROFILES + k] * (&contrast[0][0])[k];
        gram[a] = sum;
    }
    /* All samples alike (white, black) determine nothing: then the deviation is a thousand diameters. */
    double determinant = gram[0] * gram[2] - gram[1] * gram[1], trace = gram[0] + gram[2];
    determinant = determinant > LEAST_DETERMINANT ? determinant : LEAST_DETERMINANT;
    trace = trace > LEAST_TRACE ? trace : LEAST_TRACE;
    const double ahead[2] = {(gram[2] * force[0] - gram[1] * force[1]) / determinant,
                             (gram[0] * force[1] - gram[1] * force[0]) / determinant};
    for (int a = 0; a < 2; a++) {
        const double limit = fit->max_step;
        out.step[a] = ahead[a] > limit ? limit : ahead[a] < -limit ? -limit : ahead[a];
    }
    const float raised = 1.0f + fit->clipped_sigma * smaller(out.clipped / fit->clipped_share, 1.0f);
    out.sigma = __builtin_sqrt(trace / determinant) * raised;
    out.explained = by_profile / (by_profile + larger(left_over, 0.0f));
    return out;
}

/* Move the centres of the first `count` beads of `which` in at most `rounds` steps to those of symmetry. */
KERNEL int symmetric_fit_measure(const struct symmetric_fit *fit, const uint8_t *pixels, int32_t height,
                                 int32_t width, int32_t colours, int32_t count) {
    const struct image image = {pixels, height, width, colours};
    const double far_squared = (double)fit->far_step * fit->far_step;
    for (int i = 0; i < count; i++) {
        const int bead = fit->which[i];
        double *centre = fit->centre + 2 * i;
        for (int round = 0; round < fit->rounds; round++) {
            const struct measured found = measure_step(fit, image, bead, centre);
            const double x = found.step[0], y = found.step[1], diameter = fit->diameter[bead];
            centre[0] += x * diameter;
            centre[1] += y * diameter;
            fit->sigma[i] = found.sigma;
            fit->explained[i] = found.explained;
            fit->clipped[i] = found.clipped;
            if (!(x * x + y * y > far_squared)) break;
        }
    }
    return 0;
}
