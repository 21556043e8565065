/* Variance of the pixels of an image: see estimation/image_check.py. */

#include "kernels.h"

enum { AT_ONCE = 1 << 15 }; /* pixels whose squares fit the sum of 32 bits */

/* Return the largest variance of a channel of `count` pixels, in 1/256 of a squared grey level. */
KERNEL int largest_variance(const uint8_t *pixels, int32_t count, int32_t channels) {
    double largest = 0.0;
    for (int32_t channel = 0; channel < channels; channel++) {
        int64_t total = 0, squares = 0;
        for (int32_t from = 0; from < count; from += AT_ONCE) {
            const int32_t to = count - from < AT_ONCE ? count : from + AT_ONCE;
            uint32_t sum = 0, square = 0;
            for (int32_t i = from; i < to; i++) {
                const uint32_t value = pixels[(int64_t)i * channels + channel];
                sum += value;
                square += value * value;
            }
            total += sum;
            squares += square;
        }
        if (count) {
            const double mean = (double)total / count;
            const double variance = (double)squares / count - mean * mean;
            largest = variance > largest ? variance : largest;
        }
    }
    return (int)(256.0 * largest + 0.5);
}
