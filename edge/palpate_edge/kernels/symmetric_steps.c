/* Steps to the centres of symmetry of beads: vision/symmetric_fit.py has the method and the matrices.
 *
 * A bead's samples are read once, as numbers above those at its centre: the fit has a constant, and
 * sums of small numbers are more exact. Rows of the least squares have COLUMNS numbers, the last one 0. */

#include "symmetric_steps.h"

enum {
    PROFILES = 5,
    PLANE = 3,
    FITTED = PLANE + PROFILES,
    COLUMNS = 24,
    MOST_SAMPLES = 256,
    MOST_COLOURS = 3
};

static const double LEAST_DETERMINANT = 1e-12, LEAST_TRACE = 1e-6;

struct measured {
    double step[2], sigma;
    float explained, clipped;
};

/* Where the samples about a centre lie: index of the upper left of four pixels, and the share of the next. */
static void place_samples(const struct symmetric_fit *fit, struct image image, const double centre[2],
                          float diameter, int32_t *index, float *right, float *below) {
    const float high_x = (float)(image.width - 1), high_y = (float)(image.height - 1);
    const float x = (float)centre[0], y = (float)centre[1];
    if (image.source) {
        const float reach = diameter * fit->reach + 1.0f;
        make_pixels(image.source, (int32_t)within(x - reach, 0.0f, high_x),
                    (int32_t)within(y - reach, 0.0f, high_y), (int32_t)within(x + reach, 0.0f, high_x),
                    (int32_t)within(y + reach, 0.0f, high_y));
    }
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

/* Products of a bead's samples: with the rows of the least squares, and with each other. */
struct products {
    float rows[MOST_COLOURS][COLUMNS], squares[MOST_COLOURS][MOST_COLOURS], clipped;
};

/* Samples of B, G, R in one sum for each: 12 of them, which do not wait for each other. */
static void multiply_colours(const struct symmetric_fit *fit, struct image image, int kind,
                             const int32_t *index, const float *right, const float *below,
                             struct products *out) {
    const float *own = fit->own + (int64_t)kind * fit->padded_samples;
    const float8 *rows = (const float8 *)(fit->rows + (int64_t)kind * fit->padded_samples * COLUMNS);
    const int32_t row = image.width * image.colours, count = fit->samples;
    const uint8_t *middle = image.pixels + index[count / 2];
    const float4 centre = sample_colours(middle, middle + row, right[count / 2], below[count / 2]);
    float8 sums[MOST_COLOURS][COLUMNS / 8] = {{{0}}};
    float4 squares[MOST_COLOURS] = {{0}}, white = {0, 0, 0, 0}, above[MOST_SAMPLES];
    for (int g = 0; g < count; g++) {
        const uint8_t *upper = image.pixels + index[g];
        const float4 sample = sample_colours(upper, upper + row, right[g], below[g]);
        white -= __builtin_convertvector(sample > fit->clipped_grey, float4); /* true is -1 */
        above[g] = own[g] * (sample - centre);
        for (int c = 0; c < MOST_COLOURS; c++)
            squares[c] += above[g][c] * above[g];
    }
    for (int g = 0; g < count; g++) { /* in a loop of its own: the sums fill the registers */
        for (int c = 0; c < MOST_COLOURS; c++) {
            for (int v = 0; v < COLUMNS / 8; v++)
                sums[c][v] += above[g][c] * rows[g * (COLUMNS / 8) + v];
        }
    }
    for (int c = 0; c < MOST_COLOURS; c++) {
        for (int d = 0; d < MOST_COLOURS; d++)
            out->squares[c][d] = squares[c][d];
    }
    __builtin_memcpy(out->rows, sums, sizeof sums);
    out->clipped = (white[0] + white[1] + white[2]) / (float)(MOST_COLOURS * count);
}

static void multiply_greys(const struct symmetric_fit *fit, struct image image, int kind,
                           const int32_t *index, const float *right, const float *below,
                           struct products *out) {
    const float *own = fit->own + (int64_t)kind * fit->padded_samples;
    const float8 *rows = (const float8 *)(fit->rows + (int64_t)kind * fit->padded_samples * COLUMNS);
    const int32_t count = fit->samples;
    const uint8_t *middle = image.pixels + index[count / 2];
    const float centre = sample_grey(middle, middle + image.width, right[count / 2], below[count / 2]);
    float8 sums[COLUMNS / 8] = {{0}};
    float squares = 0.0f, white = 0.0f;
    for (int g = 0; g < count; g++) {
        const uint8_t *upper = image.pixels + index[g];
        const float sample = sample_grey(upper, upper + image.width, right[g], below[g]);
        white += sample > fit->clipped_grey ? 1.0f : 0.0f;
        const float above = own[g] * (sample - centre);
        squares += above * above;
        for (int v = 0; v < COLUMNS / 8; v++)
            sums[v] += above * rows[g * (COLUMNS / 8) + v];
    }
    __builtin_memcpy(out->rows, sums, sizeof sums);
    out->squares[0][0] = squares;
    out->clipped = white / (float)count;
}

/* The products of the channels that are fitted, in place of those of B, G, R. */
static void mix_channels(const struct symmetric_fit *fit, struct products *products) {
    const struct products of_colours = *products;
    for (int i = 0; i < fit->channels; i++) {
        const float *w = fit->weights + MOST_COLOURS * i;
        for (int k = 0; k < COLUMNS; k++) {
            products->rows[i][k] =
                w[0] * of_colours.rows[0][k] + w[1] * of_colours.rows[1][k] + w[2] * of_colours.rows[2][k];
        }
        for (int j = 0; j <= i; j++) {
            const float *v = fit->weights + MOST_COLOURS * j;
            float sum = 0.0f;
            for (int c = 0; c < MOST_COLOURS; c++) {
                for (int d = 0; d < MOST_COLOURS; d++)
                    sum += w[c] * v[d] * of_colours.squares[c][d];
            }
            products->squares[i][j] = sum;
        }
    }
}

static struct products measure_products(const struct symmetric_fit *fit, struct image image, int bead,
                                        const double centre[2]) {
    int32_t index[MOST_SAMPLES];
    float right[MOST_SAMPLES], below[MOST_SAMPLES];
    struct products out;
    place_samples(fit, image, centre, fit->diameter_px[bead], index, right, below);
    if (image.colours == 1) {
        multiply_greys(fit, image, fit->kind[bead], index, right, below, &out);
    } else {
        multiply_colours(fit, image, fit->kind[bead], index, right, below, &out);
        mix_channels(fit, &out);
    }
    return out;
}

/* The inverse of a symmetric matrix of 1 to 3 rows, by its cofactors. */
static void invert(const float m[MOST_COLOURS][MOST_COLOURS], int size,
                   float out[MOST_COLOURS][MOST_COLOURS]) {
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
            for (int j = 0; j < 3; j++)
                out[i][j] *= per;
        }
    }
}

/* One step, in bead diameters, from a centre to that of symmetry. */
static struct measured measure_step(const struct symmetric_fit *fit, struct image image, int bead,
                                    const double centre[2]) {
    const int channels = fit->channels;
    const struct products of = measure_products(fit, image, bead, centre);
    struct measured out;
    out.clipped = of.clipped;
    const float per_freedom = fit->per_freedom[bead];
    float unexplained[MOST_COLOURS][MOST_COLOURS], inverse[MOST_COLOURS][MOST_COLOURS];
    float by_profile = 0.0f, left_over = fit->least_variation * (float)channels / per_freedom;
    for (int i = 0; i < channels; i++) {
        const float *fitted = of.rows[i] + 3 * PROFILES;
        for (int k = PLANE; k < FITTED; k++)
            by_profile += fitted[k] * fitted[k]; /* orthogonal to the light's */
        for (int j = 0; j <= i; j++) {
            const float *other = of.rows[j] + 3 * PROFILES;
            float explained = 0.0f;
            for (int k = 0; k < FITTED; k++)
                explained += fitted[k] * other[k];
            unexplained[i][j] = unexplained[j][i] = (of.squares[i][j] - explained) * per_freedom;
        }
        left_over += unexplained[i][i] / per_freedom;
        unexplained[i][i] += fit->noise;
    }
    invert(unexplained, channels, inverse);
    float force[2] = {0, 0}, contrast[PROFILES][PROFILES] = {{0}};
    for (int i = 0; i < channels; i++) {
        for (int p = 0; p < PROFILES; p++) {
            float weighted = 0.0f;
            for (int j = 0; j < channels; j++)
                weighted += inverse[i][j] * of.rows[j][p];
            force[0] += of.rows[i][PROFILES + p] * weighted;
            force[1] += of.rows[i][2 * PROFILES + p] * weighted;
            for (int q = 0; q < PROFILES; q++)
                contrast[p][q] += weighted * of.rows[i][q];
        }
    }
    double gram[3] = {0, 0, 0};
    const float *motion = fit->motion_gram + (int64_t)bead * 3 * PROFILES * PROFILES;
    for (int a = 0; a < 3; a++) {
        float sum = 0.0f;
        for (int k = 0; k < PROFILES * PROFILES; k++)
            sum += motion[a * PROFILES * PROFILES + k] * (&contrast[0][0])[k];
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
KERNEL int symmetric_fit_measure(const struct symmetric_fit *fit, int32_t count) {
    const struct image image = fit->image;
    const double far_squared = (double)fit->far_step * fit->far_step;
    for (int i = 0; i < count; i++) {
        const int bead = fit->which[i];
        double *centre = fit->position_px + 2 * i;
        for (int round = 0; round < fit->rounds; round++) {
            const struct measured found = measure_step(fit, image, bead, centre);
            const double x = found.step[0], y = found.step[1], diameter = fit->diameter_px[bead];
            centre[0] += x * diameter;
            centre[1] += y * diameter;
            fit->sigma[i] = found.sigma;
            fit->explained[i] = found.explained;
            fit->clipped[i] = found.clipped;
            if (!(x * x + y * y > far_squared))
                break;
        }
    }
    return 0;
}
