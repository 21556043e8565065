"""Labels grown from the quiet skin into a dent.

Where a dent moved its beads by more than half their spacing since the last frame, each is nearest to where a
neighbour was, and a whole patch may be labelled one row off. The skin around hardly moved, and is labelled
well: from there each bead's place follows from the motion of those beside it, row by row.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate_edge.common.arrays import Array, Indices, Mask

PatchSearch = Callable[[Array, Indices], tuple[Array, Mask]]  # beads' places looked for from there, and found

NEAREST = 6  # neighbours of a bead that tell whether it moves as the skin does
TORN = 0.3  # of the spacing: that much apart from most of its neighbours, a bead is another one
MOST_LOST = 0.02  # share of the beads
QUIET, AGREEING = 0.3, 0.25  # of the spacing: motion, and median difference to the neighbours
FEWEST_QUIET = 8
REACH, SCALE = 2.5, 1.2  # in spacings: of the beads that predict one, and of their weights
FEWEST_BESIDE = 3
SLOPE_RIDGE = 0.1  # of the spacing's square, on the motion's slope: few neighbours tell none
NEAR_PREDICTED = 0.4  # of the spacing
TRIES, MOST_STEPS = 3, 20


class Growth:
    """Of one reference's beads: reference_px (n, 2), spacing_px (n,), distance_px (n, n) between them."""

    def __init__(self, reference_px: Array, spacing_px: Array, distance_px: Array) -> None:
        self._reference, self._spacing = reference_px, spacing_px
        apart = distance_px / spacing_px[:, None]
        self._nearest = np.argsort(apart, axis=1)[:, 1 : NEAREST + 1]
        self._weight = np.where((apart > 0) & (apart < REACH), np.exp(-0.5 * (apart / SCALE) ** 2), 0.0)

    def is_torn(self, position_px: Array, found: Mask) -> bool:
        """Whether beads at position_px (n, 2) may bear their neighbours' labels."""
        if found.mean() < 1.0 - MOST_LOST:
            return True
        return bool((self._apart(position_px)[found] > TORN).any())

    def grow(self, position_px: Array, found: Mask, windows: PatchSearch) -> tuple[Array, Mask]:
        """Places and finds of all beads, kept where the skin is quiet and looked for anew elsewhere."""
        position, moved = position_px.copy(), position_px - self._reference
        quiet = np.linalg.norm(moved, axis=1) < QUIET * self._spacing
        known = found & quiet & (self._apart(position) < AGREEING)
        if known.sum() < FEWEST_QUIET:
            return position_px, found
        tries = np.zeros(len(known), dtype=np.intp)
        for _ in range(MOST_STEPS):
            beside = (self._weight[:, known] > 0).sum(axis=1)
            open_ = np.flatnonzero(~known & (beside >= FEWEST_BESIDE) & (tries < TRIES))
            if not len(open_):
                break
            row = open_[beside[open_] >= np.median(beside[open_])]  # the best told first
            start = self._predicted(position, known, row)
            place, ok = windows(start, row)
            ok &= np.linalg.norm(place - start, axis=1) < NEAR_PREDICTED * self._spacing[row]
            position[row[ok]], known[row[ok]] = place[ok], True
            tries[row[~ok]] += 1
        return position, known

    def _apart(self, position_px: Array) -> Array:
        """(n,): median difference between a bead's motion and its neighbours', in spacings."""
        moved = position_px - self._reference
        difference = np.linalg.norm(moved[:, None] - moved[self._nearest], axis=2)
        return np.asarray(np.median(difference, axis=1) / self._spacing)

    def _predicted(self, position_px: Array, known: Mask, beads: Indices) -> Array:
        """(m, 2): where the motion of the known ones, as a plane about each bead, puts it."""
        weight = self._weight[beads][:, known]
        offset = self._reference[known] - self._reference[beads][:, None]
        terms = np.concatenate([np.ones((*offset.shape[:2], 1)), offset], axis=2)  # (m, k, 3)
        weighted = terms * weight[:, :, None]
        normal = np.swapaxes(weighted, 1, 2) @ terms
        ridge = SLOPE_RIDGE * self._spacing[beads] ** 2 * weight.sum(axis=1)
        normal[:, [1, 2], [1, 2]] += ridge[:, None]
        moved = position_px[known] - self._reference[known]
        plane = np.linalg.solve(normal, np.swapaxes(weighted, 1, 2) @ moved)
        return np.asarray(self._reference[beads] + plane[:, 0])
