"""Errors of presses left out in turn, by region of the dome: what the sensor's own presses show."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from palpate_edge.calibration.training.samples import Samples
from palpate_edge.common.arrays import Array, Mask
from palpate_edge.estimation.calibration import RegionErrors

EDGES_DEG = (0, 30, 45, 60, 75, 90)
"""Above the base plane, as in the paper's Fig. 8b; the first region holds all lower presses too."""


def region_errors(samples: Samples, error_mm: Array, held: Mask) -> tuple[RegionErrors, ...]:
    """Return the errors of each region, from the base to the apex.

    error_mm (s,): of predictions by the other presses; held (s,): whether they are within their 95 % radius.
    """
    plain = np.flatnonzero(samples.plain)
    _, first = np.unique(samples.press[plain], return_index=True)  # the press itself, not its mirror image
    presses = plain[first]
    above_base_deg = np.degrees(np.arcsin(np.clip(samples.directions[presses, 2], -1.0, 1.0)))
    region = np.digitize(above_base_deg, EDGES_DEG[1:-1])
    found = []
    for number, (low_deg, high_deg) in enumerate(pairwise(EDGES_DEG)):
        inside = presses[region == number]
        figures = (
            (float(error_mm[inside].mean()), float(error_mm[inside].max()), int(held[inside].sum()))
            if len(inside)
            else ()
        )
        found.append(RegionErrors(low_deg, high_deg, len(inside), *figures))
    return tuple(found)
