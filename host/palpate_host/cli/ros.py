"""``palpate-host ros``: a running hand as a node of ROS 2."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path

import click

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.signals import stop_event
from palpate_host.cli.run import CONFIG, CONTROL_SOCKET
from palpate_host.common.camera_source import parse_camera
from palpate_host.operator.server import default_control_socket
from palpate_host.recording.status_follower import StatusFollower
from palpate_host.ros.contents import HandContents
from palpate_host.ros.urdf import urdf_of
from palpate_host.service.host import load_hand, now_us

SILENCE_S, SILENCE_TICKS = 0.1, 2
"""The host counts as gone after the longer of these times without a tick."""

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
    "--commands", is_flag=True, help="Offer grasp, turn, release and recover to every ROS node, beside stop."
)
@click.option(
    "--camera", "cameras", multiple=True, metavar="FINGER=RING", help="Publish pictures; may be repeated."
)
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
    cameras: tuple[str, ...],
    duration_s: float | None,
    urdf_path: Path | None,
) -> None:
    """Publish a running hand to ROS 2, and take commands from there.

    Publishes joint states, a wrench and a contact point for each fingertip, mode, diagnostics and the URDF.
    The service stop is always offered. Every node of the ROS domain may call the services: they are executed
    with the rights of this process on the control socket. Ends at SIGTERM or SIGINT.

    Exit status: 0 done, 2 wrong argument, or rclpy is not installed.

    \b
    Examples:
      palpate-host ros --config hand.toml
      palpate-host ros --config hand.toml --namespace left --frame-prefix left/ --commands
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
    from palpate_host.ros.pictures import PictureFeed  # noqa: PLC0415

    socket = socket_path or default_control_socket()
    frames = dict(zip((finger.name for finger in config.fingers), config.model.tip_sites, strict=True))
    contents = HandContents(hand, frames, frame_prefix)
    silence_s = max(SILENCE_S, SILENCE_TICKS / config.control.tick_Hz)
    end_s = None if duration_s is None else time.monotonic() + duration_s
    ticks, heard_s = 0, time.monotonic()
    with (
        closing(RosBridge(socket, urdf, silence_s, namespace, may_move=commands)) as bridge,
        closing(
            PictureFeed(
                map(parse_camera, cameras),
                {finger: frame_prefix + frame for finger, frame in frames.items()},
                bridge.publish,
            )
        ),
        StatusFollower(socket) as follower,
        stop_event() as stopped,
    ):
        click.echo(f"ros: node {bridge.name}, host at {socket}", err=True)
        while not stopped.is_set() and (end_s is None or time.monotonic() < end_s):
            statuses = follower.take(silence_s / 2)
            for status in statuses:
                bridge.publish(contents.of_tick(status))
            ticks += len(statuses)
            if statuses:
                heard_s = time.monotonic()
            elif follower.failure or time.monotonic() - heard_s > silence_s:
                reason = follower.failure or f"no tick for {silence_s:g} s"
                bridge.publish(contents.of_silence(now_us(), reason))
    click.echo(f"ros: {ticks} ticks")
