"""The sensor's stiffness from presses at the apex under known weights: the scale of the dome model's forces.

The pan of a scale, or a flat weight, touches a dome where their normals agree. Therefore the mass is the
normal force also when a hand tilts the sensor by some degrees. The place is not needed: the dome model
estimates it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.samples import WeighedSamples
from palpate_edge.calibration.training.uncertainty.interval import Interval
from palpate_edge.common.arrays import Array

# 95 % radius of the force vector at the dome model's median force, over that force, and its power of the
# force: six sensors of the twin (seeds 40 to 43, 46, 47) with twelve weighed presses each.
FORCE_SHARE, FORCE_POWER = 0.25, 0.32
HIDDEN_SLOPE = 1.3  # as for the position without presses, see confidence_radius


@dataclass(frozen=True, slots=True)
class ApexStiffness:
    """scale: the sensor's forces over the dome model's; spread: root mean square of what the scaled model
    misses the weights by, over the largest weight."""

    scale: float
    spread: float


def apex_stiffness(answers: Array, weighed: WeighedSamples) -> ApexStiffness:
    """Return the stiffness by least squares.

    answers (w, 6): the dome model's direction of any length, and force over the field's size in N/mm, for
    each weighed press.
    """
    outward = answers[:, :3] / np.linalg.norm(answers[:, :3], axis=1, keepdims=True)
    size = np.linalg.norm(weighed.fields, axis=1)
    model_N = -(answers[:, 3:] * outward).sum(axis=1) * size
    scale = float(model_N @ weighed.normal_N / (model_N @ model_N))
    missed_N = scale * model_N - weighed.normal_N
    return ApexStiffness(scale, float(np.sqrt((missed_N**2).mean()) / weighed.normal_N.max()))


def typical_force_interval(dome: DomeModel, scale: float) -> Interval:
    """Return the force's 95 % radius where only the apex was weighed: a function of the force that the dome
    model typically has at the field's size."""
    force_N = scale * np.linalg.norm(dome.forces, axis=1)
    slope, level = np.polyfit(np.log(np.linalg.norm(dome.fields, axis=1)), np.log(force_N), 1).tolist()
    log_median = float(np.log(np.median(force_N)))
    at_median = log_median + float(np.log(FORCE_SHARE))
    return Interval(at_median + FORCE_POWER * (level - log_median), FORCE_POWER * slope, HIDDEN_SLOPE)
