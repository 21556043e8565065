"""The node of the bridge: publishers, services and one subscription with rclpy.

Publishers are reliable, as REP 2003 specifies for sensor drivers; subscribers may be reliable or best effort.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rclpy
from geometry_msgs.msg import PoseStamped, Vector3
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from palpate_host.common.command import Command, CommandError, Grasp, Recover, Release, Stop
from palpate_host.common.status import HostStatus
from palpate_host.operator.client import OperatorClient
from palpate_host.ros.commands import move_of, turn_of
from palpate_host.ros.goal_requests import GoalRules
from palpate_host.ros.message_contents import JointContent, MessageContent, TextContent, TransformsContent
from palpate_host.ros.messages import message_of

if TYPE_CHECKING:
    from palpate_host.ros.actions import HandActions

NODE, RESPONSE = "palpate", "response"
STREAM = QoSProfile(depth=10)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For what changes seldom: a late subscriber is sent the last one."""
TRANSFORMS = QoSProfile(depth=100)
"""As tf2_ros publishes them."""

MOTIONS: dict[str, Command] = {"grasp": Grasp(), "release": Release(), "recover": Recover()}


class RosBridge:
    """The ROS node of one hand. Services are handled in a thread of their own."""

    def __init__(
        self,
        control_socket: Path,
        urdf: str,
        silence_s: float,
        namespace: str = "",
        *,
        rules: GoalRules,
        may_move: bool = False,
    ) -> None:
        """Create the node and publish `urdf` as robot_description.

        silence_s: longest time between two joint states; offered as their deadline. rules: of the commands.
        may_move: offer grasp, turn, move, release and recover beside stop, also as actions if palpate_msgs is
        installed. Each command is sent to `control_socket` with the rights of this process.
        """
        self._socket, self._rules = control_socket, rules
        self._joint_quality = QoSProfile(depth=10, deadline=Duration(seconds=silence_s))
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(NODE, context=self._context, namespace=namespace)
        self._publishers: dict[str, Any] = {}
        commands: dict[str, Command] = {"stop": Stop(), **(MOTIONS if may_move else {})}
        for name, command in commands.items():
            self._node.create_service(Trigger, name, self._service(command))
        if may_move:
            self._node.create_subscription(Vector3, "turn", self._turn, 1)
            self._node.create_subscription(PoseStamped, "move", self._move, 1)
        self._actions = self._offered_actions() if may_move else None
        self.publish([TextContent("robot_description", urdf), TextContent(RESPONSE, "")])
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, name="ros", daemon=True)
        self._thread.start()

    @property
    def name(self) -> str:
        """The node's name with its namespace."""
        return str(self._node.get_fully_qualified_name())

    def publish(self, contents: Iterable[MessageContent]) -> None:
        """Send one message for each content."""
        for content in contents:
            message = message_of(content)
            publisher = self._publishers.get(content.topic)
            if publisher is None:
                publisher = self._node.create_publisher(type(message), content.topic, self._quality(content))
                self._publishers[content.topic] = publisher
            publisher.publish(message)

    @property
    def has_actions(self) -> bool:
        """True when grasp, turn, move and release are actions as well."""
        return self._actions is not None

    def of_tick(self, status: HostStatus) -> None:
        """Let the actions take a tick of the host."""
        if self._actions is not None:
            self._actions.of_tick(status)

    def of_silence(self, reason: str, *, is_closed: bool) -> None:
        """Let the actions know that the host is silent; is_closed: its connection has ended."""
        if self._actions is not None:
            self._actions.of_silence(reason, is_closed=is_closed)

    def close(self) -> None:
        """Withdraw the node."""
        self._executor.shutdown()
        self._thread.join()
        if self._actions is not None:
            self._actions.close()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _quality(self, content: MessageContent) -> QoSProfile:
        if isinstance(content, TransformsContent):
            return LATCHED if content.is_static else TRANSFORMS
        if isinstance(content, TextContent):
            return LATCHED
        return self._joint_quality if isinstance(content, JointContent) else STREAM

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def _offered_actions(self) -> HandActions | None:
        try:
            from palpate_host.ros.actions import HandActions  # noqa: PLC0415 (needs palpate_msgs)
        except ImportError:
            return None
        return HandActions(self._node, self._rules, self._ask, self._report_refusal)

    def _service(self, command: Command) -> Callable[[Any, Any], Any]:
        def respond(_request: Any, response: Any) -> Any:
            response.message = self._refusal(lambda: command)
            response.success = not response.message
            return response

        return respond

    def _turn(self, message: Any) -> None:
        self._report("turn", lambda: turn_of((message.x, message.y, message.z)))

    def _move(self, message: Any) -> None:
        place, turn = message.pose.position, message.pose.orientation
        position_m, quaternion = (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)
        self._report(
            "move", lambda: move_of(message.header.frame_id, self._rules.hand_frame, position_m, quaternion)
        )

    def _report(self, topic: str, command: Callable[[], Command]) -> None:
        refusal = self._refusal(command)
        if refusal:
            self._report_refusal(topic, refusal)
        else:
            self.publish([TextContent(RESPONSE, f"{topic}: accepted")])

    def _report_refusal(self, command: str, reason: str) -> None:
        self._node.get_logger().error(reason)
        self.publish([TextContent(RESPONSE, f"{command}: {reason}")])

    def _refusal(self, command: Callable[[], Command]) -> str:
        """Send a command and return the reason when it is refused, else an empty text."""
        try:
            self._ask(command())
        except CommandError as exc:
            return str(exc)
        return ""

    def _ask(self, command: Command) -> HostStatus:
        """Send a command and return the status in the response. Raises CommandError when it is refused."""
        with OperatorClient(self._socket) as client:
            status = client.ask(command)
        if status is None:
            raise CommandError("the host has not ticked yet: try again")
        return status
