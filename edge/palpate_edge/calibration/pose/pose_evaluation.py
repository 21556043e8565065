"""Figures of a pose estimator against a pose dataset's truth, and their table for people."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from palpate_edge.calibration.evaluation import StageTime
from palpate_edge.calibration.stopwatch import Stopwatch
from palpate_edge.common.arrays import Array
from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import CalibrationError, DatasetError
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.pose_dataset import PoseDataset, read_pose_dataset
from palpate_edge.datasets.truth_table import check_split_has_rows
from palpate_edge.estimation.pose.pose_calibration import PoseCalibration
from palpate_edge.estimation.pose.pose_estimator import PoseEstimator


class LabelFigures(msgspec.Struct, frozen=True):
    """Absolute errors of one label in its unit.

    mean, p95, covered_percent (within the 95 % interval): of the answered frames, None without any;
    mean_all: of all frames, where a refused one counts as a guess of the calibration's mean.
    """

    label: str
    mean: float | None
    p95: float | None
    covered_percent: float | None
    mean_all: float


class PoseFigures(msgspec.Struct, frozen=True):
    """All figures of one evaluation."""

    dataset: str
    split: str
    frames: int
    labels: tuple[LabelFigures, ...]
    refused: dict[str, int]
    times: tuple[StageTime, ...]


def evaluate_pose(
    folder: Path,
    split: str,
    calibration: PoseCalibration,
    calibration_path: Path,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> PoseFigures:
    """Estimate every frame of a split and compare.

    Raises DatasetError when the split has no row or a learned label is missing, CalibrationError when the
    dataset is of another sensor.
    """
    dataset = read_pose_dataset(folder)
    check_pose_sensor(calibration, calibration_path, dataset)
    presses = dataset.split(split)
    labels = [label for label in calibration.labels if label in dataset.labels]
    check_split_has_rows(folder, split, presses)
    if not labels:
        raise DatasetError(
            f"{folder / 'truth.csv'} has none of the labels of {calibration_path}: "
            f"{', '.join(calibration.labels)}"
        )
    estimator, watch, contacts = PoseEstimator(calibration), Stopwatch(), []
    for number, press in enumerate(presses):
        with watch.stage("read image"):
            image = dataset.read(dataset.path(press), grey=calibration.appearance.channel == "grey")
        with watch.stage("estimate"):
            contacts.append(estimator.estimate(Frame(image, number, number, press.frame)))
        progress(number + 1, len(presses))
    truth = np.array([press.values for press in presses])
    return PoseFigures(
        dataset=folder.resolve().name,
        split=split,
        frames=len(presses),
        labels=tuple(
            _figures(label, truth[:, dataset.labels.index(label)], contacts, calibration) for label in labels
        ),
        refused=dict(Counter(contact.reason for contact in contacts if not contact.valid)),
        times=tuple(StageTime(stage, *watch.median_and_p99_ms(stage)) for stage in watch.stages),
    )


def check_pose_sensor(calibration: PoseCalibration, calibration_path: Path, dataset: PoseDataset) -> None:
    """Raise CalibrationError when a dataset's images have another size than the calibration's."""
    ours, theirs = calibration.sensor.image_size_px, dataset.sensor.image_size_px
    if ours != theirs:
        raise CalibrationError(
            f"calibration {calibration_path} is for images of {ours[0]}x{ours[1]}, {dataset.folder} has "
            f"{theirs[0]}x{theirs[1]}: make one for it with palpate-edge calibrate"
        )


def _figures(label: str, truth: Array, contacts: list[Contact], calibration: PoseCalibration) -> LabelFigures:
    place = calibration.labels.index(label)
    estimates = [contact.pose[place] if contact.valid else None for contact in contacts]
    error = np.array(
        [
            abs(known - (calibration.mean[place] if estimate is None else estimate.value))
            for estimate, known in zip(estimates, truth.tolist(), strict=True)
        ]
    )
    answered = np.array([estimate is not None for estimate in estimates])
    half_width = np.array([estimate.half_width95 for estimate in estimates if estimate is not None])
    if not answered.any():
        return LabelFigures(label, None, None, None, float(error.mean()))
    return LabelFigures(
        label=label,
        mean=float(error[answered].mean()),
        p95=float(np.percentile(error[answered], 95)),
        covered_percent=float(100 * (error[answered] <= half_width).mean()),
        mean_all=float(error.mean()),
    )


def pose_table(figures: PoseFigures) -> str:
    """Return the figures for people."""
    head = ("label", "mean", "p95", "in 95% interval", "mean of all frames")
    rows = [
        head,
        *(
            (
                figure.label,
                *("-" if value is None else f"{value:.3f}" for value in (figure.mean, figure.p95)),
                "-" if figure.covered_percent is None else f"{figure.covered_percent:.1f} %",
                f"{figure.mean_all:.3f}",
            )
            for figure in figures.labels
        ),
    ]
    width = [max(len(row[column]) for row in rows) for column in range(len(head))]
    lines = [
        "  ".join(
            [row[0].ljust(width[0]), *(cell.rjust(w) for cell, w in zip(row[1:], width[1:], strict=True))]
        )
        for row in rows
    ]
    refused = "".join(f"; {count} x {reason}" for reason, count in figures.refused.items())
    return "\n".join(
        [
            f"{figures.dataset}, split {figures.split}: {figures.frames} frames, absolute errors",
            *lines,
            f"refused: {sum(figures.refused.values())} of {figures.frames}{refused}",
            *(
                f"{time.stage}: {time.median_ms:.2f} ms median, {time.p99_ms:.2f} ms p99"
                for time in figures.times
            ),
        ]
    )
