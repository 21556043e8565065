"""The bus's time on a board: offset and drift of the own clock against the time that SYNC and 1013h carry.

The producer sends SYNC and after it 1013h with the microsecond (modulo 2^32) at which that SYNC left. Of the
pair (arrival on our clock, time sent) the transport's delay is unknown and never negative, so the true
relation is the line *under* all points of arrival minus sent: the lower convex hull's edge below the points'
mean, which minimises the sum of the delays it leaves (Moon, Skelley, Towsley: Estimation and Removal of
Clock Skew from Network Delay Measurements, INFOCOM 1999). Pure: times in, times out.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

WRAP_US = 1 << 32
WINDOW_US = 30_000_000
BLOCK_US = 500_000  # of each the least delayed sample is kept
MIN_SAMPLES = 10  # before the clock counts as synchronised; until then it may step
DELAYS_AVERAGED = 100
MAX_DRIFT = 200e-6  # two cheap oscillators, one warm
MAX_SLEW = 500e-6  # how fast a correction goes in: 0.5 ms a second
STEP_US = 2_000  # a correction larger than this is a step: slewing would take seconds
EARLY_US = 3_000  # before the line by more than this: the stamp belongs to another SYNC
LATE_US = 5_000
# Nothing arrives before it was sent: a few early ones among the last are the truth, all others were late.
EARLY_AMONG, EARLY_OF = 5, 20
LATE_IN_A_ROW = 40  # not one in time: the bus has a new time
LOST_AFTER_US = 5_000_000
HOLDOVER_DRIFT = 1e-6  # by which an oscillator's rate changes while nobody tells


class ClockState(Enum):
    """FREE: no pair yet, or too few; LOST: none for a while, the last line is followed."""

    FREE = "free"
    SYNCHRONISED = "synchronised"
    LOST = "lost"


@dataclass(frozen=True, slots=True)
class Line:
    """Local minus bus time: `offset_us` at local time `at_us`, growing by `drift`."""

    at_us: int
    offset_us: float
    drift: float

    def offset_at(self, local_us: int) -> float:
        return self.offset_us + self.drift * (local_us - self.at_us)


class BusClock:
    """Local microseconds to the bus's; the identity until a first pair has come.

    What it gives runs steadily: a correction goes in at `MAX_SLEW` at most, and steps only at the start and
    when the bus's own time has jumped.
    """

    def __init__(self) -> None:
        self.steps = 0
        self.rejected = 0
        self._sync_at_us: int | None = None
        self._samples: deque[tuple[int, int]] = deque()  # (local us, local minus bus us), one a block
        self._seen = 0  # since the bus's time last jumped
        self._mean_delay_us = 0.0
        self._line = Line(0, 0.0, 0.0)
        self._correction_us = 0.0  # to go in from _line.at_us on
        self._early: deque[bool] = deque(maxlen=EARLY_OF)
        self._late = 0
        self._last_us: int | None = None
        self._was_synchronised = False

    def sync(self, local_us: int) -> None:
        """A SYNC came at this time."""
        self._sync_at_us = local_us

    def time_stamp(self, stamp_us: int) -> None:
        """1013h came: when the last SYNC left, in bus microseconds modulo 2^32.

        Without a SYNC since the last stamp it says nothing.
        """
        local_us, self._sync_at_us = self._sync_at_us, None
        if local_us is None:
            self.rejected += 1
            return
        expected_us = round(local_us - self._line.offset_at(local_us))
        bus_us = expected_us + (stamp_us - expected_us + WRAP_US // 2) % WRAP_US - WRAP_US // 2
        if self._is_believable(local_us, local_us - bus_us):
            self._add(local_us, local_us - bus_us)

    def to_bus_us(self, local_us: int) -> int:
        """This local time on the bus's clock."""
        return round(local_us - self._line.offset_at(local_us) + self._left_us(local_us))

    def state(self, now_us: int) -> ClockState:
        if not self._was_synchronised:
            return ClockState.FREE
        assert self._last_us is not None
        return ClockState.LOST if now_us - self._last_us > LOST_AFTER_US else ClockState.SYNCHRONISED

    @property
    def drift_ppb(self) -> int:
        """By how much our clock runs fast against the bus's, 1e-9."""
        return round(1e9 * self._line.drift)

    def error_us(self, now_us: int) -> int:
        """How far off `to_bus_us` may be: what delays hide, what is still to be slewed, what holdover adds.

        A constant part of the transport's delay cannot be seen from one end.
        """
        if self._last_us is None:
            return 0
        hidden_us = (
            4 * abs(self._mean_delay_us) / len(self._samples)
        )  # the least of n delays is a n-th of them
        holdover_us = HOLDOVER_DRIFT * max(0, now_us - self._last_us)
        return round(hidden_us + abs(self._left_us(now_us)) + holdover_us)

    def _is_believable(self, local_us: int, offset_us: int) -> bool:
        """Early is another SYNC's stamp, late one that was overtaken; many of one kind are a new time."""
        if not self._samples:
            return True
        beyond_us = offset_us - self._line.offset_at(local_us)
        early, late = beyond_us < -EARLY_US, beyond_us > LATE_US
        self._early.append(early)
        self._late = self._late + 1 if late else 0
        if sum(self._early) >= EARLY_AMONG or self._late >= LATE_IN_A_ROW:
            self._samples.clear()
            self._early.clear()
            self._late = self._seen = 0
            return True
        self.rejected += early or late
        return not (early or late)

    def _add(self, local_us: int, offset_us: int) -> None:
        self._last_us = local_us
        self._seen += 1
        self._keep(local_us, offset_us)
        before_us = local_us - self.to_bus_us(local_us)
        self._line = lower_line(list(self._samples), local_us)
        self._correction_us = self._line.offset_us - before_us
        delay_us = offset_us - self._line.offset_us
        self._mean_delay_us += (delay_us - self._mean_delay_us) / min(self._seen, DELAYS_AVERAGED)
        settling = self._seen < MIN_SAMPLES
        self._was_synchronised = self._was_synchronised or not settling
        if settling or abs(self._correction_us) > STEP_US:
            self.steps += self._was_synchronised and abs(self._correction_us) > STEP_US
            self._correction_us = 0.0

    def _keep(self, local_us: int, offset_us: int) -> None:
        """The least delayed sample of each block, measured from the present line."""
        newest = self._samples[-1] if self._samples else None
        if newest is None or newest[0] // BLOCK_US != local_us // BLOCK_US:
            self._samples.append((local_us, offset_us))
        elif offset_us - self._line.offset_at(local_us) < newest[1] - self._line.offset_at(newest[0]):
            self._samples[-1] = (local_us, offset_us)
        while self._samples[0][0] < local_us - WINDOW_US:
            self._samples.popleft()

    def _left_us(self, local_us: int) -> float:
        """The part of the correction that has not gone in yet."""
        gone_in_us = MAX_SLEW * max(0, local_us - self._line.at_us)
        left_us = max(0.0, abs(self._correction_us) - gone_in_us)
        return math.copysign(left_us, self._correction_us)


def lower_line(samples: list[tuple[int, int]], at_us: int) -> Line:
    """The line under all (local us, offset us) that lies closest below them, its drift held to `MAX_DRIFT`.

    samples: at least one, their local times rising.
    """
    start_us, start_offset_us = samples[0]
    points = [(local - start_us, offset - start_offset_us) for local, offset in samples]
    left, right = _edge_under_the_mean(points)
    drift = (right[1] - left[1]) / (right[0] - left[0]) if right[0] > left[0] else 0.0
    drift = max(-MAX_DRIFT, min(MAX_DRIFT, drift))
    lowest_us = min(offset - drift * local for local, offset in points)
    return Line(at_us, start_offset_us + lowest_us + drift * (at_us - start_us), drift)


def _edge_under_the_mean(points: list[tuple[int, int]]) -> tuple[tuple[int, int], tuple[int, int]]:
    """The edge of the lower convex hull (Andrew's monotone chain) below the mean local time."""
    hull: list[tuple[int, int]] = []
    for x, y in points:
        while len(hull) > 1 and (hull[-1][0] - hull[-2][0]) * (y - hull[-2][1]) <= (x - hull[-2][0]) * (
            hull[-1][1] - hull[-2][1]
        ):
            hull.pop()
        hull.append((x, y))
    mean = sum(x for x, _ in points) / len(points)
    for left, right in pairwise(hull):
        if right[0] >= mean:
            return left, right
    return hull[0], hull[-1]
