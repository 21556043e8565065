"""Command ``palpate-host simulate sensor``: a sensor.toml as a table and as a drawing."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.datasets.sensor_file import read_sensor
from palpate_twin.cli.options import FILE


@click.command()
@click.argument("sensor_toml", type=click.Path(path_type=Path))
@click.option("--picture", type=FILE, help="File for a drawing (.svg, .png, .pdf).")
def sensor(sensor_toml: Path, picture: Path | None) -> None:
    """Check a sensor.toml and print the bead positions, from which a mould can be made.

    \b
    Examples:
      palpate-host simulate sensor demo/recording/press/sensor.toml
      palpate-host simulate sensor my-sensor.toml --picture my-sensor.svg
    """
    from palpate_twin.camera.sensor_drawing import draw_sensor, plan_text  # noqa: PLC0415 (slow to import)

    found = read_sensor(sensor_toml)
    click.echo(plan_text(found))
    if picture is not None:
        draw_sensor(found, picture)
        click.echo(f"{picture}")
