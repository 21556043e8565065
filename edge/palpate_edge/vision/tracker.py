"""From the beads of one frame to the same beads of the next: every bead keeps its number.

A frame is read in small windows around the predicted places; only when too many beads are missing there is
the whole image searched again and every candidate assigned one to one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Floats, Indices, Mask, Plane
from palpate_edge.vision.blob_detection import find_blobs
from palpate_edge.vision.region_growing import Growth
from palpate_edge.vision.shading import Shading
from palpate_edge.vision.subpixel import Refiner

MIN_CONTRAST_SHARE = 0.35  # of the bead's contrast in the reference frames
AREA_RANGE = (0.45, 1.9)  # of the bead's area in the reference frames
MORE_UNEVEN = 0.08  # of the contrast, than in the reference frames; JPEG and blur stay below 0.06
MAX_RETRIES = 3
JUMP = 0.2  # of the spacing, from one frame to the next
MOST_LOST = 0.1  # share of the beads, in windows; of more the whole image is searched
NO_PARTNER = -1
NONE_LOST: Indices = np.empty(0, np.intp)


@dataclass(frozen=True, slots=True)
class Reference:
    """The untouched sensor as its camera sees it, n beads.

    position_px (n, 2); diameter_px, contrast, area (n,); spacing_px (n,): distance to the nearest bead.
    light: on the skin about the beads, and unevenness (n,) (see refine.Refined); None where only one frame is
    known.
    """

    position_px: Array
    diameter_px: Array
    contrast: Array
    area: Array
    light: Shading | None = None
    unevenness: Array | None = None

    @property
    def spacing_px(self) -> Array:
        return spacing(self.position_px)


@dataclass(frozen=True, slots=True)
class Beads:
    """The beads of one frame: position_px (n, 2) in the reference's order, found (n,), lost: those (m,) that
    were not found, and whether the whole image had to be searched. Where found is False the position is where
    the neighbours' motion puts it.
    """

    position_px: Array
    found: Mask
    lost: Indices
    searched: bool

    @classmethod
    def of(cls, position_px: Array, found: Mask, *, searched: bool = False) -> Beads:
        """The beads at these places, of which these were found."""
        return cls(position_px, found, NONE_LOST if found.all() else np.flatnonzero(~found), searched)


@dataclass(slots=True)
class TrackingCounters:
    """What happened since the start: frames, beads lost (summed over frames), whole-image searches."""

    frames: int = 0
    beads_lost: int = 0
    searches: int = 0


class Tracker:
    """Follows the beads of one reference through a stream of planes (see markers.plane)."""

    def __init__(self, reference: Reference) -> None:
        self._reference = reference
        self._spacing = reference.spacing_px
        self._refiner = Refiner(reference.diameter_px, self._spacing, reference.light)
        self._last = reference.position_px.copy()
        self._least_contrast = (MIN_CONTRAST_SHARE * reference.contrast).astype(np.float32)
        self._least_area, self._most_area = (
            (share * reference.area).astype(np.float32) for share in AREA_RANGE
        )
        self._farthest_squared = (0.45 * self._spacing) ** 2
        self._jump = (JUMP * self._spacing) ** 2
        self._least_jump = float(self._jump.min())
        self._lost_disorder = float(np.median(0.5 * self._spacing)) ** 2
        unevenness = np.inf if reference.unevenness is None else reference.unevenness
        self._most_uneven = np.full(self._spacing.shape, unevenness + MORE_UNEVEN, np.float32)
        self._unevener = 0.0
        distance = distances(reference.position_px, reference.position_px)
        self._farness = 0.5 * (distance / self._spacing[:, None]) ** 2
        self._growth = Growth(reference.position_px, self._spacing, distance)
        self._pairs = _neighbours(reference.position_px, self._spacing)
        self._pair_limit = (0.5 * reference.diameter_px[self._pairs[0]]) ** 2
        gap = self._spacing - 0.5 * reference.diameter_px
        self._still_apart = float(gap.min()) / 2  # two beads that move towards each other by less
        self.counters = TrackingCounters()

    def reset(self) -> None:
        """Forget the last frame: the next one starts from the reference."""
        self._last = self._reference.position_px.copy()

    def follow(self, dark: Plane) -> Beads:
        """The beads of the next frame."""
        self._refiner.look(dark)
        position, found = self._from(self._last)
        if self._jumped(position, found):
            rest = self._from(self._reference.position_px)
            position, found = self._tidier((position, found), rest)
            if self._growth.is_torn(position, found):
                grown = self._complete(*self._growth.grow(position, found, self._windows))
                position, found = self._tidier((position, found), grown)
        beads = Beads.of(position, found)
        if len(beads.lost) > MOST_LOST * len(found):
            self.counters.searches += 1
            position, found = self._search(dark)
            self._drop_doubles(position, found)
            beads = Beads.of(position, found, searched=True)
        self.counters.frames += 1
        if len(beads.lost):
            self.counters.beads_lost += len(beads.lost)
            position[beads.lost] = self._filled(position, found, beads.lost)
        self._last = position
        return beads

    def _from(self, start_px: Array) -> tuple[Array, Mask]:
        """Every bead refined from `start_px`, the missing ones again from where their neighbours went."""
        return self._complete(*self._windows(start_px))

    def _complete(self, position_px: Array, found: Mask) -> tuple[Array, Mask]:
        """With the missing looked for again and doubles dropped; changes both arrays."""
        if not found.all():
            self._retry(position_px, found)
        self._drop_doubles(position_px, found)
        return position_px, found

    def _retry(self, position_px: Array, found: Mask) -> None:
        """Look for the missing again, from where their neighbours went; changes both arrays."""
        for _ in range(MAX_RETRIES):
            missing = np.flatnonzero(~found)
            if not len(missing) or len(missing) == len(found):
                return
            start_px = self._filled(position_px, found, missing)
            position_px[missing], found[missing] = self._windows(start_px, missing)
            if not found[missing].any():
                return

    def _jumped(self, position_px: Array, found: Mask) -> bool:
        """Whether some bead went so far since the last frame that it may be its neighbour: another touch,
        not the same one a little later."""
        moved = position_px - self._last
        squared = np.vecdot(moved, moved)
        if squared.max() <= self._least_jump:
            return False
        return bool(((squared > self._jump) & found).any())

    def _tidier(self, one: tuple[Array, Mask], other: tuple[Array, Mask]) -> tuple[Array, Mask]:
        """Of two readings of a frame that of less disorder; the first where they are alike."""
        return other if self._disorder(*other) < self._disorder(*one) else one

    def _disorder(self, position_px: Array, found: Mask) -> float:
        """How differently neighbours moved from their rest, mean square in px; a bead taken for its
        neighbour makes it large, a lost one counts as moved by half a spacing."""
        moved = position_px - self._reference.position_px
        first, second = self._pairs
        apart = ((moved[first] - moved[second]) ** 2).sum(axis=1)
        lost = ~(found[first] & found[second])
        return float(np.where(lost, self._lost_disorder, apart).mean())

    def _windows(self, start_px: Array, beads: Indices | None = None) -> tuple[Array, Mask]:
        """The given beads (or all) refined from `start_px`, and which windows really hold their bead."""
        refined = self._refiner.centroids(start_px, beads)
        chosen = slice(None) if beads is None else beads
        moved = refined.position_px - start_px
        found = refined.settled & (refined.contrast > self._least_contrast[chosen])
        found &= refined.area > self._least_area[chosen]
        found &= refined.area < self._most_area[chosen]
        found &= np.vecdot(moved, moved) < self._farthest_squared[chosen]
        found &= self._even(refined.unevenness, beads)
        return refined.position_px, found

    def _even(self, unevenness: Floats, beads: Indices | None) -> Mask:
        """Beads with no glare beside them, whose edge would pull them to the other side.

        What is uneven about most beads alike is the camera's noise; it is taken from the last whole frame.
        """
        if beads is not None:
            return np.asarray(unevenness < self._most_uneven[beads] + self._unevener)
        even = unevenness < self._most_uneven
        self._unevener = 0.0
        if not even.all():
            more = unevenness - self._most_uneven
            self._unevener = max(0.0, float(np.median(more)) + MORE_UNEVEN)
            even = more < self._unevener
        return np.asarray(even)

    def _drop_doubles(self, position_px: Array, found: Mask) -> None:
        """Of beads that sit on one place only the one that came from nearest by stays found."""
        away = position_px - self._reference.position_px
        if np.vecdot(away, away).max() < self._still_apart**2:
            return
        first, second = self._pairs
        apart = position_px[first] - position_px[second]
        near = (apart**2).sum(axis=1) < self._pair_limit
        near &= found[first] & found[second]
        if near.any():
            moved = np.linalg.norm(position_px - self._last, axis=1)
            first, second = first[near], second[near]
            found[np.where(moved[first] > moved[second], first, second)] = False

    def _search(self, dark: Plane) -> tuple[Array, Mask]:
        """Find every blob of the image and give each bead its own."""
        reference = self._reference
        blobs = find_blobs(dark, float(np.median(reference.diameter_px)))
        if not len(blobs.strength):
            return reference.position_px, np.zeros(len(reference.position_px), dtype=np.bool_)
        partner = assign(reference.position_px, blobs.position_px, self._spacing)
        start = np.where(partner[:, None] >= 0, blobs.position_px[partner], reference.position_px)
        position, found = self._windows(start)
        return position, found & (partner >= 0)

    def _filled(self, position_px: Array, found: Mask, missing: Indices) -> Array:
        """Where the missing beads (m,) would be, (m, 2): the reference moved like its found neighbours."""
        reference = self._reference.position_px
        if not found.any():
            return reference[missing]
        squared = self._farness[missing][:, found]
        weight = np.exp(squared.min(axis=1, keepdims=True) - squared)
        moved = position_px[found] - reference[found]
        return np.asarray(reference[missing] + weight @ moved / weight.sum(axis=1, keepdims=True))


def _neighbours(position_px: Array, spacing_px: Array) -> tuple[Indices, Indices]:
    """Pairs (p,), (p,) of beads that could come to lie on each other: nearer than three spacings."""
    near = distances(position_px, position_px) < 3 * spacing_px[:, None]
    first, second = np.nonzero(np.triu(near, k=1))
    return first, second


def distances(a: Array, b: Array) -> Array:
    """(n, m) distances between (n, 2) and (m, 2) points."""
    return np.asarray(np.sqrt(((a[:, None, :] - b[None, :, :]) ** 2).sum(axis=2)))


def spacing(points_px: Array) -> Array:
    """Distance (n,) of each of (n, 2) points to the nearest other one."""
    distance = distances(points_px, points_px)
    np.fill_diagonal(distance, np.inf)
    return np.asarray(distance.min(axis=1))


def spread(at_px: Array, value: Array, where_px: Array, scale_px: Array) -> Array:
    """Gaussian-weighted mean of `value` (n, k), known at (n, 2), at (m, 2) places; scale_px (m,)."""
    squared = (distances(where_px, at_px) / scale_px[:, None]) ** 2
    weight = np.exp(-0.5 * (squared - squared.min(axis=1, keepdims=True)))
    return np.asarray(weight @ value / weight.sum(axis=1, keepdims=True))


def assign(reference_px: Array, candidates_px: Array, spacing_px: Array) -> NDArray[np.intp]:
    """One candidate for each reference bead, or NO_PARTNER: (n,) indices into the candidates.

    Mutual nearest neighbours within 0.6 of the bead's spacing come first; their motion, spread to the
    neighbourhood, then predicts where the others went, three times over.
    """
    partner = np.full(len(reference_px), NO_PARTNER, dtype=np.intp)
    if len(candidates_px) == 0:
        return partner
    predicted = reference_px
    for gate in (0.6, 0.5, 0.4):
        distance = distances(predicted, candidates_px)
        forth = distance.argmin(axis=1)
        back = distance.argmin(axis=0)
        beads = np.arange(len(reference_px))
        mutual = (back[forth] == beads) & (distance[beads, forth] < gate * spacing_px)
        partner = np.where(mutual, forth, NO_PARTNER).astype(np.intp)
        if not mutual.any():
            break
        motion = candidates_px[partner[mutual]] - reference_px[mutual]
        predicted = reference_px + spread(reference_px[mutual], motion, reference_px, spacing_px)
    return partner
