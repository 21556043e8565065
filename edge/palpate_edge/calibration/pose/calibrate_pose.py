"""Pose dataset -> PoseCalibration."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np

from palpate_edge.calibration.measurement import dropped_presses
from palpate_edge.calibration.pose.press_matching import FEWEST_PRESSES, match_presses
from palpate_edge.calibration.pose.regression.label_regression import fit_labels
from palpate_edge.calibration.pose.rest_markers import find_rest_markers
from palpate_edge.calibration.pose.spots import press_spots
from palpate_edge.common.errors import CalibrationError
from palpate_edge.datasets.pose_dataset import PoseDataset
from palpate_edge.estimation.calibration import CalibrationSource
from palpate_edge.estimation.pose.kernel_expansion import packed
from palpate_edge.estimation.pose.pose_calibration import PoseCalibration


def calibrate_pose(
    dataset: PoseDataset, progress: Callable[[int, int], None] = lambda _done, _total: None
) -> PoseCalibration:
    """Calibrate a sensor with its reference frames and the train split of its presses.

    Raises CalibrationError when the markers are not found or cannot be followed, DatasetError for bad files.
    """
    presses = dataset.split("train")
    if len(presses) < FEWEST_PRESSES:
        raise CalibrationError(
            f"{dataset.folder / 'truth.csv'} has {len(presses)} rows of the split train, at least "
            f"{FEWEST_PRESSES} are needed"
        )
    rest = find_rest_markers(dataset)
    spots = press_spots(dataset, presses, rest, lambda done: progress(done, len(presses) + 1))
    matched = match_presses(rest.position_px, spots)
    good = matched.good
    points = matched.modes.coordinates(matched.displacement_px[good])
    targets = np.array([press.values for press in presses])[good]
    fitted = fit_labels(points, matched.modes.variance, targets, dataset.labels)
    dropped = dropped_presses(
        "markers could not be followed",
        [press for press, kept in zip(presses, good.tolist(), strict=True) if not kept],
    )
    progress(len(presses) + 1, len(presses) + 1)
    return PoseCalibration(
        sensor=dataset.sensor,
        appearance=rest.appearance,
        diameter_px=rest.diameter_px,
        weakest_strength=rest.weakest_strength,
        beads=tuple((x, y) for x, y in rest.position_px.tolist()),
        contact_threshold_px=rest.contact_threshold_px,
        labels=dataset.labels,
        mean=tuple(targets.mean(axis=0).tolist()),
        displacement=matched.modes.as_modes(),
        guide=matched.guide,
        centres=packed(points),
        groups=fitted.groups,
        half_widths=fitted.half_widths,
        source=CalibrationSource(
            dataset.folder.resolve().name, len(dataset.reference), int(good.sum()), dropped
        ),
        local=fitted.local or msgspec.UNSET,
        networks=fitted.networks or msgspec.UNSET,
    )
