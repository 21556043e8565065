"""``palpate-host console``: the console of a hand, a page in the browser."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.common.signals import stop_event
from palpate_host.cli.run import CONFIG, CONTROL_SOCKET
from palpate_host.config import hand_config
from palpate_host.operator.server import default_control_socket


@click.command()
@CONFIG
@CONTROL_SOCKET
@click.option("--port", type=click.IntRange(0, 65535), default=8471, show_default=True, help="0: any free.")
def console(config_path: Path, socket_path: Path | None, port: int) -> None:
    """Show and command a running hand in the browser.

    The page has the fingers with contacts and forces, the mode with its reason, the joints with their
    torques, and buttons to grasp, turn, release, stop and recover. Commands go through the host's control
    socket, so this user must be permitted there.

    The page is served on 127.0.0.1 only. From another machine: ssh -L 8471:127.0.0.1:8471 USER@HOST, then
    open the printed address there. Everyone on this machine may look; commands need the printed token. The
    page's stop is no emergency stop: a browser or a network may be late.

    \b
    Example:
      palpate-host console --config hand.toml

    Exit status: 0 after Ctrl-C, 2 when configuration, port or token cannot be used.
    """
    from palpate_host.console.serve import serve_hand  # noqa: PLC0415 (MuJoCo is slow to import)

    config = hand_config.load(config_path)
    with stop_event() as stopped:
        path = socket_path or default_control_socket()
        serve_hand(config, path, port, stopped, lambda line: click.echo(line, err=True))
