"""Presses of a pose model as another sensor of its kind would have shown them, and what they predict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.pose.pose_model import PoseModel
from palpate_edge.calibration.pose.principal_modes import principal_modes
from palpate_edge.calibration.pose.regression.kernel_regression import choose_settings, fit
from palpate_edge.calibration.pose.rest_registration import register_rest
from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import CalibrationError
from palpate_edge.estimation.pose.kernel_expansion import ExpansionRunner

MODES = 40
POWERS, LENGTHS = (0.0, 0.5), (1.0, 2.0, 4.0)


@dataclass(frozen=True, slots=True)
class PressesHere:
    """displacement_px (s, 2 n) in this sensor's image, its markers in its order; targets (s, k)."""

    displacement_px: Array
    targets: Array


def presses_here(model: PoseModel, rest_px: Array, labels: Sequence[str]) -> PressesHere:
    """Return a model's presses on a sensor with markers at rest (n, 2), and their values of `labels`.

    Raises CalibrationError when the layouts differ or the model has not learned a label.
    """
    missing = [label for label in labels if label not in model.labels]
    if missing:
        raise CalibrationError(
            f"the pose model has no {', '.join(missing)}, it has {', '.join(model.labels)}: drop the column, "
            "or train a model with it"
        )
    registration = register_rest(rest_px, model.rest_px)
    columns = [model.labels.index(label) for label in labels]
    return PressesHere(
        registration.displacement_here(model.rest_px, model.displacement_px), model.targets[:, columns]
    )


def predicted_labels(presses: PressesHere, displacement_px: Array) -> Array:
    """Return the labels (m, k) of displacements (m, 2 n) by a plain kernel regression on presses."""
    modes = principal_modes(presses.displacement_px, MODES)
    points = modes.coordinates(presses.displacement_px)
    (settings,) = choose_settings(points, modes.variance, [presses.targets], POWERS, LENGTHS)
    fitted = fit(points, settings.metric(modes.variance), presses.targets, settings.ridge)
    runner = ExpansionRunner(fitted.expansion, points)
    coordinates = modes.coordinates(displacement_px).astype(np.float32)
    return np.array([runner.at(point) for point in coordinates], dtype=np.float64)
