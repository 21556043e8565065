"""Stand-ins for rclpy and its messages: the bridge's own decisions are tested where ROS is not installed.

Messages have the fields of ROS 2's common_interfaces and of ros/palpate_msgs/action, and refuse any other.
Callbacks are called as rclpy does, but by the test. `make ros-test` has the real ones.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import pytest

ACTIONS = Path(__file__).resolve().parents[3] / "ros" / "palpate_msgs" / "action"

DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/Float64": "float64 data",
    "std_msgs/String": "string data",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/PointStamped": "std_msgs/Header header\ngeometry_msgs/Point point",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "diagnostic_msgs/KeyValue": "string key\nstring value",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values"
    ),
    "diagnostic_msgs/DiagnosticArray": ("std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status"),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
}
ZEROS: dict[str, Callable[[], Any]] = {
    "string": str,
    "bool": bool,
    "float64": float,
    "int32": int,
    "uint32": int,
    "byte": lambda: b"\x00",
}
MESSAGES: dict[str, type] = {}


class Message:
    """A message; a keyword or attribute that its definition lacks is an error."""

    __slots__ = ()
    fields: ClassVar[dict[str, str]] = {}

    def __init__(self, **values: Any) -> None:
        unknown = set(values) - set(self.fields)
        if unknown:
            raise AssertionError(f"{type(self).__name__} has no field {unknown}")
        for name, kind in self.fields.items():
            setattr(self, name, values[name] if name in values else _zero(kind))

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        return dict(cls.fields)


def _zero(kind: str) -> Any:
    return [] if kind.endswith("[]") else ZEROS.get(kind, MESSAGES.get(kind, list))()


def message_type(name: str, definition: str) -> type:
    """Return the class of a message from the text of its .msg file."""
    lines = (line.partition("#")[0].split() for line in definition.splitlines())
    fields = {parts[1]: parts[0] for parts in lines if parts}
    return type(name.partition("/")[2] or name, (Message,), {"__slots__": tuple(fields), "fields": fields})


MESSAGES |= {name: message_type(name, definition) for name, definition in DEFINITIONS.items()}


def action_type(path: Path) -> type:
    """Return an action from its .action file: Goal, Result and Feedback."""
    parts = path.read_text().split("---\n")
    kinds = zip(("Goal", "Result", "Feedback"), parts, strict=True)
    return type(path.stem, (), {kind: message_type(kind, text) for kind, text in kinds})


class GoalHandle:
    """A goal at its server. state: "" until it has ended. feedback: the messages that were published."""

    def __init__(self, server: ActionServer) -> None:
        self._server = server
        self.is_cancel_requested = False
        self.state = ""
        self.result: Any = None
        self.feedback: list[Any] = []

    def execute(self) -> None:
        self._server.notify_execute(self, None)

    def publish_feedback(self, message: Any) -> None:
        assert isinstance(message, self._server.action_type.Feedback)
        self.feedback.append(message)

    def succeed(self) -> None:
        self.state = "succeeded"

    def abort(self) -> None:
        self.state = "aborted"

    def canceled(self) -> None:
        self.state = "canceled"


class ActionServer:
    """rclpy.action.ActionServer; `send` and `cancel` are a client's, `work` runs what was scheduled."""

    def __init__(
        self,
        node: Any,
        kind: Any,
        name: str,
        execute: Any,
        *,
        goal_callback: Any,
        handle_accepted_callback: Any,
        cancel_callback: Any,
    ) -> None:
        self.action_type, self._execute = kind, execute
        self._begin, self._accepted, self._cancel = goal_callback, handle_accepted_callback, cancel_callback
        self._tasks: list[tuple[GoalHandle, Any]] = []
        self.is_destroyed = False
        node.servers[name] = self

    def notify_execute(self, handle: GoalHandle, callback: Any) -> None:
        self._tasks.append((handle, callback))

    def send(self, between: Callable[[], None] = lambda: None, **goal: Any) -> GoalHandle | None:
        """Send a goal, and return its handle; None for one that is rejected. between: runs before the
        handle is there."""
        if not _is_accepted(self._begin(self.action_type.Goal(**goal))):
            return None
        between()
        handle = GoalHandle(self)
        self._accepted(handle)
        return handle

    def cancel(self, handle: GoalHandle) -> bool:
        """Request to cancel a goal; return whether the server agrees."""
        handle.is_cancel_requested = _is_accepted(self._cancel(handle))
        return handle.is_cancel_requested

    def work(self) -> None:
        while self._tasks:
            handle, callback = self._tasks.pop(0)
            handle.result = (callback or self._execute)(handle)
            assert isinstance(handle.result, self.action_type.Result)

    def destroy(self) -> None:
        self.is_destroyed = True


def _is_accepted(answer: str) -> bool:
    assert answer in ("accept", "reject")
    return answer == "accept"


class StandInNode:
    """A node that keeps what it was asked for. published: topic -> (type, quality, messages)."""

    def __init__(self, name: str = "palpate", *, namespace: str = "", **_context: Any) -> None:
        self._name = f"{namespace}/{name}"
        self.servers: dict[str, ActionServer] = {}
        self.services: dict[str, Any] = {}
        self.subscriptions: dict[str, tuple[type, Any]] = {}
        self.published: dict[str, tuple[type, Any, list[Any]]] = {}
        self.errors: list[str] = []
        self.is_destroyed = False

    def get_fully_qualified_name(self) -> str:
        return self._name

    def create_service(self, _kind: Any, name: str, callback: Any) -> None:
        self.services[name] = callback

    def create_subscription(self, kind: type, topic: str, callback: Any, _depth: int) -> None:
        self.subscriptions[topic] = kind, callback

    def create_publisher(self, kind: type, topic: str, quality: Any) -> Any:
        assert topic not in self.published
        messages: list[Any] = []
        self.published[topic] = kind, quality, messages
        return SimpleNamespace(publish=messages.append)

    def get_logger(self) -> Any:
        return SimpleNamespace(error=self.errors.append)

    def destroy_node(self) -> None:
        self.is_destroyed = True


class Executor:
    """rclpy.executors.SingleThreadedExecutor without work: `spin` waits for the shutdown."""

    def __init__(self, **_context: Any) -> None:
        self._ended = threading.Event()

    def add_node(self, _node: Any) -> None: ...

    def spin(self) -> None:
        self._ended.wait()

    def shutdown(self) -> None:
        self._ended.set()


NEEDS_ROS = ("palpate_host.ros.actions", "palpate_host.ros.bridge", "palpate_host.ros.messages")


@contextmanager
def stand_in_ros(*, has_actions: bool = True) -> Iterator[list[StandInNode]]:
    """Import the modules that need ROS with the stand-ins. Yield the nodes that are created.

    has_actions: whether palpate_msgs is installed.
    """
    nodes: list[StandInNode] = []

    def create_node(*arguments: Any, **options: Any) -> StandInNode:
        nodes.append(StandInNode(*arguments, **options))
        return nodes[-1]

    response = SimpleNamespace(ACCEPT="accept", REJECT="reject")
    context = type("Context", (), {"try_shutdown": lambda _self: None})
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {"Context": context, "init": lambda **_options: None, "create_node": create_node},
        "rclpy.action": {"ActionServer": ActionServer, "CancelResponse": response, "GoalResponse": response},
        "rclpy.duration": {"Duration": lambda seconds: seconds},
        "rclpy.executors": {"ExternalShutdownException": KeyError, "SingleThreadedExecutor": Executor},
        "rclpy.qos": {
            "DurabilityPolicy": SimpleNamespace(TRANSIENT_LOCAL="transient local"),
            "QoSProfile": lambda **values: values,
        },
        "rclpy.signals": {"SignalHandlerOptions": SimpleNamespace(NO="no")},
        "std_srvs": {},
        "std_srvs.srv": {"Trigger": object},
    }
    for name, kind in MESSAGES.items():
        package, _, short = name.partition("/")
        modules.setdefault(package, {})
        modules.setdefault(f"{package}.msg", {})[short] = kind
    if has_actions:
        actions = {path.stem: action_type(path) for path in ACTIONS.glob("*.action")}
        modules["palpate_msgs"] = {"action": SimpleNamespace(**actions)}
    with pytest.MonkeyPatch.context() as patch:
        for name in NEEDS_ROS:
            patch.delitem(sys.modules, name, raising=False)
        if not has_actions:
            patch.setitem(sys.modules, "palpate_msgs", None)
        for name, values in modules.items():
            module = ModuleType(name)
            module.__dict__.update(values)
            patch.setitem(sys.modules, name, module)
        try:
            yield nodes
        finally:
            for name in NEEDS_ROS:
                sys.modules.pop(name, None)
