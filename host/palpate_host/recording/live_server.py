"""A Foxglove WebSocket server with the topics of topics.py, and a layout of Foxglove's panels for a hand.

The protocol is Foxglove's over a WebSocket, with the subprotocol foxglove.sdk.v1.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable
from typing import Any

import foxglove
from foxglove.websocket import ChannelView, Client, ServerListener

from palpate_edge.common.errors import ConfigError
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.recording.topics import HAND_FRAME, HandTopics

BACKLOG = 4096
"""Messages that wait for a slow client; beyond them the oldest are dropped."""


class LiveServer:
    """The server; `write` publishes a tick and never waits for a client."""

    def __init__(self, config: HandConfig, hand: HandKinematics, host: str, port: int) -> None:
        """Listen. port: 0 for any free one. Raises ConfigError when the address cannot be used."""
        context = foxglove.Context()
        self._subscriptions = _Subscriptions()
        self._topics = HandTopics(context, hand, [finger.name for finger in config.fingers])
        try:
            self._server = foxglove.start_server(
                name="palpate",
                host=host,
                port=port,
                server_listener=self._subscriptions,
                context=context,
                message_backlog_size=BACKLOG,
            )
        except (RuntimeError, OSError) as exc:
            raise ConfigError(f"{host}:{port} cannot be listened on: give another --port or --host") from exc

    @property
    def port(self) -> int:
        """The port on which the server listens."""
        return self._server.port

    def write(self, status: HostStatus) -> None:
        """Publish one tick. A new subscriber is sent mode and contacts with the next tick."""
        if self._subscriptions.take():
            self._topics.repeat()
        self._topics.write(status)

    def close(self) -> None:
        """Disconnect every client and stop."""
        self._server.stop()


class _Subscriptions(ServerListener):
    def __init__(self) -> None:
        self._has_new = threading.Event()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:  # noqa: ARG002
        self._has_new.set()

    def take(self) -> bool:
        """Return whether a client has subscribed since the last call."""
        if not self._has_new.is_set():
            return False
        self._has_new.clear()
        return True


def layout(config: HandConfig) -> str:
    """Return a layout for this hand as JSON: 3-D scene, forces, orientation error, torques, modes, log."""
    fingers = [finger.name for finger in config.fingers]
    joints = [joint.name for joint in config.joints]
    visible: dict[str, Any] = {f"/tactile/{name}/force": {"visible": True} for name in fingers}
    panels: dict[str, Any] = {
        "3D!hand": {
            "followTf": HAND_FRAME,
            "cameraState": {"distance": 0.6, "phi": 60, "thetaOffset": 45, "perspective": True},
            "scene": {"transforms": {"axisScale": 0.02, "labelSize": 0.01}},
            "topics": {**visible, "/object": {"visible": True, "axisScale": 0.03}},
        },
        "Plot!force": _plot("normal force, N", [f"/tactile/{name}/quantities.fn_N" for name in fingers]),
        "Plot!error": _plot("orientation error, deg", ["/host/status.orientation_error_deg"]),
        "Plot!torque": _plot(
            "commanded torque, N m",
            [f'/joint_commands.joints[:]{{name=="{name}"}}.effort' for name in joints],
        ),
        "StateTransitions!mode": {
            "paths": [{"value": "/host/status.mode", "enabled": True}],
            "isSynced": True,
        },
        "RosOut!log": {"topicToRender": "/diagnostics", "searchTerms": [], "minLogLevel": 1},
    }
    arrangement = _split(
        "row",
        _split("column", "3D!hand", _split("column", "StateTransitions!mode", "RosOut!log", 40), 70),
        _split("column", "Plot!force", _split("column", "Plot!error", "Plot!torque", 50), 33),
        55,
    )
    whole = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": arrangement,
    }
    return json.dumps(whole, indent=2) + "\n"


def _plot(title: str, values: Iterable[str]) -> dict[str, Any]:
    paths = [{"value": value, "enabled": True, "timestampMethod": "receiveTime"} for value in values]
    return {
        "title": title,
        "paths": paths,
        "xAxisVal": "timestamp",
        "isSynced": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "followingViewWidth": 20,
    }


def _split(direction: str, first: object, second: object, percentage: int) -> dict[str, object]:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percentage}
