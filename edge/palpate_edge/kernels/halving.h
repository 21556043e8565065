/* An image at half the resolution, of which only the parts are made that are read: halving.c. */

#ifndef PALPATE_HALVING_H
#define PALPATE_HALVING_H

#include "kernels.h"

enum { COLOURS = 3 };

struct halving {
    int32_t height, width, colours; /* of the small image; colours: 1 or COLOURS */
    float weights[COLOURS];         /* of B, G, R in the plane */
    int64_t stride;                 /* bytes from a row of the image to the next */
    const uint8_t *image;           /* (2 height, 2 width, colours), or a row or a column more */
    uint8_t *small;                 /* (height, width, colours): means of two by two pixels */
    float *plane; /* (height, width), of a colour image: weighted sum of the small one's */
    int32_t *from, *to; /* (height) columns of each row that are made: from <= column < to */
    int32_t *first, *last; /* (height) the same for those that are wanted */
};

void make_row(const struct halving *halving, int32_t row, int32_t from, int32_t to);
void make_about(const struct halving *halving, const double *place, int32_t count, int32_t reach);

static inline int32_t limited(int32_t value, int32_t high) {
    return value < 0 ? 0 : value > high ? high : value;
}

/* Make the pixels of a rectangle, first and last ones included, as far as they are in the image. */
static inline void make_pixels(const struct halving *halving, int32_t left, int32_t top, int32_t right,
                               int32_t bottom) {
    const int32_t from = limited(left, halving->width - 1), to = limited(right, halving->width - 1) + 1;
    const int32_t last = limited(bottom, halving->height - 1);
    for (int32_t row = limited(top, halving->height - 1); row <= last; row++) {
        if (from < halving->from[row] || to > halving->to[row])
            make_row(halving, row, from, to);
    }
}

#endif
