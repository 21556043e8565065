"""The shapes of canonical fields as a function of the contact: of the dome model, and of the sensor itself.

The dome model's presses give a first expansion. A second one, of shorter reach, is fitted to what it leaves
of the sensor's own presses; a faint press counts less. Both are joined to one of few centres.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.calibration.training.answer_field import LENGTH, AnswerField, answers, evenly_forced
from palpate_edge.calibration.training.compress import compressed
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel
from palpate_edge.calibration.training.projection import Projection
from palpate_edge.calibration.training.samples import Samples
from palpate_edge.common.arrays import Array, Indices

DOME_RIDGE = 0.03
OWN_LENGTH, OWN_RIDGE = 0.7, 0.1  # ridge of a firm press
KEPT_CENTRES = 250
OWN_IMPORTANCE = 3.0  # of own presses where centres are left out, over the dome model's


def dome_shapes(projection: Projection, dome: DomeModel) -> AnswerField:
    """Return the shapes of the dome model's presses."""
    some = evenly_forced(dome.forces)
    size = np.linalg.norm(dome.fields[some], axis=1)
    points = answers(dome.directions[some], dome.forces[some], size)
    shapes = _shapes(projection, dome.fields[some])
    offset = np.asarray(shapes.mean(axis=0))
    gram = gaussian_kernel(points, points, LENGTH) + DOME_RIDGE * np.eye(len(points))
    return AnswerField(points, np.linalg.solve(gram, shapes - offset), offset)


def own_shapes(
    projection: Projection, base: AnswerField, samples: Samples, rows: Indices, kept: int = KEPT_CENTRES
) -> AnswerField:
    """Return the shapes that the dome model's become with some samples of the sensor.

    base: result of :func:`dome_shapes`; rows: of the samples; kept: number of centres at most.
    """
    rows = rows[np.linalg.norm(samples.forces_N[rows], axis=1) > 0]
    size = np.linalg.norm(samples.fields[rows], axis=1)
    points = answers(samples.directions[rows], samples.forces_N[rows], size)
    left = _shapes(projection, samples.fields[rows]) - _sum(base, points) - base.offset
    gram = gaussian_kernel(points, points, OWN_LENGTH) + OWN_RIDGE * np.diag(samples.faintness[rows] ** 2)
    weights = np.linalg.solve(gram, left)
    both = np.concatenate([points, base.centres])
    values = _sum(base, both) + gaussian_kernel(both, points, OWN_LENGTH) @ weights
    importance = np.repeat([OWN_IMPORTANCE, 1.0], [len(points), len(base.centres)])
    return AnswerField(
        *compressed(both, values, lambda a, b: gaussian_kernel(a, b, LENGTH), kept, importance), base.offset
    )


def _shapes(projection: Projection, fields: Array) -> Array:
    """Return the coefficients (s, p) of the shapes of fields (s, 2 g)."""
    size = np.linalg.norm(fields, axis=1, keepdims=True)
    return np.asarray((fields / size - projection.mean) @ projection.components)


def _sum(field: AnswerField, points: Array) -> Array:
    return np.asarray(gaussian_kernel(points, field.centres, LENGTH) @ field.weights)
