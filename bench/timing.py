"""Time calls, and print a table of medians and 99th percentiles."""

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
    """One row of a table: durations in seconds of single calls."""

    name: str
    seconds: np.ndarray

    @property
    def median_s(self) -> float:
        return float(np.median(self.seconds))


def time_each(
    call: Callable[[Item], object], items: Iterable[Item], clock_s: Callable[[], float] = time.perf_counter
) -> np.ndarray:
    """Return the duration in s of every call over `ROUNDS` rounds; the first round is a warm-up."""
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
    """Return the durations in s of every `make`, and of every `call` on its result.

    The calls alternate, so that both have the same machine load, and every `call` finds the caches as `make`
    leaves them. Durations are processor time, because long calls are interrupted by other processes.
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


def table(title: str, rows: Sequence[Row], against: Row | None = None, *, spread: bool = False) -> str:
    """Return a table of median and p99 in ms, ratio to the first row, and speed relative to `against`.

    spread: with a column for the ratio of p99 and median.
    """
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
    if spread:
        lines[1] += f"  {'p99/median':>10}"
        for number, row in enumerate(rows, start=2):
            lines[number] += f"  {np.percentile(row.seconds, 99) / row.median_s:10.1f}"
    return "\n".join(lines)
