"""An unattended run of 200 presses: a calibration from its labels against one from exact labels."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import pytest
from tests.twin.press_rig.rig_trial import RigTrial

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.evaluation import Figures, evaluate_dataset
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.press_rig.labels import label_run
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import Plan, single_presses, write_dataset
from palpate_twin.dome.probe import Probe
from palpate_twin.press_rig.virtual_rig import Placement

LONGEST_S = 1800
PLACE_TOLERANCE_MM = 0.05
FORCE_TOLERANCE_PERCENT = 1.0


def _with_exact_labels(trial: RigTrial, radius_mm: float, target: Path) -> Path:
    """Copy a run and replace its labels by the twin's."""
    shutil.copytree(trial.files.folder, target)
    with (target / "truth.csv").open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    for number, row in enumerate(rows):
        press, force_N = trial.truth[number]
        if press is None:
            continue
        normal_N = max(0.0, float(-force_N @ press.outward))
        row[3:10] = [f"{value:.5f}" for value in (*radius_mm * press.outward, normal_N, *force_N)]
    with (target / "truth.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])
    return target


def _figures(presses: Path, test: Path) -> Figures:
    calibration = calibrate(read_dataset(presses), dome=load_dome_model())
    return evaluate_dataset(test, "test", calibration, Path("none.cal"), None)


@pytest.mark.slow
def test_200_presses_calibrate_as_exact_labels_do(tmp_path: Path, view: CameraView) -> None:
    trial = RigTrial(tmp_path / "presses", view, Placement((0.8, -0.6, 0.0)), presses=200)
    start_us = trial.now_us
    trial.run()
    assert (trial.now_us - start_us) / 1e6 <= LONGEST_S
    report = label_run(trial.files.folder, trial.files.journal, load_dome_model())
    assert report.presses == 200
    assert report.tilt_deg == pytest.approx(2.0, abs=0.3)
    assert report.turn_deg == pytest.approx(2.0, abs=0.3)

    plan = Plan(train=0, test=100, probes=(Probe.SPHERE5,))
    test = tmp_path / "test"
    write_dataset(test, view, single_presses(view, plan, seed=9), plan.references, seed=9)
    exact = _with_exact_labels(trial, view.twin.sensor.dome.outer_radius_mm, tmp_path / "exact")
    rig_band, exact_band = (_figures(folder, test).overall for folder in (trial.files.folder, exact))
    for name, band in (("rig", rig_band), ("exact", exact_band)):
        print(f"{name}: {band.mean_mm:.3f} mm, {band.force_rmse_percent:.2f} %")
    moving_s = trial.rig.printer.moving_us / 1e6
    print(f"{(trial.now_us - start_us) / 1e6:.0f} s, {moving_s:.0f} s in motion; {report}")
    assert rig_band.mean_mm is not None and exact_band.mean_mm is not None
    assert rig_band.force_rmse_percent is not None and exact_band.force_rmse_percent is not None
    assert rig_band.mean_mm < exact_band.mean_mm + PLACE_TOLERANCE_MM
    assert rig_band.force_rmse_percent < exact_band.force_rmse_percent + FORCE_TOLERANCE_PERCENT
