"""The result of one trial, on the twin or on a real hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.experiment.protocol import TrialCase

SETTLED_DEG = 2.0


@dataclass(frozen=True, slots=True)
class TrialResult:
    """The measured turn of one trial.

    time_s: (n,), 0 at the start of the turn. turn: n rotations (3, 3) since then, by the external camera.
    true_turn: the same by the simulation, empty on a real hand. slip_mm: path of each tip's skin on the
    object, None on a real hand. failure: why the host stopped the hand, or empty.
    """

    case: TrialCase
    folder: Path
    time_s: Array
    turn: Sequence[Array]
    true_turn: Sequence[Array]
    slip_mm: Array | None
    pictures: int
    failure: str

    @property
    def rpy_deg(self) -> Array:
        """Roll, pitch and yaw of each measurement (n, 3)."""
        return np.array([rotation.to_rpy_deg(turn) for turn in self.turn]).reshape(-1, 3)

    @property
    def error_deg(self) -> float:
        """The angle to the target at the end, by the camera."""
        return self.remaining_deg(self.turn)

    @property
    def true_error_deg(self) -> float | None:
        return self.remaining_deg(self.true_turn) if self.true_turn else None

    @property
    def settling_s(self) -> float | None:
        """The time from which the turn stays within SETTLED_DEG of its last value."""
        last = self.turn[-1]
        far = [i for i, turn in enumerate(self.turn) if rotation.angle_deg(last @ turn.T) > SETTLED_DEG]
        return float(self.time_s[far[-1] + 1]) if far else float(self.time_s[0])

    def remaining_deg(self, turns: Sequence[Array]) -> float:
        """Return the angle from the last of the turns to the target."""
        goal = rotation.from_rpy_deg(*self.case.turn.rpy_deg)
        return rotation.angle_deg(goal @ turns[-1].T)
