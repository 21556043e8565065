"""The daemon's own clock: microseconds that never step, and the way to it from the kernel's stamps."""

from __future__ import annotations

import time
from collections.abc import Callable


def monotonic_us() -> int:
    """CLOCK_MONOTONIC in us."""
    return time.monotonic_ns() // 1000


def unix_ahead_us() -> int:
    """What CLOCK_REALTIME shows more than CLOCK_MONOTONIC, in us."""
    return time.time_ns() // 1000 - monotonic_us()


class LocalClock:
    """Unix time as it was at the start, carried on by CLOCK_MONOTONIC, or by the `monotonic` of a twin."""

    def __init__(self, monotonic: Callable[[], int] = monotonic_us) -> None:
        self._monotonic_us = monotonic
        self._offset_us = unix_ahead_us()

    def now_us(self) -> int:
        return self.at_monotonic_us(self._monotonic_us())

    def at_monotonic_us(self, stamp_us: int) -> int:
        """A stamp of CLOCK_MONOTONIC (V4L2) on this clock."""
        return stamp_us + self._offset_us

    def at_unix_us(self, stamp_us: int) -> int:
        """A recent stamp of CLOCK_REALTIME (CAN frames) on this clock, however the system's clock was set."""
        return self.at_monotonic_us(stamp_us - unix_ahead_us())
