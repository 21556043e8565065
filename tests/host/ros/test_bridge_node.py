"""The bridge's node with stand-ins for rclpy, and the messages: fields, units and qualities of service."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.host.ros.stand_in_ros import MESSAGES, StandInNode, stand_in_ros

from palpate_host.common.command import Command, CommandError, Grasp, Move, Recover, Release, Rotate, Stop
from palpate_host.common.mode import Mode
from palpate_host.common.status import Counters, HostStatus
from palpate_host.operator.server import OperatorSocket
from palpate_host.ros.goal_requests import GoalRules
from palpate_host.ros.message_contents import (
    WARN,
    DiagnosisContent,
    JointContent,
    MessageContent,
    NumberContent,
    PartDiagnosis,
    PictureContent,
    PointContent,
    PoseContent,
    TextContent,
    Transform,
    TransformsContent,
    WrenchContent,
)

AT_US = 1_700_000_000_123_456
READY = HostStatus(
    *(AT_US, Mode.READY, "because", "", (), (), None, None, None, None),
    *(None, None, None, "", Counters(), None, (), None, None),
)
TRANSFORM = Transform(AT_US, "hand", "tip", (0.1, 0.2, 0.3), (0.1, 0.7, -0.1, 0.7))
LATCHED = {"depth": 1, "durability": "transient local"}


@pytest.fixture(scope="module")
def message_of() -> Iterator[Callable[[MessageContent], Any]]:
    with stand_in_ros():
        yield import_module("palpate_host.ros.messages").message_of


def values(message: Any) -> Any:
    """Return a message as plain values, without its header."""
    if hasattr(message, "fields"):
        return {name: values(getattr(message, name)) for name in message.fields if name != "header"}
    return [values(one) for one in message] if isinstance(message, list | tuple) else message


def xyz(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


@pytest.mark.parametrize(
    ("content", "kind", "frame", "expected"),
    [
        (
            JointContent("t", AT_US, ("a", "b"), (1.0, 2.0), (3.0, 4.0), (5.0, 6.0)),
            "sensor_msgs/JointState",
            "",
            {
                "name": ["a", "b"],
                "position": [1.0, 2.0],
                "velocity": [3.0, 4.0],
                "effort": [5.0, 6.0],
            },
        ),
        (
            WrenchContent("t", AT_US, "tip", (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)),
            "geometry_msgs/WrenchStamped",
            "tip",
            {"wrench": {"force": xyz(1.0, 2.0, 3.0), "torque": xyz(4.0, 5.0, 6.0)}},
        ),
        (
            PointContent("t", AT_US, "tip", (1.0, 2.0, 3.0)),
            "geometry_msgs/PointStamped",
            "tip",
            {"point": xyz(1.0, 2.0, 3.0)},
        ),
        (
            PoseContent("t", AT_US, "hand", (1.0, 2.0, 3.0), (0.1, 0.2, 0.3, 0.9)),
            "geometry_msgs/PoseStamped",
            "hand",
            {"pose": {"position": xyz(1.0, 2.0, 3.0), "orientation": {**xyz(0.1, 0.2, 0.3), "w": 0.9}}},
        ),
        (
            PictureContent("t", AT_US, "camera", b"\xff\xd8"),
            "sensor_msgs/CompressedImage",
            "camera",
            {"format": "jpeg", "data": b"\xff\xd8"},
        ),
        (NumberContent("t", 0.5), "std_msgs/Float64", None, {"data": 0.5}),
        (TextContent("t", "hold"), "std_msgs/String", None, {"data": "hold"}),
        (
            DiagnosisContent("t", AT_US, (PartDiagnosis("bus", WARN, "loaded", {"load": "80 %"}),)),
            "diagnostic_msgs/DiagnosticArray",
            "",
            {
                "status": [
                    {
                        "level": b"\x01",
                        "name": "bus",
                        "message": "loaded",
                        "hardware_id": "",
                        "values": [{"key": "load", "value": "80 %"}],
                    }
                ]
            },
        ),
        (
            TransformsContent("t", (TRANSFORM,)),
            "tf2_msgs/TFMessage",
            None,
            {
                "transforms": [
                    {
                        "child_frame_id": "tip",
                        "transform": {
                            "translation": xyz(0.1, 0.2, 0.3),
                            "rotation": {**xyz(0.1, 0.7, -0.1), "w": 0.7},
                        },
                    }
                ]
            },
        ),
    ],
    ids=lambda one: type(one).__name__ if hasattr(one, "topic") else "",
)
def test_the_message_of_each_content(
    message_of, content: MessageContent, kind: str, frame: str | None, expected: dict[str, Any]
) -> None:
    """Fields as in ROS 2's common_interfaces; a stamp is whole seconds and the rest in ns."""
    message = message_of(content)
    assert type(message) is MESSAGES[kind]
    assert values(message) == expected
    header = message.header if hasattr(message, "header") else None
    if isinstance(content, TransformsContent):
        header, frame = message.transforms[0].header, "hand"
    if frame is not None:
        stamp = header.stamp
        assert (stamp.sec, stamp.nanosec, header.frame_id) == (1_700_000_000, 123_456_000, frame)


def test_anything_else_is_no_message(message_of) -> None:
    with pytest.raises(TypeError, match="no message for 3"):
        message_of(3)


class BridgedHand:
    """A bridge, its node, and the host behind the control socket, which serves in a thread.

    refusal: of the host, empty: it accepts. status: in its responses.
    """

    def __init__(self, path: Path, bridge: Any, node: StandInNode) -> None:
        self.bridge, self.node = bridge, node
        self.commands: list[Command] = []
        self.refusal = ""
        self.status: HostStatus | None = READY
        self._socket, self._ended = OperatorSocket(path), threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def call(self, service: str) -> tuple[bool, str]:
        response = self.node.services[service](None, SimpleNamespace(success=None, message=None))
        return response.success, response.message

    def hear(self, topic: str, message: Any) -> str:
        """Publish a message to the node; return its response."""
        kind, callback = self.node.subscriptions[topic]
        assert type(message) is kind
        callback(message)
        return str(self.node.published["response"][2][-1].data)

    def close(self) -> None:
        self.bridge.close()
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def _serve(self) -> None:
        while not self._ended.wait(0.002):
            self._socket.serve(self._execute, self.status)

    def _execute(self, command: Command) -> None:
        if self.refusal:
            raise CommandError(self.refusal)
        self.commands.append(command)


@contextmanager
def bridged(tmp_path: Path, *, has_actions: bool = True, **options: Any) -> Iterator[BridgedHand]:
    rules = GoalRules("hand", ramp_s=3.0, measured_in=(Mode.MANIPULATE,))
    with stand_in_ros(has_actions=has_actions) as nodes:
        module = import_module("palpate_host.ros.bridge")
        path = tmp_path / "host.sock"
        bridge = module.RosBridge(path, "<robot/>", 0.2, rules=rules, **options)
        hand = BridgedHand(path, bridge, nodes[0])
        try:
            yield hand
        finally:
            hand.close()


def test_a_bridge_that_may_not_move_offers_stop_alone(tmp_path: Path) -> None:
    with bridged(tmp_path, namespace="/left") as hand:
        assert hand.bridge.name == "/left/palpate"
        assert set(hand.node.services) == {"stop"}
        assert not hand.node.subscriptions and not hand.node.servers and not hand.bridge.has_actions
        hand.bridge.of_tick(READY)  # without actions: no effect
        hand.bridge.of_silence("closed", is_closed=True)
        assert hand.call("stop") == (True, "")
        assert hand.commands == [Stop()]
    assert hand.node.is_destroyed


def test_the_services_send_their_commands_and_return_the_hosts_refusal(tmp_path: Path) -> None:
    with bridged(tmp_path, may_move=True) as hand:
        for name in ("grasp", "release", "recover"):
            assert hand.call(name) == (True, "")
        assert hand.commands == [Grasp(), Release(), Recover()]
        hand.refusal = "grasp is refused: the hand is in fault"
        assert hand.call("grasp") == (False, hand.refusal)
        hand.refusal, hand.status = "", None
        assert hand.call("stop") == (False, "the host has not ticked yet: try again")


def test_topics_turn_and_move_the_object(tmp_path: Path) -> None:
    with bridged(tmp_path, may_move=True) as hand:
        turn = MESSAGES["geometry_msgs/Vector3"](x=0.1, y=0.0, z=-0.2)
        assert hand.hear("turn", turn) == "turn: accepted"
        pose = MESSAGES["geometry_msgs/PoseStamped"]()
        pose.pose.position.x, pose.pose.orientation.w = 0.002, 1.0
        assert hand.hear("move", pose) == "move: accepted"
        assert hand.commands == [
            Rotate(pytest.approx((5.72958, 0.0, -11.45916), abs=1e-4)),
            Move(pytest.approx((2.0, 0.0, 0.0)), pytest.approx((0.0, 0.0, 0.0))),
        ]
        pose.header.frame_id = "camera"
        refusal = "the frame is camera: a pose of move is in hand"
        assert hand.hear("move", pose) == f"move: {refusal}"
        assert hand.node.errors == [refusal]
        assert len(hand.commands) == 2


def test_actions_are_offered_if_palpate_msgs_is_installed(tmp_path: Path) -> None:
    with bridged(tmp_path, may_move=True) as hand:
        assert hand.bridge.has_actions
        grasp = hand.node.servers["grasp"].send()
        assert hand.commands == [Grasp()] and grasp is not None
        hand.bridge.of_silence("closed", is_closed=True)
        hand.bridge.of_tick(READY)  # at the time of the command: not yet counted
        hand.node.servers["grasp"].work()
        assert grasp.state == ""
    assert all(server.is_destroyed for server in hand.node.servers.values())


def test_without_palpate_msgs_there_are_no_actions(tmp_path: Path) -> None:
    with bridged(tmp_path, has_actions=False, may_move=True) as hand:
        assert not hand.bridge.has_actions and set(hand.node.subscriptions) == {"turn", "move"}


def test_what_changes_seldom_is_kept_for_late_subscribers(tmp_path: Path) -> None:
    joints = JointContent("joint_states", AT_US, (), (), (), ())
    with bridged(tmp_path) as hand:
        hand.bridge.publish(
            [
                joints,
                joints,
                TransformsContent("tf", (TRANSFORM,)),
                TransformsContent("tf_static", (TRANSFORM,), is_static=True),
                NumberContent("turned", 0.5),
            ]
        )
        published = hand.node.published
        assert published["robot_description"][2][0].data == "<robot/>"
        assert len(published["joint_states"][2]) == 2  # one publisher for both
        assert {topic: quality for topic, (_, quality, _) in published.items()} == {
            "robot_description": LATCHED,
            "response": LATCHED,
            "tf_static": LATCHED,
            "tf": {"depth": 100},
            "joint_states": {"depth": 10, "deadline": 0.2},
            "turned": {"depth": 10},
        }
