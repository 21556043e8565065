"""``palpate-edge check``, ``record`` and ``identify``: commands for a fingertip that runs."""

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
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list instead of a table.")
def check(config_path: Path, as_json: bool) -> None:
    """Report the state of each part of a fingertip.

    Each part has a value, a limit, a verdict (ok, warn, fail, absent) and a remedy. If the daemon runs, its
    health report is evaluated, with its counters; otherwise camera and bus are tried for a second, without
    sending.

    \b
    Examples:
      palpate-edge check --config finger-1.toml
      palpate-edge check --config finger-1.toml --json | jq '.[] | select(.verdict != "ok")'

    Exit status: 0 when no part fails, 1 when a part fails.
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
        click.echo(f"{config.name}: {'running' if report else 'not running, camera and bus were tried'}")
        click.echo(as_table(rows))
    sys.exit(exit_status(rows))


@click.command()
@click.argument("action", type=click.Choice(["start", "stop"]))
@CONFIG
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


@click.command()
@CONFIG
def identify(config_path: Path) -> None:
    """Blink the LED ring of a fingertip for ten seconds.

    Every other frame is dark meanwhile, so a fingertip in OPERATIONAL, which a hand uses, refuses.

    \b
    Examples:
      palpate-edge identify --config finger-1.toml

    Exit status: 0, or 7 when the fingertip refuses, has no illumination controller, or the controller does
    not answer.
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
        raise IlluminationError(f"{config.name} has no LED ring: set illumination.i2c_bus to its I2C bus")
    report = read_health(config.name, config.health, time.monotonic())
    if report is not None and report.nmt_state == "operational":
        raise IlluminationError(
            f"{config.name} is operational, a hand uses its contacts: stop the host first"
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
