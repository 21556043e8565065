"""``palpate-host simulate sensor``: a sensor.toml in figures and as a drawing."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.datasets.sensor_file import read_sensor


@click.command()
@click.argument("sensor_toml", type=click.Path(path_type=Path))
@click.option(
    "--picture", type=click.Path(path_type=Path, dir_okay=False), help="Draw it there (.svg, .png, .pdf)."
)
def sensor(sensor_toml: Path, picture: Path | None) -> None:
    """Checks a sensor.toml and prints where its beads go: what a mould is made from.

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
