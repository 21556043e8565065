"""``palpate-host simulate paper`` and ``hand``: the paper's experiments on a simulated hand."""

from __future__ import annotations

import os
from pathlib import Path

import click

from palpate_host.config.packaged import MODELS

PACKAGED = {name: MODELS / f"{name}.toml" for name in ("table3", "table4", "table4-wide")}
CONTACT_NOISE_MM = 0.15
"""Standard deviation along each axis: the mean length of such a vector is sqrt(8/pi) = 1.596 times it, 0.24
mm of error; the estimator's on the twin's ten sensors is 0.16 to 0.35, 0.22 on average
(docs/accuracy-twin.md)."""
FILM_STRIDE = 2  # a picture a second


def hand_file(name: str) -> Path:
    """`table3`, `table4`, `table4-wide`, or a hand.toml."""
    return PACKAGED.get(name, Path(name))


hand_option = click.option(
    "--hand",
    "hand_name",
    default="table4-wide",
    show_default=True,
    metavar="table3|table4|table4-wide|FILE",
    help="A hand of the paper, Table 4's on a wider object, or a hand.toml with [twin].",
)


@click.command()
@click.option(
    "--engine",
    type=click.Choice(["eqs", "mujoco", "both"]),
    default="both",
    show_default=True,
    help="Eqs. (4)-(8) with rolling tips, or MuJoCo's contacts with friction.",
)
@click.option(
    "--hand",
    "hand_names",
    multiple=True,
    default=("table3", "table4"),
    show_default=True,
    metavar="table3|table4|FILE",
    help="Table 3 makes Fig. 17, Table 4 (with a camera's ArUco truth) Fig. 20; may be given many times.",
)
@click.option(
    "--friction", type=click.FloatRange(0.05, 5.0), help="Of the tips in mujoco.  [default: the hand's]"
)
@click.option(
    "--noise",
    "noise_mm",
    type=click.FloatRange(0.0, 5.0),
    help="Of contacts, standard deviation along each axis, mm.  [default: 0.15; Table 3: 0]",
)
@click.option("--seconds", type=click.FloatRange(0.5, 600), default=10.0, show_default=True, help="Of a run.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Of the noise.")
@click.option("--jobs", type=click.IntRange(1), help="Runs at the same time.  [default: one a core]")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("paper"),
    show_default=True,
    help="Folder for the figures and results.md.",
)
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
    """Turns an object by 30 deg in roll, pitch and yaw: the paper's law beside the blind one.

    Contacts come 30 times a second and 50 ms late. Table 3's are exact; other hands' have the estimator's
    noise, and the object's turn is also measured by an external camera. The third column of errors is the
    paper's law with an integral. The same options give the same numbers.

    \b
    Examples:
      palpate-host simulate paper
      palpate-host simulate paper --hand table3 --engine eqs --seconds 5 -o fig17
      palpate-host simulate paper --hand my-hand.toml --noise 0.24
    """
    from rich.progress import Progress  # noqa: PLC0415 (as below: slow to import)

    from palpate_twin.paper.figure_data import all_cases, engines_table, run_all, table  # noqa: PLC0415
    from palpate_twin.paper.figures import draw_turns  # noqa: PLC0415
    from palpate_twin.paper.trial import ENGINES  # noqa: PLC0415

    engines = list(ENGINES) if engine == "both" else [engine]
    output.mkdir(parents=True, exist_ok=True)
    cases = []
    for name in dict.fromkeys(hand_names):
        is_simulation = name == "table3"
        usual_mm = 0.0 if is_simulation else CONTACT_NOISE_MM
        noise = usual_mm if noise_mm is None else noise_mm
        cases += all_cases(hand_file(name), engines, seconds, noise, seed, not is_simulation, friction)
    with Progress() as progress:
        task = progress.add_task("runs", total=len(cases))
        results = run_all(cases, jobs or os.cpu_count() or 1, lambda: progress.advance(task))
    for path in dict.fromkeys(result.case.hand_toml for result in results):
        picture = output / f"{path.stem}.svg"
        draw_turns([result for result in results if result.case.hand_toml == path], picture)
        click.echo(f"{picture}")
    text = "\n\n".join(part for part in (table(results), engines_table(results)) if part)
    (output / "results.md").write_text(text + "\n", encoding="utf-8")
    click.echo(text)


@click.command()
@hand_option
@click.option(
    "--write",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the hand's MuJoCo model (MJCF) there.",
)
@click.option(
    "--picture",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Draw hand and object there (.png); needs OpenGL: MUJOCO_GL=egl or osmesa without a display.",
)
def hand(hand_name: str, write: Path | None, picture: Path | None) -> None:
    """Checks a hand.toml and prints its hand: joints, tips in the start pose, where they meet the object.

    \b
    Examples:
      palpate-host simulate hand --hand table3
      palpate-host simulate hand --hand my-hand.toml --write my-hand.xml --picture my-hand.png
    """
    from palpate_twin.paper.describe import describe, draw, mjcf  # noqa: PLC0415

    path = hand_file(hand_name)
    click.echo(describe(path))
    if write is not None:
        write.write_text(mjcf(path), encoding="utf-8")
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
    help="About which axis, by 30 deg; each is a run of its own.",
)
@click.option("--seconds", type=click.FloatRange(2.0, 600), default=8.0, show_default=True, help="Of a run.")
@click.option("--friction", type=click.FloatRange(0.05, 5.0), help="Of the tips.  [default: the hand's]")
@click.option(
    "--integral",
    type=click.FloatRange(0.0, 10.0),
    default=0.0,
    show_default=True,
    help="control.integral_per_s.",
)
@click.option("--engine", type=click.Choice(["eqs", "mujoco"]), default="mujoco", show_default=True)
@click.option("--direct", is_flag=True, help="True contacts with noise in place of rendered frames.")
@click.option(
    "--weight", "has_weight", is_flag=True, help="The object has its weight, and the host carries it."
)
@click.option("--film", "with_film", is_flag=True, help="Draw each run (film-yaw.png, ...); needs OpenGL.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Of sensors and noise.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("loop"),
    show_default=True,
    help="Folder for the sensors, kept for the next run, and results.md.",
)
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
    """The whole chain in lock step: physics, rendered fingertips, estimators, CAN nodes, drives, host.

    Grasps the object and turns it. One process on a virtual clock: the same options give the same numbers,
    however busy the machine is. The first run makes a sensor for each finger and calibrates it.

    \b
    Examples:
      palpate-host simulate loop --turn yaw
      palpate-host simulate loop --direct --friction 0.8 --integral 1
    """
    from rich.progress import Progress  # noqa: PLC0415 (as below: slow to import)

    from palpate_host.config import hand_config  # noqa: PLC0415
    from palpate_twin.closed_loop.fingertip_feel import DirectFeel, Feel, RenderedFeel  # noqa: PLC0415
    from palpate_twin.closed_loop.fingertip_sensors import fingertip_sensors  # noqa: PLC0415
    from palpate_twin.dome.library import load_library  # noqa: PLC0415
    from palpate_twin.hand.film import draw_states, write_row  # noqa: PLC0415
    from palpate_twin.paper.figure_data import AXES  # noqa: PLC0415
    from palpate_twin.paper.loop import loop_table, run_loop  # noqa: PLC0415

    path = hand_file(hand_name)
    config = hand_config.load(path)
    radius_mm = 1e3 * config.control.tip_radius_m
    output.mkdir(parents=True, exist_ok=True)
    with Progress() as progress:
        task = progress.add_task("fingertips", total=len(turns))
        sensors = None
        if not direct:
            library = load_library()
            names = [finger.name for finger in config.fingers]
            sensors = fingertip_sensors(
                output, names, radius_mm, seed, library, lambda text: progress.update(task, description=text)
            )

        def make_feel() -> Feel:
            if sensors is None:
                return DirectFeel(radius_mm, CONTACT_NOISE_MM, seed)
            return RenderedFeel(sensors, library, seed)

        results = []
        for turn in turns:
            progress.update(task, description=turn)
            results.append(
                run_loop(
                    path,
                    AXES.index(turn),
                    make_feel,
                    seconds=seconds,
                    friction=friction,
                    integral_per_s=integral,
                    engine=engine,
                    has_weight=has_weight,
                )
            )
            progress.advance(task)
    text = loop_table(results)
    (output / "results.md").write_text(text + "\n", encoding="utf-8")
    click.echo(text)
    for turn, result in zip(turns, results, strict=True) if with_film else ():
        picture = output / f"film-{turn}.png"
        write_row(picture, draw_states(result.twin, result.film[::FILM_STRIDE]))
        click.echo(f"{picture}")
    for result in results:
        if result.failure:
            raise click.ClickException(f"the host stopped the hand: {result.failure}")
