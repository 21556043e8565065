"""``palpate-edge record``: keep the frames of a running fingertip."""

from __future__ import annotations

import os
import time
from pathlib import Path

import click

from palpate_edge.cli.options import config_option


@click.command()
@click.argument("action", type=click.Choice(["start", "stop"]))
@config_option
def record(action: str, config_path: Path) -> None:
    """Start or stop recording the frames of a running fingertip.

    A recording is a folder of images under record.folder; beyond record.megabytes or record.seconds the
    oldest images are deleted. Every command that takes frames accepts it. SIGUSR1 and SIGUSR2 do the same.

    \b
    Examples:
      palpate-edge record start --config finger-1.toml
      palpate-edge record stop --config finger-1.toml
      palpate-edge estimate recordings/20250101-120000 --calibration finger-1.cal --csv contacts.csv
    """
    from palpate_edge.common.errors import CaptureError  # noqa: PLC0415
    from palpate_edge.common.signals import RECORD, RECORD_NO_MORE  # noqa: PLC0415
    from palpate_edge.daemon.config import read_config  # noqa: PLC0415
    from palpate_edge.daemon.health import read_health  # noqa: PLC0415

    config = read_config(config_path)
    report = read_health(config.name, config.health, time.monotonic())
    if report is None:
        raise CaptureError(f"no daemon of {config.name} runs: start palpate-edge run --config {config_path}")
    os.kill(report.pid, RECORD if action == "start" else RECORD_NO_MORE)
    click.echo(f"{config.name}: recording under {config.record.folder}" if action == "start" else "stopped")
