"""Checks of the beads' numbers: whether a bead may have been taken for its neighbour."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Mask
from palpate_edge.geometry.points import as_complex
from palpate_edge.vision.beads import Reference

Labelling = tuple[Array, Mask]
"""One reading of a frame: places (n, 2) of the numbered beads, and which (n,) were found."""

PAIR_RANGE = 3.0  # spacings: beads nearer than that can come to lie on each other
JUMP = 0.2  # of the spacing, from one frame to the next


class LabelCheck:
    """Compares the beads of a frame with each other and with the frame before."""

    def __init__(self, reference: Reference) -> None:
        neighbourhood = reference.neighbourhood
        spacing_px, diameter_px = neighbourhood.spacing_px, reference.diameter_px
        self._reference_px = reference.position_px
        self._pairs = neighbourhood.pairs(PAIR_RANGE)
        self._overlap_squared = ((0.5 * diameter_px[self._pairs[0]]) ** 2).astype(np.float32)
        gap_px = spacing_px - 0.5 * diameter_px
        self._min_overlap_squared = (float(gap_px.min()) / 2) ** 2  # two beads that approach each other
        self._jump_squared = (JUMP * spacing_px) ** 2
        self._min_jump_squared = float(self._jump_squared.min())

    def has_jumped(self, labelling: Labelling, last_px: Array) -> bool:
        """Return whether a bead moved so far since `last_px` (n, 2) that it may be its neighbour.

        That is another contact, not the same one a frame later.
        """
        position_px, found = labelling
        step = position_px - last_px
        squared = np.vecdot(step, step)
        if squared.max() <= self._min_jump_squared:
            return False
        return bool(((squared > self._jump_squared) & found).any())

    def drop_doubles(self, labelling: Labelling, last_px: Array) -> Labelling:
        """Clear `found` of beads that share a place with another one that came from nearer by.

        Changes `found` in place and returns the labelling.
        """
        position_px, found = labelling
        displacement = position_px - self._reference_px
        if np.vecdot(displacement, displacement).max() < self._min_overlap_squared:
            return labelling
        place = as_complex(position_px)
        apart = place.take(self._pairs[0]) - place.take(self._pairs[1])
        near = (apart.real**2 + apart.imag**2 < self._overlap_squared).nonzero()[0]
        if len(near):
            first, second = (ends[near] for ends in self._pairs)
            both = found[first] & found[second]
            first, second = first[both], second[both]
            step_px = np.linalg.norm(position_px - last_px, axis=1)
            found[np.where(step_px[first] > step_px[second], first, second)] = False
        return labelling
