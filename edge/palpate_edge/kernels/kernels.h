/* What all kernels share. There is no C library: only the compiler's own headers and builtins.
 *
 * Kernels own no memory and call nothing: Python gives them arrays and keeps those. Indices from Python are
 * checked there; places may be anything, NaN as well, and never lead outside an array. */

#ifndef PALPATE_KERNELS_H
#define PALPATE_KERNELS_H

#include <stdint.h>

#define KERNEL __attribute__((visibility("default")))

typedef uint8_t byte4 __attribute__((vector_size(4)));
typedef float float4 __attribute__((vector_size(16), aligned(4)));
typedef float float8
    __attribute__((vector_size(32), aligned(4))); /* two float4 where the machine has no AVX */

static inline float smaller(float a, float b) { return a < b ? a : b; }
static inline float larger(float a, float b) { return a > b ? a : b; }

/* The value between two limits; NaN becomes the lower one. */
static inline float within(float value, float low, float high) {
    return value > low ? smaller(value, high) : low;
}

/* Of two places (x, y). */
static inline double squared_between(const double *a, const double *b) {
    const double x = a[0] - b[0], y = a[1] - b[1];
    return x * x + y * y;
}

#endif
