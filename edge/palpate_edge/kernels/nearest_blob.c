/* Nearest blob of a place; the method is described in vision/nearest_blob.py.
 *
 * Blobs are sorted into about as many square cells as there are blobs. A place is compared with the blobs of
 * the nine cells about it, and of more cells only where a nearer blob may lie beyond. */

#include "matching.h"

/* Cell number along one axis of a place in cells; NaN becomes 0. */
static inline int32_t cell_of(double at, int32_t side) {
    return at > 0.0 ? (at < side ? (int32_t)at : side - 1) : 0;
}

/* How far a place lies from the nearer side of its cell, in cells; 0 outside of the grid. */
static inline double to_side(double at, int32_t cell) {
    double before = at - cell, after = cell + 1 - at;
    double least = before < after ? before : after;
    return least > 0.0 ? least : 0.0;
}

void blob_grid_sort(struct blob_grid *grid, int32_t count) {
    const int32_t side = grid->side, cells = side * side;
    const double *blob = grid->blob_px;
    double left = __builtin_inf(), top = left, right = -left, bottom = -left;
    for (int32_t i = 0; i < count; i++) {
        double x = blob[2 * i], y = blob[2 * i + 1];
        left = x < left ? x : left, right = x > right ? x : right;
        top = y < top ? y : top, bottom = y > bottom ? y : bottom;
    }
    double width = right - left, height = bottom - top;
    double cell_px = (width > height ? width : height) / side;
    grid->count = count, grid->left_px = left, grid->top_px = top;
    grid->cell_px = cell_px > 0.0 ? cell_px : 1.0;
    for (int32_t cell = 0; cell <= cells; cell++)
        grid->first[cell] = 0;
    for (int32_t i = 0; i < count; i++) {
        int32_t column = cell_of((blob[2 * i] - left) / grid->cell_px, side);
        int32_t row = cell_of((blob[2 * i + 1] - top) / grid->cell_px, side);
        grid->cell[i] = row * side + column;
        grid->first[grid->cell[i] + 1]++;
    }
    for (int32_t cell = 0; cell < cells; cell++)
        grid->first[cell + 1] += grid->first[cell];
    for (int32_t i = count - 1; i >= 0; i--) { /* from the end of each cell: `first` of the next one */
        int32_t at = --grid->first[grid->cell[i] + 1];
        grid->number[at] = i;
        grid->sorted_px[2 * at] = blob[2 * i], grid->sorted_px[2 * at + 1] = blob[2 * i + 1];
    }
    for (int32_t cell = 0; cell < cells; cell++) /* each was moved to its own start, one place too late */
        grid->first[cell] = grid->first[cell + 1];
    grid->first[cells] = count;
}

/* The nearest blob whose squared distance, px^2, is less than `squared`, which it then becomes; else NO_BLOB.
 * Of blobs at the same distance it is that of the lowest number. */
int32_t blob_grid_nearest(const struct blob_grid *grid, double x_px, double y_px, double *squared) {
    const int32_t side = grid->side;
    const double *sorted = grid->sorted_px;
    double at_x = (x_px - grid->left_px) / grid->cell_px, at_y = (y_px - grid->top_px) / grid->cell_px;
    int32_t column = cell_of(at_x, side), row = cell_of(at_y, side), best = NO_BLOB;
    double inside_x = to_side(at_x, column), inside_y = to_side(at_y, row), least = *squared;
    double inside = inside_x < inside_y ? inside_x : inside_y;
    for (int32_t reach = 1;; reach *= 2) {
        int32_t from = column > reach ? column - reach : 0;
        int32_t to = column + reach < side ? column + reach : side - 1;
        int32_t last = row + reach < side ? row + reach : side - 1;
        for (int32_t near = row > reach ? row - reach : 0; near <= last; near++) {
            int32_t end = grid->first[near * side + to + 1];
            for (int32_t i = grid->first[near * side + from]; i < end; i++) {
                double x = sorted[2 * i] - x_px, y = sorted[2 * i + 1] - y_px, apart = x * x + y * y;
                if (apart < least || (apart == least && best > grid->number[i]))
                    least = apart, best = grid->number[i];
            }
        }
        double clear_px = (reach + inside) * grid->cell_px; /* no blob beyond these cells is nearer */
        if (least <= clear_px * clear_px || reach >= side)
            break;
    }
    *squared = least;
    return best;
}

/* Give each place its blob within its gate. Of several places that want one blob the nearest gets it, of
 * equally near ones the last; the others get none. */
void blob_grid_give(const struct blob_grid *grid, const struct blob_wish *wish) {
    for (int32_t i = 0; i < grid->count; i++)
        grid->owner[i] = -1;
    for (int32_t i = 0; i < wish->count; i++) {
        double x_px = wish->place_px[2 * i], y_px = wish->place_px[2 * i + 1];
        double gate = wish->gate_squared[i], squared = gate;
        int32_t blob = NO_BLOB;
        wish->blob[i] = NO_BLOB;
        if (!(gate > 0.0))
            continue;
        if (wish->known && wish->known[i] != NO_BLOB) {
            blob = wish->known[i];
            double x = grid->blob_px[2 * blob] - x_px, y = grid->blob_px[2 * blob + 1] - y_px;
            squared = x * x + y * y;
        }
        if (blob == NO_BLOB || !(squared <= wish->near_squared[i])) {
            squared = gate;
            blob = blob_grid_nearest(grid, x_px, y_px, &squared);
        }
        if (blob == NO_BLOB || !(squared < gate))
            continue;
        int32_t owner = grid->owner[blob];
        if (owner >= 0) {
            if (squared > wish->squared[owner])
                continue;
            wish->blob[owner] = NO_BLOB;
        }
        grid->owner[blob] = i;
        wish->blob[i] = blob, wish->squared[i] = squared;
    }
}

/* Take the frame's `count` blobs from blob_px. */
KERNEL int blob_grid_load(struct blob_grid *grid, int32_t count) {
    blob_grid_sort(grid, count);
    return 0;
}

/* Write the nearest blob (n) of each place (n, 2), and the squared distance (n) to it, px^2. */
KERNEL int blob_grid_look_up(const struct blob_grid *grid, int32_t count, const double *place_px,
                             int32_t *blob, double *squared) {
    for (int32_t i = 0; i < count; i++) {
        squared[i] = __builtin_inf();
        blob[i] = blob_grid_nearest(grid, place_px[2 * i], place_px[2 * i + 1], &squared[i]);
    }
    return 0;
}

/* Write the blob (n) that each place (n, 2) is given within its gate (n), px^2. */
KERNEL int blob_grid_assign(const struct blob_grid *grid, int32_t count, const double *place_px,
                            const double *gate_squared, int32_t *blob, double *squared) {
    const struct blob_wish wish = {count, place_px, gate_squared, 0, 0, blob, squared};
    blob_grid_give(grid, &wish);
    return 0;
}
