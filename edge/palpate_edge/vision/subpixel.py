"""Sub-pixel places: weighted centroids of all beads at once, each in a small window.

The skin's grey is read on a circle about the bead, the bead's grey on a circle inside it. Each pixel of a
disk is weighted by how much nearer its grey is to the bead's than to the skin's; weights are cut off at both
ends, so that neither noise nor a highlight on the bead displaces the centroid. The disk is larger than the
bead: one step is exact unless the start was far off, and only such beads take another step.

Brightness falls off across a bead. The grey half-way between bead and skin then differs from side to side,
and the wider the edges (blur), the more this displaces the centroid. Therefore the slope of the skin's grey,
measured on the untouched sensor, is subtracted first: from each pixel in proportion to its brightness,
because a pixel twice as bright as the skin also changes twice as much.

Light that slopes in one frame only (a lamp's halo, a contact's shade) displaces the centroid in the same way,
by up to two pixels. Where the skin about a bead is more uneven than in the reference frames, a plane through
its pixels that counts outlying ones less gives the slope (kernels/fitted_plane.h), which is subtracted too. A
light's edge, a bead beside and camera noise are no plane, and nothing is subtracted.
"""

from __future__ import annotations

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Counts, Floats, Indices, Mask, Plane
from palpate_edge.kernels.centroids import OUTSIDE, CentroidFinder, WindowLimits, WindowShapes
from palpate_edge.kernels.halving import HalvedImage
from palpate_edge.vision.binning import halved
from palpate_edge.vision.shading import Shading, skin_reach

BINNED_FROM_PX = 12.0  # beads of at least this diameter are measured on pixels of two by two
SKIN_RADIUS, SKIN_PIXELS = 0.8, 16  # circle on the skin about a bead: radius in bead diameters, pixels
CORE_RADIUS, CORE_PIXELS = 0.25, 16  # circle inside the bead
DISK_RADIUS = 0.8  # of the pixels that the centroid is made of, in bead diameters
SKIN_RANKS = slice(6, 14)  # of the skin's pixels by grey: the darkest may be a bead's, the brightest glare
LOW_RANKS, HIGH_RANKS = slice(3, 6), slice(11, 14)  # their difference is the skin's unevenness
CONVERGED_STEP = 0.05  # of a bead diameter: a centroid that moved less is on its bead
MAX_STEP = 0.5  # of a bead diameter
GATE = 0.1  # of the contrast: a pixel less darker than the skin has weight 0
MAX_STEPS = 4
DARKEST_SKIN = 0.25  # of the contrast: lower bound of the skin's grey that slopes are scaled by


class Refined(msgspec.Struct, frozen=True):
    """Beads after refinement, in the order given.

    position_px (n, 2); contrast (n,): grey levels; area (n,): in bead disks, 1 is a whole bead; unevenness
    (n,): variation of the skin's grey around the bead, over the contrast; converged (n,): the last step was
    small; windows (n,): that were measured; levelled (n,): the slope of the skin's grey was subtracted.
    """

    position_px: Array
    contrast: Floats
    area: Floats
    unevenness: Floats
    converged: Mask
    windows: Counts
    levelled: Mask


def refined_places(dark: Plane, start_px: Array, diameter_px: float) -> Array:
    """Return the sub-pixel places (n, 2) of beads of one diameter near `start_px` (n, 2), in one plane."""
    if not len(start_px):
        return start_px
    return Refiner(np.full(len(start_px), diameter_px)).refine(dark, start_px).position_px


class Refiner:
    """Measures weighted centroids of many beads at once; one object serves all frames of a layout.

    binning: pixels of the plane, along an axis, that are measured as one; finder: measures them.
    """

    def __init__(
        self,
        diameter_px: Array,
        spacing_px: Array | None = None,
        shading: Shading | None = None,
        max_unevenness: Array | None = None,
    ) -> None:
        """diameter_px (n,); spacing_px (n,): distance to the nearest other bead, whose pixels are left out;
        shading: none if not given; max_unevenness (n,): from more on the slope of the skin's grey in the
        frame itself is subtracted, never if not given."""
        self.binning = 2 if diameter_px.min() >= BINNED_FROM_PX else 1
        diameter = np.asarray(diameter_px, dtype=np.float64) / self.binning
        disk = DISK_RADIUS * diameter
        if spacing_px is not None:
            disk = np.minimum(disk, skin_reach(diameter, spacing_px / self.binning))
        slope = np.zeros((len(diameter), 2)) if shading is None else shading.slope * self.binning
        unlit = None if shading is None else shading.unlit
        reach = int(disk.max())
        axis = np.arange(-reach, reach + 1)
        steps = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        added = np.where(np.hypot(*steps.T) <= disk[:, None], 0.0, OUTSIDE)
        if unlit is None:
            added += slope @ steps.T
        circles = (_circle(SKIN_RADIUS * diameter, SKIN_PIXELS), _circle(CORE_RADIUS * diameter, CORE_PIXELS))
        shapes = WindowShapes(
            reach,
            np.concatenate(circles, axis=1),
            _skin_ranks(),
            added[:1] if (added == added[0]).all() else added,
            slope,
            # Subtracting the skin's slope displaces the centroid of an unshaded bead.
            (unlit is None) * slope * diameter[:, None] ** 2 / 16,
            0.5 * np.pi / 4 * diameter**2,
            np.full(len(diameter), np.inf) if max_unevenness is None else max_unevenness,
            diameter,
        )
        self.finder = CentroidFinder(shapes, WindowLimits(GATE, unlit, DARKEST_SKIN, MAX_STEP))

    def refine(self, dark: Plane, start_px: Array) -> Refined:
        """Load the plane and return the centroids of all beads near `start_px` (n, 2)."""
        self.load(dark)
        return self.centroids(start_px)

    def load(self, dark: Plane) -> None:
        """Take the plane that is measured until the next one is loaded."""
        self.finder.load(dark if self.binning == 1 else halved(dark))

    def load_halved(self, image: HalvedImage) -> None:
        """Take the plane of an image that is halved already, where this refiner reads halved ones."""
        self.finder.load_halved(image)

    def centroids(
        self,
        start_px: Array,
        beads: Indices | None = None,
        max_steps: int = MAX_STEPS,
        min_contrast: Floats | float = 0.0,
        max_faint: int | None = None,
        converged_step: float = CONVERGED_STEP,
    ) -> Refined:
        """Return the centroids of `beads` (m,), all if None, near `start_px` (m, 2) in the loaded plane.

        At most `max_steps` are taken, and no second one from faint places, where the contrast is below
        `min_contrast` (m,). If more than `max_faint` starts are faint, no step is taken from any. No step
        follows one shorter than `converged_step` bead diameters. A start outside the image gives contrast 0
        and stays where it is.
        """
        half = 0.5 * (self.binning - 1)  # a binned pixel's centre lies between those of its pixels
        start = (start_px - half) / self.binning
        found = self.finder.find(start, beads, max_steps, min_contrast, max_faint, converged_step)
        return Refined(found.place * self.binning + half, *found[1:])


def _circle(radius: Array, count: int) -> Indices:
    """Return the offsets (n, count, 2) of `count` pixels on circles of `radius` (n,)."""
    angle = 2 * np.pi * np.arange(count) / count
    offsets = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(np.rint(offsets), dtype=np.intp)


def _skin_ranks() -> Floats:
    """Return the weights (2, 16) of the skin's greys, sorted, in its grey and in its variation."""
    ranks = np.zeros((2, SKIN_PIXELS), np.float32)
    for row, part, sign in ((0, SKIN_RANKS, 1), (1, HIGH_RANKS, 1), (1, LOW_RANKS, -1)):
        ranks[row, part] += sign / len(ranks[row, part])
    return ranks
