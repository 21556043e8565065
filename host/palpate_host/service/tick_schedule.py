"""The schedule of ticks: a fixed period from the first call on; ticks that are too late are skipped."""

from __future__ import annotations

from bisect import bisect_right

from palpate_host.common.status import LATE_BINS_US


class TickSchedule:
    """Schedules ticks. next_us: time of the next tick, 0 before the first; ticks: taken so far; left_out:
    skipped because the loop was more than a period late; lateness: histogram of the delays of taken ticks
    (LATE_BINS_US)."""

    def __init__(self, period_us: int) -> None:
        self.next_us = self.ticks = self.left_out = 0
        self.lateness = [0] * (len(LATE_BINS_US) + 1)
        self._period_us = period_us

    def take(self, now_us: int) -> int | None:
        """Return the time of the tick that is due, at most a period ago; None when none is due. The first
        call's tick is `now_us`."""
        due_us = self.next_us or now_us
        if now_us < due_us:
            return None
        left_out = (now_us - due_us) // self._period_us
        self.lateness[bisect_right(LATE_BINS_US, now_us - due_us)] += 1
        self.left_out += left_out
        self.ticks += 1
        tick_us = due_us + left_out * self._period_us
        self.next_us = tick_us + self._period_us
        return tick_us
