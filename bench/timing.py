"""Medians and 99th percentiles, and the table that compares them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

Item = TypeVar("Item")
Made = TypeVar("Made")
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


def time_both(
    make: Callable[[Item], Made], call: Callable[[Made], object], items: Iterable[Item]
) -> tuple[np.ndarray, np.ndarray]:
    """Seconds of every `make` and of every `call` on what it has just made: turn by turn, so that both see
    the same load of the machine, and every `call` finds the caches as `make` leaves them.

    In processor time, as a call of some milliseconds is interrupted by other work and a short one is not.
    """
    items = list(items)
    durations = []
    for number in range(ROUNDS):
        for item in items:
            begin = time.thread_time()
            made = make(item)
            between = time.thread_time()
            call(made)
            end = time.thread_time()
            if number:
                durations.append((between - begin, end - between))
    made_s, called_s = np.array(durations).T
    return made_s, called_s


def table(title: str, rows: Sequence[Row], against: Row | None = None) -> str:
    """Median and p99 in ms, the median over the first row's, and that of `against` over it."""
    width = max(len(row.name) for row in rows)
    lines = [title, f"{'':{width}}  {'median ms':>10}  {'p99 ms':>8}  {'x first':>8}"]
    for row in rows:
        p99_s = np.percentile(row.seconds, 99)
        ratio = row.median_s / rows[0].median_s
        lines.append(f"{row.name:{width}}  {1e3 * row.median_s:10.3f}  {1e3 * p99_s:8.3f}  {ratio:8.2f}")
    if against is not None:
        lines[1] += f"  {'faster than (a)':>15}"
        for number, row in enumerate(rows, start=2):
            lines[number] += f"  {against.median_s / row.median_s:15.1f}"
    return "\n".join(lines)
