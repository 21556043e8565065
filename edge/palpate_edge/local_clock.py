"""The daemon's own clock: microseconds that never step, and the way to it from the kernel's stamps."""

from __future__ import annotations

import time


class LocalClock:
    """Unix time as it was at the start, carried on by CLOCK_MONOTONIC."""

    def __init__(self) -> None:
        self._offset_us = (time.time_ns() - time.monotonic_ns()) // 1000

    def now_us(self) -> int:
        return self.at_monotonic_us(time.monotonic_ns() // 1000)

    def at_monotonic_us(self, stamp_us: int) -> int:
        """A stamp of CLOCK_MONOTONIC (V4L2) on this clock."""
        return stamp_us + self._offset_us

    def at_unix_us(self, stamp_us: int) -> int:
        """A recent stamp of CLOCK_REALTIME (CAN frames) on this clock, however the system's clock was set."""
        return self.at_monotonic_us(stamp_us - time.time_ns() // 1000 + time.monotonic_ns() // 1000)
