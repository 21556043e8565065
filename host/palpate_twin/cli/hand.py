"""Commands ``palpate-host simulate paper``, ``hand`` and ``loop``: experiments with a simulated hand."""

from __future__ import annotations

import os
from pathlib import Path

import click

from palpate_edge.common.atomic_write import make_folder, write_atomically
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.progress import notes_beside
from palpate_twin.cli.options import (
    FILE,
    friction_option,
    hand_file,
    hand_option,
    jobs_option,
    noise_seed_option,
    results_option,
)

CONTACT_NOISE_MM = 0.15
"""Standard deviation along each axis. The mean length of such a vector is sqrt(8/pi) = 1.596 times it, an
error of 0.24 mm; the estimator's error on the twin's ten sensors is 0.16 to 0.35 mm, 0.22 mm on average
(docs/accuracy-twin.md)."""
FILM_STRIDE = 2  # one picture per second


@click.command()
@click.option(
    "--engine",
    type=click.Choice(["eqs", "mujoco", "both"]),
    default="both",
    show_default=True,
    help="Physics engine: eqs is Eqs. (4)-(8) with rolling tips, mujoco has contacts with friction.",
)
@click.option(
    "--hand",
    "hand_names",
    multiple=True,
    default=("table3", "table4"),
    show_default=True,
    metavar="table3|table4|FILE",
    help="table3 gives Fig. 17, table4 (with an ArUco marker as ground truth) Fig. 20; may be repeated.",
)
@click.option(
    "--friction",
    type=click.FloatRange(0.05, 5.0),
    help="Friction coefficient of the tips in mujoco.  [default: from hand.toml]",
)
@click.option(
    "--noise",
    "noise_mm",
    type=click.FloatRange(0.0, 5.0),
    help="Noise of contact positions: standard deviation along each axis in mm.  [default: 0.15; table3: 0]",
)
@click.option(
    "--seconds",
    type=click.FloatRange(0.5, 600),
    default=10.0,
    show_default=True,
    help="Duration of each run.",
)
@noise_seed_option
@jobs_option
@results_option("paper", "the figures and results.md")
def paper(
    engine: str,
    hand_names: tuple[str, ...],
    friction: float | None,
    noise_mm: float | None,
    seconds: float,
    seed: int,
    jobs: int | None,
    output: Path,
) -> None:
    """Turn an object by 30 deg in roll, pitch and yaw under the paper's law and the blind law.

    Contacts arrive at 30 Hz with a delay of 50 ms. For table3 they are exact; for other hands they have the
    estimator's noise, and an external camera also measures the object's rotation. A third law is the paper's
    with an integral term. The same options give the same numbers.

    \b
    Examples:
      palpate-host simulate paper
      palpate-host simulate paper --hand table3 --engine eqs --seconds 5 -o fig17
      palpate-host simulate paper --hand my-hand.toml --noise 0.24
    """
    from rich.progress import Progress  # noqa: PLC0415 (as below: keeps --help fast)

    from palpate_twin.paper.figure_data import all_cases, engines_table, run_all, table  # noqa: PLC0415
    from palpate_twin.paper.figures import draw_turns  # noqa: PLC0415
    from palpate_twin.paper.trial import ENGINES  # noqa: PLC0415

    engines = list(ENGINES) if engine == "both" else [engine]
    make_folder(output, ConfigError)
    cases = []
    for name in dict.fromkeys(hand_names):
        is_simulation = name == "table3"
        default_mm = 0.0 if is_simulation else CONTACT_NOISE_MM
        noise = default_mm if noise_mm is None else noise_mm
        cases += all_cases(hand_file(name), engines, seconds, noise, seed, not is_simulation, friction)
    with Progress() as progress:
        task = progress.add_task("runs", total=len(cases))
        results = run_all(cases, jobs or os.cpu_count() or 1, lambda: progress.advance(task))
    for path in dict.fromkeys(result.case.hand_toml for result in results):
        picture = output / f"{path.stem}.svg"
        draw_turns([result for result in results if result.case.hand_toml == path], picture)
        click.echo(f"{picture}")
    text = "\n\n".join(part for part in (table(results), engines_table(results)) if part)
    write_atomically(output / "results.md", f"{text}\n".encode(), ConfigError)
    click.echo(text)


@click.command()
@hand_option
@click.option("--write", type=FILE, help="File for the hand's MuJoCo model (MJCF).")
@click.option(
    "--picture",
    type=FILE,
    help="File for a picture of hand and object (.png). Needs OpenGL; without a display set MUJOCO_GL=egl "
    "or osmesa.",
)
def hand(hand_name: str, write: Path | None, picture: Path | None) -> None:
    """Check a hand.toml and print its joints, its tips in the start pose and their first contacts.

    \b
    Examples:
      palpate-host simulate hand --hand table3
      palpate-host simulate hand --hand my-hand.toml --write my-hand.xml --picture my-hand.png
    """
    from palpate_twin.paper.describe import describe, draw, mjcf  # noqa: PLC0415

    path = hand_file(hand_name)
    with notes_beside(write):
        click.echo(describe(path))
    if write is not None:
        write_atomically(write, mjcf(path).encode(), ConfigError)
        with notes_beside(write):
            click.echo(f"{write}")
    if picture is not None:
        draw(path, picture)
        click.echo(f"{picture}")


@click.command()
@hand_option
@click.option(
    "--turn",
    "turns",
    type=click.Choice(["roll", "pitch", "yaw"]),
    multiple=True,
    default=("roll", "pitch", "yaw"),
    show_default=True,
    help="Axis of the 30 deg turn; may be repeated, one run each.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(2.0, 600),
    default=8.0,
    show_default=True,
    help="Duration of each run.",
)
@friction_option
@click.option(
    "--integral",
    type=click.FloatRange(0.0, 10.0),
    default=0.0,
    show_default=True,
    help="Integral gain, control.integral_per_s of hand.toml.",
)
@click.option(
    "--engine",
    type=click.Choice(["eqs", "mujoco"]),
    default="mujoco",
    show_default=True,
    help="Physics engine: eqs is Eqs. (4)-(8) with rolling tips, mujoco has contacts with friction.",
)
@click.option("--direct", is_flag=True, help="Use true contacts with noise instead of rendered frames.")
@click.option(
    "--weight", "has_weight", is_flag=True, help="Give the object weight, which the host compensates."
)
@click.option("--film", "with_film", is_flag=True, help="Draw each run (film-yaw.png, ...); needs OpenGL.")
@click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Random seed of sensors and noise."
)
@results_option("loop", "results.md and for the sensors, which later runs use again")
def loop(
    hand_name: str,
    turns: tuple[str, ...],
    seconds: float,
    friction: float | None,
    integral: float,
    engine: str,
    direct: bool,
    has_weight: bool,
    with_film: bool,
    seed: int,
    output: Path,
) -> None:
    """Grasp and turn an object with the whole chain in lock step.

    The chain is physics, rendered fingertips, estimators, CAN nodes, drives and host, in one process on
    simulated time: the same options give the same numbers on any machine. The first run creates a sensor for
    each finger and calibrates it.

    \b
    Examples:
      palpate-host simulate loop --turn yaw
      palpate-host simulate loop --direct --friction 0.8 --integral 1
    """
    from rich.progress import Progress  # noqa: PLC0415 (as below: keeps --help fast)

    from palpate_host.config import hand_reader  # noqa: PLC0415
    from palpate_twin.closed_loop.fingertip_sensors import fingertip_sensors  # noqa: PLC0415
    from palpate_twin.closed_loop.tactile_rendering import (  # noqa: PLC0415
        ContactSource,
        RenderedContactSource,
        TrueContactSource,
    )
    from palpate_twin.dome.library import load_library  # noqa: PLC0415
    from palpate_twin.hand.film import draw_states, write_row  # noqa: PLC0415
    from palpate_twin.paper.figure_data import AXES  # noqa: PLC0415
    from palpate_twin.paper.loop import loop_table, run_loop  # noqa: PLC0415

    path = hand_file(hand_name)
    config = hand_reader.load(path)
    radius_mm = 1e3 * config.control.tip_radius_m
    make_folder(output, ConfigError)
    with Progress() as progress:
        task = progress.add_task("fingertips", total=len(turns))
        sensors = None
        if not direct:
            library = load_library()
            names = [finger.name for finger in config.fingers]
            sensors = fingertip_sensors(
                output, names, radius_mm, seed, library, lambda text: progress.update(task, description=text)
            )

        def make_contact_source() -> ContactSource:
            if sensors is None:
                return TrueContactSource(radius_mm, CONTACT_NOISE_MM, seed)
            return RenderedContactSource(sensors, library, seed)

        results = []
        for turn in turns:
            progress.update(task, description=turn)
            results.append(
                run_loop(
                    path,
                    AXES.index(turn),
                    make_contact_source,
                    seconds=seconds,
                    friction=friction,
                    integral_per_s=integral,
                    engine=engine,
                    has_weight=has_weight,
                )
            )
            progress.advance(task)
    text = loop_table(results)
    write_atomically(output / "results.md", f"{text}\n".encode(), ConfigError)
    click.echo(text)
    for turn, result in zip(turns, results, strict=True) if with_film else ():
        picture = output / f"film-{turn}.png"
        write_row(picture, draw_states(result.twin, result.film[::FILM_STRIDE]))
        click.echo(f"{picture}")
    for result in results:
        if result.failure:
            raise click.ClickException(f"the host stopped the hand: {result.failure}")
