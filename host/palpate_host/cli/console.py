"""``palpate-host console``: the console of a hand, a page in the browser or a view in the terminal."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.common.signals import stop_event
from palpate_host.cli.run import CONFIG, CONTROL_SOCKET
from palpate_host.config import hand_reader
from palpate_host.operator.server import default_control_socket


@click.command()
@CONFIG
@CONTROL_SOCKET
@click.option(
    "--recordings",
    "recordings_folder",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("recordings"),
    show_default=True,
    help="Folder of the recordings that the page makes and plays.",
)
@click.option("--port", type=click.IntRange(0, 65535), default=8471, show_default=True, help="0: any free.")
@click.option("--terminal", "is_terminal", is_flag=True, help="Show it in this terminal instead; no port.")
def console(
    config_path: Path, socket_path: Path | None, recordings_folder: Path, port: int, is_terminal: bool
) -> None:
    """Show and command a running hand in the browser or the terminal.

    The page has the fingers with contacts and forces, the mode with its reason, the joints with their
    torques, bus load and temperatures, buttons to grasp, turn, release, stop and recover, and recordings.
    Commands go through the host's control socket, so this user must be permitted there.

    The page is served on 127.0.0.1 only. From another machine: ssh -L 8471:127.0.0.1:8471 USER@HOST, then
    open the printed address there. Everyone on this machine may look; commands need the printed token. The
    page's stop is no emergency stop: a browser or a network may be late.

    With --terminal fingers, mode and joints are shown in characters, also over ssh. Keys are on the last
    line: the space bar stops the hand, each other command waits for Enter, q ends the view.

    \b
    Examples:
      palpate-host console --config hand.toml
      palpate-host console --config hand.toml --terminal

    Exit status: 0 after Ctrl-C, 2 when configuration, port or token cannot be used.
    """
    config = hand_reader.load(config_path)
    path = socket_path or default_control_socket()
    if is_terminal:
        from palpate_host.console.terminal.command_hand import command_in_terminal  # noqa: PLC0415

        with stop_event() as stopped:
            command_in_terminal(path, stopped)
        return
    from palpate_host.console.serve import serve_hand  # noqa: PLC0415 (MuJoCo is slow to import)

    with stop_event() as stopped:
        serve_hand(config, path, recordings_folder, port, stopped, lambda line: click.echo(line, err=True))
