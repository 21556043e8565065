"""``palpate-edge record``: keep the frames of a fingertip, from its daemon or from its camera."""

from __future__ import annotations

import os
import time
from pathlib import Path

import click

from palpate_edge.cli.options import OUTPUT, config_option


@click.command()
@click.argument("action", type=click.Choice(["start", "stop"]))
@config_option
@click.option("-o", "--output", type=OUTPUT, help="Without a daemon: this new folder, not record.folder.")
@click.option("--frames", type=click.IntRange(1), help="Without a daemon: stop after so many frames.")
@click.option("--seconds", type=click.FloatRange(0.1), help="Without a daemon: stop after so many seconds.")
def record(
    action: str, config_path: Path, output: Path | None, frames: int | None, seconds: float | None
) -> None:
    """Start or stop recording the frames of a fingertip.

    A running daemon has the camera and records on request; SIGUSR1 and SIGUSR2 do the same. Without a daemon
    `start` takes the camera itself, until Ctrl-C, --frames or --seconds. A calibration is not needed.

    A recording is a folder of images under record.folder; beyond record.megabytes or record.seconds the
    oldest images are deleted. Every command that takes frames accepts it.

    \b
    Examples:
      palpate-edge record start --config finger-1.toml
      palpate-edge record stop --config finger-1.toml
      palpate-edge record start --config finger-1.toml --frames 20 -o my-dome/reference
      palpate-edge estimate recordings/20250101-120000 --calibration finger-1.cal --csv contacts.csv
    """
    from palpate_edge.common.errors import CaptureError, ConfigError  # noqa: PLC0415
    from palpate_edge.common.signals import RECORD, RECORD_NO_MORE, stop_event  # noqa: PLC0415
    from palpate_edge.daemon.camera_recording import record_camera  # noqa: PLC0415
    from palpate_edge.daemon.config import read_config  # noqa: PLC0415
    from palpate_edge.daemon.health import read_health  # noqa: PLC0415

    config = read_config(config_path)
    report = read_health(config.name, config.health, time.monotonic())
    if report is not None:
        if output is not None or frames is not None or seconds is not None:
            raise ConfigError(
                f"the daemon of {config.name} has the camera (pid {report.pid}): leave out -o, --frames and "
                "--seconds, or stop it"
            )
        os.kill(report.pid, RECORD if action == "start" else RECORD_NO_MORE)
        click.echo(
            f"{config.name}: recording under {config.record.folder}" if action == "start" else "stopped"
        )
        return
    if action == "stop":
        raise CaptureError(f"no daemon of {config.name} runs, so nothing is recorded by one")
    folder = output or Path(config.record.folder) / time.strftime("%Y%m%d-%H%M%S")
    click.echo(f"{config.name}: no daemon runs, recording from the camera to {folder}", err=True)
    if frames is None and seconds is None:
        click.echo("Ctrl-C ends the recording", err=True)
    with stop_event() as stopped:
        written = record_camera(
            config,
            folder,
            stopped,
            lambda line: click.echo(line, err=True),
            frames=frames,
            seconds=seconds,
        )
    click.echo(f"{folder}: {written} frames")
