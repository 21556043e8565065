"""Skin motion: how far the beads are displaced, and whether they move as one skin.

A press displaces neighbouring beads alike; camera noise displaces each on its own. Displacements are
therefore averaged over a neighbourhood of about two bead spacings before their size is taken. On the press
sample this lowers the motion of an untouched frame from 0.04 px to 0.018 px.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array, Floats
from palpate_edge.vision.beads import Beads, Reference
from palpate_edge.vision.neighbourhood import mean_of, rms, row_normalised, weighted

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
    """Measures the motion of one sensor's beads by a single float32 product."""

    def __init__(self, reference: Reference) -> None:
        neighbourhood = reference.neighbourhood
        self._reference_px = reference.position_px
        self._spacing_px = neighbourhood.spacing_px
        averaging, neighbours = neighbourhood.weights(AVERAGING_LENGTH), neighbourhood.weights(1.0)
        np.fill_diagonal(neighbours, 0.0)
        self._variance = (averaging**2).sum(axis=1) / averaging.sum(axis=1) ** 2
        self._sums = np.vstack([averaging, neighbours, averaging**2]).astype(np.float32)
        roughness = np.eye(len(self._spacing_px)) - row_normalised(neighbours)
        both = np.vstack([row_normalised(averaging), roughness / self._spacing_px[:, None]])
        self._average_and_roughness = both.astype(np.float32)

    def measure(self, beads: Beads) -> Motion:
        """Return the motion of the found beads."""
        displacement, found = beads.position_px - self._reference_px, beads.found
        if beads.all_exact:
            both = self._average_and_roughness @ displacement.astype(np.float32)
            return Motion(displacement, rms(both[: len(found)]), rms(both[len(found) :]))
        count, weight = len(found), beads.weight
        sums = self._sums @ weighted(displacement, weight)
        averaged = sums[:count][found]
        rough = displacement - mean_of(sums[count : 2 * count])
        rough *= (np.sqrt(weight) / self._spacing_px)[:, None]
        size_px, noise = self._size(averaged, sums[2 * count :, 2][found], self._variance[found])
        return Motion(displacement, size_px, rms(rough[found]), noise)

    @staticmethod
    def _size(averaged: Floats, squared_sum: Floats, exact_variance: Array) -> tuple[float, float]:
        """Return Motion.size_px and Motion.noise from the sums (m, 3) over each found bead's neighbours.

        squared_sum (m,): sums of a^2 w; averaged[:, 2]: sums of a w. A mean with weights a w, w = 1 /
        variance, has the variance sum(a^2 w) / sum(a w)^2. Each mean counts by its exact_variance (m,), that
        with all beads exact, over its variance.
        """
        if not len(averaged):
            return 0.0, 1.0
        share = exact_variance * np.maximum(averaged[:, 2], 1e-9) ** 2 / np.maximum(squared_sum, 1e-12)
        share = np.minimum(share, 1.0)
        mean = mean_of(averaged)
        total = float(share.sum())
        size_px = math.sqrt(float(share @ np.vecdot(mean, mean)) / total)
        return size_px, max(1.0, math.sqrt(len(share) / total))


def faintness(motion_px: float, threshold_px: float) -> float:
    """Return the factor, at least 1, by which the position error grows for a faint contact.

    A bead's place has an error of a few hundredths of a pixel at any displacement, so the error of the
    contact's position grows as 1 / motion. Motion up to the contact threshold may be no signal at all.
    """
    return math.hypot(1.0, FAINT * threshold_px / max(motion_px - threshold_px, 1e-3 * threshold_px))
