"""Networks for the labels of sideways motion, and whether they pay.

Inputs are the labels by the first regression and, of shear and torsion, by each local one: where the skin
begins to slip, these differ. All come from presses left out, so that the networks see errors as they will be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.pose.regression.label_candidates import Candidates
from palpate_edge.calibration.pose.regression.network_training import fit_networks
from palpate_edge.common.arrays import Array, Indices
from palpate_edge.estimation.pose.network import Networks

MOTIONS = ("shear", "torsion")


@dataclass(frozen=True, slots=True)
class MotionNetworks:
    """networks: corrections of the mean of local regressions; errors: of each kind that these correct, by its
    number, at the judged presses."""

    networks: Networks
    errors: dict[int, Array]


def fit_motion_networks(
    candidates: Candidates, kinds: dict[str, list[int]], judged: Indices
) -> MotionNetworks | None:
    """Return networks with their errors at the `judged` (e,) presses; None where nothing moves sideways."""
    moving = [number for number, kind in enumerate(kinds) if kind in MOTIONS and candidates.local[number]]
    if not moving:
        return None
    places = list(kinds.values())
    first = np.empty((len(candidates.centres), sum(map(len, places))))
    for some, regression in zip(places, candidates.first, strict=True):
        first[:, some] = regression.in_parts
    local = [
        [one.left_out / len(candidates.local[number]) for one in candidates.local[number]]
        for number in moving
    ]
    means = [np.sum(of_kind, axis=0) for of_kind in local]
    left = [candidates.targets[number] - mean for number, mean in zip(moving, means, strict=True)]
    inputs = np.hstack([first, *(one for of_kind in local for one in of_kind)])
    fitted = fit_networks(inputs, np.hstack(left), [place for number in moving for place in places[number]])
    error = np.abs(np.hstack(left) - fitted.left_out)[np.searchsorted(candidates.centres, judged)]
    ends = np.cumsum([len(places[number]) for number in moving])[:-1]
    return MotionNetworks(fitted.networks, dict(zip(moving, np.hsplit(error, ends), strict=True)))
