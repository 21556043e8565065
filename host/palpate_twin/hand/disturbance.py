"""The loads that disturb the grasped object: forces, torques, added mass, changed friction, on a schedule."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.config.twin_config import DisturbanceConfig


@dataclass(frozen=True, slots=True)
class Load:
    """The sum of the loads at one time; friction is None when it is the tips' own.

    force_N, torque_Nm: (3,) in the hand's frame, at the object's centre of mass, without the added weight.
    """

    force_N: Array
    torque_Nm: Array
    added_mass_kg: float
    friction: float | None


class Schedule:
    """The disturbances of a run, which the engine follows step by step."""

    def __init__(self, disturbances: Sequence[DisturbanceConfig], step_s: float) -> None:
        """step_s: a load acts from the step that begins nearest to its start."""
        self._disturbances, self._early_s = tuple(disturbances), 0.5 * step_s
        ends = [one.start_s + one.duration_s for one in disturbances]
        self._changes_s = sorted({one.start_s for one in disturbances} | set(ends) - {math.inf})

    def next_load(self, time_s: float) -> Load | None:
        """Return the load from this time on if it changed since the last call, None if it did not."""
        changes_s, now_s = self._changes_s, time_s + self._early_s
        if not changes_s or changes_s[0] > now_s:
            return None
        while changes_s and changes_s[0] <= now_s:
            changes_s.pop(0)
        acting = [one for one in self._disturbances if one.start_s <= now_s < one.start_s + one.duration_s]
        frictions = [one.friction for one in acting if one.friction is not None]
        return Load(
            force_N=np.sum([(0.0, 0.0, 0.0), *(one.force_N for one in acting)], axis=0),
            torque_Nm=np.sum([(0.0, 0.0, 0.0), *(one.torque_Nm for one in acting)], axis=0),
            added_mass_kg=math.fsum(one.added_mass_kg for one in acting),
            friction=frictions[-1] if frictions else None,
        )
