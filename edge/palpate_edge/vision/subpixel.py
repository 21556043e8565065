"""Sub-pixel places: weighted centroids of all beads at once, each in a small window.

The skin's grey is read on a circle about the bead, the bead's grey on a circle inside it. Each pixel of a
disk is weighted by how much nearer its grey is to the bead's than to the skin's; weights are cut off at both
ends, so that neither noise nor a highlight on the bead displaces the centroid. The disk is larger than the
bead: one step is exact unless the start was far off, and only such beads take another step.

Brightness falls off across a bead. The grey half-way between bead and skin then differs from side to side,
and the wider the edges (blur), the more this displaces the centroid. Therefore the slope of the skin's grey,
measured on the untouched sensor, is subtracted first: from each pixel in proportion to its brightness,
because a pixel twice as bright as the skin also changes twice as much.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices, Mask, Plane
from palpate_edge.vision.patches import CORE_PIXELS, SKIN_PIXELS, Patches
from palpate_edge.vision.shading import Shading, skin_reach

BINNED_FROM_PX = 12.0  # beads of at least this diameter are measured on pixels of two by two
DISK_RADIUS = 0.8  # of the pixels that the centroid is made of, in bead diameters
SKIN_RANKS = slice(6, 14)  # of the skin's pixels by grey: the darkest may be a bead's, the brightest glare
LOW_RANKS, HIGH_RANKS = slice(3, 6), slice(11, 14)  # their difference is the skin's unevenness
CONVERGED_STEP = 0.05  # of a bead diameter: a centroid that moved less is on its bead
MAX_STEP = 0.5  # of a bead diameter
GATE = 0.1  # of the contrast: a pixel less darker than the skin has weight 0
MAX_STEPS = 4
OUTSIDE = -1e6  # added to the weight of pixels outside the disk
DARKEST_SKIN = 0.25  # of the contrast: lower bound of the skin's grey that slopes are scaled by


class Refined(msgspec.Struct, frozen=True):
    """Beads after refinement, in the order given.

    position_px (n, 2); contrast (n,): grey levels; area (n,): in bead disks, 1 is a whole bead; unevenness
    (n,): variation of the skin's grey around the bead, over the contrast; converged (n,): the last step was
    small.
    """

    position_px: Array
    contrast: Floats
    area: Floats
    unevenness: Floats
    converged: Mask


class Levels(NamedTuple):
    """Greys about places (m,) in the pixels with the indices `pixel` (m,).

    skin (m,): its grey; contrast (m,): to the bead; scale (m,): 1 over the contrast, at most 1;
    unevenness (m,): see Refined.
    """

    pixel: Indices
    skin: Floats
    contrast: Floats
    scale: Floats
    unevenness: Floats


def refined_places(dark: Plane, start_px: Array, diameter_px: float) -> Array:
    """Return the sub-pixel places (n, 2) of beads of one diameter near `start_px` (n, 2), in one plane."""
    if not len(start_px):
        return start_px
    return Refiner(np.full(len(start_px), diameter_px)).refine(dark, start_px).position_px


class Refiner:
    """Measures weighted centroids of many beads at once; one object serves all frames of a layout.

    binning: pixels of the plane, along an axis, that are measured as one.
    """

    def __init__(
        self, diameter_px: Array, spacing_px: Array | None = None, shading: Shading | None = None
    ) -> None:
        """diameter_px (n,); spacing_px (n,): distance to the nearest other bead, whose pixels are left out;
        shading: none if not given."""
        self.binning = 2 if diameter_px.min() >= BINNED_FROM_PX else 1
        diameter = np.asarray(diameter_px, dtype=np.float64) / self.binning
        disk = DISK_RADIUS * diameter
        if spacing_px is not None:
            disk = np.minimum(disk, skin_reach(diameter, spacing_px / self.binning))
        slope = np.zeros((len(diameter), 2)) if shading is None else shading.slope * self.binning
        self._unlit = None if shading is None else shading.unlit
        self._patches = Patches(self.binning, int(disk.max()), diameter)
        steps = self._patches.steps
        added = np.where(np.hypot(*steps.T) <= disk[:, None], 0.0, OUTSIDE)
        if self._unlit is None:
            added += slope @ steps.T
        self._alike = bool((added == added[0]).all())
        self._added = (added[:1] if self._alike else added).astype(np.float32)
        self._slope = slope.astype(np.float32)
        self._moments = np.column_stack([np.ones(len(steps)), steps]).astype(np.float32)
        self._one_and_steps = np.ascontiguousarray(self._moments.T)
        # Displacement that subtracting the skin's slope adds to the centroid of an unshaded bead.
        self._slope_shift = (self._unlit is None) * slope * diameter[:, None] ** 2 / 16
        self._half_area = (0.5 * np.pi / 4 * diameter**2).astype(np.float32)
        self._max_step = MAX_STEP * diameter[:, None]
        self._diameter_squared = diameter**2

    def refine(self, dark: Plane, start_px: Array) -> Refined:
        """Load the plane and return the centroids of all beads near `start_px` (n, 2)."""
        self.load(dark)
        return self.centroids(start_px)

    def load(self, dark: Plane, *, binned: bool = False) -> None:
        """Take the plane in which :meth:`centroids` measures until the next one is loaded.

        binned: to :attr:`binning` already.
        """
        self._patches.load(dark, binned=binned)

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
        position = self._patches.inside(start)
        centre = np.rint(position).astype(np.intp)
        levels = self._levels(centre, beads)
        at_bead = levels.contrast >= min_contrast
        if max_faint is not None and len(at_bead) - np.count_nonzero(at_bead) > max_faint:
            nowhere = np.zeros_like(at_bead)
            return Refined(start_px, levels.contrast, nowhere.astype(np.float32), levels.unevenness, nowhere)
        offset, contrast, area, unevenness = self._measure(levels, beads)
        there = centre + offset
        step = there - position
        squared = self._diameter_squared if beads is None else self._diameter_squared[beads]
        converged_squared = converged_step**2 * squared
        step_squared = np.vecdot(step, step)
        moving = ((step_squared > converged_squared) & at_bead).nonzero()[0]
        for _ in range(max_steps - 1):
            if not len(moving):
                break
            which = moving if beads is None else beads[moving]
            max_step = self._max_step[which]
            again = position[moving] + np.minimum(np.maximum(step[moving], -max_step), max_step)
            again = self._patches.inside(again)
            centre = np.rint(again).astype(np.intp)
            measured = self._measure(self._levels(centre, which), which)
            offset, contrast[moving], area[moving], unevenness[moving] = measured
            position[moving], there[moving] = again, centre + offset
            step[moving] = last_step = there[moving] - again
            step_squared[moving] = last_squared = np.vecdot(last_step, last_step)
            moving = moving[last_squared > converged_squared[moving]]
        converged = step_squared <= converged_squared
        place_px = there * self.binning + half
        if position is not start:
            outside = self._patches.outside(start)
            contrast[outside], place_px[outside] = 0.0, start_px[outside]
        return Refined(place_px, contrast, area, unevenness, converged)

    def _levels(self, centre: Indices, beads: Indices | None) -> Levels:
        """Measure the greys of skin and bead about the binned pixels `centre` (m, 2)."""
        index = self._patches.index(centre)
        greys = self._patches.circles(index, slice(None) if beads is None else beads)
        greys[:, :SKIN_PIXELS].sort(axis=1)
        skin, variation, core = (greys @ _TO_LEVELS).T
        contrast: Floats = skin - core
        scale = np.reciprocal(np.maximum(contrast, 1.0))
        return Levels(index, skin, contrast, scale, variation * scale)

    def _measure(self, levels: Levels, beads: Indices | None) -> tuple[Array, Floats, Floats, Floats]:
        """Measure where these levels (m,) are: centroid from there (m, 2), contrast, area, unevenness."""
        some = slice(None) if beads is None else beads
        pixel, skin, contrast, scale, unevenness = levels
        weight = self._patches.squares(pixel)
        if self._unlit is None:
            weight *= -scale[:, None]
        else:
            if self._unlit:
                weight -= self._unlit
                skin = skin - self._unlit
            lit = np.maximum(np.abs(skin), np.maximum(DARKEST_SKIN * contrast, 1.0))
            slope = self._slope[some] / np.copysign(lit, skin)[:, None]
            weight *= np.concatenate((-scale[:, None], slope), axis=1) @ self._one_and_steps
        weight += (skin * scale - GATE)[:, None]
        weight += self._added if self._alike else self._added[some]
        cv2.threshold(weight, 0.0, 0.0, cv2.THRESH_TOZERO, dst=weight)
        cv2.threshold(weight, 1.0, 0.0, cv2.THRESH_TRUNC, dst=weight)
        factor = 1.5 - weight  # t^2 (3 - 2 t) / 2: smooth at both ends, so independent of the pixel grid
        weight *= weight
        weight *= factor
        moments = weight @ self._moments
        mass = np.maximum(moments[:, 0], 1e-3)
        area = np.divide(mass, self._half_area[some])
        return moments[:, 1:] / mass[:, None] - self._slope_shift[some], contrast, area, unevenness


def _to_levels() -> Floats:
    """Return the matrix (32, 3) from greys about a bead, the skin's sorted, to skin, variation and bead."""
    levels = np.zeros((SKIN_PIXELS + CORE_PIXELS, 3), np.float32)
    ranks = levels[:SKIN_PIXELS]
    for column, part, sign in ((0, SKIN_RANKS, 1), (1, HIGH_RANKS, 1), (1, LOW_RANKS, -1)):
        ranks[part, column] += sign / len(ranks[part])
    levels[SKIN_PIXELS:, 2] = 1 / CORE_PIXELS
    return levels


_TO_LEVELS = _to_levels()
