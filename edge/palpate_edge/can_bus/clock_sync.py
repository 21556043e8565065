"""The bus clock on a board: offset and drift of the local clock against the time that SYNC and 1013h carry.

The producer sends SYNC, then 1013h with the microsecond (modulo 2^32) at which that SYNC was sent. Each pair
gives a point: arrival on the local clock minus time sent. The delay of the transport is unknown and never
negative, so the true relation is the line *below* all points: the edge of the lower convex hull under the
points' mean, which minimises the sum of the delays (Moon, Skelley, Towsley: Estimation and Removal of Clock
Skew from Network Delay Measurements, INFOCOM 1999). Pure: times in, times out.
"""

from __future__ import annotations

import math
from collections import deque
from enum import Enum
from itertools import pairwise

import msgspec

WRAP_US = 1 << 32
WINDOW_US = 30_000_000
BLOCK_US = 500_000  # the least delayed sample of each block is kept
MIN_SAMPLES = 10  # before the clock counts as synchronised; until then it may step
DELAYS_AVERAGED = 100
MAX_DRIFT = 200e-6  # two cheap oscillators, one of them warm
MAX_SLEW = 500e-6  # rate at which a correction is applied: 0.5 ms a second
STEP_US = 2_000  # a larger correction is applied at once: slewing would take seconds
EARLY_US = 3_000  # a sample further below the line has the stamp of another SYNC
LATE_US = 5_000
# Delay is never negative: if 5 of the last 20 samples are early, older ones were delayed; restart the fit.
EARLY_AMONG, EARLY_OF = 5, 20
LATE_IN_A_ROW = 40  # none of them in time: the producer's time has jumped
LOST_AFTER_US = 5_000_000
HOLDOVER_DRIFT = 1e-6  # change of an oscillator's rate while no time stamp comes


class ClockState(Enum):
    """State of the bus clock, in health reports and (as 0, 1, 2) in 2042h:01.

    FREE: never synchronised, times are local. SYNCHRONISED: time stamps come. LOST: it was synchronised, and
    no time stamp came for 5 s; the last offset and drift are extrapolated.
    """

    FREE = "free"
    SYNCHRONISED = "synchronised"
    LOST = "lost"


class Line(msgspec.Struct, frozen=True):
    """Local minus bus time: `offset_us` at local time `at_us`, growing by `drift` (us a us)."""

    at_us: int
    offset_us: float
    drift: float

    def offset_at(self, local_us: int) -> float:
        """Return local minus bus time in us at this local time."""
        return self.offset_us + self.drift * (local_us - self.at_us)


class BusClock:
    """Converts local microseconds to the bus clock; the identity until a first time stamp has come.

    The result runs steadily: corrections are applied at `MAX_SLEW` at most. It steps only at the start and
    when the bus's own time has jumped.

    steps: jumps since the first synchronisation. rejected: time stamps that were not used, since the start.
    """

    def __init__(self) -> None:
        self.steps = 0
        self.rejected = 0
        self._sync_at_us: int | None = None
        self._samples: deque[tuple[int, int]] = deque()  # (local us, local minus bus us), one a block
        self._seen = 0  # since the bus's time last jumped
        self._mean_delay_us = 0.0
        self._line = Line(0, 0.0, 0.0)
        self._correction_us = 0.0  # to be applied from _line.at_us on
        self._early: deque[bool] = deque(maxlen=EARLY_OF)
        self._late = 0
        self._last_us: int | None = None
        self._was_synchronised = False

    def sync(self, local_us: int) -> None:
        """Take note of the arrival of a SYNC."""
        self._sync_at_us = local_us

    def time_stamp(self, stamp_us: int) -> None:
        """Take the time stamp of the last SYNC: 1013h, bus microseconds modulo 2^32.

        A stamp without a SYNC since the last stamp is rejected.
        """
        local_us, self._sync_at_us = self._sync_at_us, None
        if local_us is None:
            self.rejected += 1
            return
        expected_us = round(local_us - self._line.offset_at(local_us))
        bus_us = expected_us + (stamp_us - expected_us + WRAP_US // 2) % WRAP_US - WRAP_US // 2
        if self._is_plausible(local_us, local_us - bus_us):
            self._add(local_us, local_us - bus_us)

    def to_bus_us(self, local_us: int) -> int:
        """Convert a local time to the bus clock."""
        return round(local_us - self._line.offset_at(local_us) + self._not_applied_us(local_us))

    def state(self, now_us: int) -> ClockState:
        """Return the state at this local time."""
        if not self._was_synchronised:
            return ClockState.FREE
        assert self._last_us is not None
        return ClockState.LOST if now_us - self._last_us > LOST_AFTER_US else ClockState.SYNCHRONISED

    @property
    def drift_ppb(self) -> int:
        """The rate of the local clock against the bus's, 1e-9; positive when the local clock runs fast."""
        return round(1e9 * self._line.drift)

    def error_us(self, now_us: int) -> int:
        """Return the uncertainty of `to_bus_us`: hidden by delays, not yet slewed, and added by holdover.

        A constant part of the transport's delay cannot be measured from one end and is not included.
        """
        if self._last_us is None:
            return 0
        # The least of n exponential delays is 1/n of their mean.
        hidden_us = 4 * abs(self._mean_delay_us) / len(self._samples)
        holdover_us = HOLDOVER_DRIFT * max(0, now_us - self._last_us)
        return round(hidden_us + abs(self._not_applied_us(now_us)) + holdover_us)

    def _is_plausible(self, local_us: int, offset_us: int) -> bool:
        """Return whether a sample is used: early ones carry another SYNC's stamp, late ones were delayed;
        many of one kind mean that the bus's time has jumped, and restart the fit."""
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
        """Keep the least delayed sample of each block, measured from the present line."""
        newest = self._samples[-1] if self._samples else None
        if newest is None or newest[0] // BLOCK_US != local_us // BLOCK_US:
            self._samples.append((local_us, offset_us))
        elif offset_us - self._line.offset_at(local_us) < newest[1] - self._line.offset_at(newest[0]):
            self._samples[-1] = (local_us, offset_us)
        while self._samples[0][0] < local_us - WINDOW_US:
            self._samples.popleft()

    def _not_applied_us(self, local_us: int) -> float:
        """Return the part of the correction that has not been applied yet."""
        applied_us = MAX_SLEW * max(0, local_us - self._line.at_us)
        return math.copysign(max(0.0, abs(self._correction_us) - applied_us), self._correction_us)


def lower_line(samples: list[tuple[int, int]], at_us: int) -> Line:
    """Return the line closest below all (local us, offset us), its drift limited to `MAX_DRIFT`.

    samples: at least one, in the order of their local times.
    """
    start_us, start_offset_us = samples[0]
    points = [(local - start_us, offset - start_offset_us) for local, offset in samples]
    left, right = _edge_under_the_mean(points)
    drift = (right[1] - left[1]) / (right[0] - left[0]) if right[0] > left[0] else 0.0
    drift = max(-MAX_DRIFT, min(MAX_DRIFT, drift))
    lowest_us = min(offset - drift * local for local, offset in points)
    return Line(at_us, start_offset_us + lowest_us + drift * (at_us - start_us), drift)


def _edge_under_the_mean(points: list[tuple[int, int]]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the edge of the lower convex hull (Andrew's monotone chain) below the mean local time."""
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
