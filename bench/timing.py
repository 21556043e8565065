"""Medians and 99th percentiles, and the table that compares them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

Item = TypeVar("Item")
ROUNDS = 3


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a table: durations in seconds of single calls."""

    name: str
    seconds: np.ndarray

    @property
    def median_s(self) -> float:
        return float(np.median(self.seconds))


def time_each(
    call: Callable[[Item], object], items: Iterable[Item], clock_s: Callable[[], float] = time.perf_counter
) -> np.ndarray:
    """Seconds of every call, over `ROUNDS` rounds; the first round warms up and is not kept."""
    items = list(items)
    durations = []
    for number in range(ROUNDS):
        for item in items:
            begin = clock_s()
            call(item)
            if number:
                durations.append(clock_s() - begin)
    return np.array(durations)


def table(title: str, rows: Sequence[Row]) -> str:
    """Median and p99 in ms, and the median over the first row's."""
    width = max(len(row.name) for row in rows)
    lines = [title, f"{'':{width}}  {'median ms':>10}  {'p99 ms':>8}  {'x first':>8}"]
    lines += [
        f"{row.name:{width}}  {1e3 * row.median_s:10.3f}  {1e3 * np.percentile(row.seconds, 99):8.3f}  "
        f"{row.median_s / rows[0].median_s:8.2f}"
        for row in rows
    ]
    return "\n".join(lines)
