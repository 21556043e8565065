/* Colour images at half the resolution, and one channel of them: vision/binning.py. */

#include "kernels.h"

typedef uint8_t byte16 __attribute__((vector_size(16)));
typedef uint16_t short16 __attribute__((vector_size(32)));

enum { COLOURS = 3, AT_ONCE = 4 }; /* pixels that are made of 24 bytes of two rows */
enum { AHEAD = 2048 }; /* bytes that are asked for early: a camera's image lies in memory, not in a cache */

static byte16 load_16(const uint8_t *bytes) {
    byte16 some;
    __builtin_memcpy(&some, bytes, 16);
    return some;
}

/* Means of two bytes, halves rounded up: one instruction of x86-64 and of aarch64. */
static byte16 mean_of_two(byte16 a, byte16 b) {
    const short16 sum = __builtin_convertvector(a, short16) + __builtin_convertvector(b, short16) + 1;
    return __builtin_convertvector(sum >> 1, byte16);
}

/* Means of four bytes, halves rounded up. The mean of two rounded means is 1 too large where one of them was
 * rounded and they differ in their last bit. */
static byte16 mean_of_four(byte16 a, byte16 b, byte16 c, byte16 d) {
    const byte16 first = mean_of_two(a, b), second = mean_of_two(c, d);
    return mean_of_two(first, second) - (((a ^ b) | (c ^ d)) & (first ^ second) & 1);
}

/* Of eight pixels in 24 bytes the 1st, 3rd, 5th, 7th, and the others; four bytes more are of no use. */
static byte16 even_pixels(const uint8_t *bytes) {
    const byte16 low = load_16(bytes), high = load_16(bytes + 8);
    return __builtin_shufflevector(low, high, 0, 1, 2, 6, 7, 8, 12, 13, 14, 26, 27, 28, 28, 28, 28, 28);
}

static byte16 odd_pixels(const uint8_t *bytes) {
    const byte16 low = load_16(bytes), high = load_16(bytes + 8);
    return __builtin_shufflevector(low, high, 3, 4, 5, 9, 10, 11, 15, 24, 25, 29, 30, 31, 31, 31, 31, 31);
}

static void halve_pixel(const uint8_t *upper, const uint8_t *lower, const float weights[COLOURS],
                        uint8_t *small, float *plane) {
    float sum = 0.0f;
    for (int c = 0; c < COLOURS; c++) {
        small[c] = (uint8_t)((upper[c] + upper[COLOURS + c] + lower[c] + lower[COLOURS + c] + 2) >> 2);
        sum += weights[c] * (float)small[c];
    }
    *plane = sum;
}

/* Four pixels of eight of two rows. */
static void halve_four(const uint8_t *upper, const uint8_t *lower, const float weights[COLOURS],
                       uint8_t *small, float *plane) {
    const byte16 mean =
        mean_of_four(even_pixels(upper), odd_pixels(upper), even_pixels(lower), odd_pixels(lower));
    __builtin_memcpy(small, &mean, COLOURS * AT_ONCE);
    const byte4 blue = __builtin_shufflevector(mean, mean, 0, 3, 6, 9);
    const byte4 green = __builtin_shufflevector(mean, mean, 1, 4, 7, 10);
    const byte4 red = __builtin_shufflevector(mean, mean, 2, 5, 8, 11);
    const float4 sum = weights[0] * __builtin_convertvector(blue, float4) +
                       weights[1] * __builtin_convertvector(green, float4) +
                       weights[2] * __builtin_convertvector(red, float4);
    __builtin_memcpy(plane, &sum, sizeof sum);
}

/* small (height / 2, width / 2, 3): means of two by two pixels of an image (height, width, 3), whose rows are
 * `stride` bytes apart; plane (height / 2, width / 2): its colours B, G, R times `weights`, added. */
KERNEL int halve_colours(const uint8_t *image, int64_t stride, int32_t height, int32_t width, float blue,
                         float green, float red, uint8_t *small, float *plane) {
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
        for (; x < half; x++)
            halve_pixel(upper + 6 * x, lower + 6 * x, weights, pixels + 3 * x, values + x);
    }
    return 0;
}
