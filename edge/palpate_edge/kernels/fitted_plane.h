/* A plane through grey levels on a circle, by least squares that count outlying ones less (Huber). */

#ifndef PALPATE_FITTED_PLANE_H
#define PALPATE_FITTED_PLANE_H

#include "kernels.h"

enum { MOST_LEVELS = 32, PLANE_ROUNDS = 3 };
/* Of the mean distance to the plane: a plane that rises less from the centre to the circle is noise. */
#define LEAST_RISE 3.0f

struct fitted_plane {
    float slope[2];
    int is_clear; /* the levels follow the plane */
};

/* Fit the levels (count) at the steps (count, 2) from the centre. */
static inline struct fitted_plane fit_plane(const int32_t *step, const float *level, int count) {
    struct fitted_plane plane = {{0.0f, 0.0f}, 0};
    float weight[MOST_LEVELS], height = 0.0f, off = 0.0f, squared = 0.0f;
    for (int i = 0; i < count; i++) {
        weight[i] = 1.0f;
        squared += (float)(step[2 * i] * step[2 * i] + step[2 * i + 1] * step[2 * i + 1]) / (float)count;
    }
    for (int round = 0; round < PLANE_ROUNDS; round++) {
        float w = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0, v = 0, xv = 0, yv = 0;
        for (int i = 0; i < count; i++) {
            const float wx = weight[i] * (float)step[2 * i], wy = weight[i] * (float)step[2 * i + 1];
            w += weight[i];
            x += wx, y += wy;
            xx += wx * (float)step[2 * i], xy += wx * (float)step[2 * i + 1];
            yy += wy * (float)step[2 * i + 1];
            v += weight[i] * level[i], xv += wx * level[i], yv += wy * level[i];
        }
        xx -= x * x / w, xy -= x * y / w, yy -= y * y / w;
        xv -= x * v / w, yv -= y * v / w;
        const float determinant = xx * yy - xy * xy;
        if (!(determinant > 0.0f))
            return plane;
        plane.slope[0] = (xv * yy - yv * xy) / determinant;
        plane.slope[1] = (yv * xx - xv * xy) / determinant;
        height = (v - plane.slope[0] * x - plane.slope[1] * y) / w;
        off = 0.0f;
        for (int i = 0; i < count; i++) {
            const float at =
                height + plane.slope[0] * (float)step[2 * i] + plane.slope[1] * (float)step[2 * i + 1];
            weight[i] = level[i] > at ? level[i] - at : at - level[i];
            off += weight[i] / (float)count;
        }
        off = larger(off, 1e-6f);
        for (int i = 0; i < count; i++)
            weight[i] = off / larger(weight[i], off);
    }
    const float rise = plane.slope[0] * plane.slope[0] + plane.slope[1] * plane.slope[1];
    plane.is_clear = rise * squared > LEAST_RISE * LEAST_RISE * off * off;
    return plane;
}

#endif
