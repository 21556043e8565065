"""Conversion between a CiA 402 drive's integers and SI units."""

from __future__ import annotations

import math
from dataclasses import dataclass

FULL_SCALE_PER_MILLE = 1000


@dataclass(frozen=True, slots=True)
class DriveScale:
    """Units of one drive: 6076h in mN m, 6092h:01 in increments per turn of the joint."""

    rated_torque_mNm: int
    increments_per_turn: int

    def to_rad(self, increments: int) -> float:
        return increments * math.tau / self.increments_per_turn

    def to_increments(self, angle_rad: float) -> int:
        return round(angle_rad * self.increments_per_turn / math.tau)

    def to_per_mille(self, torque_Nm: float) -> int:
        """Return a torque in per mille of the rated torque, limited to +-1000.

        Rounded towards zero so that no torque limit is exceeded.
        """
        per_mille = math.trunc(torque_Nm * 1000.0 * FULL_SCALE_PER_MILLE / self.rated_torque_mNm)
        return max(-FULL_SCALE_PER_MILLE, min(FULL_SCALE_PER_MILLE, per_mille))

    def to_Nm(self, per_mille: int) -> float:
        return per_mille * self.rated_torque_mNm / (1000.0 * FULL_SCALE_PER_MILLE)
