/* The exponential function, of four floats and of one double: there is no C library. */

#ifndef PALPATE_EXPONENTIAL_H
#define PALPATE_EXPONENTIAL_H

#include "kernels.h"

typedef int32_t whole4 __attribute__((vector_size(16), aligned(4)));

static inline float4 all4(float value) { return (float4){value, value, value, value}; }

/* The first where the mask is set, else the second. */
static inline float4 either4(whole4 mask, float4 first, float4 second) {
    return (float4)(((whole4)first & mask) | ((whole4)second & ~mask));
}

/* exp(x) to 2 ulp (Moshier, Cephes, expf): x = n log 2 + r with |r| <= log(2) / 2, a polynomial of r, times 2^n.
 * Below -87 it is that of -87, above 88 that of 88; NaN stays NaN. */
static inline float4 exp4(float4 x) {
#pragma clang fp reassociate(off)  // the two parts of log 2 are one number to a compiler that may add them
    float4 bounded = either4(x > all4(-87.0f), either4(x < all4(88.0f), x, all4(88.0f)), all4(-87.0f));
    float4 twos = bounded * 1.44269504f;
    float4 half = either4(twos < all4(0.0f), all4(-0.5f), all4(0.5f));
    whole4 n = __builtin_convertvector(twos + half, whole4);
    float4 whole = __builtin_convertvector(n, float4);
    float4 r = bounded - whole * 0.693359375f;
    r = r + whole * 2.12194440e-4f;
    float4 sum = r * 1.9875691500e-4f + 1.3981999507e-3f;
    sum = sum * r + 8.3334519073e-3f;
    sum = sum * r + 4.1665795894e-2f;
    sum = sum * r + 1.6666665459e-1f;
    sum = sum * r + 5.0000001201e-1f;
    sum = sum * (r * r) + r;
    float4 result = (sum + 1.0f) * (float4)((n + 127) << 23);
    return either4(x == x, result, x);
}

/* exp(x) of a small number, |x| < 1, by its series. */
static inline double exp_of_small(double x) {
    double sum = 1.0;
    for (int k = 18; k > 0; k--)
        sum = 1.0 + x * sum / k;
    return sum;
}

#endif
