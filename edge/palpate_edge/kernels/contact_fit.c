/* Gauss-Newton steps of a contact to the displacement of the beads: see estimation/contact_fit/
 * contact_fitter.py. Single precision where fields are summed, double for the equations of a step.
 *
 * The columns of a product (a contact's field, then its slopes along the five numbers) lie one after the
 * other, each padded. */

#include "small_matrices.h"

#define NUMBERS 5  /* of a contact: place along two tangents, way along two, logarithm of the size */
#define COLUMNS 6
#define POINT 7

struct contact_fit {
    int32_t steps, beads, padded_beads, directions, centres, padded_centres, shapes, padded_shapes;
    int32_t padded_skin, padded_fields;
    double noise_px2, model_error2, least_signal, least_force_N, least_size_mm, largest_turn_rad;
    double largest_growth, place_weight, force_weight, size_weight;
    const float *centre;     /* (7, padded centres) */
    const float *weights;    /* (centres, padded shapes) */
    const float *offset;     /* (padded shapes,) */
    const float *fields;     /* (shapes + 1, padded fields) */
    const float *skin;       /* (shapes + 1, padded skin): x of all directions, then y, then z */
    const float *kernel;     /* (directions, padded beads), of the frame's azimuth */
    const float *px_per_mm;  /* (2, 3, padded beads) */
    const double *start;     /* (16,): see below */
    const double *values;    /* (2 g,) */
    const double *measured_px;  /* (beads, 2) */
    const double *bead_weight;  /* (beads,) */
    double *weight;          /* (beads,): of each bead's x and y, 1/px^2 */
    float *both;             /* (6, padded centres) */
    float *coefficients;     /* (6, padded shapes + 8) */
    float *moved;            /* (6, padded skin) */
    float *seen;             /* (3, 6, padded beads) */
    float *expected;         /* (padded fields,) */
    double *fitted;          /* (4,): place in F, misfit */
};

/* Numbers of `start`: place and force in F, cosine and sine of the azimuth, size and its logarithm, count of
 * found beads, precision of the five numbers. */
enum start { PLACE = 0, FORCE = 3, COSINE = 6, SINE, SIZE, LOG_SIZE, FOUND, PRECISION };

/* A contact in the canonical frame. */
struct touch {
    double place[3], way[3], size_mm, log_size;
};

static inline void to_canonical(const double *vector, const double *start, double *turned) {
    turned[0] = start[COSINE] * vector[0] + start[SINE] * vector[1];
    turned[1] = start[COSINE] * vector[1] - start[SINE] * vector[0];
    turned[2] = vector[2];
}

static inline void scale_to_unit(double *vector) {
    double length = __builtin_sqrt(dot(vector, vector, 3));
    for (int k = 0; k < 3; k++)
        vector[k] /= length;
}

/* Two orthonormal vectors (2, 3) across a unit vector. */
static void tangents_of(const double *unit, double tangents[2][3]) {
    double x = unit[0], y = unit[1], z = unit[2], *first = tangents[0], *second = tangents[1];
    if (y < 0.9 && y > -0.9) {
        double length = __builtin_sqrt(x * x + z * z);
        first[0] = z / length, first[1] = 0.0, first[2] = -x / length;
    } else {
        double length = __builtin_sqrt(y * y + z * z);
        first[0] = 0.0, first[1] = -z / length, first[2] = y / length;
    }
    second[0] = y * first[2] - z * first[1];
    second[1] = z * first[0] - x * first[2];
    second[2] = x * first[1] - y * first[0];
}

/* The kernels of the centres at a contact and, with `tangents`, their slopes along the five numbers. */
static void kernels_of_centres(const struct contact_fit *fit, const struct touch *touch,
                               double tangents[4][3]) {
    int32_t row = fit->padded_centres;
    float point[POINT], along[4][3], growth = (float)fit->size_weight;
    for (int k = 0; k < 3; k++) {
        point[k] = (float)(fit->place_weight * touch->place[k]);
        point[3 + k] = (float)(fit->force_weight * (touch->way[k] + touch->place[k]));
        for (int t = 0; tangents && t < 4; t++)
            along[t][k] = (float)((t < 2 ? fit->place_weight : fit->force_weight) * tangents[t][k]);
    }
    point[6] = (float)(fit->size_weight * touch->log_size);
    for (int32_t at = 0; at < row; at += BLOCK) {
        float8 off[POINT], square = all8(0.0f);
        for (int k = 0; k < POINT; k++) {
            off[k] = *(const float8 *)(fit->centre + k * row + at) - all8(point[k]);
            square += off[k] * off[k];
        }
        float8 kernel = decay8(0.5f * square);
        *(float8 *)(fit->both + at) = kernel;
        if (!tangents)
            continue;
        for (int t = 0; t < 4; t++) {
            const float8 *across = off + (t < 2 ? 0 : 3);
            float8 slope = across[0] * along[t][0] + across[1] * along[t][1] + across[2] * along[t][2];
            *(float8 *)(fit->both + (1 + t) * row + at) = kernel * slope;
        }
        *(float8 *)(fit->both + 5 * row + at) = kernel * (off[6] * growth);
    }
}

/* The coefficients (6, shapes + 1) of a contact's field and of its slopes, or only the field's. */
static void coefficients_of(const struct contact_fit *fit, int with_slopes) {
    int32_t width = fit->padded_shapes, row = width + BLOCK;
    float *field = fit->coefficients, *growth = field + 5 * row;
    if (with_slopes)
        multiply(fit->weights, fit->centres, width, fit->both, fit->padded_centres, field, row, COLUMNS);
    else
        multiply(fit->weights, fit->centres, width, fit->both, fit->padded_centres, field, row, 1);
    for (int32_t k = 0; k < fit->shapes; k++)
        field[k] += fit->offset[k];
    field[fit->shapes] = 1.0f;  // the mean field's
    if (!with_slopes)
        return;
    for (int c = 1; c < COLUMNS; c++)
        field[c * row + fit->shapes] = 0.0f;
    for (int32_t k = 0; k <= fit->shapes; k++)
        growth[k] += field[k];  // a field grows with its size
}

/* What the beads show of fields of size 1: `seen`, (3, 6, beads), mm, in the canonical frame. */
static void see(const struct contact_fit *fit) {
    int32_t skin = fit->padded_skin, row = fit->padded_beads, count = fit->directions;
    int32_t all = fit->padded_shapes + BLOCK;
    multiply(fit->skin, fit->shapes + 1, skin, fit->coefficients, all, fit->moved, skin, COLUMNS);
    for (int axis = 0; axis < 3; axis++) {
        float *seen = fit->seen + axis * COLUMNS * row;
        multiply(fit->kernel, count, row, fit->moved + axis * count, skin, seen, row, COLUMNS);
    }
}

/* The normal equations of a step without the precisions: normal (5, 5), upper triangle; right sides (5,). */
static void normal_equations(const struct contact_fit *fit, double size_mm, double *normal, double *right) {
    int32_t row = fit->padded_beads;
    double cosine = fit->start[COSINE], sine = fit->start[SINE];
    for (int i = 0; i < NUMBERS * NUMBERS; i++)
        normal[i] = 0.0;
    for (int i = 0; i < NUMBERS; i++)
        right[i] = 0.0;
    for (int32_t b = 0; b < fit->beads; b++)
        for (int axis = 0; axis < 2; axis++) {
            const float *px = fit->px_per_mm + axis * 3 * row + b;
            float x = px[0] * (float)cosine + px[row] * (float)sine;
            float y = px[row] * (float)cosine - px[0] * (float)sine, z = px[2 * row];
            double shown[COLUMNS];
            for (int c = 0; c < COLUMNS; c++) {
                const float *seen = fit->seen + c * row + b;
                float sum = x * seen[0] + y * seen[COLUMNS * row] + z * seen[2 * COLUMNS * row];
                shown[c] = size_mm * (double)sum;
            }
            double left_px = fit->measured_px[2 * b + axis] - shown[0];
            for (int i = 0; i < NUMBERS; i++) {
                double weighted = fit->weight[b] * shown[1 + i];
                right[i] += weighted * left_px;
                for (int j = i; j < NUMBERS; j++)
                    normal[i * NUMBERS + j] += weighted * shown[1 + j];
            }
        }
}

static void take_step(const struct contact_fit *fit, struct touch *touch, double *moved) {
    double tangents[4][3], normal[NUMBERS * NUMBERS], step[NUMBERS];
    const double *precision = fit->start + PRECISION;
    tangents_of(touch->place, tangents);
    tangents_of(touch->way, tangents + 2);
    kernels_of_centres(fit, touch, tangents);
    coefficients_of(fit, 1);
    see(fit);
    normal_equations(fit, touch->size_mm, normal, step);
    for (int i = 0; i < NUMBERS; i++) {
        normal[i * NUMBERS + i] += precision[i];
        step[i] -= precision[i] * moved[i];
    }
    factorise(normal, NUMBERS);
    solve_factorised(normal, NUMBERS, step);
    double turn_rad = __builtin_sqrt(dot(step, step, 4));
    double share = turn_rad > fit->largest_turn_rad ? fit->largest_turn_rad / turn_rad : 1.0;
    for (int i = 0; i < NUMBERS; i++)
        step[i] *= share;
    if (step[4] > fit->largest_growth)
        step[4] = fit->largest_growth;
    if (step[4] < -fit->largest_growth)
        step[4] = -fit->largest_growth;
    for (int k = 0; k < 3; k++) {
        double place = touch->place[k];
        touch->place[k] += step[0] * tangents[0][k] + step[1] * tangents[1][k];
        touch->way[k] += place + step[2] * tangents[2][k] + step[3] * tangents[3][k];
    }
    scale_to_unit(touch->place);
    for (int k = 0; k < 3; k++)
        touch->way[k] -= touch->place[k];
    scale_to_unit(touch->way);
    touch->log_size += step[4];
    touch->size_mm *= exp_of_small(step[4]);
    for (int i = 0; i < NUMBERS; i++)
        moved[i] += step[i];
}

/* What a contact's field leaves of the frame's, squared, both of size 1. */
static double misfit_of(const struct contact_fit *fit, const struct touch *touch) {
    kernels_of_centres(fit, touch, 0);
    coefficients_of(fit, 0);
    multiply(fit->fields, fit->shapes + 1, fit->padded_fields, fit->coefficients, 0, fit->expected, 0, 1);
    double product = 0.0, expected = 0.0, given = 0.0;
    for (int32_t k = 0; k < 2 * fit->directions; k++) {
        double one = (double)fit->expected[k], other = fit->values[k];
        product += one * other;
        expected += one * one;
        given += other * other;
    }
    double least2 = fit->least_size_mm * fit->least_size_mm, squares = expected * given;
    return 2.0 - 2.0 * product / __builtin_sqrt(squares < least2 * least2 ? least2 * least2 : squares);
}

static void weigh_beads(const struct contact_fit *fit) {
    double total = 0.0, square = 0.0;
    for (int32_t b = 0; b < fit->beads; b++) {
        double x = fit->measured_px[2 * b], y = fit->measured_px[2 * b + 1];
        total += fit->bead_weight[b];
        square += 0.5 * fit->bead_weight[b] * (x * x + y * y);
    }
    total = total > 1e-12 ? total : 1e-12;
    square /= total;
    double signal = square - fit->noise_px2 * fit->start[FOUND] / total, least = fit->least_signal * square;
    signal = signal > least ? signal : least;
    signal = signal > 1e-12 ? signal : 1e-12;
    for (int32_t b = 0; b < fit->beads; b++) {
        double weight = fit->bead_weight[b];
        fit->weight[b] = weight / (fit->noise_px2 + fit->model_error2 * signal * weight);
    }
}

KERNEL int contact_fit(const struct contact_fit *fit) {
    const double *start = fit->start;
    struct touch touch = {.size_mm = start[SIZE], .log_size = start[LOG_SIZE]};
    double moved[NUMBERS] = {0.0};
    to_canonical(start + PLACE, start, touch.place);
    to_canonical(start + FORCE, start, touch.way);
    double force_N = __builtin_sqrt(dot(touch.way, touch.way, 3));
    for (int k = 0; k < 3; k++)
        touch.way[k] = force_N > fit->least_force_N ? touch.way[k] / force_N : -touch.place[k];
    weigh_beads(fit);
    for (int32_t step = 0; step < fit->steps; step++)
        take_step(fit, &touch, moved);
    fit->fitted[0] = start[COSINE] * touch.place[0] - start[SINE] * touch.place[1];
    fit->fitted[1] = start[SINE] * touch.place[0] + start[COSINE] * touch.place[1];
    fit->fitted[2] = touch.place[2];
    fit->fitted[3] = misfit_of(fit, &touch);
    return 0;
}
