"""Presses of a pose model, turned about the sensor's axis by each turn that brings the layout onto itself.

A tip is never alike in all directions: its skin, its camera and its mounting each lean to one side, and a
regression on its presses learns that. The turned presses are those of tips that lean to other sides.
Regressions on each of them, averaged, are right about what such tips have in common.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_edge.calibration.pose.label_vectors import label_vectors
from palpate_edge.calibration.pose.rest_registration import register_turned
from palpate_edge.calibration.pose.transferred import PressesHere
from palpate_edge.common.arrays import Array

TURNS = 12  # tried, evenly spaced: those of a hexagon and those of a square are among them


def turned_presses(presses: PressesHere, rest_px: Array, labels: Sequence[str]) -> list[PressesHere]:
    """Return the presses of markers at rest (n, 2) as they are, and all of them after each turn.

    There is no turn where a pair of labels does not show how it turns with the image.
    """
    vectors = label_vectors(presses, labels)
    found = [presses]
    if any(vector.sense == 0 for vector in vectors):
        return found
    for number in range(1, TURNS):
        turn_rad = 2 * np.pi * number / TURNS
        registration = register_turned(rest_px, turn_rad)
        if registration is not None:
            targets = presses.targets.copy()
            for vector in vectors:
                turned = vector.in_image(targets) * np.exp(1j * turn_rad)
                targets[:, vector.places] = vector.parts(turned)
            found.append(
                PressesHere(registration.displacement_here(rest_px, presses.displacement_px), targets)
            )
    return found
