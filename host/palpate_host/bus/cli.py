"""``palpate-host bus``: the hub, a logger, statistics and faults."""

from __future__ import annotations

import signal
from pathlib import Path

import click

from palpate_host.bus.candump import LogHeader, LogWriter
from palpate_host.bus.default_socket import default_socket
from palpate_host.bus.hub import Hub

SOCKET = click.option(
    "--socket",
    "socket_path",
    type=click.Path(path_type=Path, dir_okay=False),
    default=None,
    help="The hub's Unix socket; default $PALPATE_HUB or palpate-hub.sock in $XDG_RUNTIME_DIR.",
)


@click.group()
def bus() -> None:
    """The local CAN hub: a bus between processes of one machine, without SocketCAN."""


@bus.command()
@SOCKET
@click.option("--bitrate", type=click.IntRange(0, 1_000_000), default=1_000_000, show_default=True)
@click.option("--txqueuelen", type=click.IntRange(1, 4096), default=128, show_default=True)
@click.option("--log", "log_path", type=click.Path(path_type=Path, dir_okay=False), default=None)
def hub(socket_path: Path | None, bitrate: int, txqueuelen: int, log_path: Path | None) -> None:
    """Runs the hub until SIGTERM or SIGINT."""
    path = socket_path or default_socket()
    log = LogWriter(log_path, LogHeader()) if log_path else None
    server = Hub(path, bitrate, txqueuelen, log)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: server.stop())
    click.echo(f"CAN hub at {path}, {bitrate} bit/s", err=True)
    server.run()
    server.close()
