/* From displacements of the beads to the canonical field: see estimation/displacement_field.py. */

#include "small_matrices.h"

struct canonical_field {
    int32_t beads, padded_beads, directions;
    double bead_noise;       /* variance of a bead's place, relative to the field's */
    double noise_mm2, noise_weight, least_signal; /* of a sensor whose fields are not smoothed */
    const float *scaled;     /* (directions, 3): times sqrt(3) over the length of the covariance */
    const float *tangents;   /* (2, directions, 3): meridional and azimuthal */
    const float *scaled_beads;   /* (3, padded beads): likewise */
    const double *unit;      /* (beads, 3) */
    const double *mm_per_px; /* (beads, 3, 2) */
    const double *inverse;   /* (beads, beads): of the covariance with the beads' noise, symmetric */
    const double *modes;     /* (beads, modes): columns are eigenvectors of the covariance */
    const double *variances; /* (modes): its eigenvalues */
    const double *displacement_px; /* (beads, 2) */
    double *moved_mm;        /* (3, beads) */
    double *weights;         /* (3, beads) */
    double *amounts;         /* (3, modes) */
    float *turned;           /* (3, padded beads): beads in the canonical frame */
    float *turned_weights;   /* (3, padded beads) */
    float *kernel;           /* (directions, padded beads) */
    double *mean_motion;     /* (6,), mm */
    double *gravity;         /* (2,): centre of the squared displacement, x and y */
    double *values;          /* (2 directions,) */
};

static void turn_columns(const struct canonical_field *field, double cosine, double sine) {
    int32_t row = field->padded_beads;
    const float *unit = field->scaled_beads;
    float cos_32 = (float)cosine, sin_32 = (float)sine;
    for (int32_t b = 0; b < row; b++) {
        field->turned[b] = cos_32 * unit[b] + sin_32 * unit[row + b];
        field->turned[row + b] = cos_32 * unit[row + b] - sin_32 * unit[b];
        field->turned[2 * row + b] = unit[2 * row + b];
    }
}

/* Matern's covariance (directions, padded beads) of order 3/2 about an azimuth: by differences of the
 * directions, since products of near ones lose digits. */
static void find_kernel(const struct canonical_field *field, double cosine, double sine) {
    int32_t row = field->padded_beads;
    turn_columns(field, cosine, sine);
    const float *turned = field->turned, *direction = field->scaled;
    float *kernel = field->kernel;
    for (int32_t d = 0; d < field->directions; d++, direction += 3, kernel += row) {
        float8 to_x = all8(direction[0]), to_y = all8(direction[1]), to_z = all8(direction[2]);
        for (int32_t b = 0; b < row; b += 8) {
            const float *bead = turned + b;
            float8 x = *(const float8 *)bead - to_x, y = *(const float8 *)(bead + row) - to_y;
            float8 z = *(const float8 *)(bead + 2 * row) - to_z;
            float8 distance = sqrt8(x * x + y * y + z * z);
            *(float8 *)(kernel + b) = (1.0f + distance) * decay8(distance);
        }
    }
}

/* Displacements in the image as such on the sphere. */
static void move_on_sphere(const struct canonical_field *field) {
    int32_t count = field->beads;
    for (int32_t b = 0; b < count; b++)
        for (int k = 0; k < 3; k++) {
            const double *slope = field->mm_per_px + 6 * b + 2 * k;
            field->moved_mm[k * count + b] =
                slope[0] * field->displacement_px[2 * b] + slope[1] * field->displacement_px[2 * b + 1];
        }
}

/* The centre of gravity of what the weights w of displacements m give: with the covariance C and
 * (C + r I) w = m it is C w = m - r w. */
static void find_gravity(const struct canonical_field *field, double noise) {
    int32_t count = field->beads;
    double x = 0.0, y = 0.0;
    for (int32_t b = 0; b < count; b++) {
        double square = 0.0;
        for (int k = 0; k < 3; k++) {
            double smooth = field->moved_mm[k * count + b] - noise * field->weights[k * count + b];
            square += smooth * smooth;
        }
        x += square * field->unit[3 * b];
        y += square * field->unit[3 * b + 1];
    }
    field->gravity[0] = x, field->gravity[1] = y;
}

/* Three sums (3, count) of a row times columns (3, count). */
static inline void multiply_row(const double *row, const double *columns, int32_t count, double sums[3]) {
    sums[0] = sums[1] = sums[2] = 0.0;
    for (int32_t k = 0; k < count; k++) {
        sums[0] += row[k] * columns[k];
        sums[1] += row[k] * columns[count + k];
        sums[2] += row[k] * columns[2 * count + k];
    }
}

/* The weights of a smoothed displacement, whose noise is the beads' own. */
static void weigh_smoothed(const struct canonical_field *field) {
    int32_t count = field->beads;
    double sums[3];
    move_on_sphere(field);
    for (int32_t b = 0; b < count; b++) {
        multiply_row(field->inverse + (int64_t)b * count, field->moved_mm, count, sums);
        for (int k = 0; k < 3; k++)
            field->weights[k * count + b] = sums[k];
    }
    find_gravity(field, field->bead_noise);
}

/* The variance of a bead's place over that of the displacement of all beads, which are exact. */
static double relative_noise(const struct canonical_field *field) {
    double square = 0.0, signal, least;
    for (int32_t k = 0; k < 3 * field->beads; k++)
        square += field->moved_mm[k] * field->moved_mm[k];
    square /= field->beads;
    signal = square - field->noise_mm2;
    least = field->least_signal * square;
    least = least > 1e-12 ? least : 1e-12;
    return field->noise_mm2 / (signal > least ? signal : least);
}

/* The weights of a displacement as it is measured, all beads exact, by the covariance's modes: the noise is
 * that of the beads over the frame's displacement. */
static void weigh_exact(const struct canonical_field *field) {
    int32_t count = field->beads;
    double sums[3], *amounts = field->amounts;
    move_on_sphere(field);
    const double noise = field->bead_noise + field->noise_weight * relative_noise(field);
    for (int32_t k = 0; k < 3 * count; k++)
        amounts[k] = 0.0;
    for (int32_t b = 0; b < count; b++)
        for (int k = 0; k < 3; k++)
            add_scaled(amounts + k * count, field->modes + (int64_t)b * count, field->moved_mm[k * count + b],
                       count);
    for (int32_t mode = 0; mode < count; mode++) {
        const double per = 1.0 / (field->variances[mode] + noise);
        for (int k = 0; k < 3; k++)
            amounts[k * count + mode] *= per;
    }
    for (int32_t b = 0; b < count; b++) {
        multiply_row(field->modes + (int64_t)b * count, amounts, count, sums);
        for (int k = 0; k < 3; k++)
            field->weights[k * count + b] = sums[k];
    }
    find_gravity(field, noise);
}

/* The values of the field that the weights and the kernel about an azimuth give. */
static void find_values(const struct canonical_field *field, double cosine, double sine) {
    int32_t count = field->beads, row = field->padded_beads, directions = field->directions;
    const double *weights = field->weights;
    float *turned = field->turned_weights;  // behind the beads it stays 0
    for (int32_t b = 0; b < count; b++) {
        float x = (float)weights[b], y = (float)weights[count + b];
        turned[b] = (float)cosine * x + (float)sine * y;
        turned[row + b] = (float)cosine * y - (float)sine * x;
        turned[2 * row + b] = (float)weights[2 * count + b];
    }
    for (int32_t d = 0; d < directions; d++) {
        const float *kernel = field->kernel + (int64_t)d * row;
        float x = 0.0f, y = 0.0f, z = 0.0f;
        for (int32_t b = 0; b < row; b++) {
            x += kernel[b] * turned[b];
            y += kernel[b] * turned[row + b];
            z += kernel[b] * turned[2 * row + b];
        }
        for (int part = 0; part < 2; part++) {
            const float *along = field->tangents + 3 * (part * directions + d);
            field->values[part * directions + d] = (double)(along[0] * x + along[1] * y + along[2] * z);
        }
    }
}

/* The mean displacement of the beads on the sphere, and the mean of their directions times it. */
KERNEL int canonical_mean_motion(const struct canonical_field *field) {
    int32_t count = field->beads;
    double sums[6] = {0.0};
    move_on_sphere(field);
    for (int32_t b = 0; b < count; b++) {
        const double *unit = field->unit + 3 * b;
        const double x = field->moved_mm[b], y = field->moved_mm[count + b],
                     z = field->moved_mm[2 * count + b];
        sums[0] += x, sums[1] += y, sums[2] += z;
        sums[3] += unit[1] * z - unit[2] * y;
        sums[4] += unit[2] * x - unit[0] * z;
        sums[5] += unit[0] * y - unit[1] * x;
    }
    for (int i = 0; i < 6; i++)
        field->mean_motion[i] = sums[i] / count;
    return 0;
}

/* The covariance about an azimuth. */
KERNEL int canonical_turn(const struct canonical_field *field, double cosine, double sine) {
    find_kernel(field, cosine, sine);
    return 0;
}

/* The covariance and the field of the weights about an azimuth. */
KERNEL int canonical_weighed(const struct canonical_field *field, double cosine, double sine) {
    find_kernel(field, cosine, sine);
    find_values(field, cosine, sine);
    return 0;
}

/* The same of the displacement, which is smoothed or all_exact, about the azimuth of its centre of gravity
 * plus an angle. */
KERNEL int canonical_field(const struct canonical_field *field, int32_t all_exact, double cosine,
                           double sine) {
    if (all_exact)
        weigh_exact(field);
    else
        weigh_smoothed(field);
    double x = field->gravity[0], y = field->gravity[1], length = __builtin_sqrt(x * x + y * y);
    x = length > 0.0 ? x / length : 1.0;
    y = length > 0.0 ? y / length : 0.0;
    return canonical_weighed(field, x * cosine - y * sine, y * cosine + x * sine);
}
