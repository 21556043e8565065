"""``palpate-host simulate dataset``: press datasets of made-up sensors."""

from __future__ import annotations

from pathlib import Path

import click
import cv2

from palpate_host.twin.camera.layouts import NAMES
from palpate_host.twin.dome.probe import Probe

SHIPPED_PROBES = {probe.label: probe for probe in (Probe.PLATE, Probe.SPHERE5)}

sensor_option = click.option(
    "--sensor",
    "sensor_path",
    type=click.Path(path_type=Path, exists=True),
    help="A dataset made by this command, its twin.json, or a sensor.toml.  [default: made up from the seed]",
)
seed_option = click.option(
    "--random-seed",
    type=click.IntRange(0),
    help="Of everything random in the sensor: all of it, or what a sensor.toml leaves open.  [default: 0]",
)
probe_option = click.option(
    "--probe",
    "probe_names",
    type=click.Choice(list(SHIPPED_PROBES)),
    multiple=True,
    default=("plate",),
    show_default=True,
    help="What presses; may be given many times.",
)


@click.command()
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="A folder, new.")
@sensor_option
@seed_option
@click.option("--layout", type=click.Choice(NAMES), help="Of a made-up sensor.  [default: by the seed]")
@click.option("--presses", type=click.IntRange(0), default=200, show_default=True, help="To train with.")
@click.option("--test-presses", type=click.IntRange(0), default=60, show_default=True)
@click.option(
    "--seconds", type=click.FloatRange(0, min_open=True), help="A moving contact, no single presses."
)
@probe_option
@click.option("--hide", type=click.IntRange(0), default=0, help="The most beads hidden in a frame.")
@click.option("--press-seed", type=click.IntRange(0), default=0, show_default=True, help="Of the presses.")
def dataset(
    output: Path,
    sensor_path: Path | None,
    random_seed: int | None,
    layout: str | None,
    presses: int,
    test_presses: int,
    seconds: float | None,
    probe_names: tuple[str, ...],
    hide: int,
    press_seed: int,
) -> None:
    """Writes a press dataset of a simulated sensor, for `palpate-edge calibrate` and `evaluate`.

    The same options give the same bytes. Beside sensor.toml stands twin.json: the sensor as it really is.

    \b
    Examples:
      palpate-host simulate dataset -o dome-7 --random-seed 7
      palpate-host simulate dataset -o moving-7 --sensor dome-7 --seconds 8 --press-seed 1
      palpate-host simulate dataset -o mine --sensor sensor.toml --presses 500 --probe plate --probe sphere5
    """
    from rich.progress import Progress  # noqa: PLC0415 (as below: what --help need not wait for)

    from palpate_host.twin.camera.choose_sensor import choose_sensor  # noqa: PLC0415
    from palpate_host.twin.camera.renderer import CameraView  # noqa: PLC0415
    from palpate_host.twin.camera.write_dataset import (  # noqa: PLC0415
        Plan,
        one_sequence,
        single_presses,
        write_dataset,
    )
    from palpate_host.twin.dome.library import load_library  # noqa: PLC0415

    cv2.setNumThreads(1)
    twin = choose_sensor(sensor_path, random_seed, layout)
    view = CameraView(twin, load_library())
    plan = Plan(presses, test_presses, tuple(SHIPPED_PROBES[name] for name in probe_names), hide)
    if seconds is None:
        shots = single_presses(view, plan, press_seed)
    else:
        shots = one_sequence(view, plan, seconds, press_seed)
    with Progress() as progress:
        task = progress.add_task("frames", total=plan.references + len(shots))
        write_dataset(output, view, shots, plan.references, press_seed, lambda: progress.advance(task))
    click.echo(f"{output}: {len(twin.bead_mm)} beads, {len(shots)} frames")
