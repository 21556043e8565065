"""``palpate-edge identify``: blink the LED ring of a fingertip."""

from __future__ import annotations

import os
import time
from contextlib import closing
from pathlib import Path

import click

from palpate_edge.cli.options import config_option


@click.command()
@config_option
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
