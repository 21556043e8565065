"""The stiffness by place: how much stiffer or softer one sensor's wall is than the correction model's."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from palpate_edge.common.contact import Vector3
from palpate_edge.estimation.pose.kernel_expansion import Expansion, ExpansionRunner, PackedArray


class PlaceStiffness(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Logarithm of the force over the correction model's, as an expansion about contact places.

    centres (c, 3): unit vectors in F.
    """

    centres: PackedArray
    log_ratio: Expansion


class StiffnessMap:
    """Computes the ratio of forces at a contact's place."""

    def __init__(self, stiffness: PlaceStiffness) -> None:
        self._centres = stiffness.centres.array()
        self._runner = ExpansionRunner(stiffness.log_ratio, self._centres)

    def ratio(self, direction: Vector3) -> float:
        """Return the force over the correction model's at a unit vector of F."""
        return math.exp(float(self._runner.at(np.array(direction, np.float32))[0]))

    def extremes(self) -> tuple[float, float]:
        """Return the least and the largest ratio at the places of the presses that it was learned from."""
        ratios = [self.ratio((x, y, z)) for x, y, z in self._centres.tolist()]
        return min(ratios), max(ratios)
