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
from palpate_edge.kernels.skin_motion import SkinMotionKernel
from palpate_edge.vision.beads import Beads, Reference

AVERAGING_LENGTH = 2.0  # spacings
MAX_ROUGHNESS = 0.12  # spacings; see Motion
FAINT = 36.0  # contact thresholds; motion well above that hardly improves the position


class Motion(NamedTuple):
    """The found beads' displacement from the reference.

    displacement_px (n, 2). size_px: root mean square of the averaged displacement. roughness: root mean
    square difference between a bead's displacement and its neighbours' mean, in spacings. Skin stretches
    smoothly: roughness is 0.003 untouched and at most 0.052 in the press sample and sequences; beads of
    another dome taken for this one's give 0.28. noise: by how much the hidden, dim and glaring beads of the
    frame make size_px less exact, 1 where all beads are seen as in the reference frames.
    """

    displacement_px: Array
    size_px: float
    roughness: float
    noise: float = 1.0


class SkinMotion:
    """Measures the motion of one sensor's beads."""

    def __init__(self, reference: Reference) -> None:
        neighbourhood = reference.neighbourhood
        neighbours = neighbourhood.weights(1.0)
        np.fill_diagonal(neighbours, 0.0)
        self._kernel = SkinMotionKernel(
            reference.position_px,
            neighbourhood.spacing_px,
            neighbourhood.weights(AVERAGING_LENGTH),
            neighbours,
        )

    def measure(self, beads: Beads) -> Motion:
        """Return the motion of the found beads.

        A mean with weights a w, w = 1 / variance, has the variance sum(a^2 w) / sum(a w)^2. Each bead's mean
        counts in the size by the variance that it has with all beads exact, over its variance.
        """
        return Motion(
            *self._kernel.measure(beads.position_px, beads.weight, beads.found, all_exact=beads.all_exact)
        )


def faintness(motion_px: float, threshold_px: float) -> float:
    """Return the factor, at least 1, by which the position error grows for a faint contact.

    A bead's place has an error of a few hundredths of a pixel at any displacement, so the error of the
    contact's position grows as 1 / motion. Motion up to the contact threshold may be no signal at all.
    """
    return math.hypot(1.0, FAINT * threshold_px / max(motion_px - threshold_px, 1e-3 * threshold_px))
