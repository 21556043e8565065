"""Region growing: labels carried from the quiet skin into a dent.

Where a dent displaced its beads by more than half their spacing since the last frame, each lies nearest to
where a neighbour was, and a whole patch may be labelled one row off. The skin around it hardly moved and is
labelled correctly: from there each bead's place follows from the displacement of its neighbours, row by row.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate_edge.common.arrays import Array, Indices, Mask
from palpate_edge.vision.neighbourhood import Neighbourhood

PatchSearch = Callable[[Array, Indices], tuple[Array, Mask]]
"""Expected places (m, 2) of beads (m,) -> their places, and which were found."""

NEAREST = 6  # neighbours whose displacement a bead is compared with
TORN = 0.3  # spacings: a bead displaced that differently from most neighbours is another bead
MAX_LOST_SHARE = 0.02  # of the beads
QUIET, AGREEING = 0.3, 0.25  # spacings: displacement, and median difference to the neighbours
MIN_QUIET = 8
REACH, LENGTH = 2.5, 1.2  # spacings: of the beads that predict one, and of their Gaussian weights
MIN_NEIGHBOURS = 3
SLOPE_RIDGE = 0.1  # of the spacing's square: a few neighbours determine no slope of the displacement
MAX_MISS = 0.4  # spacings between prediction and bead
MAX_TRIES, MAX_ROUNDS = 3, 20


class RegionGrowing:
    """Grows correct labels over one reference's beads."""

    def __init__(self, neighbourhood: Neighbourhood) -> None:
        """neighbourhood: of the reference's beads."""
        self._reference, self._spacing = neighbourhood.position_px, neighbourhood.spacing_px
        self._nearest = neighbourhood.nearest(NEAREST)
        relative = neighbourhood.relative
        within = (relative > 0) & (relative < REACH)
        self._weight = np.where(within, neighbourhood.weights(LENGTH), 0.0)

    def is_torn(self, position_px: Array, found: Mask) -> bool:
        """Return whether beads at position_px (n, 2) may bear their neighbours' labels."""
        if found.mean() < 1.0 - MAX_LOST_SHARE:
            return True
        return bool((self._disagreement(position_px)[found] > TORN).any())

    def grow(self, position_px: Array, found: Mask, search: PatchSearch) -> tuple[Array, Mask]:
        """Return places (n, 2) and finds (n,): kept where the skin is quiet, searched again elsewhere.

        Both stay as they are when too little skin is quiet.
        """
        position, displacement = position_px.copy(), position_px - self._reference
        quiet = np.linalg.norm(displacement, axis=1) < QUIET * self._spacing
        known = found & quiet & (self._disagreement(position) < AGREEING)
        if known.sum() < MIN_QUIET:
            return position_px, found
        tries = np.zeros(len(known), dtype=np.intp)
        for _ in range(MAX_ROUNDS):
            support = (self._weight[:, known] > 0).sum(axis=1)
            open_ = np.flatnonzero(~known & (support >= MIN_NEIGHBOURS) & (tries < MAX_TRIES))
            if not len(open_):
                break
            row = open_[support[open_] >= np.median(support[open_])]  # the best supported first
            expected = self._predict(position, known, row)
            place, ok = search(expected, row)
            ok &= np.linalg.norm(place - expected, axis=1) < MAX_MISS * self._spacing[row]
            position[row[ok]], known[row[ok]] = place[ok], True
            tries[row[~ok]] += 1
        return position, known

    def _disagreement(self, position_px: Array) -> Array:
        """Return the median difference (n,) between a bead's displacement and its neighbours', spacings."""
        displacement = position_px - self._reference
        difference = np.linalg.norm(displacement[:, None] - displacement[self._nearest], axis=2)
        return np.asarray(np.median(difference, axis=1) / self._spacing)

    def _predict(self, position_px: Array, known: Mask, beads: Indices) -> Array:
        """Return expected places (m, 2) of `beads`: the known displacements, as a plane about each bead."""
        weight = self._weight[beads][:, known]
        offset = self._reference[known] - self._reference[beads][:, None]
        terms = np.concatenate([np.ones((*offset.shape[:2], 1)), offset], axis=2)  # (m, k, 3)
        weighted = terms * weight[:, :, None]
        normal = np.swapaxes(weighted, 1, 2) @ terms
        ridge = SLOPE_RIDGE * self._spacing[beads] ** 2 * weight.sum(axis=1)
        normal[:, [1, 2], [1, 2]] += ridge[:, None]
        displacement = position_px[known] - self._reference[known]
        plane = np.linalg.solve(normal, np.swapaxes(weighted, 1, 2) @ displacement)
        return np.asarray(self._reference[beads] + plane[:, 0])
