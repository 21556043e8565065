"""Commands ``palpate-host simulate dataset`` and ``camera``: rendered frames as files and in real time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click
import cv2
import msgspec

from palpate_edge.common.signals import stop_event
from palpate_twin.camera.layouts import NAMES
from palpate_twin.cli.options import FILE
from palpate_twin.dome.probe import Probe

SHIPPED_PROBES = {probe.label: probe for probe in (Probe.PLATE, Probe.SPHERE5)}

sensor_option = click.option(
    "--sensor",
    "sensor_path",
    type=click.Path(path_type=Path, exists=True),
    help="Sensor to simulate: a dataset of `simulate dataset`, its twin.json, or a sensor.toml.  "
    "[default: a random sensor]",
)
seed_option = click.option(
    "--random-seed",
    type=click.IntRange(0),
    help="Random seed of the sensor, or of the properties that a sensor.toml does not specify.  [default: 0]",
)
probe_option = click.option(
    "--probe",
    "probe_names",
    type=click.Choice(list(SHIPPED_PROBES)),
    multiple=True,
    default=("plate",),
    show_default=True,
    help="Probe that presses the dome; may be repeated.",
)
press_seed_option = click.option(
    "--press-seed", type=click.IntRange(0), default=0, show_default=True, help="Random seed of the presses."
)


@click.command()
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), required=True, help="New folder for the dataset."
)
@sensor_option
@seed_option
@click.option(
    "--layout", type=click.Choice(NAMES), help="Bead layout of a random sensor.  [default: by the seed]"
)
@click.option(
    "--presses",
    type=click.IntRange(0),
    default=200,
    show_default=True,
    help="Number of presses for training.",
)
@click.option(
    "--test-presses",
    type=click.IntRange(0),
    default=60,
    show_default=True,
    help="Number of presses for testing.",
)
@click.option(
    "--weights",
    type=click.IntRange(0),
    default=0,
    help="Number of presses at the apex on a kitchen scale of 1 g, in weights.csv.",
)
@click.option(
    "--rods",
    type=click.IntRange(0),
    default=0,
    help="Number of presses through the holes of a printed jig, in weights.csv.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(0, min_open=True),
    help="Write a moving contact of this duration instead of single presses.",
)
@probe_option
@click.option("--hide", type=click.IntRange(0), default=0, help="Largest number of beads hidden in a frame.")
@press_seed_option
@click.option(
    "--wall-unevenness",
    type=click.FloatRange(0, 0.5),
    help="Standard deviation of the wall's stiffness over the dome, as a fraction.  [default: the sensor's, "
    "0 for a new one]",
)
@click.option(
    "--twist", is_flag=True, help="Twist the probe about the contact normal too; truth.csv has the torsion."
)
@click.option(
    "--look",
    "look_properties",
    multiple=True,
    metavar="NAME|KEY=VALUE",
    help="Change the appearance: veil, overexposed or room-light, or a property of twin.json's look, for "
    "example bead_bgr=red, bead_bgr=40,40,200, veil=0.5, exposure=1.8, flicker=0.1, changing_light=1, "
    "jpeg_quality=60; may be repeated.",
)
def dataset(
    output: Path,
    sensor_path: Path | None,
    random_seed: int | None,
    layout: str | None,
    presses: int,
    test_presses: int,
    weights: int,
    rods: int,
    seconds: float | None,
    probe_names: tuple[str, ...],
    hide: int,
    press_seed: int,
    wall_unevenness: float | None,
    twist: bool,
    look_properties: tuple[str, ...],
) -> None:
    """Write a press dataset of a simulated sensor for `palpate-edge calibrate` and `evaluate`.

    The same options give the same bytes. Besides sensor.toml, which describes the nominal sensor, the folder
    contains twin.json with the true one.

    \b
    Examples:
      palpate-host simulate dataset -o dome-7 --random-seed 7
      palpate-host simulate dataset -o moving-7 --sensor dome-7 --seconds 8 --press-seed 1
      palpate-host simulate dataset -o mine --sensor sensor.toml --presses 500 --probe plate --probe sphere5
      palpate-host simulate dataset -o kitchen-7 --random-seed 7 --presses 0 --weights 12
      palpate-host simulate dataset -o jig-7 --random-seed 7 --presses 0 --rods 34
      palpate-host simulate dataset -o uneven-7 --random-seed 7 --wall-unevenness 0.1
      palpate-host simulate dataset -o hard-7 --random-seed 7 --look veil --look bead_bgr=red --hide 12
    """
    from rich.progress import Progress  # noqa: PLC0415 (as below: keeps --help fast)

    from palpate_twin.camera.choose_sensor import choose_sensor  # noqa: PLC0415
    from palpate_twin.camera.hard_looks import with_properties  # noqa: PLC0415
    from palpate_twin.camera.renderer import CameraView  # noqa: PLC0415
    from palpate_twin.camera.write_dataset import (  # noqa: PLC0415
        Plan,
        one_sequence,
        single_presses,
        write_dataset,
    )
    from palpate_twin.dome.library import load_library  # noqa: PLC0415

    cv2.setNumThreads(1)
    twin = choose_sensor(sensor_path, random_seed, layout)
    if wall_unevenness is not None:
        twin = msgspec.structs.replace(twin, wall_unevenness=wall_unevenness)
    twin = msgspec.structs.replace(twin, look=with_properties(twin.look, look_properties))
    view = CameraView(twin, load_library())
    plan = Plan(presses, test_presses, tuple(SHIPPED_PROBES[name] for name in probe_names), hide)
    plan = replace(plan, twist=twist, weights=weights, rods=rods)
    if seconds is None:
        shots = single_presses(view, plan, press_seed)
    else:
        shots = one_sequence(view, plan, seconds, press_seed)
    with Progress() as progress:
        task = progress.add_task("frames", total=plan.references + len(shots))
        write_dataset(
            output,
            view,
            shots,
            plan.references,
            press_seed,
            lambda: progress.advance(task),
            torsion=twist,
        )
    click.echo(f"{output}: {len(twin.bead_mm)} beads, {len(shots)} frames")


@click.command()
@click.option(
    "--shm",
    "ring",
    type=FILE,
    required=True,
    help="Path of the frame ring to create, preferably in /dev/shm or /run.",
)
@sensor_option
@seed_option
@probe_option
@press_seed_option
@click.option(
    "--seconds", type=click.FloatRange(0, min_open=True), help="Stop after this time.  [default: never]"
)
@click.option("--truth", type=FILE, help="CSV file for the true contact of each frame.")
def camera(
    ring: Path,
    sensor_path: Path | None,
    random_seed: int | None,
    probe_names: tuple[str, ...],
    press_seed: int,
    seconds: float | None,
    truth: Path | None,
) -> None:
    """Simulate the camera of a sensor that is pressed at random places, in real time.

    Runs until SIGTERM or SIGINT. `palpate-edge run` reads the frames with `source = "shared_memory"` and the
    ring's path.

    \b
    Examples:
      palpate-host simulate dataset -o dome-7 --random-seed 7
      palpate-edge calibrate dome-7 -o dome-7.cal
      palpate-host simulate camera --sensor dome-7 --shm /dev/shm/finger-1
    """
    from palpate_twin.camera.choose_sensor import choose_sensor  # noqa: PLC0415
    from palpate_twin.camera.live import run_camera  # noqa: PLC0415
    from palpate_twin.camera.renderer import CameraView  # noqa: PLC0415
    from palpate_twin.dome.library import load_library  # noqa: PLC0415

    cv2.setNumThreads(1)
    twin = choose_sensor(sensor_path, random_seed)
    view = CameraView(twin, load_library())
    probes = tuple(SHIPPED_PROBES[name] for name in probe_names)
    counts = (0, 0)

    def count(written: int, skipped: int) -> None:
        nonlocal counts
        counts = (written, skipped)

    with stop_event() as stop:
        click.echo(f"camera of {len(twin.bead_mm)} beads at {twin.sensor.camera.fps:g} Hz: {ring}", err=True)
        run_camera(view, ring, probes, press_seed, stop, seconds=seconds, truth=truth, after_frame=count)
    click.echo(f"camera stopped: {counts[0]} frames, {counts[1]} exposures skipped", err=True)
