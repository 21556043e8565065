/* Colour images at half the resolution, and one channel of them: vision/binning.py. */

#include "kernels.h"

typedef uint8_t byte8 __attribute__((vector_size(8)));
typedef uint8_t byte16 __attribute__((vector_size(16)));
typedef uint16_t short8 __attribute__((vector_size(16)));
typedef uint16_t short16 __attribute__((vector_size(32)));

enum { COLOURS = 3, AT_ONCE = 4 }; /* pixels that are made of 24 bytes of two rows */
enum { AHEAD = 2048 }; /* bytes that are asked for early: a camera's image lies in memory, not in a cache */

static short16 load_16(const uint8_t *bytes) {
    byte16 some;
    __builtin_memcpy(&some, bytes, 16);
    return __builtin_convertvector(some, short16);
}

static short8 load_8(const uint8_t *bytes) {
    byte8 some;
    __builtin_memcpy(&some, bytes, 8);
    return __builtin_convertvector(some, short8);
}

static void halve_pixel(const uint8_t *upper, const uint8_t *lower, const float weights[COLOURS], uint8_t *small,
                        float *plane) {
    float sum = 0.0f;
    for (int c = 0; c < COLOURS; c++) {
        small[c] = (uint8_t)((upper[c] + upper[COLOURS + c] + lower[c] + lower[COLOURS + c] + 2) >> 2);
        sum += weights[c] * (float)small[c];
    }
    *plane = sum;
}

/* Four pixels: bytes B G R of eight pixels of two rows, added from row to row, then from pixel to pixel. */
static void halve_four(const uint8_t *upper, const uint8_t *lower, const float weights[COLOURS], uint8_t *small,
                       float *plane) {
    const short16 most = load_16(upper) + load_16(lower);
    const short8 last = load_8(upper + 16) + load_8(lower + 16);
    const short16 rest = __builtin_shufflevector(last, last, 0, 1, 2, 3, 4, 5, 6, 7, -1, -1, -1, -1, -1, -1, -1, -1);
    const short16 even = __builtin_shufflevector(most, rest, 0, 1, 2, 6, 7, 8, 12, 13, 14, 18, 19, 20, 20, 20, 20, 20);
    const short16 odd = __builtin_shufflevector(most, rest, 3, 4, 5, 9, 10, 11, 15, 16, 17, 21, 22, 23, 23, 23, 23, 23);
    const byte16 mean = __builtin_convertvector((even + odd + 2) >> 2, byte16);
    __builtin_memcpy(small, &mean, COLOURS * AT_ONCE);
    const byte4 blue = __builtin_shufflevector(mean, mean, 0, 3, 6, 9);
    const byte4 green = __builtin_shufflevector(mean, mean, 1, 4, 7, 10);
    const byte4 red = __builtin_shufflevector(mean, mean, 2, 5, 8, 11);
    const float4 sum = weights[0] * __builtin_convertvector(blue, float4)
                       + weights[1] * __builtin_convertvector(green, float4)
                       + weights[2] * __builtin_convertvector(red, float4);
    __builtin_memcpy(plane, &sum, sizeof sum);
}

/* small (height / 2, width / 2, 3): means of two by two pixels of an image (height, width, 3), whose rows are
 * `stride` bytes apart; plane (height / 2, width / 2): its colours B, G, R times `weights`, added. */
KERNEL int halve_colours(const uint8_t *image, int64_t stride, int32_t height, int32_t width, float blue, float green,
                         float red, uint8_t *small, float *plane) {
    const float weights[COLOURS] = {blue, green, red};
    const int half = width / 2;
    for (int row = 0; row < height / 2; row++) {
        const uint8_t *upper = image + 2 * row * stride, *lower = upper + stride;
        uint8_t *pixels = small + (int64_t)row * half * COLOURS;
        float *values = plane + (int64_t)row * half;
        int x = 0;
        for (; x + AT_ONCE <= half; x += AT_ONCE) {
            __builtin_prefetch(lower + 6 * x + AHEAD);
            halve_four(upper + 6 * x, lower + 6 * x, weights, pixels + 3 * x, values + x);
        }
        for (; x < half; x++) halve_pixel(upper + 6 * x, lower + 6 * x, weights, pixels + 3 * x, values + x);
    }
    return 0;
}
