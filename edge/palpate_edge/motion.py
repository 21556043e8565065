"""How far the skin has moved: the quantity that tells touch from no touch.

A press moves neighbouring beads alike, the camera's noise moves each on its own. The beads' motion is
therefore averaged over a neighbourhood of about two bead spacings before its size is taken; on the press
sample this lowers the motion of an untouched frame from 0.04 px to 0.018 px.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from palpate_edge.tracking import Beads, Reference, distances

Array = NDArray[np.float64]

NEIGHBOURHOOD_SPACINGS = 2.0
MAX_ROUGHNESS = 0.12  # see SkinMotion.roughness; rougher is no motion of one skin

FAINT = 36.0  # contact thresholds of motion above which more motion makes a place hardly surer


def faintness(motion_px: float, threshold_px: float) -> float:
    """How many times farther a touch may be off for being faint, 1 or more.

    A bead's place is wrong by a few hundredths of a pixel whatever moves it, so that the error of the
    contact's place grows as one over the motion. Of the motion up to a threshold may be no signal at all.
    """
    return math.hypot(1.0, FAINT * threshold_px / max(motion_px - threshold_px, 1e-3 * threshold_px))


class SkinMotion:
    """Size of the smoothed motion of one sensor's beads against their reference."""

    def __init__(self, reference: Reference) -> None:
        self._reference_px = reference.position_px
        self._spacing_px = reference.spacing_px
        near = distances(reference.position_px, reference.position_px) / self._spacing_px[:, None]
        self._around = np.exp(-0.5 * (near / NEIGHBOURHOOD_SPACINGS) ** 2)
        self._beside = np.exp(-0.5 * near**2)
        np.fill_diagonal(self._beside, 0.0)
        self._around_all, self._beside_all = means(self._around), means(self._beside)
        self._rough_all = (np.eye(len(near)) - self._beside_all) / self._spacing_px[:, None]

    def size_px(self, beads: Beads) -> float:
        """Root mean square, over the found beads, of the smoothed motion, pixels."""
        moved = beads.position_px - self._reference_px
        if beads.found.all():
            return rms(self._around_all @ moved)
        return rms(found_means(self._around, moved, beads.found)[beads.found])

    def roughness(self, beads: Beads) -> float:
        """How little the found beads move like their neighbours: root mean square difference between a
        bead's motion and its neighbours' mean, in bead spacings.

        Skin stretches smoothly: 0.003 untouched, at most 0.052 in the press sample and sequences. Beads of
        another dome taken for ours give 0.28.
        """
        moved = beads.position_px - self._reference_px
        if beads.found.all():
            return rms(self._rough_all @ moved)
        rough = (moved - found_means(self._beside, moved, beads.found)) / self._spacing_px[:, None]
        return rms(rough[beads.found])


def rms(motion_px: Array) -> float:
    """Root mean square length of (n, 2) vectors; 0 of none."""
    flat = motion_px.ravel()
    return math.sqrt(float(flat @ flat) / max(1, len(motion_px)))


def found_means(weight: Array, moved: Array, found: NDArray[np.bool_]) -> Array:
    """Means (n, k) of the found ones' values (n, k) by weights (n, n)."""
    sums = weight @ np.column_stack([moved * found[:, None], found])
    return np.asarray(sums[:, :-1] / np.maximum(sums[:, -1:], 1e-12))


def means(weight: Array) -> Array:
    """Rows scaled to sum 1."""
    return np.asarray(weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-12))
