/* Displacements as the neighbours predict them; the method is described in vision/local_warp.py.
 *
 * Each bead has about twenty neighbours with a weight. A known bead's terms and moments lie in one row of
 * twelve numbers; that of an unknown bead is zero. A bead's sums are of its neighbours' weighted rows. */

#include "matching.h"

#define ROW 12

static void fill_rows(const struct local_warp *warp) {
    for (int32_t bead = 0; bead < warp->beads; bead++) {
        float *row = warp->rows + ROW * bead;
        const float *terms = warp->terms + 6 * bead;
        if (!warp->known[bead]) {
            for (int i = 0; i < ROW; i++)
                row[i] = 0.0f;
            continue;
        }
        float x = terms[1], y = terms[2];
        float along_x = (float)warp->displacement_px[2 * bead];
        float along_y = (float)warp->displacement_px[2 * bead + 1];
        for (int i = 0; i < 6; i++)
            row[i] = terms[i];
        row[6] = along_x, row[7] = along_y;
        row[8] = along_x * x, row[9] = along_y * x;
        row[10] = along_x * y, row[11] = along_y * y;
    }
}

void local_warp_fit(const struct local_warp *warp) {
    fill_rows(warp);
    for (int32_t bead = 0; bead < warp->beads; bead++) {
        float4 one = {0}, two = {0}, three = {0};
        int32_t end = warp->first[bead + 1];
        for (int32_t i = warp->first[bead]; i < end; i++) {
            const float4 *row = (const float4 *)(warp->rows + ROW * warp->neighbour[i]);
            float weight = warp->weight[i];
            one += weight * row[0], two += weight * row[1], three += weight * row[2];
        }
        float total = larger(one[0], warp->min_weight), per_total = 1.0f / total;
        one *= per_total, two *= per_total, three *= per_total;
        float x = one[1], y = one[2], shift_x = two[2], shift_y = two[3];
        float xx = one[3] - x * x + warp->ridge, xy = two[0] - x * y, yy = two[1] - y * y + warp->ridge;
        float ahead_x = warp->terms[6 * bead + 1] - x, ahead_y = warp->terms[6 * bead + 2] - y;
        float per_determinant = 1.0f / (xx * yy - xy * xy);
        float by_x = (ahead_x * yy - ahead_y * xy) * per_determinant;
        float by_y = (ahead_y * xx - ahead_x * xy) * per_determinant;
        float moved_x = shift_x + (three[0] - shift_x * x) * by_x + (three[2] - shift_x * y) * by_y;
        float moved_y = shift_y + (three[1] - shift_y * x) * by_x + (three[3] - shift_y * y) * by_y;
        warp->predicted_px[2 * bead] = moved_x, warp->predicted_px[2 * bead + 1] = moved_y;
        warp->support[bead] = total * warp->per_all[bead];
    }
}

/* Predict the displacement of each bead from displacement_px of the known others. */
KERNEL int local_warp_predict(const struct local_warp *warp) {
    local_warp_fit(warp);
    return 0;
}
