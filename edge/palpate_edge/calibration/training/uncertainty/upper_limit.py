"""The value that 95 % of new errors stay below, from few errors of presses left out in turn.

The errors of a sensor's own presses are taken together with those of typical presses, drawn from a log-normal
distribution, so that few presses need not determine the distribution's upper end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from palpate_edge.common.arrays import Array

COVERAGE = 0.95
PRIOR_PRESSES = 10  # how many presses the typical ones weigh


@dataclass(frozen=True, slots=True)
class TypicalErrors:
    """logarithm: distribution of a typical sensor's errors; flattery_presses: how many presses' worth the
    choice of settings by the same presses makes errors too small."""

    logarithm: NormalDist
    flattery_presses: float


def upper_limit(above: Array, presses: int, typical: TypicalErrors) -> float:
    """Return the limit of the logarithms `above` (s,) of left-out errors of some presses."""
    prior = [typical.logarithm.inv_cdf((number + 0.5) / 1000) for number in range(1000)]
    values = np.concatenate([above, prior])
    weight = np.repeat([presses / len(above), PRIOR_PRESSES / len(prior)], [len(above), len(prior)])
    order = np.argsort(values)
    below = np.cumsum(weight[order])
    limit = float(values[order][np.searchsorted(below, COVERAGE * below[-1])])
    return limit + math.log1p(typical.flattery_presses / presses)
