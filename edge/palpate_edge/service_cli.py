"""``palpate-edge check`` and ``palpate-edge record``: what a person or a script asks of a fingertip."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import click

CONFIG = click.option(
    "--config",
    "config_path",
    type=click.Path(path_type=Path),
    required=True,
    help="The fingertip's TOML file.",
)


@click.command()
@CONFIG
@click.option("--json", "as_json", is_flag=True, help="A list of objects instead of a table.")
def check(config_path: Path, as_json: bool) -> None:
    """Tell the state of each part: value, limit, ok, warn or fail, and the way out.

    Beside a running daemon it asks that; without one it tries camera and bus for a second and sends nothing.
    The exit status is 1 when a part fails.

    \b
    Examples:
      palpate-edge check --config finger-1.toml
      palpate-edge check --config finger-1.toml --json | jq '.[] | select(.verdict != "ok")'
    """
    import msgspec  # noqa: PLC0415

    from palpate_edge.check import as_table, exit_status  # noqa: PLC0415
    from palpate_edge.check import check as check_parts  # noqa: PLC0415
    from palpate_edge.config import read_config  # noqa: PLC0415
    from palpate_edge.health import read_health  # noqa: PLC0415

    config = read_config(config_path)
    report = read_health(config.name, config.health, time.monotonic())
    rows = check_parts(config, report)
    if as_json:
        click.echo(msgspec.json.encode(rows).decode())
    else:
        click.echo(f"{config.name}: {'running' if report else 'not running, its parts were tried'}")
        click.echo(as_table(rows))
    sys.exit(exit_status(rows))


@click.command()
@click.argument("action", type=click.Choice(["start", "stop"]))
@CONFIG
def record(action: str, config_path: Path) -> None:
    """Start or stop keeping the frames of a running fingertip (SIGUSR1 and SIGUSR2 do the same).

    The recording is a folder of images under record.folder, a ring of record.megabytes and record.seconds;
    every command that takes frames takes it.

    \b
    Examples:
      palpate-edge record start --config finger-1.toml
      palpate-edge record stop --config finger-1.toml
      palpate-edge estimate recordings/20250101-120000 --calibration finger-1.cal --csv contacts.csv
    """
    from palpate_edge.config import read_config  # noqa: PLC0415
    from palpate_edge.errors import CaptureError  # noqa: PLC0415
    from palpate_edge.health import read_health  # noqa: PLC0415

    config = read_config(config_path)
    report = read_health(config.name, config.health, time.monotonic())
    if report is None:
        raise CaptureError(f"no daemon of {config.name} runs: start palpate-edge run --config {config_path}")
    os.kill(report.pid, signal.SIGUSR1 if action == "start" else signal.SIGUSR2)
    click.echo(f"{config.name}: recording under {config.record.folder}" if action == "start" else "stopped")
