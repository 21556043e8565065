"""Torn frames: where the labels of markers jump by a row, judged by the true poses.

The displacements that the pose alone predicts are subtracted. What is left over where the object slipped is
smooth; where markers bear their neighbours' numbers it jumps by a spacing from one marker to the next. The
prediction is a kernel regression from the poses of all other frames: nothing of the estimator is used.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Mask
from palpate_edge.geometry.points import distances, spacing

JUMP = 0.5  # spacings, between what is left over of two neighbours
NEIGHBOURS = 1.3  # spacings apart at rest, at most
MOST_JUMPS = 6  # those of one marker that is wrong, a speck for instance; a row off makes more
LENGTH, RIDGE = 2.0, 0.03  # of the regression, in deviations of the poses; of its noise


def torn_frames(rest_px: Array, displacement_px: Array, found: Mask, poses: Array) -> Mask:
    """Return which frames (s,) are torn.

    rest_px (n, 2), displacement_px (s, n, 2) and found (s, n) of the markers; poses (s, k): the truth.
    """
    pitch_px = float(np.median(spacing(rest_px)))
    first, second = np.nonzero(np.triu(distances(rest_px, rest_px) < NEIGHBOURS * pitch_px, k=1))
    left_px = displacement_px - predicted_displacement(
        displacement_px.reshape(len(poses), -1), poses
    ).reshape(displacement_px.shape)
    jump = np.linalg.norm(left_px[:, first] - left_px[:, second], axis=2) > JUMP * pitch_px
    jumps = (jump & found[:, first] & found[:, second]).sum(axis=1)
    return np.asarray(jumps > MOST_JUMPS)


def predicted_displacement(displacement_px: Array, poses: Array) -> Array:
    """Return the displacement (s, d) of each frame by the poses of the others."""
    point = (poses - poses.mean(axis=0)) / (LENGTH * poses.std(axis=0))
    gram = np.exp(-0.5 * distances(point, point) ** 2) + RIDGE * np.eye(len(point))
    inverse = np.linalg.inv(gram)
    off = displacement_px - np.median(displacement_px, axis=0)
    return np.asarray(displacement_px - (inverse @ off) / np.diag(inverse)[:, None])
