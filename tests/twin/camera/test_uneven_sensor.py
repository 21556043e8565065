"""A sensor of the twin whose wall is not equally stiff everywhere, calibrated as by its user."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.calibration.evaluation import evaluate_dataset
from palpate_edge.cli.main import cli
from palpate_twin.cli.simulate import simulate


def run(command: object, *words: str) -> str:
    result = CliRunner().invoke(command, words, catch_exceptions=False)  # type: ignore[arg-type]
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.slow
def test_the_stiffness_by_place_brings_forces_nearer_to_the_truth(tmp_path: Path) -> None:
    """Seed 2101 with 40 presses; with 20 not each draw of presses shows that the wall is uneven."""
    folder, path = tmp_path / "dome", tmp_path / "dome.cal"
    run(
        simulate, "dataset", "-o", str(folder), "--random-seed", "2101", "--presses", "40",
        "--test-presses", "60", "--wall-unevenness", "0.12", "--probe", "plate", "--probe", "sphere5",
    )  # fmt: skip
    text = run(cli, "calibrate", str(folder), "-o", str(path))
    assert "stiffness by place: forces x " in text
    learned = load_calibration(path)
    even = msgspec.structs.replace(learned, place_stiffness=msgspec.UNSET)
    with_it, without = (
        evaluate_dataset(folder, "test", calibration, path, None) for calibration in (learned, even)
    )
    assert with_it.overall.force_rmse_percent is not None and without.overall.force_rmse_percent is not None
    assert with_it.overall.force_rmse_percent < without.overall.force_rmse_percent
    assert with_it.overall.mean_mm == without.overall.mean_mm
    assert with_it.force_covered_percent is not None and with_it.force_covered_percent >= 85
