"""Skin motion: how far the beads are displaced, and whether they move as one skin.

A press displaces neighbouring beads alike; camera noise displaces each on its own. Displacements are
therefore averaged over a neighbourhood of about two bead spacings before their size is taken. On the press
sample this lowers the motion of an untouched frame from 0.04 px to 0.018 px.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.estimation.camera_motion import SplitMotion, camera_modes
from palpate_edge.kernels.skin_motion import SkinMotionKernel, SkinWeights
from palpate_edge.vision.beads import Beads, Reference

AVERAGING_LENGTH = 2.0  # spacings
DENT_LENGTH = 1.4  # spacings: of the neighbourhood that a dent is averaged over
MAX_ROUGHNESS = 0.12  # spacings; see Motion
FAINT = 36.0  # contact thresholds; motion well above that hardly improves the position


class DriftField(NamedTuple):
    """A drift of the untouched skin.

    moved_rest_px (n, 2): the beads with it; without_slopes (n, 2, 2): from a bead's displacement to the one
    that it would be without it.
    """

    moved_rest_px: Array
    without_slopes: Array


class Motion(NamedTuple):
    """The found beads' displacement from the reference, without the drift.

    position_px, displacement_px (n, 2); split: the displacement as that of a moved camera and a dent.
    size_px: root mean square of the averaged displacement; dent_size_px: the same of the dent. roughness:
    root mean square difference between a bead's displacement and its neighbours' mean, in spacings. Skin
    stretches smoothly: roughness is 0.003 untouched and at most 0.052 in the press sample and sequences;
    beads of another dome taken for this one's give 0.28. noise: by how much the hidden, dim and glaring beads
    of the frame make size_px less exact, 1 where all beads are seen as in the reference frames.
    """

    position_px: Array
    displacement_px: Array
    split: SplitMotion
    size_px: float
    roughness: float
    noise: float
    dent_size_px: float


class SkinMotion:
    """Measures the motion of one sensor's beads."""

    def __init__(self, reference: Reference) -> None:
        neighbourhood = reference.neighbourhood
        neighbours = neighbourhood.weights(1.0)
        np.fill_diagonal(neighbours, 0.0)
        self._kernel = SkinMotionKernel(
            reference.position_px,
            neighbourhood.spacing_px,
            SkinWeights(
                neighbourhood.weights(AVERAGING_LENGTH), neighbours, neighbourhood.weights(DENT_LENGTH)
            ),
            camera_modes(reference.position_px),
        )
        self._none = DriftField(reference.position_px, np.tile(np.eye(2), (len(reference.position_px), 1, 1)))
        self._drift = self._none

    def measure(self, beads: Beads, drift: DriftField | None = None) -> Motion:
        """Return the motion of the found beads.

        drift: that is taken off, if any.

        A mean with weights a w, w = 1 / variance, has the variance sum(a^2 w) / sum(a w)^2. Each bead's mean
        counts in the size by the variance that it has with all beads exact, over its variance.
        """
        drift = drift or self._none
        if drift is not self._drift:
            self._drift = drift
            self._kernel.drift(*drift)
        moved_px, *sizes = self._kernel.measure(
            beads.position_px, beads.weight, beads.found, all_exact=beads.all_exact
        )
        position_px, displacement_px, common_px, dent_px = moved_px
        return Motion(position_px, displacement_px, SplitMotion(common_px, dent_px), *sizes)


def faintness(motion_px: float, threshold_px: float) -> float:
    """Return the factor, at least 1, by which the position error grows for a faint contact.

    A bead's place has an error of a few hundredths of a pixel at any displacement, so the error of the
    contact's position grows as 1 / motion. Motion up to the contact threshold may be no signal at all.
    """
    return math.hypot(1.0, FAINT * threshold_px / max(motion_px - threshold_px, 1e-3 * threshold_px))
