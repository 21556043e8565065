"""Contacts -> the typical fields of one sensor's beads, by which noisy displacements are smoothed.

A dome is the same all around. Therefore each canonical field, of norm 1, is turned to all azimuths; the
principal components of the displacements that it would give the sensor's beads are the typical fields.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.estimation.displacement_field import DisplacementReader, interpolation, mirrored
from palpate_edge.estimation.field_smoothing.typical_fields import TypicalFields
from palpate_edge.estimation.pose.kernel_expansion import packed

KEPT = 60  # fields; those of the twin's domes leave 0.5 % of the displacement's variance
TURNS = 24  # azimuths
DOME_PRESSES = 200.0  # own presses that weigh as much as the whole dome model
# The same where fields only fill in hidden beads: nothing is smoothed, and exact presses teach well.
KEPT_TO_FILL, DOME_PRESSES_TO_FILL = 100, 20.0
LEAST_REMAINDER = 1e-6


def typical_fields(
    reader: DisplacementReader, own: Array, dome: Array, *, smooths_all: bool
) -> TypicalFields:
    """Return the principal fields of a sensor's own presses (m, 2 g), m >= 0, and the dome model's (n, 2 g).

    reader: of the sensor's beads; own: read without typical fields; smooths_all: see TypicalFields.
    """
    second_moment = _second_moment(dome)
    if len(own):
        share = len(own) / (len(own) + (DOME_PRESSES if smooths_all else DOME_PRESSES_TO_FILL))
        both = np.concatenate([own, mirrored(own)])
        second_moment = (1 - share) * second_moment + share * _second_moment(both)
    beads, mm_per_px = reader.geometry
    px_per_mm = np.linalg.pinv(mm_per_px)
    covariance = np.zeros((2 * len(beads), 2 * len(beads)))
    for turn_rad in 2 * np.pi * np.arange(TURNS) / TURNS:
        seen = (px_per_mm @ interpolation(beads, float(turn_rad))).reshape(len(covariance), -1)
        covariance += seen @ second_moment @ seen.T
    variance, fields = np.linalg.eigh(covariance / np.trace(covariance) * len(covariance))
    variance, fields = variance[::-1], fields[:, ::-1]
    most = KEPT if smooths_all else KEPT_TO_FILL
    kept = min(most, int(np.count_nonzero(variance > LEAST_REMAINDER)))
    remainder = max(float(variance[kept:].sum()) / len(variance), LEAST_REMAINDER)
    return TypicalFields(packed(fields[:, :kept]), packed(variance[:kept]), remainder, smooths_all)


def _second_moment(fields: Array) -> Array:
    """Return the second moment (2 g, 2 g) of fields (n, 2 g), each of norm 1."""
    shapes = fields / np.linalg.norm(fields, axis=1, keepdims=True)
    return np.asarray(shapes.T @ shapes / len(shapes))
