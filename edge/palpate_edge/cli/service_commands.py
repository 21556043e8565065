"""``palpate-edge check`` and ``palpate-edge record``: what a person or a script asks of a fingertip."""

from __future__ import annotations

import os
import sys
import time
from contextlib import closing
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

    from palpate_edge.daemon.check_rows import as_table, exit_status  # noqa: PLC0415
    from palpate_edge.daemon.config import read_config  # noqa: PLC0415
    from palpate_edge.daemon.health import read_health  # noqa: PLC0415
    from palpate_edge.daemon.self_check import check as check_parts  # noqa: PLC0415

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


@click.command()
@CONFIG
def identify(config_path: Path) -> None:
    """Blink a fingertip's LED ring for ten seconds, so that a person sees which one it is.

    Every other frame is dark meanwhile, so a fingertip that a hand relies on (OPERATIONAL) refuses. The exit
    status is 7 when it refuses, has no illumination controller, or that does not answer.

    \b
    Examples:
      palpate-edge identify --config finger-1.toml
    """
    from palpate_edge.common.errors import IlluminationError  # noqa: PLC0415
    from palpate_edge.common.signals import IDENTIFY  # noqa: PLC0415
    from palpate_edge.daemon.config import read_config  # noqa: PLC0415
    from palpate_edge.daemon.health import read_health  # noqa: PLC0415
    from palpate_edge.illumination.client import IlluminationClient  # noqa: PLC0415
    from palpate_edge.illumination.controller_thread import BLINK_UPDATES, UPDATE_PERIOD_S, LightController  # noqa: PLC0415

    config = read_config(config_path)
    bus, address = config.illumination.i2c_bus, config.illumination.address
    if bus is None:
        raise IlluminationError(f"{config.name} has no LED ring: illumination.i2c_bus names its I2C bus")
    report = read_health(config.name, config.health, time.monotonic())
    if report is not None and report.nmt_state == "operational":
        raise IlluminationError(
            f"{config.name} is operational, a hand relies on what it sees: stop the host first"
        )
    if report is not None and report.light is not None and report.light.problem:
        raise IlluminationError(report.light.problem)
    if report is not None:
        os.kill(report.pid, IDENTIFY)
        click.echo(f"{config.name}: its LED ring blinks")
        return
    # No daemon runs: nobody else talks to the controller.
    with closing(LightController(lambda: IlluminationClient.open(bus, address), 0)) as light:
        click.echo(f"{config.name}: its LED ring blinks")
        light.blink()
        for _ in range(BLINK_UPDATES):
            light.update()
            time.sleep(UPDATE_PERIOD_S)
