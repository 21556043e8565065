/* Products and solutions of matrices of a few dozen rows. */

#ifndef PALPATE_SMALL_MATRICES_H
#define PALPATE_SMALL_MATRICES_H

#include "exponential.h"

#define BLOCK 8          /* rows of a product at a time: with six columns the sums fill the registers */
#define MOST_COLUMNS 6

/* out (columns, width) = values (columns, depth) times matrix (depth, width); width: a multiple of BLOCK.
 *
 * columns: a constant where it is called, at most MOST_COLUMNS; *_row: numbers from one row to the next. */
static inline __attribute__((always_inline)) void multiply(const float *matrix, int32_t depth, int32_t width,
                                                           const float *values, int32_t values_row,
                                                           float *out, int32_t out_row, const int columns) {
    for (int32_t at = 0; at < width; at += BLOCK) {
        float8 sums[MOST_COLUMNS];
#pragma unroll
        for (int c = 0; c < columns; c++)
            sums[c] = all8(0.0f);
        for (int32_t k = 0; k < depth; k++) {
            const float8 row = *(const float8 *)(matrix + (int64_t)k * width + at);
#pragma unroll
            for (int c = 0; c < columns; c++)
                sums[c] += row * values[c * values_row + k];
        }
#pragma unroll
        for (int c = 0; c < columns; c++)
            *(float8 *)(out + c * out_row + at) = sums[c];
    }
}

static inline double dot(const double *a, const double *b, int32_t count) {
    double sum = 0.0;
    for (int32_t k = 0; k < count; k++)
        sum += a[k] * b[k];
    return sum;
}

static inline void add_scaled(double *restrict sum, const double *restrict values, double factor,
                              int32_t count) {
    for (int32_t k = 0; k < count; k++)
        sum[k] += factor * values[k];
}

/* Add four rows of a matrix times their factors: a sum is loaded and stored less often than one by one. */
static inline void add_four(double *restrict sum, const double *const rows[4], const double factors[4],
                            int32_t from, int32_t to) {
    const double *restrict a = rows[0], *restrict b = rows[1], *restrict c = rows[2], *restrict d = rows[3];
    for (int32_t k = from; k < to; k++)
        sum[k] += factors[0] * a[k] + factors[1] * b[k] + factors[2] * c[k] + factors[3] * d[k];
}

/* Cholesky's factor U, with U' U = A, of a symmetric positive matrix A (size, size), of which the upper
 * triangle is given, in its place, but with the inverse of each diagonal number. Of any other matrix it has
 * NaN or infinite numbers. */
static inline void factorise(double *matrix, int32_t size) {
    for (int32_t i = 0; i < size; i++) {
        double *row = matrix + (int64_t)i * size;
        int32_t k = 0;
        for (; k + 3 < i; k += 4) {
            const double *above = matrix + (int64_t)k * size;
            const double *rows[4] = {above, above + size, above + 2 * size, above + 3 * size};
            const double factors[4] = {-rows[0][i], -rows[1][i], -rows[2][i], -rows[3][i]};
            add_four(row, rows, factors, i, size);
        }
        for (; k < i; k++) {
            const double *above = matrix + (int64_t)k * size;
            add_scaled(row + i, above + i, -above[i], size - i);
        }
        row[i] = 1.0 / __builtin_sqrt(row[i]);
        for (int32_t j = i + 1; j < size; j++)
            row[j] *= row[i];
    }
}

/* Solve the equations of a matrix whose factor `factorise` has made; values (size,): the right sides, then
 * the solution. */
static inline void solve_factorised(const double *factor, int32_t size, double *values) {
    for (int32_t i = 0; i < size; i++) {
        const double *row = factor + (int64_t)i * size;
        values[i] *= row[i];
        add_scaled(values + i + 1, row + i + 1, -values[i], size - i - 1);
    }
    for (int32_t i = size - 1; i >= 0; i--) {
        const double *row = factor + (int64_t)i * size;
        values[i] = (values[i] - dot(row + i + 1, values + i + 1, size - i - 1)) * row[i];
    }
}

#endif
