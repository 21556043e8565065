"""``palpate-host ros``: a running hand as a node of ROS 2."""

from __future__ import annotations

import time
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path

import click

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.gc_freeze import long_lived
from palpate_edge.common.signals import stop_event
from palpate_host.cli.run import CONFIG, CONTROL_SOCKET
from palpate_host.common.camera_source import parse_camera
from palpate_host.common.mode import Mode
from palpate_host.config.control_config import ControlMode
from palpate_host.config.hand_config import HandConfig
from palpate_host.operator.server import default_control_socket
from palpate_host.recording.tick_stream import TickStream
from palpate_host.ros.contents import HAND_FRAME, HandContents
from palpate_host.ros.goal_requests import GoalRules
from palpate_host.ros.urdf import urdf_of
from palpate_host.service.host import load_hand, now_us
from palpate_host.service.real_time import request_fifo

SILENCE_S, SILENCE_TICKS = 0.1, 2
"""The host counts as silent after the longer of these times without a tick."""

NO_ACTIONS = (
    "ros: no actions, since palpate_msgs is not installed: build it with colcon, or with"
    " python ros/build_interfaces.py"
)

PRIORITY = 30
"""Priority in the real-time class: below the host's, so that the bridge never delays a tick."""

INSTALL = (
    "pip install ros-jazzy-rclpy ros-jazzy-rmw-fastrtps-cpp ros-jazzy-sensor-msgs ros-jazzy-diagnostic-msgs"
    " ros-jazzy-std-srvs (Python 3.11 on x86-64), or source the setup file of an installed ROS 2"
)


@click.command()
@CONFIG
@CONTROL_SOCKET
@click.option("--namespace", default="", help="Put before every topic and service, as in left.")
@click.option("--frame-prefix", default="", help="Put before every frame, as in left/.")
@click.option(
    "--commands",
    is_flag=True,
    help="Offer grasp, turn, move, release and recover to every ROS node, beside stop; also as actions if"
    " palpate_msgs is installed.",
)
@click.option("--tf", is_flag=True, help="Publish the frames too, in place of robot_state_publisher.")
@click.option(
    "--camera", "cameras", multiple=True, metavar="FINGER=RING", help="Publish pictures; may be repeated."
)
@click.option("--real-time", is_flag=True, help="Request SCHED_FIFO: no busy program delays the messages.")
@click.option("--duration", "duration_s", type=click.FloatRange(min=0), help="Stop after so many seconds.")
@click.option(
    "--urdf",
    "urdf_path",
    type=click.Path(path_type=Path, dir_okay=False, allow_dash=True),
    help="Write the URDF of this hand (- for stdout), and publish nothing.",
)
def ros(
    config_path: Path,
    socket_path: Path | None,
    namespace: str,
    frame_prefix: str,
    commands: bool,
    tf: bool,
    cameras: tuple[str, ...],
    real_time: bool,
    duration_s: float | None,
    urdf_path: Path | None,
) -> None:
    """Publish a running hand to ROS 2, and take commands from there.

    Publishes joint states, a wrench and a contact point for each fingertip, mode, diagnostics and the URDF.
    With --tf also the frames of links, fingertips and object.
    The service stop is always offered. Every node of the ROS domain may call the services: they are executed
    with the rights of this process on the control socket. Ends at SIGTERM or SIGINT.

    Exit status: 0 done, 2 wrong argument, or rclpy is not installed.

    \b
    Examples:
      palpate-host ros --config hand.toml
      palpate-host ros --config hand.toml --namespace left --frame-prefix left/ --commands --tf
      palpate-host ros --config hand.toml --urdf hand.urdf
    """
    config, hand = load_hand(config_path)
    urdf = urdf_of(config)
    if urdf_path is not None:
        write_atomically(urdf_path, urdf.encode(), ConfigError)
        return
    try:
        from palpate_host.ros.bridge import RosBridge  # noqa: PLC0415 (rclpy is not installed everywhere)
    except ModuleNotFoundError as exc:
        raise ConfigError(f"ros needs {exc.name}: {INSTALL}") from exc
    if tf and find_spec("tf2_msgs") is None:
        raise ConfigError(
            "ros --tf needs tf2_msgs, which an installed ROS 2 has: source its setup file, or build it:"
            " python ros/build_interfaces.py"
        )
    from palpate_host.ros.pictures import PictureFeed  # noqa: PLC0415
    from palpate_host.ros.transforms import HandFrames  # noqa: PLC0415

    if real_time and (refusal := request_fifo(PRIORITY)):
        click.echo(
            f"ros: no real-time class ({refusal}): raise the limit with ulimit -r {PRIORITY}", err=True
        )
    socket = socket_path or default_control_socket()
    frames = dict(zip((finger.name for finger in config.fingers), config.model.tip_sites, strict=True))
    contents = HandContents(hand, frames, frame_prefix)
    hand_frames = HandFrames(urdf, frame_prefix) if tf else None
    silence_s = max(SILENCE_S, SILENCE_TICKS / config.control.tick_Hz)
    end_s = None if duration_s is None else time.monotonic() + duration_s
    ticks, heard_s = 0, time.monotonic()
    with (
        closing(
            RosBridge(
                socket, urdf, silence_s, namespace, rules=_rules(config, frame_prefix), may_move=commands
            )
        ) as bridge,
        closing(
            PictureFeed(
                map(parse_camera, cameras),
                {finger: frame_prefix + frame for finger, frame in frames.items()},
                bridge.publish,
            )
        ),
        closing(TickStream(socket)) as stream,
        stop_event() as stopped,
        long_lived(),
    ):
        click.echo(f"ros: node {bridge.name}, host at {socket}", err=True)
        if commands and not bridge.has_actions:
            click.echo(NO_ACTIONS, err=True)
        if hand_frames is not None:
            bridge.publish([hand_frames.fixed(now_us())])
        while not stopped.is_set() and (end_s is None or time.monotonic() < end_s):
            status = stream.next(silence_s / 2)
            if status is not None:
                messages = contents.of_tick(status)
                bridge.publish(messages)
                bridge.of_tick(status)
                if hand_frames is not None:
                    bridge.publish(hand_frames.of_tick(messages))
                ticks, heard_s = ticks + 1, time.monotonic()
            elif stream.failure or time.monotonic() - heard_s > silence_s:
                reason = stream.failure or f"no tick for {silence_s:g} s"
                bridge.publish(contents.of_silence(now_us(), reason))
                bridge.of_silence(reason, is_closed=bool(stream.failure))
    click.echo(f"ros: {ticks} ticks")


def _rules(config: HandConfig, frame_prefix: str) -> GoalRules:
    """Return what the actions need to know of the hand: in which mode its law measures the errors."""
    measures = Mode.BLIND if config.control.mode is ControlMode.BLIND else Mode.MANIPULATE
    return GoalRules(frame_prefix + HAND_FRAME, config.target.ramp_s, (measures,))
