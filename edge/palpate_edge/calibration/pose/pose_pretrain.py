"""Pose datasets of several sensors of one kind -> a pose model that the next one can start from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from palpate_edge.calibration.pose.label_axes import AxisChange, declared_change, measured_change
from palpate_edge.calibration.pose.pose_model import PoseModel
from palpate_edge.calibration.pose.press_matching import FEWEST_PRESSES, match_presses
from palpate_edge.calibration.pose.rest_markers import find_rest_markers
from palpate_edge.calibration.pose.spots import press_spots
from palpate_edge.calibration.pose.transferred import PressesHere, predicted_labels, presses_here
from palpate_edge.calibration.pose.untouched_rest import untouched_offset
from palpate_edge.common.errors import CalibrationError, DatasetError
from palpate_edge.datasets.pose_dataset import PoseDataset, is_pose_dataset, read_pose_dataset

MOST_PRESSES = 3000  # of a model; more take long in every calibration that starts from it


def pretrain_poses(
    folders: Sequence[Path], progress: Callable[[int, int], None] = lambda _done, _total: None
) -> PoseModel:
    """Return the train presses of all datasets, brought to the first one's image and axes.

    Raises DatasetError for a dataset without pose labels or with other ones, CalibrationError when markers
    cannot be followed or layouts differ.
    """
    for folder in folders:
        if not is_pose_dataset(folder):
            raise DatasetError(
                f"{folder} is not a pose dataset, another one is: a model is made from press datasets or "
                "from pose datasets, not from both"
            )
    datasets = [read_pose_dataset(folder) for folder in folders]
    for dataset in datasets[1:]:
        if dataset.labels != datasets[0].labels:
            raise DatasetError(
                f"{dataset.folder / 'truth.csv'} has the labels {', '.join(dataset.labels)}, "
                f"{datasets[0].folder} has {', '.join(datasets[0].labels)}: give datasets with the same ones"
            )
    most = max(FEWEST_PRESSES, MOST_PRESSES // len(datasets))
    total = sum(min(most, len(dataset.split("train"))) for dataset in datasets)
    parts: list[PoseModel] = []
    before = 0

    def report(done: int) -> None:
        progress(before + done, total)

    for dataset in datasets:
        part = _measured(dataset, most, report)
        before += min(most, len(dataset.split("train")))
        parts.append(_brought(part, parts[0]) if parts else part)
    return PoseModel(
        parts[0].rest_px,
        np.concatenate([part.displacement_px for part in parts]),
        parts[0].labels,
        np.concatenate([part.targets for part in parts]),
        parts[0].axes,
    )


def _measured(dataset: PoseDataset, most: int, progress: Callable[[int], None]) -> PoseModel:
    """Return a model of one sensor's presses, at most `most` of them."""
    presses = dataset.split("train")
    if len(presses) < FEWEST_PRESSES:
        raise CalibrationError(
            f"{dataset.folder / 'truth.csv'} has {len(presses)} rows of the split train, a pose model needs "
            f"at least {FEWEST_PRESSES} of each sensor"
        )
    some = np.linspace(0, len(presses) - 1, min(most, len(presses))).astype(int).tolist()
    presses = tuple(presses[place] for place in some)
    rest = find_rest_markers(dataset)
    matched = match_presses(rest.position_px, press_spots(dataset, presses, rest, progress))
    targets = np.array([press.values for press in presses])[matched.good]
    displacement = matched.displacement_px[matched.good]
    offset = untouched_offset(rest.position_px, displacement, targets, dataset.labels)
    return PoseModel(
        rest.position_px + offset.reshape(-1, 2),
        displacement - offset,
        dataset.labels,
        targets,
        dataset.sensor.labels or None,
    )


def _brought(part: PoseModel, first: PoseModel) -> PoseModel:
    """Return another sensor's presses in the first one's image and about its axes."""
    here = presses_here(part, first.rest_px, first.labels)
    if part.axes is not None and first.axes is not None:
        change = declared_change(part.axes, first.axes)
    else:
        own = PressesHere(first.displacement_px, first.targets)
        predicted = predicted_labels(own, here.displacement_px)
        change = measured_change(here.targets, predicted, first.labels) or AxisChange()
    return PoseModel(
        first.rest_px,
        here.displacement_px,
        first.labels,
        change.applied(here.targets, first.labels),
        first.axes,
    )
