"""The action servers of one hand, with rclpy and palpate_msgs: grasp, turn, move, reorient and release.

One goal is open at a time, as the host has one command at a time: a later goal replaces it. Requests are
handled in the node's thread, ticks in the thread that reads them.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from palpate_msgs import action as types
from rclpy.action import ActionServer, CancelResponse, GoalResponse

from palpate_host.common.command import Command, CommandError, Grasp
from palpate_host.common.status import HostStatus
from palpate_host.ros.goal_requests import GoalRequest, GoalRules
from palpate_host.ros.goals import GoalOutcome, GoalProgress, values_of

FEEDBACK_US = 100_000
"""Time between two messages of feedback."""
LOST_S = 2.0
"""A goal ends after this time without a tick of the host."""
CANCELED = GoalOutcome(False, "canceled: the object is held where it was")
SUCCESS = {
    types.Grasp: "grasped",
    types.Turn: "reached",
    types.Move: "reached",
    types.Reorient: "reached",
    types.Release: "released",
}
"""The field of each result that is true at success."""

Ask = Callable[[Command], HostStatus]
Refuse = Callable[[str, str], None]


class GoalServer(ActionServer):
    """An action server whose goals run without a task of the executor.

    rclpy's executor polls a task that waits, without pause. So `execute` only marks the goal as executing,
    and a callback is scheduled once the outcome is known.
    """

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Schedule `execute_callback`; None: nothing yet."""
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)


@dataclass(slots=True)
class OpenGoal:
    """The goal that the host pursues.

    alive_s: monotonic time of its last tick, or of the host's response. handle: None until rclpy has made it.
    """

    server: GoalServer
    request: GoalRequest
    progress: GoalProgress
    values: Mapping[str, Any]
    alive_s: float
    has_ticked: bool = False
    handle: Any = None
    outcome: GoalOutcome | None = None
    is_canceling: bool = False
    next_feedback_us: int = 0


class HandActions:
    """The actions of one hand."""

    def __init__(self, node: Any, rules: GoalRules, ask: Ask, refuse: Refuse) -> None:
        """Offer the actions under `node`.

        ask: sends a command to the host, raises CommandError when it is refused. refuse: publishes a reason
        for an action's name, since a refused goal has no text.
        """
        self._rules, self._ask, self._refuse = rules, ask, refuse
        self._lock = threading.Lock()
        self._open: OpenGoal | None = None
        self._servers = {
            name: GoalServer(
                node,
                kind,
                name,
                _not_yet,
                goal_callback=partial(self._begin, name, request_of),
                handle_accepted_callback=self._accepted,
                cancel_callback=partial(self._cancel, name),
            )
            for name, kind, request_of in (
                ("grasp", types.Grasp, self._grasp),
                ("turn", types.Turn, self._turn),
                ("move", types.Move, self._move),
                ("reorient", types.Reorient, self._reorient),
                ("release", types.Release, self._release),
            )
        }

    def of_tick(self, status: HostStatus) -> None:
        """Send feedback, and end the open goal when this tick decides it."""
        with self._lock:
            goal = self._open
            if goal is None or goal.outcome is not None or goal.is_canceling:
                return
            if goal.progress.is_after(status):
                return
            goal.alive_s, goal.has_ticked = time.monotonic(), True
            outcome = goal.progress.of_tick(status)
            goal.values = values_of(status)
            if goal.handle is not None and status.time_us >= goal.next_feedback_us:
                goal.next_feedback_us = status.time_us + FEEDBACK_US
                goal.handle.publish_feedback(_filled(goal.server.action_type.Feedback, goal.values))
            if outcome is not None:
                self._end(goal, outcome)

    def of_silence(self, reason: str, *, is_closed: bool) -> None:
        """End the open goal if no host is there to pursue it.

        is_closed: the stream of ticks has no connection. That ends a goal which has had ticks at once. A goal
        that a host has just accepted waits for its first tick: the stream may not have connected yet.
        """
        with self._lock:
            goal = self._open
            if goal is None or goal.outcome is not None or goal.is_canceling:
                return
            if (is_closed and goal.has_ticked) or time.monotonic() - goal.alive_s > LOST_S:
                self._end(goal, GoalOutcome(False, f"no host: {reason}"))

    def close(self) -> None:
        """Withdraw the actions, before the node."""
        for server in self._servers.values():
            server.destroy()

    def _end(self, goal: OpenGoal, outcome: GoalOutcome) -> None:
        """Keep the outcome and schedule the result; the lock is held."""
        goal.outcome = outcome
        if goal.handle is not None:
            goal.server.notify_execute(goal.handle, partial(self._conclude, goal))

    def _conclude(self, goal: OpenGoal, handle: Any) -> Any:
        """Return the result, in the node's thread."""
        with self._lock:
            outcome, is_open = goal.outcome, self._open is goal
            if is_open:
                self._open = None
        assert outcome is not None
        if is_open and outcome.must_hold:
            self._hold()
        if handle.is_cancel_requested:
            handle.canceled()
        elif outcome.reached:
            handle.succeed()
        else:
            handle.abort()
        values = {**goal.values, "reason": outcome.reason, SUCCESS[goal.server.action_type]: outcome.reached}
        return _filled(goal.server.action_type.Result, values)

    def _hold(self) -> None:
        try:
            self._ask(Grasp())
        except CommandError as exc:
            self._refuse("hold", str(exc))

    def _begin(self, name: str, request_of: Callable[[Any], GoalRequest], goal: Any) -> Any:
        try:
            request = request_of(goal)
            accepted = self._ask(request.command)
        except CommandError as exc:
            self._refuse(name, str(exc))
            return GoalResponse.REJECT
        progress = GoalProgress(request.command, accepted, request.judge, request.timeout_s)
        begun = OpenGoal(self._servers[name], request, progress, values_of(accepted), time.monotonic())
        with self._lock:
            former, self._open = self._open, begun
            if former is not None and former.outcome is None:
                self._end(former, GoalOutcome(False, f"replaced by {name}"))
        return GoalResponse.ACCEPT

    def _accepted(self, handle: Any) -> None:
        handle.execute()
        with self._lock:
            goal = self._open
            assert goal is not None and goal.handle is None  # _begin has just made it, in this thread
            goal.handle = handle
            if goal.outcome is not None:
                self._end(goal, goal.outcome)

    def _cancel(self, name: str, handle: Any) -> Any:
        """Have the object held where it is; a grasp and a release are not canceled, since nothing is held."""
        with self._lock:
            goal = self._open
            if goal is None or goal.handle is not handle or goal.outcome is not None:
                return CancelResponse.REJECT
            goal.is_canceling = goal.request.may_cancel
        if not goal.is_canceling:
            self._refuse(name, "cancel is refused: the object is not held; send release, or stop")
            return CancelResponse.REJECT
        try:
            self._ask(Grasp())
        except CommandError as exc:
            goal.is_canceling = False
            self._refuse(name, f"cancel: {exc}")
            return CancelResponse.REJECT
        with self._lock:
            self._end(goal, CANCELED)  # its task runs after rclpy has marked the goal as canceling
        return CancelResponse.ACCEPT

    def _grasp(self, goal: Any) -> GoalRequest:
        return self._rules.grasp(goal.timeout)

    def _release(self, goal: Any) -> GoalRequest:
        return self._rules.release(goal.timeout)

    def _turn(self, goal: Any) -> GoalRequest:
        rpy_rad = goal.rpy.x, goal.rpy.y, goal.rpy.z
        return self._rules.turn(rpy_rad, goal.duration, goal.tolerance, goal.timeout)

    def _reorient(self, goal: Any) -> GoalRequest:
        rpy_rad = goal.rpy.x, goal.rpy.y, goal.rpy.z
        return self._rules.reorient(rpy_rad, [(one.x, one.y, one.z) for one in goal.corners], goal.timeout)

    def _move(self, goal: Any) -> GoalRequest:
        place, turn = goal.pose.pose.position, goal.pose.pose.orientation
        return self._rules.move(
            goal.pose.header.frame_id,
            (place.x, place.y, place.z),
            (turn.x, turn.y, turn.z, turn.w),
            goal.duration,
            goal.tolerance,
            goal.position_tolerance,
            goal.timeout,
        )


def _filled(kind: Any, values: Mapping[str, Any]) -> Any:
    """Return a message with the values of its fields."""
    return kind(**{field: values[field] for field in kind.get_fields_and_field_types()})


def _not_yet(_handle: Any) -> None:
    """Stand for the callback that `GoalServer` never schedules by itself."""
    raise AssertionError("a goal has no outcome yet")
