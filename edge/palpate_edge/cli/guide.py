"""``palpate-edge guide``: from a camera to a calibration, step by step at the terminal."""

from __future__ import annotations

import sys
import time
from contextlib import closing
from pathlib import Path

import click

from palpate_edge.cli.options import config_option


@click.command()
@config_option
def guide(config_path: Path) -> None:
    """Calibrate a fingertip step by step, with a scale or a jig.

    Focus, exposure, beads, pictures of the untouched dome, warm-up, presses of the apex on the scale, and the
    calibration: each step has live values and a verdict. Enter goes on; grams are typed as a number; `undo`
    deletes the last press; `quit` ends. With the jig.csv of `palpate-edge jig` beside sensor.toml the presses
    go from hole to hole; `scale` and `jig` change between both ways. Everything is kept in the folder of
    estimator.sensor as it is done, and the next call goes on from there. The page of `palpate-edge watch` has
    the same steps.

    \b
    Example:
      palpate-edge guide --config finger-1.toml

    Exit status: 0 calibrated or ended with `quit`, 2 configuration, 5 no camera.
    """
    from palpate_edge.can_bus.simulated_clock import clock_of  # noqa: PLC0415
    from palpate_edge.common.errors import ConfigError  # noqa: PLC0415
    from palpate_edge.common.signals import stop_event  # noqa: PLC0415
    from palpate_edge.daemon.capture_factory import open_source  # noqa: PLC0415
    from palpate_edge.daemon.config import read_config  # noqa: PLC0415
    from palpate_edge.daemon.health import read_health  # noqa: PLC0415
    from palpate_edge.guide.guide_files import configured_files  # noqa: PLC0415
    from palpate_edge.guide.guide_runner import GuideRunner  # noqa: PLC0415
    from palpate_edge.guide.terminal import TypedLines, run_in_terminal  # noqa: PLC0415

    config = read_config(config_path)
    report = read_health(config.name, config.health, time.monotonic())
    if report is not None:
        raise ConfigError(f"the daemon of {config.name} has the camera (pid {report.pid}): end it first")
    files = configured_files(config)
    runner = GuideRunner(files)
    click.echo(f"{files.folder}: every picture is kept here")
    lines = TypedLines(sys.stdin)
    with (
        closing(
            open_source(config, None, clock_of(config.bus), lambda line: click.echo(line, err=True))
        ) as source,
        stop_event() as stopped,
    ):
        done = run_in_terminal(
            runner,
            source,
            lines.next,
            lambda text: click.echo(text, nl=False),
            stopped.is_set,
            is_live=sys.stdout.isatty(),
        )
    if done:
        click.echo(f"\n{files.calibration}, {files.report}: written")
    else:
        click.echo(f"\n{files.folder}: kept; the same command goes on from here")
