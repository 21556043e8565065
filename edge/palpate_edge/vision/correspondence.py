"""Correspondence: which blob of an image is which bead, by topology and not by nearness.

A hard press displaces beads by more than half their spacing; the blob nearest to a bead's old place is then
its neighbour's, and whole regions are labelled one row off, each of them smooth in itself. Therefore labels
spread along the skin from where they are right:

1. *Hypotheses*: places where the beads may be (the last frame's, the reference's). The one whose places lie
   nearest to blobs is taken, and each bead is given the blob next to its place.
2. *Patches*: neighbours whose displacements differ by a fraction of the spacing belong to one patch. Between
   the right patch and one that is a row off runs a tear. The largest patch is the seed.
3. *Growth*: every bead is predicted from its labelled neighbours by a local affine map (local_warp.py) and
   given the blob there, or none. Each round adds about two rows, and takes back labels that the others
   contradict.
4. *Check*: the right labels leave over neither beads nor blobs. Labels a row off leave over both, beads on
   one side of the dome and blobs on the other. Then the next largest patch is tried, and the labelling with
   the most beads taken. What is still left over on both sides is the doubt.

Nothing here depends on a layout of rings or rows, nor on a frame before. docs/matching.md shows the steps in
pictures, kernels/matching.c computes them.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Indices, Mask, median
from palpate_edge.kernels.matching import MatchingGates, MatchingKernel, MatchingLimits
from palpate_edge.kernels.nearest_blob import NO_BLOB
from palpate_edge.vision.blob_detection import Blobs
from palpate_edge.vision.local_warp import LocalWarp
from palpate_edge.vision.neighbourhood import Neighbourhood

START_GATE = 0.5  # local spacings, from the hypothesis to a blob
GROWTH_GATE = 0.36  # from the prediction; it is right to about 0.1
NEAR = 0.12  # from the prediction; half the least distance between blobs is more, so no other one is nearer
PATCH_NEIGHBOURS, PATCH_REACH = 6, 1.7  # of a bead: count, and local spacings
PATCH_STEP = 0.25  # local spacings, between the displacements of neighbours in one patch
SMOOTH = 0.25  # local spacings; a bead farther from its prediction may be another one
MIN_SUPPORT = 0.25  # of a bead's neighbours have to be labelled before it is
MIN_PATCH = 8  # beads; fewer determine no affine map and its error
MAX_HYPOTHESES, MAX_PATCHES = 2, 4  # tried, and of each the patches tried as seeds
MAX_ROUNDS = 24  # of growth a frame, over all seeds
RANKING_BEADS = 64  # about that many beads rank the hypotheses
ENOUGH_LEFT = 0.02  # of the beads; with fewer left over the labels are right, and no other seed is tried
CAP_SQUARED = 0.16  # squared spacings, from a hypothesis to the nearest blob; farther is no nearer to right
STRONG = 0.5  # of the labelled blobs' strength; specks and reflections are mostly weaker
AT_LATTICE = 1.3  # local spacings; a blob nearer to a bead's place stands in the lattice or one row beside it


class Match(msgspec.Struct, frozen=True):
    """Labels of one frame's blobs.

    blob (n,): each bead's blob, or NO_BLOB; predicted_px (n, 2): each bead's place as its neighbours predict
    it; doubt: share of the beads left over on both sides, 1 without labels; 0 where they can only be right.
    """

    blob: Indices
    predicted_px: Array
    doubt: float

    @property
    def found(self) -> Mask:
        """Which beads (n,) have a blob."""
        return np.asarray(self.blob != NO_BLOB)


class Correspondence:
    """Matches blobs with the beads of one layout."""

    def __init__(self, neighbourhood: Neighbourhood) -> None:
        """neighbourhood: of the reference's beads."""
        warp = LocalWarp(neighbourhood)
        spacing_px = warp.spacing_px
        near = neighbourhood.nearest(PATCH_NEIGHBOURS)
        distance_px = np.take_along_axis(neighbourhood.distance_px, near, axis=1)
        joined = distance_px < PATCH_REACH * spacing_px[:, None]
        limits = MatchingLimits(
            ranking_step=max(1, len(spacing_px) // RANKING_BEADS),
            max_hypotheses=MAX_HYPOTHESES,
            max_patches=MAX_PATCHES,
            min_patch=MIN_PATCH,
            max_rounds=MAX_ROUNDS,
            min_support=MIN_SUPPORT,
            cap_squared_px2=CAP_SQUARED * median(spacing_px) ** 2,
            enough_left=ENOUGH_LEFT,
            strong=STRONG,
        )
        self._kernel = MatchingKernel(
            neighbourhood.position_px,
            warp.kernel,
            MatchingGates(
                *((gate * spacing_px) ** 2 for gate in (START_GATE, GROWTH_GATE, NEAR, SMOOTH, AT_LATTICE))
            ),
            np.where(joined, near, np.arange(len(near))[:, None]),
            (PATCH_STEP * spacing_px) ** 2,
            limits,
        )

    def match(self, blobs: Blobs, hypotheses_px: Array | Sequence[Array]) -> Match:
        """Return the labels of one image's blobs.

        hypotheses_px (h, n, 2): where the beads may be, at least one; ties go to the first.
        """
        return Match(*self._kernel.match(blobs.position_px, blobs.strength, hypotheses_px))

    def patches(self, displacement_px: Array, known: Mask) -> list[Mask]:
        """Return the patches (n,) of the known beads, the largest first."""
        return self._kernel.patches(displacement_px, known)

    def is_smooth(self, position_px: Array, found: Mask) -> bool:
        """Return whether each found bead at position_px (n, 2) is displaced as its neighbours predict."""
        return self._kernel.is_smooth(position_px, found)
