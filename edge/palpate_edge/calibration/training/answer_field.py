"""The way back: from an answer (place and direction of force) to the field that such a contact makes.

A frame spliced of two presses has beads that move like some press in each half, and the correction model
finds an answer between them. No single contact makes such a field: what the answer's own field leaves of it
is the *misfit*, squared, both fields of size 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.training.compress import compressed
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel
from palpate_edge.calibration.training.samples import Samples
from palpate_edge.common.arrays import Array, Indices
from palpate_edge.estimation.contact_fit.contact_fields import FORCE_WEIGHT, PLACE_WEIGHT, SIZE_WEIGHT

LENGTH = 1.0
# The dome's fields count little where the sensor's own are near, those of another camera least.
OWN_RIDGE, SEEN_RIDGE, DOME_RIDGE = 1e-3, 1e-2, 1e-1
MOST_CENTRES = 800  # of each kind: an answer has but five degrees of freedom
KEPT_CENTRES = 250


@dataclass(frozen=True, slots=True)
class AnswerField:
    """Kernel expansion from answers to shapes in the projection's components: centres (k, 7), weights (k, p),
    offset (p,)."""

    centres: Array
    weights: Array
    offset: Array

    def shapes(self, directions: Array, forces: Array, sizes: Array) -> Array:
        """(s, p) of answers, see :func:`answers`."""
        return np.asarray(
            _gauss(answers(directions, forces, sizes), self.centres) @ self.weights + self.offset
        )


def answers(directions: Array, forces: Array, sizes: Array) -> Array:
    """(s, 7) points of the kernel's space from unit directions (s, 3), forces (s, 3), fields' sizes (s,)."""
    way = forces / np.linalg.norm(forces, axis=1, keepdims=True)
    size = SIZE_WEIGHT * np.log(sizes)[:, None]
    return np.concatenate([PLACE_WEIGHT * directions, FORCE_WEIGHT * (way + directions), size], axis=1)


def evenly_forced(forces: Array) -> Indices:
    """Return presses with a force (s, 3), `MOST_CENTRES` at most, evenly from first to last."""
    forced = np.flatnonzero(np.linalg.norm(forces, axis=1) > 0)
    return forced[np.linspace(0, len(forced) - 1, min(len(forced), MOST_CENTRES)).astype(np.intp)]


def fit_answer_field(
    mean: Array, components: Array, samples: Samples | None, dome: DomeModel | None
) -> AnswerField:
    """From the sensor's own plain samples and the dome model's presses (at least one of them).

    mean (2 g,), components (2 g, p): the projection of shapes.
    """
    parts = []
    if samples is not None:
        plain = np.flatnonzero(samples.plain)
        parts.append((samples.fields, samples.directions, samples.forces_N, plain, OWN_RIDGE))
    if dome is not None:
        ridge = SEEN_RIDGE if dome.is_seen else DOME_RIDGE
        parts.append((dome.fields, dome.directions, dome.forces, np.arange(len(dome.fields)), ridge))
    centres, shapes, ridges = [], [], []
    for fields, directions, forces, usable, ridge in parts:
        some = usable[evenly_forced(forces[usable])]
        size = np.linalg.norm(fields[some], axis=1)
        centres.append(answers(directions[some], forces[some], size))
        shapes.append((fields[some] / size[:, None] - mean) @ components)
        ridges.append(np.full(len(some), ridge))
    points, target = np.concatenate(centres), np.concatenate(shapes)
    offset = np.asarray(target.mean(axis=0))
    gram, each_ridge = _gauss(points, points), np.concatenate(ridges)
    fitted = gram @ np.linalg.solve(gram + np.diag(each_ridge), target - offset)
    return AnswerField(*compressed(points, fitted, _gauss, KEPT_CENTRES, each_ridge**-0.25), offset)


def _gauss(a: Array, b: Array) -> Array:
    return gaussian_kernel(a, b, LENGTH)
