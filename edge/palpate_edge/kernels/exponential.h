/* Functions of eight floats at once, and the exponential of a double: there is no C library. */

#ifndef PALPATE_EXPONENTIAL_H
#define PALPATE_EXPONENTIAL_H

#include "kernels.h"

typedef int32_t whole8 __attribute__((vector_size(32), aligned(4)));

static inline float8 all8(float value) {
    return (float8){value, value, value, value, value, value, value, value};
}

static inline float8 sqrt8(float8 x) {
    for (int i = 0; i < 8; i++)
        x[i] = __builtin_sqrtf(x[i]);
    return x;
}

/* exp(-x) of x >= 0 to 2 ulp (Moshier, Cephes, expf): -x = n log 2 + r with |r| <= log(2) / 2, a polynomial
 * of r, times 2^n. Above 87 it is that of 87; NaN stays NaN.
 *
 * The sum of a float and 1.5 2^23 holds its whole part in the last bits. */
static inline float8 decay8(float8 x) {
#pragma clang fp reassociate(off)
    const float8 whole_bits = all8(12582912.0f);
    whole8 is_above = x > all8(87.0f);
    float8 bounded = (float8)(((whole8)x & ~is_above) | ((whole8)all8(87.0f) & is_above));
    float8 shifted = whole_bits - bounded * 1.44269504f, n = shifted - whole_bits;
    float8 r = n * -0.693359375f - bounded;
    r = r + n * 2.12194440e-4f;
    float8 sum = r * 1.9875691500e-4f + 1.3981999507e-3f;
    sum = sum * r + 8.3334519073e-3f;
    sum = sum * r + 4.1665795894e-2f;
    sum = sum * r + 1.6666665459e-1f;
    sum = sum * r + 5.0000001201e-1f;
    sum = sum * (r * r) + r;
    return (sum + 1.0f) * (float8)(((whole8)shifted + 127) << 23);
}

/* exp(x) of a small number, |x| < 1, by its series. */
static inline double exp_of_small(double x) {
    double sum = 1.0;
    for (int k = 18; k > 0; k--)
        sum = 1.0 + x * sum / k;
    return sum;
}

#endif
