"""``palpate-host record``: records the bus and the host's status."""

from __future__ import annotations

import time
from pathlib import Path

import click

from palpate_edge.common.signals import stop_event
from palpate_host.cli.run import CONFIG, CONTROL_SOCKET
from palpate_host.operator.server import default_control_socket
from palpate_host.recording.bounds import Bounds
from palpate_host.service.host import load_hand

MB = 1_000_000
DEFAULTS = Bounds()


@click.command()
@CONFIG
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Folder for the pieces: 000001.log (candump), 000001.mcap, and so on.",
)
@CONTROL_SOCKET
@click.option("--duration", "duration_s", type=click.FloatRange(min=0), help="Stop after so many seconds.")
@click.option(
    "--piece-mb",
    type=click.FloatRange(0.1),
    default=DEFAULTS.piece_bytes / MB,
    show_default=True,
    help="A piece ends after it.",
)
@click.option(
    "--keep-mb",
    type=click.FloatRange(0.2),
    default=DEFAULTS.folder_bytes / MB,
    show_default=True,
    help="The oldest pieces go beyond it.",
)
def record(
    config_path: Path,
    output: Path,
    socket_path: Path | None,
    duration_s: float | None,
    piece_mb: float,
    keep_mb: float,
) -> None:
    """Record all frames of the bus and the host's status as bus logs and MCAP.

    A process of its own, which sends nothing on the bus and which the host never waits for; it may be started
    before the host or later. Ends at SIGTERM or SIGINT. A power cut costs the last second; the files it
    leaves can be exported and viewed.

    \b
    Examples:
      palpate-host run --config hand.toml &
      palpate-host record --config hand.toml -o recording
      palpate-host view recording --config hand.toml
    """
    # needs the extra `record`, which slow imports come with
    from palpate_host.recording.hand_recording import record_hand  # noqa: PLC0415

    config, hand = load_hand(config_path)
    bounds = Bounds(piece_bytes=round(piece_mb * MB), folder_bytes=round(keep_mb * MB))
    socket = socket_path or default_control_socket()
    end_s = None if duration_s is None else time.monotonic() + duration_s
    with stop_event() as stopped:
        recording = record_hand(
            output,
            config,
            hand,
            bounds,
            socket,
            lambda: stopped.is_set() or (end_s is not None and time.monotonic() >= end_s),
            lambda: click.echo(f"record: listening, host at {socket}", err=True),
        )
    summary = f"{recording.frames} frames, {recording.ticks} ticks in {output}"
    click.echo(f"record: {summary}, piece {recording.pieces}")
