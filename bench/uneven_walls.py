"""Force errors without and with the stiffness by place: ``python -m bench.uneven_walls FOLDER...``.

Each FOLDER is a press dataset, such as one of ``palpate-host simulate dataset --wall-unevenness 0.12``. It is
calibrated with all its train presses, and with some at random.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import click
import cv2
import msgspec
import numpy as np

from bench.accuracy_report import number, table
from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.evaluation import evaluate_dataset
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.entry_point import run_cli
from palpate_edge.datasets.press_dataset import PressDataset, read_dataset
from palpate_edge.estimation.calibration import Calibration

Numbers = tuple[float, float]
"""Force RMSE without and with the stiffness by place, % of the largest force."""


@click.command()
@click.argument("folders", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option("--presses", type=click.IntRange(5), default=20, show_default=True, help="Presses of a draw.")
@click.option("--draws", type=click.IntRange(0), default=4, show_default=True, help="Draws of each dataset.")
def main(folders: tuple[Path, ...], presses: int, draws: int) -> None:
    """Print the force errors of each FOLDER's test split, in % of the largest force."""
    cv2.setNumThreads(1)
    rows = []
    for folder in folders:
        dataset = read_dataset(folder)
        few = [_errors(folder, some) for some in _drawn(dataset, presses, draws)]
        rows += [(folder.name, f"{presses}, draw {draw}", *_texts(one)) for draw, one in enumerate(few)]
        if few:
            without, with_it = np.mean(few, axis=0).tolist()
            rows.append((folder.name, f"{presses}, mean", *_texts((without, with_it))))
        rows.append((folder.name, "all", *_texts(_errors(folder, dataset))))
    click.echo(table(("dataset", "presses", "without %", "with %"), rows))


def _drawn(dataset: PressDataset, presses: int, draws: int) -> Iterator[PressDataset]:
    """Yield the dataset with so many of its train presses, taken at random."""
    train, test = dataset.split("train"), dataset.split("test")
    for seed in range(draws):
        chosen = np.sort(np.random.default_rng(seed).choice(len(train), presses, replace=False))
        yield replace(dataset, presses=(*(train[index] for index in chosen), *test))


def _errors(folder: Path, dataset: PressDataset) -> Numbers:
    calibration = calibrate(dataset, dome=load_dome_model())
    even = msgspec.structs.replace(calibration, place_stiffness=msgspec.UNSET)
    return _error(folder, even), _error(folder, calibration)


def _error(folder: Path, calibration: Calibration) -> float:
    error = evaluate_dataset(folder, "test", calibration, folder, None).overall.force_rmse_percent
    return float("nan") if error is None else error


def _texts(errors: Numbers) -> tuple[str, ...]:
    return tuple(number(error, 2) for error in errors)


if __name__ == "__main__":
    run_cli(main)
