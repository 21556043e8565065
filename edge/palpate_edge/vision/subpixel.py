"""The sub-pixel place of every bead in a small window about where it is expected, for all beads at once.

About each bead a few pixels on a circle tell the skin's grey and a few in the middle the bead's; each
pixel of a disk then weighs by how much nearer it is to the bead's grey, cut off below a quarter and above
three quarters, so that neither noise nor a highlight on the bead pulls the centroid. The disk is larger than
the bead: one step is exact unless the bead was far off, and only such beads take another.

Light falls off across a bead. Half-way between bead and skin is then another grey on one side than on the
other, and the wider the edges (blur), the farther that pulls the centroid. The slope of the skin's grey, as
the untouched sensor shows it, is therefore taken off first: from each pixel as much as it is lit, since what
is twice as bright as the skin also loses twice as much.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Floats, Indices, Mask, Plane
from palpate_edge.vision.patches import CORE_PIXELS, SKIN_PIXELS, Patches
from palpate_edge.vision.shading import Shading, skin_reach

BINNED_FROM_PX = 12.0  # beads of at least this diameter are measured on pixels of two by two
DISK_RADIUS = 0.8  # of the pixels that weigh in the centroid, in bead diameters
SKIN_RANKS = slice(6, 14)  # of the skin's pixels by grey: the dark may be another bead's, the brightest glare
LOW_RANKS, HIGH_RANKS = slice(3, 6), slice(11, 14)  # whose difference tells how uneven the skin is
SETTLED_STEP = 0.05  # of a bead diameter: a centroid that moved less is on its bead
LONGEST_STEP = 0.5
GATE = 0.1  # of the contrast: what is less darker than the skin is skin
MOST_STEPS = 4
OUTSIDE = -1e6  # what keeps a pixel out
DARKEST_SKIN = 0.25  # of the contrast: a darker skin tells too little of the light


@dataclass(frozen=True, slots=True)
class Refined:
    """Beads after refinement, in the order given: position_px (n, 2), contrast (n,) in grey levels, area (n,)
    in bead disks (1 is a whole bead), unevenness (n,): how much the skin's grey varies around the bead, over
    its contrast; settled (n,): the last step was small."""

    position_px: Array
    contrast: Floats
    area: Floats
    unevenness: Floats
    settled: Mask


class Refiner:
    """Weighted centroids of many beads at once; made once a layout, called every frame."""

    def __init__(
        self, diameter_px: Array, spacing_px: Array | None = None, light: Shading | None = None
    ) -> None:
        """diameter_px (n,) of each bead; spacing_px (n,): distance to the nearest other bead, whose pixels
        are kept out; light: even where it is not told."""
        self._binning = 2 if diameter_px.min() >= BINNED_FROM_PX else 1
        diameter = np.asarray(diameter_px, dtype=np.float64) / self._binning
        disk = DISK_RADIUS * diameter
        if spacing_px is not None:
            disk = np.minimum(disk, skin_reach(diameter, spacing_px / self._binning))
        slope = np.zeros((len(diameter), 2)) if light is None else light.slope * self._binning
        self._unlit = None if light is None else light.unlit
        self._windows = Patches(self._binning, int(disk.max()), diameter)
        steps = self._windows.steps
        in_disk = np.hypot(*steps.T) <= disk[:, None]
        self._slope = (slope @ steps.T).astype(np.float32)
        self._outside = np.where(in_disk, 0.0, OUTSIDE).astype(np.float32)
        self._moments = np.column_stack([np.ones(len(steps)), steps]).astype(np.float32)
        # What taking the skin's slope off a flat bead shifts that by.
        self._slant = (self._unlit is None) * slope * diameter[:, None] ** 2 / 16
        self._whole = (0.5 * np.pi / 4 * diameter**2).astype(np.float32)
        self._longest_step = LONGEST_STEP * diameter[:, None]
        self._settled_squared = (SETTLED_STEP * diameter) ** 2

    def refine(self, dark: Plane, start_px: Array) -> Refined:
        """Centroids near `start_px` (n, 2) of all beads. A start outside the image gets contrast 0."""
        self.look(dark)
        return self.centroids(start_px)

    def look(self, dark: Plane) -> None:
        """Take the plane in which :meth:`centroids` works until the next look."""
        self._windows.load(dark)

    def centroids(self, start_px: Array, beads: Indices | None = None) -> Refined:
        """Centroids, in the plane last looked at, of the given `beads` (m,) near `start_px` (m, 2)."""
        half = 0.5 * (self._binning - 1)  # a binned pixel's centre lies between those of its pixels
        start = (start_px - half) / self._binning
        position = self._windows.inside(start)
        centre = np.rint(position).astype(np.intp)
        offset, contrast, area, unevenness = self._measure(centre, beads)
        there = centre + offset
        step = there - position
        settled_squared = self._settled_squared if beads is None else self._settled_squared[beads]
        settled = np.vecdot(step, step) <= settled_squared
        for _ in range(MOST_STEPS - 1):
            if settled.all():
                break
            moving = np.flatnonzero(~settled)
            which = moving if beads is None else beads[moving]
            longest = self._longest_step[which]
            again = position[moving] + np.minimum(np.maximum(step[moving], -longest), longest)
            again = self._windows.inside(again)
            centre = np.rint(again).astype(np.intp)
            offset, contrast[moving], area[moving], unevenness[moving] = self._measure(centre, which)
            position[moving], there[moving] = again, centre + offset
            step[moving] = there[moving] - again
            settled[moving] = np.vecdot(step[moving], step[moving]) <= settled_squared[moving]
        place_px = there * self._binning + half
        if position is not start:
            outside = self._windows.outside(start)
            contrast[outside], place_px[outside] = 0.0, start_px[outside]
        return Refined(place_px, contrast, area, unevenness, settled)

    def _measure(self, centre: Indices, beads: Indices | None) -> tuple[Array, Floats, Floats, Floats]:
        """About the binned pixels `centre` (m, 2): centroid (m, 2) from there, contrast, area, unevenness."""
        some = slice(None) if beads is None else beads
        place = self._windows.place(centre)
        greys = self._windows.circles(place, some)
        greys[:, :SKIN_PIXELS].sort(axis=1)
        skin, spread, core = (greys @ _LEVELS).T
        contrast: Floats = skin - core
        scale = np.reciprocal(np.maximum(contrast, 1.0))
        weight = self._windows.squares(place)
        if self._unlit is None:
            weight *= -scale[:, None]
            weight += self._slope[some]
        else:
            weight -= self._unlit
            skin = skin - self._unlit
            lit = np.maximum(np.abs(skin), np.maximum(DARKEST_SKIN * contrast, 1.0))
            slope = self._slope[some] / np.copysign(lit, skin)[:, None]
            slope -= scale[:, None]
            weight *= slope
        weight += (skin * scale - GATE)[:, None]
        weight += self._outside[some]
        cv2.threshold(weight, 0.0, 0.0, cv2.THRESH_TOZERO, dst=weight)
        cv2.threshold(weight, 1.0, 0.0, cv2.THRESH_TRUNC, dst=weight)
        rest = 1.5 - weight  # t^2 (3 - 2 t) / 2: smooth at both ends, so that where pixels lie does not tell
        weight *= weight
        weight *= rest
        moments = weight @ self._moments
        mass = np.maximum(moments[:, 0], 1e-3)
        area = np.divide(mass, self._whole[some])
        return moments[:, 1:] / mass[:, None] - self._slant[some], contrast, area, spread * scale


def _levels() -> Floats:
    """(32, 3): from the greys about a bead, the skin's sorted, to the skin's grey, its spread, the bead's."""
    levels = np.zeros((SKIN_PIXELS + CORE_PIXELS, 3), np.float32)
    ranks = levels[:SKIN_PIXELS]
    for column, part, sign in ((0, SKIN_RANKS, 1), (1, HIGH_RANKS, 1), (1, LOW_RANKS, -1)):
        ranks[part, column] += sign / len(ranks[part])
    levels[SKIN_PIXELS:, 2] = 1 / CORE_PIXELS
    return levels


_LEVELS = _levels()
