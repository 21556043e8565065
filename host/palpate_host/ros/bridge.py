"""The node of the bridge: publishers, services and one subscription with rclpy.

Publishers are reliable, as REP 2003 specifies for sensor drivers; subscribers may be reliable or best effort.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from math import degrees
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import Vector3
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from palpate_host.common.command import Command, CommandError, Grasp, Recover, Release, Rotate, Stop
from palpate_host.operator.client import OperatorClient
from palpate_host.ros.contents import JointContent, MessageContent, TextContent
from palpate_host.ros.messages import message_of

NODE = "palpate"
STREAM = QoSProfile(depth=10)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For texts that change seldom: a late subscriber is sent the last one."""

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
        may_move: bool = False,
    ) -> None:
        """Create the node and publish `urdf` as robot_description.

        silence_s: longest time between two joint states; offered as their deadline. may_move: offer grasp,
        turn, release and recover beside stop. Each command is sent to `control_socket` with the rights of
        this process.
        """
        self._socket = control_socket
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
        self.publish([TextContent("robot_description", urdf)])
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

    def close(self) -> None:
        """Withdraw the node."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _quality(self, content: MessageContent) -> QoSProfile:
        if isinstance(content, TextContent):
            return LATCHED
        return self._joint_quality if isinstance(content, JointContent) else STREAM

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def _service(self, command: Command) -> Callable[[Any, Any], Any]:
        def respond(_request: Any, response: Any) -> Any:
            response.message = self._refusal(command)
            response.success = not response.message
            return response

        return respond

    def _turn(self, message: Any) -> None:
        refusal = self._refusal(Rotate((degrees(message.x), degrees(message.y), degrees(message.z))))
        if refusal:
            self._node.get_logger().error(refusal)

    def _refusal(self, command: Command) -> str:
        """Send a command and return the host's reason when it refuses, else an empty text."""
        try:
            with OperatorClient(self._socket) as client:
                client.ask(command)
        except CommandError as exc:
            return str(exc)
        return ""
