"""``palpate-edge setup``: a configuration from what is connected to the board."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from palpate_edge.cli.options import INPUT, OUTPUT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from palpate_edge.common.arrays import Image
    from palpate_edge.setup.finger_file import SetupChoices
    from palpate_edge.setup.found import FoundBus, FoundCamera

    Found = TypeVar("Found", FoundBus, FoundCamera)


def _read_answers(context: click.Context, _option: click.Parameter, path: Path | None) -> None:
    """Take the options of a TOML file as defaults. Raises ConfigError."""
    import msgspec  # noqa: PLC0415

    from palpate_edge.common.config_file import read_toml  # noqa: PLC0415
    from palpate_edge.setup.choices import SetupAnswers  # noqa: PLC0415

    if path is not None:
        answers = read_toml(path, SetupAnswers, guide="its keys are the options of palpate-edge setup")
        context.default_map = msgspec.to_builtins(answers)


@click.command()
@click.option("-o", "--output", type=OUTPUT, help="Configuration to write [default: NAME.toml].")
@click.option("--name", default="finger-1", show_default=True, help="Name of the fingertip.")
@click.option("--camera", help="Name in /dev/v4l/by-path, a ring of frames, or a recording.")
@click.option("--node", type=click.IntRange(1, 127), default=16, show_default=True, help="CANopen node id.")
@click.option("--channel", help="CAN interface such as can0, or hub for the local hub.")
@click.option("--i2c-bus", type=click.IntRange(0, 255), help="N of /dev/i2c-N; default: where one answers.")
@click.option("--exposure-us", type=click.IntRange(1, 1_000_000), help="Default: proposed from the picture.")
@click.option("--sensor", type=INPUT, help="Your sensor.toml; default: the sensor of docs/building.md.")
@click.option("--yes", is_flag=True, help="Ask nothing: take the first of what is found and not down.")
@click.option(
    "--answers",
    type=INPUT,
    is_eager=True,
    expose_value=False,
    callback=_read_answers,
    help="TOML file with these options, such as node = 17.",
)
def setup(
    output: Path | None,
    name: str,
    camera: str | None,
    node: int,
    channel: str | None,
    i2c_bus: int | None,
    exposure_us: int | None,
    sensor: Path | None,
    yes: bool,
) -> None:
    """Write a configuration from the devices on this board.

    Cameras of V4L2, simulated cameras, recordings in this folder, CAN interfaces and I2C buses are listed.
    What is missing or not unique is asked. A picture is taken to propose an exposure. The folder NAME-presses
    with a sensor.toml is made for reference frames and presses. Existing files are kept.

    \b
    Examples:
      palpate-edge setup --name finger-1
      palpate-edge setup --yes --name finger-2 --node 17 --channel can0
      palpate-edge setup --answers answers.toml

    Exit status: 0 written, 2 nothing found or existing file, 5 the camera gives no picture.
    """
    from palpate_edge.common.errors import ConfigError  # noqa: PLC0415
    from palpate_edge.setup.choices import named_bus, named_camera, trial_config  # noqa: PLC0415
    from palpate_edge.setup.finger_file import SetupChoices  # noqa: PLC0415
    from palpate_edge.setup.picture_trial import suitable_exposure  # noqa: PLC0415
    from palpate_edge.setup.search import find_buses, find_cameras, find_lights  # noqa: PLC0415

    path = output or Path(f"{name}.toml")
    if path.exists():
        raise ConfigError(f"{path} exists: give another --name or -o, or remove it first")
    cameras, buses, lights = find_cameras(Path()), find_buses(), find_lights()
    for title, lines in (
        ("cameras", [one.line for one in cameras]),
        ("buses", [one.line for one in buses]),
        ("I2C", [one.line for one in lights]),
    ):
        click.echo("\n  ".join([f"{title}:", *(lines or ["none"])]))
    usable = [one for one in cameras if not one.problem]
    chosen = named_camera(camera) if camera else _choose("camera", usable, yes)
    if chosen.source == "recorded":
        chosen = replace(chosen, path=str(Path(chosen.path).resolve()))
    answering = [light.i2c_bus for light in lights if not light.problem]
    ready = [one for one in buses if not (yes and one.is_down)]
    choices = SetupChoices(
        name=name,
        camera=chosen,
        bus=named_bus(channel) if channel else _choose("bus", ready, yes),
        node_id=node,
        dataset=f"{name}-presses",
        exposure_us=exposure_us,
        i2c_bus=i2c_bus if i2c_bus is not None else next(iter(answering), None),
    )
    image, proposed_us = suitable_exposure(trial_config(choices, sensor), click.echo)
    _write(path, replace(choices, exposure_us=exposure_us or proposed_us), sensor, image)


def _choose(what: str, found: Sequence[Found], yes: bool) -> Found:
    """Return the only one found, the first one with --yes, else the one that is asked for.

    Raises ConfigError when nothing was found.
    """
    from palpate_edge.common.errors import ConfigError  # noqa: PLC0415

    if not found:
        raise ConfigError(f"no usable {what} found: connect one, or give --{what}")
    if len(found) == 1 or yes:
        return found[0]
    for number, one in enumerate(found, start=1):
        click.echo(f"{number}: {one.line}")
    chosen: int = click.prompt(f"which {what}", type=click.IntRange(1, len(found)), default=1)
    return found[chosen - 1]


def _write(path: Path, choices: SetupChoices, sensor: Path | None, image: Image) -> None:
    """Write the configuration and the sensor's description; print the verdict on the picture."""
    from palpate_edge.common.atomic_write import make_folder, write_atomically  # noqa: PLC0415
    from palpate_edge.common.errors import ConfigError  # noqa: PLC0415
    from palpate_edge.daemon.check_rows import as_table, judge_picture  # noqa: PLC0415
    from palpate_edge.daemon.health_report import picture_health  # noqa: PLC0415
    from palpate_edge.setup.finger_file import SENSOR, finger_toml, scaled_sensor_toml  # noqa: PLC0415
    from palpate_edge.vision.picture_measure import measure_picture  # noqa: PLC0415

    description = (sensor or SENSOR).read_text(encoding="utf-8")
    if sensor is None:
        description = scaled_sensor_toml(description, (image.shape[1], image.shape[0]))
    folder = path.parent / choices.dataset
    make_folder(folder, ConfigError)
    if not (folder / "sensor.toml").exists():
        write_atomically(folder / "sensor.toml", description.encode(), ConfigError)
    write_atomically(path, finger_toml(choices).encode(), ConfigError)
    click.echo(as_table([judge_picture(picture_health(measure_picture(image)))]))
    if choices.exposure_us is not None:
        click.echo(f"exposure: {choices.exposure_us} us")
    click.echo(f"{folder / 'sensor.toml'}: the sensor's geometry; correct it where yours differs")
    click.echo(f"{path}: written; next: palpate-edge check --config {path}")
