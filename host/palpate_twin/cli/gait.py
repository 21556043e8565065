"""Command ``palpate-host simulate gait``: large turns of a held object by finger gaiting."""

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
    jobs_option,
    noise_option,
    noise_seed_option,
    results_option,
)

AXES = ("roll", "pitch", "yaw")


@click.command()
@click.option(
    "--hand",
    "hand_name",
    default="table4-four",
    show_default=True,
    metavar="table4-four|FILE",
    help="The hand of four fingers, or a hand.toml with [twin] and law = 'pose'.",
)
@click.option(
    "--axis",
    "axes",
    type=click.Choice(AXES),
    multiple=True,
    help="Axis of the hand about which the object turns; may be given several times.  [default: all three]",
)
@click.option(
    "--angle",
    "angle_deg",
    type=click.FloatRange(1.0, 180.0),
    default=90.0,
    show_default=True,
    help="Angle of the turn in deg.",
)
@click.option(
    "--chain",
    "in_chain",
    is_flag=True,
    help="Run the whole chain in lock step: host core, CAN bus, nodes and drives at the hand's tick rate.",
)
@click.option(
    "--seeds", type=click.IntRange(1, 1000), default=1, show_default=True, help="Number of runs of each turn."
)
@friction_option
@noise_option(0.15)
@force_noise_option(0.03)
@noise_seed_option
@jobs_option
@results_option("gait")
def gait(
    hand_name: str,
    axes: tuple[str, ...],
    angle_deg: float,
    in_chain: bool,
    seeds: int,
    friction: float | None,
    noise_mm: float,
    force_noise: float,
    seed: int,
    jobs: int | None,
    output: Path,
) -> None:
    """Turn a held object far: one finger lifts and takes hold again while the others hold.

    The engine is mujoco, the object has its weight. The law runs 1000 times a second without bus and drives,
    and contacts arrive at 30 Hz with a delay of 50 ms; --chain runs the whole chain. Each seed has its own
    noise, and its own place of the object within 1.5 mm. The same options give the same numbers.

    \b
    Examples:
      palpate-host simulate gait --axis yaw
      palpate-host simulate gait --seeds 20 -o gait-20
      palpate-host simulate gait --chain --axis roll --axis yaw --seeds 20 -o gait-chain
      palpate-host simulate gait --axis roll --angle 45 --friction 0.8
    """
    from rich.progress import Progress  # noqa: PLC0415 (as below: keeps --help fast)

    from palpate_host.config.control_config import ControlLaw, ControlMode  # noqa: PLC0415
    from palpate_twin.paper.gait_runs import GaitCase, gait_table, run_gaits  # noqa: PLC0415
    from palpate_twin.paper.trial_parameters import Trial  # noqa: PLC0415

    make_folder(output, ConfigError)
    cases = [
        GaitCase(
            AXES.index(axis),
            angle_deg,
            Trial(
                mode=ControlMode.PROPOSED,
                rpy_deg=(0.0, 0.0, 0.0),
                noise_mm=noise_mm,
                force_noise=force_noise,
                has_weight=True,
                seed=seed + number,
                friction=friction,
                law=ControlLaw.POSE,
            ),
            in_chain,
        )
        for axis in axes or AXES
        for number in range(seeds)
    ]
    with Progress() as progress:
        task = progress.add_task("runs", total=len(cases))
        results = run_gaits(
            hand_file(hand_name), cases, jobs or os.cpu_count() or 1, lambda: progress.advance(task)
        )
    text = gait_table(cases, results)
    write_atomically(output / "results.md", f"{text}\n".encode(), ConfigError)
    click.echo(text)
