"""Checks of the beads' numbers: whether a bead may have been taken for its neighbour."""

from __future__ import annotations

from typing import NamedTuple

from palpate_edge.common.arrays import Array, Mask
from palpate_edge.kernels.labels import LabelKernel
from palpate_edge.vision.beads import Reference

Labelling = tuple[Array, Mask]
"""One reading of a frame: places (n, 2) of the numbered beads, and which (n,) were found."""


class CheckedLabels(NamedTuple):
    """lost: beads that were not found, or are no more; has_jumped: whether a bead moved so far that it may be
    its neighbour. That is another contact, not the same one a frame later."""

    lost: int
    has_jumped: bool


PAIR_RANGE = 3.0  # spacings: beads nearer than that can come to lie on each other
JUMP = 0.2  # of the spacing, from one frame to the next


class LabelCheck:
    """Compares the beads of a frame with each other and with the frame before."""

    def __init__(self, reference: Reference) -> None:
        neighbourhood = reference.neighbourhood
        spacing_px, diameter_px = neighbourhood.spacing_px, reference.diameter_px
        pairs = neighbourhood.pairs(PAIR_RANGE)
        gap_px = spacing_px - 0.5 * diameter_px
        self._kernel = LabelKernel(
            reference.position_px,
            (JUMP * spacing_px) ** 2,
            pairs,
            (0.5 * diameter_px[pairs[0]]) ** 2,
            min_overlap_squared=(float(gap_px.min()) / 2) ** 2,  # two beads that approach each other
        )

    def check(self, labelling: Labelling, last_px: Array) -> CheckedLabels:
        """Clear `found`, in place, of beads that share a place with another one that came from nearer by.

        last_px (n, 2): the beads' places before.
        """
        return CheckedLabels(*self._kernel.check(*labelling, last_px))
