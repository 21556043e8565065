"""Errors of single beads' places in pictures of contacts, learned from the sensor's own presses.

Beads beside the dark edge of the opening, or amid the LEDs' reflections, are found as exactly as the others
in reference frames, but not when they move. A press shows this: its beads move as some mixture of the dome
model's typical fields. What a bead is off from the place that the other beads give it, beyond what such
mixtures leave open, is the error of its own place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_edge.calibration.training.samples import TrainingPress
from palpate_edge.calibration.training.typical_contacts import typical_fields
from palpate_edge.common.arrays import Array, Mask
from palpate_edge.estimation.displacement_field import DisplacementReader

ROUNDS = 4  # the errors of a bead's neighbours are part of what it seems to be off
HARMLESS = 0.02  # root mean square of the errors of all beads, or the error of one
LARGEST = 1.0  # variance; a bead with more is of no use anyway


def bead_errors(reader: DisplacementReader, presses: Sequence[TrainingPress], fields: Array) -> Array:
    """Return the standard deviations (n,) of the beads' places along an axis, over the root mean square of a
    press's displacement along an axis.

    fields (m, 2 g): of the dome model, as the sensor shows them; presses: at least one. Faint ones count
    less.
    """
    typical = typical_fields(reader, fields[:0], fields, smooths_all=False)
    found = np.array([press.beads.found for press in presses])
    moved_px = np.array([reader.displacement_px(press.beads) for press in presses]) * found[:, :, None]
    square = (moved_px**2).sum(axis=(1, 2)) / np.maximum(2 * found.sum(axis=1), 1)
    moved = moved_px / np.sqrt(np.maximum(square, 1e-12))[:, None, None]
    weight = found / np.array([press.faintness for press in presses])[:, None] ** 2
    scaled = np.asarray(typical.fields.array() * np.sqrt(typical.variance.array()), dtype=np.float64)
    masks, kind = np.unique(found, axis=0, return_inverse=True)
    variance = np.zeros(found.shape[1])
    for _ in range(ROUNDS):
        beyond = np.zeros_like(weight)
        for number, mask in enumerate(masks):
            same = kind.ravel() == number
            beyond[same] = _beyond(moved[same], scaled, typical.remainder, variance, mask)
        variance = (weight * beyond).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-12)
        variance = np.clip(variance, 0.0, LARGEST)
    return np.sqrt(variance)


def are_harmless(errors: Array) -> bool:
    """Return whether errors (n,) of the beads' places are too small, together, to be reckoned with."""
    return float(np.sqrt((errors**2).mean())) < HARMLESS


def _beyond(moved: Array, scaled: Array, remainder: float, variance: Array, found: Mask) -> Array:
    """Return the squares (p, n), per axis, of what beads are off from the places that the others give them,
    without what the typical fields leave open.

    moved (p, n, 2): of mean square 1; scaled (2 n, k): typical fields times their standard deviations; found
    (n,): the same beads in all of these presses.
    """
    count = len(found)
    trust = np.repeat(found / (remainder + variance), 2)
    trusted = trust[:, None] * scaled
    within = np.linalg.inv(np.eye(scaled.shape[1]) + scaled.T @ trusted)
    spread = (trusted @ within).reshape(count, 2, -1)
    blocks = -spread @ trusted.reshape(count, 2, -1).transpose(0, 2, 1)  # of the inverse covariance
    blocks[:, (0, 1), (0, 1)] += trust.reshape(count, 2)
    blocks[~found] = np.eye(2)
    rows = moved.reshape(len(moved), -1)
    pull = trust * rows - (rows @ trusted) @ within @ trusted.T
    open_ = np.linalg.inv(blocks)
    off = np.matvec(open_, pull.reshape(len(moved), count, 2))
    explained = np.trace(open_, axis1=1, axis2=2) - 2 * variance
    return np.asarray(((off**2).sum(axis=2) - explained) / 2)
