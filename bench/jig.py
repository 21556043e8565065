"""Accuracy by way of calibrating, on sensors of the twin: ``python -m bench.jig``.

Each sensor is calibrated without presses, with 12 weights on the apex, through the holes of its jig (once and
twice through all holes, printed with an error of 0.1 mm and 0.5 deg), and by exact presses of a robot. All
are evaluated on 100 other presses of plate and ball with shear.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click
import cv2
import numpy as np

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.evaluation import Figures, evaluate_dataset
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.entry_point import run_cli
from palpate_edge.datasets.press_dataset import Press, PressDataset, read_dataset
from palpate_edge.estimation.frame_estimator import Method
from palpate_edge.jig.jig_plan import JigSize, plan_holes
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import Plan, single_presses, write_dataset
from palpate_twin.dome.library import load_library
from palpate_twin.dome.probe import Probe

WEIGHTS, TEST, ROUNDS = 12, 100, 2


def simulate(folder: Path, seed: int, robot: int) -> tuple[PressDataset, int]:
    """Write and read the dataset of a sensor; return it, and the number of its jig's holes."""
    view = CameraView(random_sensor(seed), load_library())
    radius_mm = view.twin.sensor.dome.outer_radius_mm
    holes = len(plan_holes(radius_mm, JigSize(2 * radius_mm)))
    probes = (Probe.PLATE, Probe.SPHERE5)
    plan = Plan(robot, TEST, probes, weights=WEIGHTS, rods=ROUNDS * holes)
    write_dataset(folder, view, single_presses(view, plan, 0), plan.references, 0)
    return read_dataset(folder), holes


def ways(dataset: PressDataset, holes: int, robot: Sequence[int]) -> dict[str, tuple[Press, ...]]:
    """Return the training presses of each way to calibrate."""
    train = dataset.split("train")
    scale = [press for press in train if press.is_weighed and press.position_mm is None]
    rod = [press for press in train if press.is_weighed and press.position_mm is not None]
    exact = [press for press in train if press.touches and not press.is_weighed]
    presses = {"none": (), "scale, 12 at the apex": tuple(scale)}
    presses |= {f"jig, {n} at each hole": tuple(rod[: n * holes]) for n in range(1, ROUNDS + 1)}
    return presses | {f"robot, {count} exact": tuple(exact[:count]) for count in robot}


def row(name: str, figures: Sequence[Figures]) -> str:
    """Return a row of the table: means over the sensors."""
    bands = [one.overall for one in figures]

    def mean(values: Sequence[float | None], digits: int) -> str:
        known = [value for value in values if value is not None]
        return f"{np.mean(known):.{digits}f}" if known else "–"

    cells = [
        mean([band.mean_mm for band in bands], 2),
        mean([band.median_mm for band in bands], 2),
        mean([band.covered_percent for band in bands], 1),
        mean([band.force_rmse_percent for band in bands], 2),
        mean([band.direction_deg for band in bands], 2),
        mean([one.force_covered_percent for one in figures], 1),
    ]
    return f"| {name} | {' | '.join(cells)} |"


@click.command()
@click.option("--first", default=70, show_default=True, help="seed of the first sensor")
@click.option("--sensors", default=8, show_default=True)
@click.option(
    "--robot", default=(17, 34, 200), multiple=True, show_default=True, help="exact presses; 0: none"
)
def main(first: int, sensors: int, robot: tuple[int, ...]) -> None:
    """Print position errors, mean and median in mm, and force errors in % by sensor; then all means."""
    cv2.setNumThreads(1)
    dome, counts = load_dome_model(), [count for count in robot if count]
    found: dict[str, list[Figures]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(first, first + sensors):
            dataset, holes = simulate(Path(scratch) / f"sensor-{seed}", seed, max(counts, default=0))
            cells = []
            for name, presses in ways(dataset, holes, counts).items():
                calibration = calibrate(replace(dataset, presses=presses), dome=dome)
                path = Path(scratch) / name
                figures = evaluate_dataset(dataset.folder, "test", calibration, path, Method.CORRECTED)
                found.setdefault(name, []).append(figures)
                band = figures.overall
                cells.append(
                    f"{band.mean_mm:.2f} / {band.median_mm:.2f} / {band.force_rmse_percent or 0:.1f}"
                )
            click.echo(f"| {seed} | {holes} | {' | '.join(cells)} |")
    click.echo("")
    for name, all_figures in found.items():
        click.echo(row(name, all_figures))


if __name__ == "__main__":
    run_cli(main)
