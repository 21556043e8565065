"""Markers of the untouched sensor where the reference frames are its lightest presses.

A set without untouched frames starts from a press that is tilted and sheared. Its light presses together show
where the markers are when nothing touches: displacement is fitted to depth, tilt, shear and torsion, and
taken where all of them are 0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.geometry.points import spacing

LIGHT_SHARE = 1 / 3  # of the presses, by depth
FEWEST = 100  # light presses for the fit
REACH = 0.5  # from 0 to the least depth, over the depths of the light presses: no fit holds farther
LEAST_OFFSET = 0.08  # pitches; less is the fit's own error


def untouched_offset(rest_px: Array, displacement_px: Array, targets: Array, labels: Sequence[str]) -> Array:
    """Return how far (2 n,) the untouched sensor's markers are from `rest_px` (n, 2), 0 where that is not
    known or no more than the fit's error."""
    nothing = np.zeros(rest_px.size)
    if "depth_mm" not in labels:
        return nothing
    place = labels.index("depth_mm")
    light = np.argsort(targets[:, place], kind="stable")[: int(LIGHT_SHARE * len(targets))]
    if len(light) < FEWEST:
        return nothing
    depth = targets[light][:, [place]]
    if depth.min() > REACH * np.ptp(depth):
        return nothing
    others = np.delete(targets[light], place, axis=1)
    others = others / np.maximum(np.abs(others).max(axis=0), 1e-9)
    features = np.hstack([np.ones_like(depth), depth, depth**2, others, depth * others, depth**2 * others])
    offset = np.linalg.lstsq(features, displacement_px[light], rcond=None)[0][0]
    size = np.sqrt(np.square(offset).sum() / len(rest_px)) / np.median(spacing(rest_px))
    return np.asarray(offset if size > LEAST_OFFSET else nothing)
