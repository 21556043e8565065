"""Milliseconds by stage, for evaluations and benchmarks."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np


class Stopwatch:
    """Collects the durations of named stages."""

    def __init__(self) -> None:
        self._seconds: defaultdict[str, list[float]] = defaultdict(list)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what stands inside."""
        begin = time.perf_counter()
        yield
        self._seconds[name].append(time.perf_counter() - begin)

    @property
    def stages(self) -> tuple[str, ...]:
        return tuple(self._seconds)

    def median_and_p99_ms(self, name: str) -> tuple[float, float]:
        values = 1e3 * np.array(self._seconds[name])
        return float(np.median(values)), float(np.percentile(values, 99))
