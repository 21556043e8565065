"""``palpate-edge watch``: the console of a fingertip, a page in the browser or a view in the terminal."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.cli.options import config_option


@click.command()
@config_option
@click.option("--port", type=click.IntRange(0, 65535), default=8470, show_default=True, help="0: any free.")
@click.option("--terminal", "is_terminal", is_flag=True, help="Show it in this terminal instead; no port.")
def watch(config_path: Path, port: int, is_terminal: bool) -> None:
    """Show a fingertip live in the browser or the terminal.

    The page has the camera's picture with beads and displacements, the dome with the contact, the force over
    time and the health of each part, and buttons to record, take a snapshot, tare and set the LEDs. A running
    daemon has the camera and is watched; without one this command takes the camera itself. Neither a
    calibration nor a bus is needed.

    The page is served on 127.0.0.1 only. From another machine: ssh -L 8470:127.0.0.1:8470 USER@BOARD, then
    open the printed address there. Everyone on this machine may look; commands need the printed token.

    With --terminal the same in characters, also over ssh: picture, contact, force over time and health.
    Keys are on the last line; q or Ctrl-C ends it.

    \b
    Examples:
      palpate-edge watch --config finger-1.toml
      palpate-edge watch --config finger-1.toml --terminal

    Exit status: 0 after Ctrl-C, or one of `palpate-edge --help`.
    """
    from palpate_edge.common.logs import logging_to_stderr  # noqa: PLC0415
    from palpate_edge.common.signals import stop_event  # noqa: PLC0415
    from palpate_edge.console.serve import serve_console  # noqa: PLC0415
    from palpate_edge.daemon.config import read_config  # noqa: PLC0415

    config = read_config(config_path)
    if is_terminal:
        from palpate_edge.console.terminal.watch_terminal import watch_in_terminal  # noqa: PLC0415

        with stop_event() as stopped:
            watch_in_terminal(config, stopped)
        return
    with logging_to_stderr(config.name), stop_event() as stopped:
        serve_console(config, port, stopped, lambda line: click.echo(line, err=True))
