"""Local clock that never steps, and the conversion of the kernel's time stamps to it, in microseconds."""

from __future__ import annotations

import time
from collections.abc import Callable


def monotonic_us() -> int:
    """Return CLOCK_MONOTONIC in us."""
    return time.monotonic_ns() // 1000


def unix_ahead_us() -> int:
    """Return CLOCK_REALTIME minus CLOCK_MONOTONIC in us."""
    return time.time_ns() // 1000 - monotonic_us()


class LocalClock:
    """Unix time at the start, advanced by CLOCK_MONOTONIC or by the `monotonic` clock of a simulation."""

    def __init__(self, monotonic: Callable[[], int] = monotonic_us) -> None:
        self._monotonic_us = monotonic
        self._offset_us = unix_ahead_us()

    def now_us(self) -> int:
        return self.at_monotonic_us(self._monotonic_us())

    def at_monotonic_us(self, stamp_us: int) -> int:
        """Convert a stamp of CLOCK_MONOTONIC (V4L2) to this clock."""
        return stamp_us + self._offset_us

    def at_unix_us(self, stamp_us: int) -> int:
        """Convert a recent stamp of CLOCK_REALTIME (CAN frames), independent of steps of the system clock."""
        return self.at_monotonic_us(stamp_us - unix_ahead_us())
