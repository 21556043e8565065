"""Command ``palpate-host simulate shake``: pushes, weight and turns on a held object."""

from __future__ import annotations

import os
from pathlib import Path

import click

from palpate_edge.common.atomic_write import make_folder, write_atomically
from palpate_edge.common.errors import ConfigError
from palpate_twin.cli.options import (
    force_noise_option,
    friction_option,
    hand_file,
    hand_option,
    jobs_option,
    noise_option,
    noise_seed_option,
    results_option,
)

DIRECTIONS = ("1", "6", "26")


@click.command()
@hand_option
@click.option(
    "--law",
    type=click.Choice(["paper", "pose"]),
    help="Law that moves the joints, control.law.  [default: from hand.toml]",
)
@click.option(
    "--chain",
    "in_chain",
    is_flag=True,
    help="Run the whole chain in lock step: host core, CAN bus, nodes and drives at the hand's tick rate.",
)
@click.option(
    "--frames",
    "with_frames",
    is_flag=True,
    help="With --chain: render the fingertips' frames and estimate the contacts from them, in place of true "
    "contacts with noise. The first run makes and calibrates the sensors in OUTPUT.",
)
@click.option(
    "--directions",
    type=click.Choice(DIRECTIONS),
    default="1",
    show_default=True,
    help="Directions of each force: down, along the axes, or also along all diagonals; the worst is printed.",
)
@click.option(
    "--random",
    "random_count",
    type=click.IntRange(1, 100_000),
    help="Instead of the table: so many runs with random loads, friction, delays and gaps, under both laws; "
    "with --frames, one of three has rendered frames.",
)
@friction_option
@click.option(
    "--integral",
    type=click.FloatRange(0.0, 10.0),
    default=1.0,
    show_default=True,
    help="Integral gain of the paper's law, control.integral_per_s of hand.toml.",
)
@noise_option(0.0)
@force_noise_option(0.0)
@click.option("--no-reflex", is_flag=True, help="Do not answer slip: pose_law.slip_reflex = false.")
@click.option(
    "--seconds",
    type=click.FloatRange(2.5, 600),
    default=6.0,
    show_default=True,
    help="Duration of each run; forces begin after 1 s.",
)
@noise_seed_option
@jobs_option
@results_option("shake")
def shake(
    hand_name: str,
    law: str | None,
    in_chain: bool,
    with_frames: bool,
    directions: str,
    random_count: int | None,
    friction: float | None,
    integral: float,
    noise_mm: float,
    force_noise: float,
    no_reflex: bool,
    seconds: float,
    seed: int,
    jobs: int | None,
    output: Path,
) -> None:
    """Push a held object, load it with steady forces and its weight, turn it, move it, let it slip.

    The engine is mujoco. The law runs 1000 times a second without bus and drives, and contacts arrive at
    30 Hz with a delay of 50 ms; --chain runs the whole chain. The same options give the same numbers.

    \b
    Examples:
      palpate-host simulate shake --law pose
      palpate-host simulate shake --law pose --chain --noise 0.15 --seconds 8
      palpate-host simulate shake --law pose --chain --frames
      palpate-host simulate shake --directions 26 --friction 0.8 -o shake-26
      palpate-host simulate shake --random 200 --seed 1 --noise 0.25 --force-noise 0.03
      palpate-host simulate shake --random 20 --law pose --chain --frames --noise 0.25 --force-noise 0.03
    """
    from rich.progress import Progress  # noqa: PLC0415 (as below: keeps --help fast)

    from palpate_host.config import hand_reader  # noqa: PLC0415
    from palpate_host.config.control_config import ControlLaw, ControlMode  # noqa: PLC0415
    from palpate_twin.paper.random_runs import LAWS, random_table, run_all  # noqa: PLC0415
    from palpate_twin.paper.shake import make_sensors, run_shakes, shake_cases, shake_table  # noqa: PLC0415
    from palpate_twin.paper.trial_parameters import Trial  # noqa: PLC0415

    if with_frames and not in_chain:
        raise click.UsageError("--frames needs --chain: the law alone has no fingertips")
    make_folder(output, ConfigError)
    base = Trial(
        mode=ControlMode.PROPOSED,
        rpy_deg=(0.0, 0.0, 0.0),
        duration_s=seconds,
        noise_mm=noise_mm,
        force_noise=force_noise,
        slip_reflex=not no_reflex,
        integral_per_s=integral,
        seed=seed,
        friction=friction,
        law=None if law is None else ControlLaw(law),
    )
    hand_toml, jobs = hand_file(hand_name), jobs or os.cpu_count() or 1
    sensors = output if with_frames else None
    with Progress() as progress:
        task = progress.add_task("runs", total=None)
        if with_frames:
            make_sensors(
                *(output, hand_reader.load(hand_toml), seed),
                lambda text: progress.update(task, description=text),
            )
        progress.update(task, description="runs")
        if random_count is not None:
            laws = LAWS if base.law is None else (base.law,)
            progress.update(task, total=random_count * len(laws))
            runs = run_all(
                *(hand_toml, base, laws, random_count, jobs),
                lambda: progress.advance(task),
                in_chain,
                sensors,
            )
            text = random_table(runs)
        else:
            cases = shake_cases(base, int(directions))
            progress.update(task, total=len(cases))
            results = run_shakes(hand_toml, cases, in_chain, jobs, lambda: progress.advance(task), sensors)
            text = shake_table(results)
    write_atomically(output / "results.md", f"{text}\n".encode(), ConfigError)
    click.echo(text)
