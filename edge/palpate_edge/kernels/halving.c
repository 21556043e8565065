/* Colour images at half the resolution, and one channel of them: vision/binning.py. */

#include "halving.h"

typedef uint8_t byte16 __attribute__((vector_size(16)));
typedef uint16_t short16 __attribute__((vector_size(32)));

enum { AT_ONCE = 4 }; /* pixels that are made of 24 bytes of two rows */
enum { LINE = 64 };    /* bytes that memory gives at once */
enum { BLOCK = 8 };   /* columns that are made together */

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

/* A row's pixels from one column to before another; the next row is asked for, since a camera's image lies in
 * memory, not in a cache. */
static void halve_colours(const struct halving *p, int32_t row, int32_t from, int32_t to) {
    const uint8_t *upper = p->image + 2 * row * p->stride, *lower = upper + p->stride;
    uint8_t *small = p->small + (int64_t)row * p->width * COLOURS;
    float *plane = p->plane + (int64_t)row * p->width;
    const int64_t next = row + 1 < p->height ? 2 * p->stride : 0;
    int32_t x = from;
    for (; x + AT_ONCE <= to; x += AT_ONCE) {
        __builtin_prefetch(upper + next + 6 * x);
        __builtin_prefetch(lower + next + 6 * x);
        halve_four(upper + 6 * x, lower + 6 * x, p->weights, small + 3 * x, plane + x);
    }
    for (; x < to; x++)
        halve_pixel(upper + 6 * x, lower + 6 * x, p->weights, small + 3 * x, plane + x);
}

static void halve_grey(const struct halving *p, int32_t row, int32_t from, int32_t to) {
    const uint8_t *upper = p->image + 2 * row * p->stride, *lower = upper + p->stride;
    uint8_t *small = p->small + (int64_t)row * p->width;
    const int64_t next = row + 1 < p->height ? 2 * p->stride : 0;
    for (int32_t x = from; x < to; x += LINE / 2) {
        const int32_t end = x + LINE / 2 < to ? x + LINE / 2 : to;
        __builtin_prefetch(upper + next + 2 * x);
        __builtin_prefetch(lower + next + 2 * x);
        for (int32_t i = x; i < end; i++)
            small[i] =
                (uint8_t)((upper[2 * i] + upper[2 * i + 1] + lower[2 * i] + lower[2 * i + 1] + 2) >> 2);
    }
}

static void halve(const struct halving *p, int32_t row, int32_t from, int32_t to) {
    if (p->colours == COLOURS)
        halve_colours(p, row, from, to);
    else
        halve_grey(p, row, from, to);
}

/* Make a row's pixels from one column to before another, and those between them and the ones that are made. */
void make_row(const struct halving *p, int32_t row, int32_t from, int32_t to) {
    from -= from % BLOCK;
    to += BLOCK - 1 - (to + BLOCK - 1) % BLOCK;
    to = to < p->width ? to : p->width;
    if (p->from[row] >= p->to[row]) {
        halve(p, row, from, to);
        p->from[row] = from;
        p->to[row] = to;
        return;
    }
    if (from < p->from[row]) {
        halve(p, row, from, p->from[row]);
        p->from[row] = from;
    }
    if (to > p->to[row]) {
        halve(p, row, p->to[row], to);
        p->to[row] = to;
    }
}

/* Make the pixels within `reach` of places (count, 2), row by row: that is faster than place by place. */
void make_about(const struct halving *p, const double *place, int32_t count, int32_t reach) {
    for (int32_t row = 0; row < p->height; row++) {
        p->first[row] = p->width;
        p->last[row] = 0;
    }
    for (int32_t i = 0; i < count; i++) {
        const int32_t x = (int32_t)within((float)place[2 * i], 0.0f, (float)(p->width - 1));
        const int32_t y = (int32_t)within((float)place[2 * i + 1], 0.0f, (float)(p->height - 1));
        const int32_t left = limited(x - reach, p->width - 1), right = limited(x + reach, p->width - 1);
        const int32_t bottom = limited(y + reach, p->height - 1);
        for (int32_t row = limited(y - reach, p->height - 1); row <= bottom; row++) {
            p->first[row] = left < p->first[row] ? left : p->first[row];
            p->last[row] = right > p->last[row] ? right : p->last[row];
        }
    }
    for (int32_t row = 0; row < p->height; row++) {
        if (p->first[row] <= p->last[row])
            make_row(p, row, p->first[row], p->last[row] + 1);
    }
}

/* Begin with an image: no pixel is made. */
KERNEL int halving_begin(const struct halving *p) {
    for (int32_t row = 0; row < p->height; row++) {
        p->from[row] = p->width;
        p->to[row] = 0;
    }
    return 0;
}

/* Make all that is missing. */
KERNEL int halving_complete(const struct halving *p) {
    for (int32_t row = 0; row < p->height; row++)
        make_row(p, row, 0, p->width);
    return 0;
}
