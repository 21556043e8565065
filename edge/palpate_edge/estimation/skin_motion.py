"""How far the skin has moved: the quantity that tells touch from no touch.

A press moves neighbouring beads alike, the camera's noise moves each on its own. The beads' motion is
therefore averaged over a neighbourhood of about two bead spacings before its size is taken; on the press
sample this lowers the motion of an untouched frame from 0.04 px to 0.018 px.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Floats
from palpate_edge.vision.tracker import Beads, Reference, distances

NEIGHBOURHOOD_SPACINGS = 2.0
MAX_ROUGHNESS = 0.12  # see Motion; rougher is no motion of one skin

FAINT = 36.0  # contact thresholds of motion above which more motion makes a place hardly surer


def faintness(motion_px: float, threshold_px: float) -> float:
    """How many times farther a touch may be off for being faint, 1 or more.

    A bead's place is wrong by a few hundredths of a pixel whatever moves it, so that the error of the
    contact's place grows as one over the motion. Of the motion up to a threshold may be no signal at all.
    """
    return math.hypot(1.0, FAINT * threshold_px / max(motion_px - threshold_px, 1e-3 * threshold_px))


class Motion(NamedTuple):
    """Of the found beads against their reference.

    size_px: root mean square of the smoothed motion. roughness: how little beads move like their neighbours,
    root mean square difference between a bead's motion and its neighbours' mean, in bead spacings. Skin
    stretches smoothly: 0.003 untouched, at most 0.052 in the press sample and sequences. Beads of another
    dome taken for ours give 0.28.
    """

    size_px: float
    roughness: float


class SkinMotion:
    """Reads the motion of one sensor's beads; with all of them found by one product, in float32."""

    def __init__(self, reference: Reference) -> None:
        self._reference_px = reference.position_px
        self._spacing_px = reference.spacing_px
        near = distances(reference.position_px, reference.position_px) / self._spacing_px[:, None]
        self._around = np.exp(-0.5 * (near / NEIGHBOURHOOD_SPACINGS) ** 2)
        self._beside = np.exp(-0.5 * near**2)
        np.fill_diagonal(self._beside, 0.0)
        rough_all = (np.eye(len(near)) - means(self._beside)) / self._spacing_px[:, None]
        self._both_all = np.vstack([means(self._around), rough_all]).astype(np.float32)

    def read(self, beads: Beads) -> Motion:
        """The motion that these beads show."""
        moved, found = beads.position_px - self._reference_px, beads.found
        if not len(beads.lost):
            both = self._both_all @ moved.astype(np.float32)
            return Motion(rms(both[: len(found)]), rms(both[len(found) :]))
        rough = (moved - found_means(self._beside, moved, found)) / self._spacing_px[:, None]
        return Motion(rms(found_means(self._around, moved, found)[found]), rms(rough[found]))


def rms(motion_px: Array | Floats) -> float:
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
