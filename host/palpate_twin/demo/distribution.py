"""Mean, median and percentiles of a list of values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Distribution:
    """Statistics in the unit of the values; percentiles are interpolated linearly between ranks."""

    count: int
    mean: float
    median: float
    p95: float
    p99: float
    largest: float


def distribution(values: Sequence[float]) -> Distribution | None:
    """Return the statistics of the values, or None if there are none."""
    if not values:
        return None
    median, p95, p99 = (float(value) for value in np.percentile(values, (50, 95, 99)))
    return Distribution(len(values), float(np.mean(values)), median, p95, p99, float(max(values)))
