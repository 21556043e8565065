"""The action servers of a hand, with stand-ins for rclpy: goals in, commands and results out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import pytest
from tests.host.ros.stand_in_ros import MESSAGES, ActionServer, GoalHandle, StandInNode, stand_in_ros

from palpate_host.common.command import Command, CommandError, Grasp, Move, Release, Reorient, Rotate
from palpate_host.common.mode import Mode
from palpate_host.common.status import Counters, HoldStatus, HostStatus
from palpate_host.ros.goal_requests import GoalRules

TICK_US = 10_000
FAR_DEG, NEAR_DEG = 5.0, 0.5
RPY = MESSAGES["geometry_msgs/Vector3"](x=0.1, y=-0.2, z=math.pi / 4)


def status(tick: int, mode: Mode = Mode.MANIPULATE, error_deg: float | None = NEAR_DEG) -> HostStatus:
    """The status of a tick; the hold is 0.4 mm from its place."""
    hold = HoldStatus((), (), (), (), None, False, place_error_mm=0.4)
    return HostStatus(
        *(tick * TICK_US, mode, "because", "", (), (), None, None, None, None),
        *(error_deg, None, None, "", Counters(), 1.0, (), None, hold),
    )


class ActedHand:
    """The actions of a hand whose host takes commands at tick 0. refusal: of the host, empty: it accepts."""

    def __init__(self) -> None:
        self.node = StandInNode()
        self.module = import_module("palpate_host.ros.actions")
        self.commands: list[Command] = []
        self.refused: list[tuple[str, str]] = []
        self.refusal = ""
        rules = GoalRules("hand", ramp_s=3.0, measured_in=(Mode.MANIPULATE,))
        self.actions = self.module.HandActions(
            self.node, rules, self._ask, lambda *pair: self.refused.append(pair)
        )

    def _ask(self, command: Command) -> HostStatus:
        if self.refusal:
            raise CommandError(self.refusal)
        self.commands.append(command)
        return status(0)

    def server(self, name: str) -> ActionServer:
        return self.node.servers[name]

    def send(self, name: str, **goal: Any) -> GoalHandle:
        handle = self.server(name).send(**goal)
        assert handle is not None
        self.server(name).work()
        return handle

    def ticks(self, first: int, last: int, **what: Any) -> None:
        for number in range(first, last + 1):
            self.actions.of_tick(status(number, **what))
        for server in self.node.servers.values():
            server.work()


@pytest.fixture
def hand() -> Iterator[ActedHand]:
    with stand_in_ros():
        yield ActedHand()


def test_a_turn_succeeds_after_half_a_second_within_the_tolerance(hand: ActedHand) -> None:
    turn = hand.send("turn", rpy=RPY, duration=2.0)
    assert hand.commands == [Rotate(pytest.approx((5.7296, -11.4592, 45.0), abs=1e-4), 2.0)]
    hand.ticks(1, 50)
    assert turn.state == ""
    hand.ticks(51, 51)
    assert turn.state == "succeeded"
    assert (turn.result.reached, turn.result.reason) == (True, "")
    assert turn.result.orientation_error == pytest.approx(math.radians(NEAR_DEG))
    hand.ticks(52, 60, mode=Mode.FAULT)  # the goal has ended
    assert (turn.state, len(hand.commands)) == ("succeeded", 1)


def test_feedback_is_sent_at_most_ten_times_a_second(hand: ActedHand) -> None:
    turn = hand.send("turn", rpy=RPY)
    hand.ticks(1, 40, error_deg=FAR_DEG)
    assert len(turn.feedback) == 4
    last = turn.feedback[-1]
    assert (last.mode, last.reason, last.orientation_error) == (
        "manipulate",
        "because",
        math.radians(FAR_DEG),
    )


def test_an_unknown_error_is_not_a_number(hand: ActedHand) -> None:
    turn = hand.send("turn", rpy=RPY)
    hand.ticks(1, 1, error_deg=None)
    assert math.isnan(turn.feedback[0].orientation_error)


def test_a_move_has_both_errors_and_both_tolerances(hand: ActedHand) -> None:
    """The hold is 0.4 mm from its place: within 1 mm, the default, but not within 0.3 mm."""
    pose = MESSAGES["geometry_msgs/PoseStamped"]()
    pose.header.frame_id = "hand"
    pose.pose.position.z, pose.pose.orientation.x = 0.005, 1.0
    move = hand.send("move", pose=pose, duration=1.0)
    (command,) = hand.commands
    assert isinstance(command, Move)
    assert command.xyz_mm == pytest.approx((0.0, 0.0, 5.0)) and command.ramp_s == 1.0
    assert [abs(angle) for angle in command.rpy_deg] == pytest.approx([180.0, 0.0, 0.0])
    hand.ticks(1, 60)
    assert move.state == "succeeded"
    assert move.result.position_error == pytest.approx(0.0004)
    strict = hand.send("move", pose=pose, duration=1.0, position_tolerance=0.0003)
    hand.ticks(1, 60)
    assert strict.state == ""


def test_a_move_in_another_frame_is_rejected_with_a_reason(hand: ActedHand) -> None:
    pose = MESSAGES["geometry_msgs/PoseStamped"]()
    pose.header.frame_id, pose.pose.orientation.w = "camera", 1.0
    assert hand.server("move").send(pose=pose) is None
    assert hand.refused == [("move", "the frame is camera: a pose of move is in hand")]
    assert hand.commands == []


def test_the_corners_of_a_turn_by_gaiting_are_in_mm(hand: ActedHand) -> None:
    corners = [MESSAGES["geometry_msgs/Point"](x=0.01 * n, y=-0.02, z=0.1) for n in range(4)]
    hand.send("reorient", rpy=RPY, corners=corners)
    (command,) = hand.commands
    assert isinstance(command, Reorient)
    expected = [pytest.approx((10.0 * n, -20.0, 100.0)) for n in range(4)]
    assert list(command.corners_mm) == expected


def test_grasp_and_release_end_in_their_modes(hand: ActedHand) -> None:
    grasp = hand.send("grasp")
    hand.ticks(1, 1, mode=Mode.GRASP)
    assert (grasp.state, grasp.result.grasped) == ("succeeded", True)
    release = hand.send("release")
    hand.ticks(1, 1, mode=Mode.RELEASE)
    assert release.state == ""
    hand.ticks(2, 2, mode=Mode.READY)
    assert (release.state, release.result.released) == ("succeeded", True)
    assert hand.commands == [Grasp(), Release()]


def test_what_the_host_refuses_is_rejected(hand: ActedHand) -> None:
    hand.refusal = "turn is refused: the hand is in ready"
    assert hand.server("turn").send(rpy=RPY) is None
    assert hand.refused == [("turn", hand.refusal)]
    assert hand.server("turn").send(rpy=RPY, timeout=-1.0) is None
    assert "timeout = -1 is not within 0 and 3600" in hand.refused[1][1]


def test_a_fault_aborts_the_goal_with_its_reason(hand: ActedHand) -> None:
    turn = hand.send("turn", rpy=RPY)
    hand.ticks(1, 1, mode=Mode.FAULT)
    assert (turn.state, turn.result.reached, turn.result.reason) == ("aborted", False, "fault: because")
    assert len(hand.commands) == 1  # a stopped hand is not told to hold


def test_a_late_goal_is_aborted_and_the_object_held(hand: ActedHand) -> None:
    turn = hand.send("turn", rpy=RPY, duration=1.0, timeout=2.0)
    hand.ticks(1, 200, error_deg=FAR_DEG)
    assert turn.state == ""
    hand.ticks(201, 201, error_deg=FAR_DEG)
    assert (turn.state, turn.result.reason) == ("aborted", "not within 2 s (manipulate: because)")
    assert isinstance(hand.commands[-1], Grasp) and len(hand.commands) == 2


def test_a_hold_that_the_host_refuses_is_reported(hand: ActedHand) -> None:
    hand.send("turn", rpy=RPY, duration=1.0, timeout=2.0)
    hand.refusal = "no"
    hand.ticks(201, 201, error_deg=FAR_DEG)
    assert hand.refused == [("hold", "no")]


def test_a_later_goal_replaces_the_former(hand: ActedHand) -> None:
    turn = hand.send("turn", rpy=RPY)
    grasp = hand.send("grasp")
    hand.server("turn").work()
    assert (turn.state, turn.result.reason) == ("aborted", "replaced by grasp")
    assert len(hand.commands) == 2  # the later goal's command holds or moves the object
    hand.ticks(1, 1, mode=Mode.GRASP)
    assert grasp.state == "succeeded"


def test_a_goal_that_ends_before_its_handle_is_there_is_concluded_with_it(hand: ActedHand) -> None:
    server = hand.server("turn")
    turn = server.send(lambda: hand.actions.of_tick(status(1, Mode.STOP)), rpy=RPY)
    assert turn is not None
    server.work()
    assert (turn.state, turn.result.reason, turn.feedback) == ("aborted", "stop: because", [])


def test_a_canceled_turn_is_held_where_it_is(hand: ActedHand) -> None:
    turn = hand.send("turn", rpy=RPY)
    assert hand.server("turn").cancel(turn)
    assert isinstance(hand.commands[-1], Grasp)
    hand.ticks(1, 1)
    assert (turn.state, turn.result.reached) == ("canceled", False)
    assert turn.result.reason == "canceled: the object is held where it was"
    assert not hand.server("turn").cancel(turn)  # it has ended


def test_a_grasp_is_not_canceled(hand: ActedHand) -> None:
    grasp = hand.send("grasp")
    assert not hand.server("grasp").cancel(grasp)
    assert hand.refused == [("grasp", "cancel is refused: the object is not held; send release, or stop")]
    hand.ticks(1, 1, mode=Mode.GRASP)
    assert grasp.state == "succeeded"


def test_a_turn_goes_on_when_the_host_refuses_to_hold(hand: ActedHand) -> None:
    turn = hand.send("turn", rpy=RPY)
    hand.refusal = "not now"
    assert not hand.server("turn").cancel(turn)
    assert hand.refused == [("turn", "cancel: not now")]
    hand.ticks(1, 60)
    assert turn.state == "succeeded"


def test_a_closed_stream_ends_a_goal_that_has_had_ticks(hand: ActedHand) -> None:
    turn = hand.send("turn", rpy=RPY)
    hand.actions.of_silence("closed", is_closed=True)
    hand.server("turn").work()
    assert turn.state == ""  # the stream may not have connected yet
    hand.ticks(1, 1, error_deg=FAR_DEG)
    hand.actions.of_silence("quiet", is_closed=False)
    hand.server("turn").work()
    assert turn.state == ""
    hand.actions.of_silence("closed", is_closed=True)
    hand.server("turn").work()
    assert (turn.state, turn.result.reason) == ("aborted", "no host: closed")


def test_two_seconds_without_a_tick_end_a_goal(hand: ActedHand, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(hand.module.time, "monotonic", lambda: now_s[0])
    turn = hand.send("turn", rpy=RPY)
    now_s[0] = 102.0
    hand.actions.of_silence("quiet", is_closed=False)
    hand.server("turn").work()
    assert turn.state == ""
    now_s[0] = 102.1
    hand.actions.of_silence("quiet", is_closed=False)
    hand.server("turn").work()
    assert (turn.state, turn.result.reason) == ("aborted", "no host: quiet")


def test_nothing_happens_without_a_goal_and_close_withdraws_the_actions(hand: ActedHand) -> None:
    hand.ticks(1, 2, mode=Mode.FAULT)
    hand.actions.of_silence("closed", is_closed=True)
    hand.actions.close()
    assert sorted(hand.node.servers) == ["grasp", "move", "release", "reorient", "turn"]
    assert all(server.is_destroyed for server in hand.node.servers.values())
    assert hand.commands == []
