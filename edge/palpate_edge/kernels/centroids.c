/* Weighted centroids of beads, each in a small window: vision/subpixel.py has the method.
 *
 * Pixels beyond the plane's edge repeat those at it. All places are in binned pixels. */

#include "centroids.h"
#include "fitted_plane.h"

enum { SKIN_PIXELS = 16, CORE_PIXELS = 16, CIRCLE = SKIN_PIXELS + CORE_PIXELS, AT_ONCE = 8 };

/* slope: of the skin's grey, beyond the reference's; counts where it `is_sloped`. */
struct levels {
    float skin, contrast, scale, unevenness, slope[2];
    int is_sloped;
};

static float pixel(struct plane plane, int32_t column, int32_t row) {
    const int64_t index =
        (int64_t)limited(row, plane.height - 1) * plane.width + limited(column, plane.width - 1);
    return plane.is_bytes ? (float)((const uint8_t *)plane.pixels)[index]
                          : ((const float *)plane.pixels)[index];
}

/* Sort a few numbers: odd-even merge sort (Batcher), the same steps for any input. */
static void sort_skin(float values[SKIN_PIXELS]) {
    for (int p = 1; p < SKIN_PIXELS; p *= 2) {
        for (int k = p; k >= 1; k /= 2) {
            for (int j = k % p; j + k < SKIN_PIXELS; j += 2 * k) {
                for (int i = 0; i < k && i + j + k < SKIN_PIXELS; i++) {
                    if ((i + j) / (2 * p) != (i + j + k) / (2 * p))
                        continue;
                    const float low = values[i + j], high = values[i + j + k];
                    values[i + j] = smaller(low, high);
                    values[i + j + k] = larger(low, high);
                }
            }
        }
    }
}

/* Write the levels of a bead whose middle has the grey `core`; the skin's pixels are sorted. */
static void set_levels(const struct centroid_finder *finder, float skin[SKIN_PIXELS], float core,
                       struct levels *levels) {
    float grey = 0.0f, variation = 0.0f;
    sort_skin(skin);
    for (int i = 0; i < SKIN_PIXELS; i++) {
        grey += finder->ranks[i] * skin[i];
        variation += finder->ranks[SKIN_PIXELS + i] * skin[i];
    }
    levels->skin = grey;
    levels->contrast = grey - core;
    levels->scale = 1.0f / larger(levels->contrast, 1.0f);
    levels->unevenness = variation * levels->scale;
}

/* Subtract the slope of the skin's grey from its pixels, where they have a clear one, and write the levels
 * that are left. The unevenness stays. */
static void level(const struct centroid_finder *finder, int bead, float skin[SKIN_PIXELS], float core,
                  struct levels *levels) {
    const int32_t *step = finder->circles + (int64_t)bead * CIRCLE * 2;
    const struct fitted_plane plane = fit_plane(step, skin, SKIN_PIXELS);
    const float unevenness = levels->unevenness;
    if (!plane.is_clear)
        return;
    for (int i = 0; i < SKIN_PIXELS; i++)
        skin[i] -= plane.slope[0] * (float)step[2 * i] + plane.slope[1] * (float)step[2 * i + 1];
    set_levels(finder, skin, core, levels);
    levels->unevenness = unevenness;
    for (int a = 0; a < 2; a++)
        levels->slope[a] = plane.slope[a] - finder->slope[2 * bead + a] * levels->contrast;
    levels->is_sloped = 1;
}

static struct levels measure_levels(const struct centroid_finder *finder, struct plane plane, int bead,
                                    const int32_t centre[2]) {
    const int32_t *step = finder->circles + (int64_t)bead * CIRCLE * 2;
    float skin[SKIN_PIXELS], sorted[SKIN_PIXELS], core = 0.0f;
    struct levels levels = {0};
    for (int i = 0; i < SKIN_PIXELS; i++)
        sorted[i] = skin[i] = pixel(plane, centre[0] + step[2 * i], centre[1] + step[2 * i + 1]);
    for (int i = SKIN_PIXELS; i < CIRCLE; i++)
        core += pixel(plane, centre[0] + step[2 * i], centre[1] + step[2 * i + 1]);
    core /= CORE_PIXELS;
    set_levels(finder, sorted, core, &levels);
    if (levels.unevenness > finder->max_unevenness[bead])
        level(finder, bead, skin, core, &levels);
    return levels;
}

static void read_window(const struct centroid_finder *finder, struct plane plane, const int32_t centre[2]) {
    const int side = finder->side;
    const int32_t left = centre[0] - finder->reach, top = centre[1] - finder->reach;
    const int is_inside = left >= 0 && top >= 0 && left + side <= plane.width && top + side <= plane.height;
    for (int y = 0; y < side; y++) {
        float *row = finder->window + y * finder->stride;
        const int64_t start = (int64_t)(top + y) * plane.width + left;
        if (!is_inside) {
            for (int x = 0; x < side; x++)
                row[x] = pixel(plane, left + x, top + y);
        } else if (plane.is_bytes) {
            const uint8_t *pixels = (const uint8_t *)plane.pixels + start;
            for (int x = 0; x < side; x++)
                row[x] = (float)pixels[x];
        } else {
            const float *pixels = (const float *)plane.pixels + start;
            for (int x = 0; x < side; x++)
                row[x] = pixels[x];
        }
    }
}

/* Subtract the slope of the skin's grey from a window. */
static void level_window(const struct centroid_finder *finder, const float slope[2]) {
    for (int y = 0; y < finder->side; y++) {
        for (int x = 0; x < finder->side; x++)
            finder->window[y * finder->stride + x] -=
                slope[0] * (float)(x - finder->reach) + slope[1] * (float)(y - finder->reach);
    }
}

/* The centroid, from the centre of its window, and the bead's area. */
static void measure_window(const struct centroid_finder *finder, struct plane plane, int bead,
                           const int32_t centre[2], struct levels levels, double offset[2], float *area) {
    const int side = finder->side, reach = finder->reach, stride = finder->stride;
    const float *added = finder->added + (finder->per_bead ? (int64_t)bead * side * stride : 0);
    const float *slope = finder->slope + 2 * bead;
    float skin = levels.skin, unlit = 0.0f, slope_x = 0.0f, slope_y = 0.0f;
    if (finder->is_shaded) {
        unlit = finder->unlit;
        skin -= unlit;
        const float size = skin < 0 ? -skin : skin;
        const float lit = larger(size, larger(finder->darkest_skin * levels.contrast, 1.0f));
        slope_x = slope[0] / (skin < 0 ? -lit : lit);
        slope_y = slope[1] / (skin < 0 ? -lit : lit);
    }
    const float constant = skin * levels.scale - finder->gate;
    float masses[AT_ONCE] = {0}, moments_x[AT_ONCE] = {0}, moments_y[AT_ONCE] = {0};
    read_window(finder, plane, centre);
    if (levels.is_sloped)
        level_window(finder, levels.slope);
    for (int y = 0; y < side; y++) {
        const float up = (float)(y - reach), factor = up * slope_y - levels.scale;
        for (int x = 0; x < stride; x += AT_ONCE) {
            const float *pixels = finder->window + y * stride + x, *more = added + y * stride + x;
            for (int k = 0; k < AT_ONCE; k++) {
                const float along = (float)(x + k - reach);
                const float linear = (pixels[k] - unlit) * (factor + along * slope_x) + constant + more[k];
                const float darker = within(linear, 0.0f, 1.0f);
                const float weight = darker * darker * (1.5f - darker); /* smooth at both ends */
                masses[k] += weight;
                moments_x[k] += weight * along;
                moments_y[k] += weight * up;
            }
        }
    }
    float mass = 0.0f, moment_x = 0.0f, moment_y = 0.0f;
    for (int k = 0; k < AT_ONCE; k++) {
        mass += masses[k];
        moment_x += moments_x[k];
        moment_y += moments_y[k];
    }
    mass = larger(mass, 1e-3f);
    offset[0] = (double)(moment_x / mass) - finder->slope_shift[2 * bead];
    offset[1] = (double)(moment_y / mass) - finder->slope_shift[2 * bead + 1];
    *area = mass / finder->half_area[bead];
}

/* The nearest place inside the plane, whose pixels are made; NaN becomes the plane's corner. */
static void move_inside(const struct centroid_finder *finder, double place[2], int32_t centre[2]) {
    const struct plane plane = finder->plane;
    const int32_t reach = finder->pixels_reach;
    const double high[2] = {plane.width - 1.0, plane.height - 1.0};
    for (int a = 0; a < 2; a++) {
        place[a] = place[a] > 0.0 ? (place[a] < high[a] ? place[a] : high[a]) : 0.0;
        centre[a] = (int32_t)__builtin_rint(place[a]);
    }
    if (plane.source)
        make_pixels(plane.source, centre[0] - reach, centre[1] - reach, centre[0] + reach, centre[1] + reach);
}

static double clipped(double value, double limit) {
    return value > limit ? limit : value < -limit ? -limit : value;
}

static void find_centroid(const struct centroid_finder *finder, int i, int max_steps, double converged_step) {
    const struct plane plane = finder->plane;
    const int bead = finder->which[i];
    const double *start = finder->start + 2 * i;
    const double diameter = finder->diameter[bead];
    const double limit = finder->max_step * diameter;
    const double near_squared = converged_step * converged_step * diameter * diameter;
    double place[2] = {start[0], start[1]}, step[2] = {0, 0}, squared = 0.0;
    finder->windows[i] = 0;
    for (int taken = 0; taken < max_steps; taken++) {
        int32_t centre[2];
        double offset[2];
        if (taken) {
            for (int a = 0; a < 2; a++)
                place[a] += clipped(step[a], limit);
        }
        move_inside(finder, place, centre);
        const struct levels levels = measure_levels(finder, plane, bead, centre);
        measure_window(finder, plane, bead, centre, levels, offset, &finder->area[i]);
        finder->windows[i]++;
        finder->unevenness[i] = levels.unevenness;
        finder->contrast[i] = levels.contrast;
        finder->levelled[i] = (uint8_t)levels.is_sloped;
        for (int a = 0; a < 2; a++) {
            finder->place[2 * i + a] = centre[a] + offset[a];
            step[a] = finder->place[2 * i + a] - place[a];
        }
        squared = step[0] * step[0] + step[1] * step[1];
        const int is_faint = !taken && !(levels.contrast >= finder->min_contrast[i]);
        if (is_faint || !(squared > near_squared))
            break;
    }
    finder->converged[i] = squared <= near_squared;
    if (start[0] < 0 || start[1] < 0 || start[0] > plane.width - 1.0 || start[1] > plane.height - 1.0) {
        finder->contrast[i] = 0.0f;
        for (int a = 0; a < 2; a++)
            finder->place[2 * i + a] = start[a];
    }
}

/* How many starts show a contrast below `min_contrast`; contrasts and unevenness are kept. */
static int count_faint(const struct centroid_finder *finder, int count) {
    int faint = 0;
    for (int i = 0; i < count; i++) {
        double place[2] = {finder->start[2 * i], finder->start[2 * i + 1]};
        int32_t centre[2];
        move_inside(finder, place, centre);
        const struct levels levels = measure_levels(finder, finder->plane, finder->which[i], centre);
        finder->contrast[i] = levels.contrast;
        finder->unevenness[i] = levels.unevenness;
        finder->levelled[i] = (uint8_t)levels.is_sloped;
        faint += !(levels.contrast >= finder->min_contrast[i]);
    }
    return faint;
}

/* Find the centroids of the first `count` beads of `which`. Where more than `max_faint` starts are faint, all
 * stay where they are. */
KERNEL int find_centroids(const struct centroid_finder *finder, int32_t count, int32_t max_steps,
                          int32_t max_faint, double converged_step) {
    if (finder->plane.source)
        make_about(finder->plane.source, finder->start, count, finder->pixels_reach + 1);
    const int stays = max_faint < count && count_faint(finder, count) > max_faint;
    for (int i = 0; i < count; i++) {
        if (!stays) {
            find_centroid(finder, i, max_steps, converged_step);
            continue;
        }
        finder->place[2 * i] = finder->start[2 * i];
        finder->place[2 * i + 1] = finder->start[2 * i + 1];
        finder->area[i] = 0.0f;
        finder->converged[i] = 0;
        finder->windows[i] = 0;
    }
    return 0;
}
