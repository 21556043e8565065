"""``palpate-edge jig``: write a printable jig for presses at known places."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.cli.options import INPUT, OUTPUT

LENGTH_MM = click.FloatRange(0, min_open=True)


@click.command()
@click.argument("sensor", type=INPUT)
@click.option("-o", "--output", type=OUTPUT, required=True, help="OpenSCAD file; jig.csv is beside it.")
@click.option(
    "--rod", "rod_mm", type=LENGTH_MM, default=10.0, show_default=True, help="Diameter of the rod, mm."
)
@click.option(
    "--fit", "fit_mm", type=LENGTH_MM, default=0.3, show_default=True, help="Play of holes and skirt, mm."
)
@click.option("--housing", "housing_mm", type=LENGTH_MM, help="Diameter, mm.  [default: the dome's]")
@click.option(
    "--skirt",
    "skirt_mm",
    type=click.FloatRange(5),
    default=12.0,
    show_default=True,
    help="From the dome's base plane down to the surface that fingertip and jig stand on, mm.",
)
@click.option(
    "--largest-theta",
    "largest_theta_deg",
    type=click.FloatRange(20, 70),
    default=60.0,
    show_default=True,
    help="Polar angle of the last ring of holes, deg.",
)
def jig(
    sensor: Path,
    output: Path,
    rod_mm: float,
    fit_mm: float,
    housing_mm: float | None,
    skirt_mm: float,
    largest_theta_deg: float,
) -> None:
    """Write a printed jig for presses at known places.

    The jig is a cap over the dome of SENSOR, a sensor.toml. Its numbered holes guide a rod with half a ball
    at its end towards the dome's centre; a weight on the rod presses. Print it with OpenSCAD and a slicer.
    `palpate-edge guide` leads from hole to hole once jig.csv is beside sensor.toml.

    \b
    Example:
      palpate-edge jig demo/recording/press/sensor.toml -o jig.scad

    Exit status: 0 success, 2 no room for the holes, 3 the sensor cannot be read.
    """
    from palpate_edge.common.atomic_write import write_atomically  # noqa: PLC0415
    from palpate_edge.common.errors import DatasetError  # noqa: PLC0415
    from palpate_edge.datasets.sensor_file import read_sensor  # noqa: PLC0415
    from palpate_edge.jig.jig_plan import JigSize, plan_holes  # noqa: PLC0415
    from palpate_edge.jig.jig_scad import scad_text  # noqa: PLC0415
    from palpate_edge.jig.jig_table import JIG, jig_table_text  # noqa: PLC0415

    radius_mm = read_sensor(sensor).dome.outer_radius_mm
    size = JigSize(
        housing_mm=housing_mm or 2 * radius_mm,
        skirt_mm=skirt_mm,
        rod_mm=rod_mm,
        fit_mm=fit_mm,
        largest_theta_deg=largest_theta_deg,
    )
    holes = plan_holes(radius_mm, size)
    table = output.with_name(JIG)
    write_atomically(output, scad_text(radius_mm, size, holes).encode(), DatasetError)
    write_atomically(table, jig_table_text(holes).encode(), DatasetError)
    click.echo(f"{output}, {table}: {len(holes)} holes of {size.hole_mm:g} mm")
