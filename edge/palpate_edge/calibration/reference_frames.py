"""Comparison of the reference frames with each other: where was the dome touched, or the camera moved?

Reference frames show the untouched dome. A touch in some of them raises the contact threshold and spoils the
beads' places at rest. Drift (a camera that moves, a holder that warms up) displaces all beads by an affine
map; what remains of the displacement is that of a touch. Touches are found in less than half of the frames;
one that is the same in all frames cannot be found in this way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array, Indices
from palpate_edge.estimation.skin_motion import AVERAGING_LENGTH
from palpate_edge.vision.neighbourhood import Neighbourhood, row_normalised

LEAST_TOUCH_PX, LEAST_DRIFT_PX = 0.05, 0.3  # root mean square over the beads; smaller differences are usual
TOUCH_OVER_USUAL = 5.0  # times the lower quartile over the frames


@dataclass(frozen=True, slots=True)
class ReferenceFaults:
    """Indices of the frames that differ from the others: touched, or moved as a whole."""

    touched: Indices
    moved: Indices


def compare_references(places_px: Array) -> ReferenceFaults:
    """Return the frames that differ from the one that is most like all others.

    places_px (f, n, 2): the places of n beads in f frames.
    """
    centre_px = np.median(places_px, axis=0)
    averaging = row_normalised(Neighbourhood(centre_px).weights(AVERAGING_LENGTH))
    smooth_px = averaging @ (places_px - centre_px)
    common = _affine(centre_px)
    drift_px = common @ smooth_px
    touch_px = smooth_px - drift_px
    touch, drift = _from_most_alike(touch_px), _from_most_alike(drift_px)
    limit_px = max(LEAST_TOUCH_PX, TOUCH_OVER_USUAL * float(np.quantile(touch, 0.25)))
    is_touched = touch > limit_px
    return ReferenceFaults(np.flatnonzero(is_touched), np.flatnonzero(~is_touched & (drift > LEAST_DRIFT_PX)))


def _affine(places_px: Array) -> Array:
    """Return the projection (n, n) of displacements at places (n, 2) onto affine ones."""
    columns = np.column_stack([np.ones(len(places_px)), places_px - places_px.mean(axis=0)])
    return np.asarray(columns @ np.linalg.pinv(columns))


def _from_most_alike(places_px: Array) -> Array:
    """Return the distances (f,), px, of frames (f, n, 2) from the one with the smallest median distance."""
    apart = np.array([np.sqrt(((places_px - one) ** 2).sum(axis=2).mean(axis=1)) for one in places_px])
    return np.asarray(apart[int(np.median(apart, axis=1).argmin())])
