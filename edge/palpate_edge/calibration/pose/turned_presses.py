"""Presses of a pose model, turned about the sensor's axis by each turn that brings the layout onto itself.

A tip is never alike in all directions: its skin, its camera and its mounting each lean to one side, and a
regression on its presses learns that. The turned presses are those of tips that lean to other sides.
Regressions on each of them, averaged, are right about what such tips have in common.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_edge.calibration.pose.label_axes import PAIRS
from palpate_edge.calibration.pose.rest_registration import register_turned
from palpate_edge.calibration.pose.transferred import PressesHere
from palpate_edge.common.arrays import Array

TURNS = 12  # tried, evenly spaced: those of a hexagon and those of a square are among them
LEAST_DETERMINANT = 0.01  # of the correlations of a pair of labels with the markers' mean displacement


def turned_presses(presses: PressesHere, rest_px: Array, labels: Sequence[str]) -> list[PressesHere]:
    """Return the presses of markers at rest (n, 2) as they are, and all of them after each turn.

    There is no turn where a pair of labels does not show how it turns with the image.
    """
    pairs = _pairs(presses, labels)
    found = [presses]
    if any(sense == 0 for _, sense in pairs):
        return found
    for number in range(1, TURNS):
        turn_rad = 2 * np.pi * number / TURNS
        registration = register_turned(rest_px, turn_rad)
        if registration is not None:
            targets = presses.targets.copy()
            for places, sense in pairs:
                turned = targets[:, places] @ (1, 1j) * np.exp(1j * sense * turn_rad)
                targets[:, places] = np.stack([turned.real, turned.imag], axis=1)
            found.append(
                PressesHere(registration.displacement_here(rest_px, presses.displacement_px), targets)
            )
    return found


def _pairs(presses: PressesHere, labels: Sequence[str]) -> list[tuple[list[int], int]]:
    """Return the places of each pair of labels that is a vector, with its sense: 1 where its y follows its x
    as the image's does, -1 where it is mirrored, 0 where that is not known.

    The markers' mean displacement shows it: it turns with the vectors of tilt and of shear.
    """
    mean_px = presses.displacement_px.reshape(len(presses.targets), -1, 2).mean(axis=1)
    found = []
    for pair in PAIRS:
        if set(pair) <= set(labels):
            places = [labels.index(label) for label in pair]
            both = np.corrcoef(presses.targets[:, places], mean_px, rowvar=False)
            determinant = float(np.linalg.det(both[:2, 2:]))
            is_known = abs(determinant) > LEAST_DETERMINANT
            found.append((places, int(np.sign(determinant)) if is_known else 0))
    return found
