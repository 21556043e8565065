"""Clients of the actions of `palpate-host ros`. Needs rclpy and palpate_msgs: make ros-test."""

from __future__ import annotations

from typing import Any

import pytest
from tests.host.ros.conftest import PATIENCE_S, Listener, wait_for

SUCCEEDED, CANCELED, ABORTED, EXECUTING = 4, 5, 6, 2
"""action_msgs/GoalStatus."""


class ActionClients:
    """Clients of the actions. Each goal keeps its feedback; its result is waited for."""

    def __init__(self, listener: Listener, namespace: str = "") -> None:
        from rclpy.action import ActionClient
        from std_msgs.msg import String

        self.types = pytest.importorskip(
            "palpate_msgs.action", reason="palpate_msgs is not built: make ros-test"
        )
        self.clients = {
            name: ActionClient(listener.node, getattr(self.types, name.title()), namespace + name)
            for name in ("grasp", "turn", "move", "reorient", "release")
        }
        self.refusals = listener.latched(String, namespace + "response")
        self.feedback: list[Any] = []

    def send(self, name: str, **fields: Any) -> Any:
        """Return the goal's handle once it is accepted or refused."""
        client = self.clients[name]
        assert client.wait_for_server(PATIENCE_S)
        goal = getattr(self.types, name.title()).Goal(**fields)
        self.feedback.clear()
        sent = client.send_goal_async(goal, lambda message: self.feedback.append(message.feedback))
        wait_for(sent.done, f"a response of {name}")
        return sent.result()

    def result(self, handle: Any) -> Any:
        """Return status and result of an accepted goal."""
        assert handle.accepted
        waiting = handle.get_result_async()
        wait_for(waiting.done, "the result")
        return waiting.result().status, waiting.result().result

    def turn(self, z: float, **fields: float) -> Any:
        from geometry_msgs.msg import Vector3

        return self.send("turn", rpy=Vector3(z=z), **fields)
