/* Functions of four floats at once, and the exponential of a double: there is no C library. */

#ifndef PALPATE_EXPONENTIAL_H
#define PALPATE_EXPONENTIAL_H

#include "kernels.h"

typedef int32_t whole4 __attribute__((vector_size(16), aligned(4)));

static inline float4 all4(float value) { return (float4){value, value, value, value}; }

static inline float4 sqrt4(float4 x) {
    return (float4){__builtin_sqrtf(x[0]), __builtin_sqrtf(x[1]), __builtin_sqrtf(x[2]),
                    __builtin_sqrtf(x[3])};
}

/* exp(-x) of x >= 0 to 2 ulp (Moshier, Cephes, expf): -x = n log 2 + r with |r| <= log(2) / 2, a polynomial
 * of r, times 2^n. Above 87 it is that of 87; NaN stays NaN.
 *
 * The sum of a float and 1.5 2^23 holds its whole part in the last bits. */
static inline float4 decay4(float4 x) {
#pragma clang fp reassociate(off)
    const float4 whole_bits = all4(12582912.0f);
    whole4 is_above = x > all4(87.0f);
    float4 bounded = (float4)(((whole4)x & ~is_above) | ((whole4)all4(87.0f) & is_above));
    float4 shifted = whole_bits - bounded * 1.44269504f, n = shifted - whole_bits;
    float4 r = n * -0.693359375f - bounded;
    r = r + n * 2.12194440e-4f;
    float4 sum = r * 1.9875691500e-4f + 1.3981999507e-3f;
    sum = sum * r + 8.3334519073e-3f;
    sum = sum * r + 4.1665795894e-2f;
    sum = sum * r + 1.6666665459e-1f;
    sum = sum * r + 5.0000001201e-1f;
    sum = sum * (r * r) + r;
    return (sum + 1.0f) * (float4)(((whole4)shifted + 127) << 23);
}

/* exp(x) of a small number, |x| < 1, by its series. */
static inline double exp_of_small(double x) {
    double sum = 1.0;
    for (int k = 18; k > 0; k--)
        sum = 1.0 + x * sum / k;
    return sum;
}

#endif
