"""When the loop's ticks are due: a fixed period from the first call on, what comes too late left out."""

from __future__ import annotations

from bisect import bisect_right

from palpate_host.common.status import LATE_BINS_US


class TickSchedule:
    """next_us: when the next tick is due, 0 before the first; ticks: taken so far; left_out: not taken, as
    the loop was more than a period late; lateness: of the ticks taken, by how much later than due they began
    (LATE_BINS_US)."""

    def __init__(self, period_us: int) -> None:
        self.next_us = self.ticks = self.left_out = 0
        self.lateness = [0] * (len(LATE_BINS_US) + 1)
        self._period_us = period_us

    def take(self, now_us: int) -> int | None:
        """The tick that is due, by its own time, which is at most a period ago; None where none is. The first
        call's is `now_us`."""
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
