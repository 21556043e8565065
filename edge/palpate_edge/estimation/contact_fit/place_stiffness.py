"""The stiffness by place: what one sensor's wall changes in the correction model's forces."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from palpate_edge.common.contact import Vector3, tangential_force_N
from palpate_edge.estimation.pose.kernel_expansion import Expansion, ExpansionRunner, PackedArray


class PlaceStiffness(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Expansions about contact places.

    centres (c, 3): unit vectors in F; log_ratio: logarithm of the force over the correction model's; slant:
    force (3,) in F along the surface that is added, over the size of the force. It is unset where it does not
    help and in older files.
    """

    centres: PackedArray
    log_ratio: Expansion
    slant: Expansion | msgspec.UnsetType = msgspec.UNSET


class StiffnessMap:
    """Computes what the wall at a contact's place changes in the force."""

    def __init__(self, stiffness: PlaceStiffness) -> None:
        self._centres = stiffness.centres.array()
        self._log_ratio = ExpansionRunner(stiffness.log_ratio, self._centres)
        slant = stiffness.slant
        self._slant = ExpansionRunner(slant, self._centres) if isinstance(slant, Expansion) else None

    def ratio(self, direction: Vector3) -> float:
        """Return the force over the correction model's at a unit vector of F, but for the slant."""
        return math.exp(float(self._log_ratio.at(np.array(direction, np.float32))[0]))

    def slant(self, direction: Vector3) -> Vector3:
        """Return the force along the surface that is added at a unit vector of F, over the force's size."""
        if self._slant is None:
            return 0.0, 0.0, 0.0
        x, y, z = self._slant.at(np.array(direction, np.float32)).tolist()
        return tangential_force_N(direction, (x, y, z))

    def corrected(self, direction: Vector3, force_N: Vector3) -> Vector3:
        """Return the force of this wall in place of the correction model's, at a unit vector of F."""
        ratio = self.ratio(direction)
        size_N = ratio * math.hypot(*force_N)
        (x, y, z), (along_x, along_y, along_z) = force_N, self.slant(direction)
        return ratio * x + size_N * along_x, ratio * y + size_N * along_y, ratio * z + size_N * along_z

    def extremes(self) -> tuple[float, float]:
        """Return the least and the largest ratio at the places of the presses that it was learned from."""
        ratios = [self.ratio((x, y, z)) for x, y, z in self._centres.tolist()]
        return min(ratios), max(ratios)
