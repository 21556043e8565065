"""`palpate-host run` and `palpate-host contract`."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.common.logs import logging_to_stderr
from palpate_host.config.hand_config import StartMode
from palpate_host.service import host
from palpate_host.service.contract import recording_header

CONFIG = click.option(
    "--config",
    "config_path",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="The hand's file; models/table4.toml in the package shows every key.",
)
CONTROL_SOCKET = click.option(
    "--socket",
    "socket_path",
    type=click.Path(path_type=Path),
    help="The host's control socket [default: $PALPATE_CONTROL, or that of palpate-host run].",
)


@click.command()
@CONFIG
@click.option("--duration", "duration_s", type=click.FloatRange(min=0), help="Stop after so many seconds.")
@click.option(
    "--status",
    "status_target",
    type=click.Path(path_type=Path),
    help="Write the status of every tick as a JSON line to this file, named pipe or Unix socket.",
)
@click.option(
    "--socket",
    "control_socket",
    type=click.Path(path_type=Path),
    help="Socket for palpate-host command [default: palpate-host.sock in $RUNTIME_DIRECTORY, ...].",
)
@click.option(
    "--start",
    type=click.Choice([mode.value for mode in StartMode]),
    help="In place of run.start: move at once, or wait for commands.",
)
def run(
    config_path: Path,
    duration_s: float | None,
    status_target: Path | None,
    control_socket: Path | None,
    start: str | None,
) -> None:
    """Control the hand on its bus until SIGTERM, SIGINT or, with --start auto, a fault.

    \b
    palpate-host run --config hand.toml --start command
    palpate-host run --config hand.toml
    palpate-host run --config hand.toml --duration 10 --status status.jsonl
    """
    options = host.Options(
        duration_s, status_target, control_socket, None if start is None else StartMode(start)
    )
    with logging_to_stderr():
        host.run(config_path, options)


@click.command()
@CONFIG
def contract(config_path: Path) -> None:
    """Print the options that bind a recorded bus log to this hand's EDS files and nodes.

    \b
    palpate-host contract --config hand.toml
    palpate-host bus hub --log hand.log $(palpate-host contract --config hand.toml)
    """
    config, _ = host.load_hand(config_path)
    for key, value in recording_header(config).entries.items():
        click.echo(f"--header {key}={value}")
