"""Errors on real TacTips: ``python -m bench.accuracy_poses CLONE``, a clone of tactile_data_shear.

Each set's train folder calibrates and its val folder is evaluated, frame by frame; test folders are not
opened. The pictures have no licence and are not part of this project: docs/own-sensor.md says where they are.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import click
import cv2
import numpy as np

from bench.accuracy_report import Section, paragraph, table
from bench.pose_tears import torn_frames
from bench.tactip_dataset import make_dataset
from palpate_edge.calibration.pose.calibrate_pose import calibrate_pose
from palpate_edge.calibration.pose.pose_calibration_file import save_pose_calibration
from palpate_edge.calibration.pose.pose_evaluation import PoseFigures, evaluate_pose
from palpate_edge.common.entry_point import run_cli
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.pose_dataset import PoseDataset, read_pose_dataset
from palpate_edge.estimation.pose.pose_calibration import PoseCalibration
from palpate_edge.estimation.pose.pose_estimator import PoseEstimator

DEFAULT_CLONE = Path("../tactile_data_shear")
MOST_TORN = 0.5  # % of the frames that are answered
COVERED = (93.0, 97.0)  # % within the 95 % interval


@dataclass(frozen=True, slots=True)
class Case:
    """A set of the clone, its train and val folders, and train presses to take, None for all.

    goals: mean absolute errors over all frames, by the beginnings of labels.
    """

    folder: str
    train: str
    val: str
    presses: int | None
    goals: dict[str, float]

    def title(self) -> str:
        return f"{self.folder.split('/')[0]}, {self.presses or 'all'} presses"


CR = ("cr_tactip/surface_3d", "train_data", "val_data")
CASES = (
    Case(*CR, 200, {"depth": 0.10, "tilt": 0.8}),
    Case(*CR, 500, {"tilt": 0.6}),
    Case(*CR, None, {"depth": 0.07, "tilt": 0.30, "shear": 0.65, "torsion": 1.6}),
    Case(
        "franka_tactip_1/surface_3d",
        "train",
        "val",
        None,
        {"depth": 0.09, "tilt": 1.0, "shear": 0.50, "torsion": 1.15},
    ),
)


@dataclass(frozen=True, slots=True)
class CaseFigures:
    """Figures of one case; used: train presses learned from; calibrate_s: time of calibrating; torn: frames
    that are answered with torn labels."""

    case: Case
    figures: PoseFigures
    used: int
    calibrate_s: float
    torn: int


@click.command()
@click.argument("clone", type=click.Path(path_type=Path), default=DEFAULT_CLONE)
@click.option("--only", help="cases whose title has this text")
def main(clone: Path, only: str | None) -> None:
    """Print errors on the real TacTips in CLONE (default: ../tactile_data_shear)."""
    cv2.setNumThreads(1)
    found = measure(clone, lambda what: click.echo(what, err=True), only or "")
    click.echo(section(found).text)


def measure(clone: Path, report_progress: Callable[[str], None], only: str = "") -> list[CaseFigures]:
    """Measure the cases whose folders are in the clone and whose title has the text `only`."""
    measured = []
    for case in CASES:
        train, val = (clone / "data" / case.folder / name for name in (case.train, case.val))
        if only not in case.title():
            continue
        if not (train.is_dir() and val.is_dir()):
            report_progress(f"{case.title()}: skipped, {train} is not there")
            continue
        report_progress(case.title())
        with tempfile.TemporaryDirectory() as work:
            measured.append(_measure_case(case, train, val, Path(work)))
    return measured


def _measure_case(case: Case, train: Path, val: Path, work: Path) -> CaseFigures:
    folder, path = work / "dataset", work / "pose.cal"
    make_dataset(train, val, folder, case.presses)
    dataset = read_pose_dataset(folder)
    begin = time.monotonic()
    calibration = calibrate_pose(dataset)
    calibrate_s = time.monotonic() - begin
    save_pose_calibration(calibration, path)
    figures = evaluate_pose(folder, "test", calibration, path)
    torn = _answered_torn(dataset, calibration)
    return CaseFigures(case, figures, calibration.source.presses, calibrate_s, torn)


def _answered_torn(dataset: PoseDataset, calibration: PoseCalibration) -> int:
    """Return the number of test frames that are torn and answered."""
    estimator, rest_px = PoseEstimator(calibration), calibration.rest_px()
    twin = PoseEstimator(calibration)  # the first one takes a frame that comes again for a frozen camera
    displacement, found, poses = [], [], []
    for number, press in enumerate(dataset.split("test")):
        image = dataset.read(dataset.path(press), grey=calibration.appearance.channel == "grey")
        if estimator.estimate(Frame(image, number, number, press.frame)).valid:
            markers = twin.markers(image)
            displacement.append(markers.position_px - rest_px)
            found.append(markers.found)
            poses.append(press.values)
    if not poses:
        return 0
    torn = torn_frames(rest_px, np.array(displacement), np.array(found), np.array(poses))
    return int(torn.sum())


def section(measured: list[CaseFigures]) -> Section:
    """Return the figures beside their goals, or a line where no set is there."""
    head = "## Real TacTips"
    if not measured:
        line = "Not measured: `tactile_data_shear` was not there (see [own-sensor.md](own-sensor.md))."
        return Section(f"{head}\n\n{line}")
    rows, missed = [], []
    for item in measured:
        for label in item.figures.labels:
            goal = item.case.goals.get(label.label.split("_")[0])
            covered = label.covered_percent or 0.0
            rows.append(
                (
                    item.case.title(),
                    label.label,
                    f"{label.mean_all:.3f}",
                    "-" if goal is None else f"<= {goal:g}",
                    f"{covered:.1f} %",
                )
            )
            name = f"{item.case.title()}, {label.label}"
            if goal is not None and label.mean_all > goal:
                missed.append(f"Real TacTip, goal not met: {name}: {label.mean_all:.3f}, goal <= {goal:g}.")
            if not COVERED[0] <= covered <= COVERED[1]:
                missed.append(f"Real TacTip, {name}: the 95 % interval holds {covered:.1f} %.")
        if item.torn > MOST_TORN / 100 * item.figures.frames:
            missed.append(f"Real TacTip, {item.case.title()}: {item.torn} frames with torn labels answered.")
    frames = " ".join(
        f"{item.case.title()}: {item.used} learned from, {sum(item.figures.refused.values())} of "
        f"{item.figures.frames} frames refused, {item.torn} answered with torn labels."
        for item in measured
    )
    text = paragraph(f"""
        Pictures of real sensors with 331 pins, pressed on a plane in known poses; train folders calibrate,
        val folders are evaluated as single frames. Errors are means over all frames; a refused frame counts
        as a guess of the train mean. Torn labels are counted by `bench/pose_tears.py` from the true poses.
        {frames} Command: `python -m bench.accuracy_poses CLONE`. No set of a marker sensor has newtons:
        force has never been measured on real pictures.
        """)
    columns = ("presses", "label", "mean absolute error", "goal", "in 95 % interval")
    return Section("\n\n".join([head, text, table(columns, rows)]), tuple(missed))


if __name__ == "__main__":
    run_cli(main)
