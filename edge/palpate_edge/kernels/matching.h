/* Parts of the matching of blobs with beads: nearest_blob.c, local_warp.c and matching.c. The Python modules
 * of the same names hold the structs and all arrays. n: beads, m: blobs of a frame. */

#ifndef PALPATE_MATCHING_H
#define PALPATE_MATCHING_H

#include "kernels.h"

#define NO_BLOB (-1)

/* The blobs of one frame, sorted into square cells. */
struct blob_grid {
    int32_t side;            /* cells in a row and rows of cells */
    int32_t count;           /* m, set by blob_grid_load */
    double left_px, top_px;  /* corner of the first cell, set by blob_grid_load */
    double cell_px;          /* side of a cell, set by blob_grid_load */
    const double *blob_px;   /* (m, 2) */
    int32_t *first;          /* (side^2 + 1) where each cell starts in `number` */
    int32_t *cell;           /* (m) scratch */
    int32_t *number;         /* (m) the blobs in the order of the cells */
    double *sorted_px;       /* (m, 2) places of the same */
    int32_t *owner;          /* (m) scratch */
};

/* Beads that want a blob, and which blobs they get. */
struct blob_wish {
    int32_t count;              /* n */
    const double *place_px;     /* (n, 2) */
    const double *gate_squared; /* (n) px^2 */
    const int32_t *known;       /* (n) blobs of the round before, or null */
    const double *near_squared; /* (n) px^2, within which a known blob is the nearest; with `known` only */
    int32_t *blob;              /* (n) result: blob or NO_BLOB */
    double *squared;            /* (n) px^2, scratch */
};

struct local_warp {
    int32_t beads;
    float ridge;              /* of the gradient, squared units */
    float min_weight;         /* of all known neighbours; a bead without any is given displacement 0 */
    const int32_t *first;     /* (n + 1) where each bead's neighbours start */
    const int32_t *neighbour; /* (e) */
    const float *weight;      /* (e) */
    const float *terms;       /* (n, 6) 1, x, y, x^2, x y, y^2 in units about the centre */
    const float *per_all;     /* (n) 1 / weight of all neighbours */
    float *rows;              /* (n, 12) scratch: terms and moments of the known beads */
    double *displacement_px;  /* (n, 2) input */
    uint8_t *known;           /* (n) input */
    double *predicted_px;     /* (n, 2) result: displacement */
    float *support;           /* (n) result: 0 to 1 */
};

void blob_grid_sort(struct blob_grid *grid, int32_t count);
int32_t blob_grid_nearest(const struct blob_grid *grid, double x_px, double y_px, double *squared);
void blob_grid_give(const struct blob_grid *grid, const struct blob_wish *wish);
void local_warp_fit(const struct local_warp *warp);

#endif
