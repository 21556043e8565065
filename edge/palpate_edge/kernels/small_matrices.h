/* Products and solutions of matrices of a few dozen rows. */

#ifndef PALPATE_SMALL_MATRICES_H
#define PALPATE_SMALL_MATRICES_H

#include "exponential.h"

#define BLOCK 8          /* rows of a product at a time: with six columns the sums fill the registers */
#define MOST_COLUMNS 6

/* out (columns, width) = values (columns, depth) times matrix (depth, width); width: a multiple of BLOCK.
 *
 * columns: a constant where it is called, at most MOST_COLUMNS; *_row: numbers from one row to the next. */
static inline __attribute__((always_inline)) void multiply(
    const float *matrix, int32_t depth, int32_t width, const float *values, int32_t values_row, float *out,
    int32_t out_row, const int columns
) {
    for (int32_t at = 0; at < width; at += BLOCK) {
        float4 sums[MOST_COLUMNS][2];
#pragma unroll
        for (int c = 0; c < columns; c++)
            sums[c][0] = sums[c][1] = all4(0.0f);
        for (int32_t k = 0; k < depth; k++) {
            const float *row = matrix + (int64_t)k * width + at;
            float4 first = *(const float4 *)row, second = *(const float4 *)(row + 4);
#pragma unroll
            for (int c = 0; c < columns; c++) {
                float4 factor = all4(values[c * values_row + k]);
                sums[c][0] += first * factor;
                sums[c][1] += second * factor;
            }
        }
#pragma unroll
        for (int c = 0; c < columns; c++) {
            *(float4 *)(out + c * out_row + at) = sums[c][0];
            *(float4 *)(out + c * out_row + at + 4) = sums[c][1];
        }
    }
}

static inline double dot(const double *a, const double *b, int32_t count) {
    double sum = 0.0;
    for (int32_t k = 0; k < count; k++)
        sum += a[k] * b[k];
    return sum;
}

/* Cholesky's factor of a symmetric positive matrix (size, size), of which the lower triangle is given, in its
 * place, but with the inverse of each diagonal number. Of any other matrix it has NaN or infinite numbers. */
static inline void factorise(double *matrix, int32_t size) {
    for (int32_t i = 0; i < size; i++) {
        double *row = matrix + (int64_t)i * size;
        for (int32_t j = 0; j < i; j++) {
            const double *above = matrix + (int64_t)j * size;
            row[j] = (row[j] - dot(row, above, j)) * above[j];
        }
        row[i] = 1.0 / __builtin_sqrt(row[i] - dot(row, row, i));
    }
}

/* Solve the equations of a matrix whose factor `factorise` has made; values (size,): the right sides, then
 * the solution. */
static inline void solve_factorised(const double *factor, int32_t size, double *values) {
    for (int32_t i = 0; i < size; i++) {
        const double *row = factor + (int64_t)i * size;
        values[i] = (values[i] - dot(row, values, i)) * row[i];
    }
    for (int32_t i = size - 1; i >= 0; i--) {
        const double *row = factor + (int64_t)i * size;
        values[i] *= row[i];
        for (int32_t j = 0; j < i; j++)
            values[j] -= row[j] * values[i];
    }
}

#endif
