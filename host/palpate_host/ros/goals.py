"""Progress of the goals of actions: the host's status tick by tick, then an outcome. Pure.

A goal is one command of the host. It ends when its condition is met, when it cannot be met any more (fault,
stop, hold, another command), or when its time is over.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Protocol

from palpate_host.common.command import Command, Reorient
from palpate_host.common.mode import STOPPED, Mode
from palpate_host.common.status import HostStatus
from palpate_host.common.tick_inputs import HostEvent, Planned, TickInputs

SETTLED_US = 500_000
"""A target is reached when its errors have been small for this time."""

TURNING = (Mode.MANIPULATE, Mode.BLIND)
HOLDING = (Mode.GRASP, Mode.HOLD)


@dataclass(frozen=True, slots=True)
class GoalOutcome:
    """The end of a goal. reason: why it is not reached, else empty. must_hold: the object is still to be
    held where it is, so that a goal that has ended turns it no further."""

    reached: bool
    reason: str = ""
    must_hold: bool = False


class Judge(Protocol):
    """The condition of one kind of goal. turns_object: while the goal is open, the host turns the object."""

    turns_object: bool

    def judge(self, status: HostStatus) -> GoalOutcome | None:
        """Return the outcome after this tick, None while it is open."""
        ...


class ReachTarget:
    """The condition of turn and move: the errors have stayed within their limits after the ramp's end."""

    turns_object = True

    def __init__(
        self, tolerance_deg: float, place_tolerance_mm: float, measured_in: Collection[Mode] = TURNING
    ) -> None:
        """place_tolerance_mm: infinite for a turn. measured_in: modes whose errors count."""
        self._tolerance_deg, self._place_tolerance_mm = tolerance_deg, place_tolerance_mm
        self._measured_in = measured_in
        self._was_turning = False
        self._within_since_us: int | None = None

    def judge(self, status: HostStatus) -> GoalOutcome | None:
        """Return an outcome when the target is reached, or the hand has ceased to turn."""
        mode = status.mode
        if mode in HOLDING:
            self._within_since_us = None
            is_open = mode is Mode.GRASP or not self._was_turning
            return None if is_open else GoalOutcome(False, reason_of(status), must_hold=True)
        if mode not in TURNING:
            return GoalOutcome(False, reason_of(status))
        self._was_turning = True
        if mode not in self._measured_in or not self._is_within(status):
            self._within_since_us = None
            return None
        if self._within_since_us is None:
            self._within_since_us = status.time_us
        return GoalOutcome(True) if status.time_us - self._within_since_us >= SETTLED_US else None

    def _is_within(self, status: HostStatus) -> bool:
        if (status.turned or 0.0) < 1.0 or status.orientation_error_deg is None:
            return False
        if status.orientation_error_deg > self._tolerance_deg:
            return False
        if math.isinf(self._place_tolerance_mm):
            return True
        place_error_mm = None if status.hold is None else status.hold.place_error_mm
        return place_error_mm is not None and place_error_mm <= self._place_tolerance_mm


class CompleteGait:
    """The condition of reorient: the turn by finger gaiting is done.

    A turn that is refused or stopped leaves the object held as it is, perhaps with a lifted finger.
    """

    turns_object = True

    def judge(self, status: HostStatus) -> GoalOutcome | None:
        """Return an outcome when the turn is done, refused or stopped, or the object is held no more."""
        if status.mode not in TURNING + HOLDING:
            return GoalOutcome(False, reason_of(status))
        hold = status.hold
        if hold is None or hold.gait not in ("done", "stopped", "refused"):
            return None
        return GoalOutcome(True) if hold.gait == "done" else GoalOutcome(False, hold.gait_reason)


class TouchObject:
    """The condition of grasp: every finger in contact."""

    turns_object = False

    def judge(self, status: HostStatus) -> GoalOutcome | None:
        """Return an outcome when every finger is in contact."""
        is_held = status.mode is Mode.GRASP and all(finger.in_contact for finger in status.fingers)
        return GoalOutcome(True) if is_held else None


class OpenHand:
    """The condition of release: the hand is ready again."""

    turns_object = False

    def judge(self, status: HostStatus) -> GoalOutcome | None:
        """Return an outcome when the hand is open."""
        return GoalOutcome(True) if status.mode is Mode.READY else None


class GoalProgress:
    """One goal, from the tick after the host has accepted its command."""

    def __init__(self, command: Command, accepted: HostStatus, judge: Judge, timeout_s: float) -> None:
        """accepted: the status in the host's response to the command."""
        self._command, self._judge = command, judge
        self._accepted_us, self._timeout_us = accepted.time_us, 1e6 * timeout_s
        self._timeout_s = timeout_s
        self._events: int | None = None
        self._awaits_plan = isinstance(command, Reorient)

    def is_after(self, status: HostStatus) -> bool:
        """Return whether the tick is one before the command; a slow reader takes it later."""
        return status.time_us <= self._accepted_us

    def of_tick(self, status: HostStatus) -> GoalOutcome | None:
        """Return the outcome after this tick, None while the goal is open."""
        if self.is_after(status):
            return None
        if status.mode in STOPPED:
            return GoalOutcome(False, reason_of(status))
        replaced_by = "" if status.inputs is None else self._replaced_by(status.inputs)
        if replaced_by:
            return GoalOutcome(False, f"replaced by {replaced_by}")
        outcome = self._judge.judge(status)
        if outcome is None and status.time_us - self._accepted_us > self._timeout_us:
            late = f"not within {self._timeout_s:g} s ({reason_of(status)})"
            return GoalOutcome(False, late, must_hold=self._judge.turns_object)
        return outcome

    def _replaced_by(self, inputs: TickInputs) -> str:
        """Return the name of a later command than this goal's, empty when there is none.

        The stream of ticks may have gaps, so the number of events counts as well. The plan of a turn by
        finger gaiting is an event too, once, and replaces nothing.
        """
        events: list[HostEvent] = [one.event for one in inputs.events]
        missed = 0 if self._events is None else inputs.event_count - self._events - len(events)
        if self._events is None:  # the tick that had the command, or a later one when that was missed
            is_here = self._command in events
            events = events[events.index(self._command) + 1 :] if is_here else []
        self._events = inputs.event_count
        later = [event for event in events if not isinstance(event, Planned)]
        is_planned = len(later) < len(events)
        if missed and self._awaits_plan and not is_planned:
            missed, is_planned = missed - 1, True
        self._awaits_plan = self._awaits_plan and not is_planned
        if later:
            return type(later[0]).__name__.lower()
        return "another command" if missed else ""


def reason_of(status: HostStatus) -> str:
    """Return the mode with the host's reason for it."""
    return f"{status.mode.value}: {status.reason}"


def values_of(status: HostStatus) -> dict[str, str | float | int]:
    """Return the values for feedback and result, by the names of the fields of palpate_msgs; rad and m."""
    error_deg, hold = status.orientation_error_deg, status.hold
    place_error_mm = None if hold is None else hold.place_error_mm
    return {
        "mode": status.mode.value,
        "reason": status.reason,
        "orientation_error": math.nan if error_deg is None else math.radians(error_deg),
        "position_error": math.nan if place_error_mm is None else 1e-3 * place_error_mm,
        "turned": status.turned or 0.0,
        "fingers_in_contact": sum(finger.in_contact for finger in status.fingers),
    }
