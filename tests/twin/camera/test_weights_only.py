"""A sensor of the twin calibrated with nothing but a kitchen scale: rendered frames, weights of 1 g steps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.calibration.evaluation import Figures, evaluate_dataset
from palpate_edge.cli.main import cli
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.datasets.weights_table import read_weight_rows
from palpate_edge.estimation.estimator import Estimator
from palpate_twin.cli.simulate import simulate

SEEDS = (301, 302, 311, 312, 313, 100, 101, 102)
"""Sensors that no constant was chosen on."""


def run(command: object, *words: str) -> str:
    result = CliRunner().invoke(command, words, catch_exceptions=False)  # type: ignore[arg-type]
    assert result.exit_code == 0, result.output
    return result.output


def figures(folder: Path, split: str = "test") -> Figures:
    path = folder.with_suffix(".cal")
    return evaluate_dataset(folder, split, load_calibration(path), path, None)


def position_errors_mm(folder: Path) -> dict[str, float]:
    """Return the error of each test frame that has an answer, by the frame's name."""
    estimator, dataset = Estimator(load_calibration(folder.with_suffix(".cal"))), read_dataset(folder)
    errors_mm = {}
    for number, press in enumerate(dataset.split("test")):
        frame = Frame(read_image(dataset.path(press)), round(1e6 * press.time_s), number, press.frame)
        contact = estimator.estimate(frame)
        if contact.position_mm is not None and press.position_mm is not None:
            errors_mm[press.frame] = float(
                np.linalg.norm(np.subtract(contact.position_mm, press.position_mm))
            )
    return errors_mm


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_a_kitchen_scale_gives_the_force_and_leaves_the_position(seed: int, tmp_path: Path) -> None:
    folder = tmp_path / "dome"
    run(
        simulate, "dataset", "-o", str(folder), "--random-seed", str(seed),
        "--presses", "0", "--test-presses", "60", "--weights", "12",
    )  # fmt: skip
    masses_g = [row.mass_g for row in read_weight_rows(folder / "weights.csv")]
    assert len(masses_g) == 12
    assert all(mass_g == round(mass_g) for mass_g in masses_g)
    assert [press.is_weighed for press in read_dataset(folder).split("train")] == [True] * 12
    text = run(cli, "calibrate", str(folder), "-o", str(folder.with_suffix(".cal")))
    assert "0 presses, 12 weighed" in text
    assert "from the weighed presses; it misses them by" in text
    with_weights = figures(folder)
    assert with_weights.overall.force_rmse_percent is not None
    assert with_weights.overall.force_rmse_percent <= 6
    assert with_weights.force_covered_percent is not None
    assert with_weights.force_covered_percent >= 85  # of some 60; 95 % less three sigma
    weighed = figures(folder, "train").weighed
    assert weighed is not None and weighed.count == 12
    assert weighed.rmse_percent <= 4
    errors_with = position_errors_mm(folder)
    (folder / "weights.csv").unlink()
    run(cli, "calibrate", str(folder), "-o", str(folder.with_suffix(".cal")))
    assert figures(folder).overall.force_rmse_N is None
    errors_without = position_errors_mm(folder)
    both = sorted(errors_with.keys() & errors_without.keys())
    # A faint touch near the limit of what is answered may be answered by one calibration only.
    assert len(both) >= max(len(errors_with), len(errors_without)) - 1
    mean_with, mean_without = (
        np.mean([some[name] for name in both]) for some in (errors_with, errors_without)
    )
    assert mean_with == pytest.approx(mean_without, rel=0.15)
