"""The goals of clients of the actions, with limits checked and defaults filled in. Pure."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from palpate_host.common.command import Command, CommandError, Grasp, Release
from palpate_host.common.mode import Mode
from palpate_host.ros.commands import move_of, reorient_of, turn_of
from palpate_host.ros.goals import CompleteGait, Judge, OpenHand, ReachTarget, TouchObject
from palpate_host.ros.message_contents import Vector

LONGEST_DURATION_S, LONGEST_TIMEOUT_S = 600.0, 3600.0
GRASP_S = RELEASE_S = 10.0
"""Default timeouts."""
REORIENT_S = 300.0
"""Default timeout of a turn by finger gaiting, with its plan."""
SETTLING_S = 15.0
"""Default time that a turn or move may take beyond its duration."""
TOLERANCE_RAD, POSITION_TOLERANCE_M = 0.02, 0.001
"""Default errors within which a target is reached."""


@dataclass(frozen=True, slots=True)
class GoalRequest:
    """One goal. may_cancel: the host can hold the object instead."""

    command: Command
    judge: Judge
    timeout_s: float
    may_cancel: bool = False


@dataclass(frozen=True, slots=True)
class GoalRules:
    """Limits and defaults of the requests to one hand.

    ramp_s: target.ramp_s. measured_in: modes whose errors count.
    """

    hand_frame: str
    ramp_s: float
    measured_in: Collection[Mode]

    def grasp(self, timeout_s: float) -> GoalRequest:
        """Return the request for palpate_msgs/Grasp."""
        return GoalRequest(Grasp(), TouchObject(), _timeout_s(timeout_s, GRASP_S))

    def release(self, timeout_s: float) -> GoalRequest:
        """Return the request for palpate_msgs/Release."""
        return GoalRequest(Release(), OpenHand(), _timeout_s(timeout_s, RELEASE_S))

    def turn(self, rpy_rad: Vector, duration_s: float, tolerance_rad: float, timeout_s: float) -> GoalRequest:
        """Return the request for palpate_msgs/Turn. Raises CommandError for a value out of its range."""
        command = turn_of(rpy_rad, _ramp_s(duration_s))
        tolerance_deg = math.degrees(_or_default("tolerance", tolerance_rad, TOLERANCE_RAD, math.pi))
        judge = ReachTarget(tolerance_deg, math.inf, self.measured_in)
        return GoalRequest(command, judge, self._timeout_s(duration_s, timeout_s), may_cancel=True)

    def reorient(self, rpy_rad: Vector, corners_m: Sequence[Vector], timeout_s: float) -> GoalRequest:
        """Return the request for palpate_msgs/Reorient. Raises CommandError for a timeout out of range."""
        command = reorient_of(rpy_rad, corners_m)
        return GoalRequest(command, CompleteGait(), _timeout_s(timeout_s, REORIENT_S), may_cancel=True)

    def move(
        self,
        frame: str,
        position_m: Vector,
        quaternion: tuple[float, float, float, float],
        duration_s: float,
        tolerance_rad: float,
        position_tolerance_m: float,
        timeout_s: float,
    ) -> GoalRequest:
        """Return the request for palpate_msgs/Move. Raises CommandError as `turn` and `move_of` do."""
        command = move_of(frame, self.hand_frame, position_m, quaternion, _ramp_s(duration_s))
        tolerance_deg = math.degrees(_or_default("tolerance", tolerance_rad, TOLERANCE_RAD, math.pi))
        tolerance_mm = 1e3 * _or_default(
            "position_tolerance", position_tolerance_m, POSITION_TOLERANCE_M, 1.0
        )
        judge = ReachTarget(tolerance_deg, tolerance_mm, self.measured_in)
        return GoalRequest(command, judge, self._timeout_s(duration_s, timeout_s), may_cancel=True)

    def _timeout_s(self, duration_s: float, timeout_s: float) -> float:
        return _timeout_s(timeout_s, (duration_s or self.ramp_s) + SETTLING_S)


def _ramp_s(duration_s: float) -> float | None:
    """Return the ramp's duration, None for 0: that of hand.toml."""
    return _or_default("duration", duration_s, 0.0, LONGEST_DURATION_S) or None


def _timeout_s(timeout_s: float, default_s: float) -> float:
    return _or_default("timeout", timeout_s, default_s, LONGEST_TIMEOUT_S)


def _or_default(name: str, value: float, default: float, most: float) -> float:
    """Return the value, or the default for 0. Raises CommandError when it is not within 0 and `most`."""
    if not 0.0 <= value <= most:
        raise CommandError(f"{name} = {value:g} is not within 0 and {most:g}: 0 takes the default")
    return value or default
