"""``palpate-host foxglove``: a running hand, live, for Foxglove."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path

import click

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.signals import stop_event
from palpate_host.cli.run import CONFIG, CONTROL_SOCKET
from palpate_host.operator.server import default_control_socket
from palpate_host.recording.status_follower import StatusFollower
from palpate_host.service.host import load_hand

WAIT_S = 0.1
"""Longest wait for a tick, after which the command looks whether it has to end."""


@click.command()
@CONFIG
@CONTROL_SOCKET
@click.option(
    "--host",
    "address",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on; any client that reaches it sees the hand.",
)
@click.option(
    "--port", type=click.IntRange(0, 65535), default=8765, show_default=True, help="0 for any free one."
)
@click.option("--duration", "duration_s", type=click.FloatRange(min=0), help="Stop after so many seconds.")
@click.option(
    "--layout",
    "layout_path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write a layout for this hand to import in Foxglove, and serve nothing.",
)
def foxglove(
    config_path: Path,
    socket_path: Path | None,
    address: str,
    port: int,
    duration_s: float | None,
    layout_path: Path | None,
) -> None:
    """Serve a running hand to Foxglove over a WebSocket.

    The topics are those of an MCAP recording. In Foxglove: Open connection, ws://localhost:8765. Clients only
    receive; commands go over the control socket. Ends at SIGTERM or SIGINT.

    Exit status: 0 done, 2 wrong argument, or the address is in use.

    \b
    Examples:
      palpate-host foxglove --config hand.toml --layout hand-layout.json
      palpate-host foxglove --config hand.toml
    """
    from palpate_host.recording.live_server import LiveServer, layout  # noqa: PLC0415 (an extra)

    config, hand = load_hand(config_path)
    if layout_path is not None:
        write_atomically(layout_path, layout(config).encode(), ConfigError)
        click.echo(f"{layout_path}: layout of {config_path.name}")
        return
    socket = socket_path or default_control_socket()
    end_s = None if duration_s is None else time.monotonic() + duration_s
    ticks = 0
    with (
        closing(LiveServer(config, hand, address, port)) as server,
        StatusFollower(socket) as follower,
        stop_event() as stopped,
    ):
        click.echo(f"foxglove: ws://{address}:{server.port}, host at {socket}", err=True)
        while not stopped.is_set() and (end_s is None or time.monotonic() < end_s):
            for status in follower.take(WAIT_S):
                server.write(status)
                ticks += 1
    click.echo(f"foxglove: {ticks} ticks")
