"""How the object turned: where it should have been, where the host believed it, where it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.mode import Mode
from palpate_twin.demo.hand_motion import Moment
from palpate_twin.hand.motion import TrueMotion

TURNING = (Mode.MANIPULATE, Mode.BLIND)
BOUND_DEG = 3.0
"""Of a turn by 30 deg through the whole chain."""
SLIPPED_MM = 1.0
"""Of the path on the skin; 30 deg of rolling are 16 mm of it."""

Asked = tuple[int, tuple[float, float, float]]
"""The host's last tick before a turn was asked for, in us, and its roll, pitch, yaw in deg."""


@dataclass(frozen=True, slots=True)
class TurnStep:
    """One turn that was asked for, over once the next one begins. Times in s since the log's first frame.

    error_deg: angle between the object and where it should be at the end; believed_error_deg: between the
    object and where the host believed it. slip_mm: path of each tip's skin against the object meanwhile.
    friction_ratio: largest tangential over normal force of a tip. pace: the hand's time over the clock's.
    """

    rpy_deg: tuple[float, float, float]
    begin_s: float
    end_s: float
    error_deg: float
    believed_error_deg: float
    slip_mm: tuple[float, float, float]
    friction_ratio: float
    pace: float

    @property
    def verdict(self) -> str:
        """What was not as it is to be; empty when all was."""
        faults = []
        if self.error_deg > BOUND_DEG:
            faults.append(f"MISSED by more than {BOUND_DEG:g} deg")
        if max(self.slip_mm) > SLIPPED_MM:
            faults.append(f"SLIPPED by more than {SLIPPED_MM:g} mm")
        return ", ".join(faults)


@dataclass(frozen=True, slots=True)
class TurnFigures:
    """largest_N, smallest_N: of the tips' normal forces while the object was turned; sunk_mm: how much lower
    it ended than it began; pace: the hand's time over the clock's meanwhile."""

    steps: tuple[TurnStep, ...]
    largest_N: float
    smallest_N: float
    sunk_mm: float
    pace: float


@dataclass(frozen=True, slots=True)
class Turn:
    """From the first tick in which the host turned the object. times_s (n,); target, believed and true roll,
    pitch, yaw (n, 3) since then; error_deg (n,) from target to truth."""

    times_s: Array
    target_deg: Array
    believed_deg: Array
    true_deg: Array
    error_deg: Array


def turn_of(
    moments: Sequence[Moment], motion: TrueMotion, begin_us: int, asked: Sequence[Asked]
) -> tuple[Turn, TurnFigures] | None:
    """None when the host never turned the object. asked: in order; the first began with the turning."""
    turning = [moment for moment in moments if moment.mode in TURNING and moment.R_d is not None]
    turning = [moment for moment in turning if moment.R_c is not None]
    if len(turning) < 2:
        return None
    stamps_us = np.array([moment.time_us for moment in turning], dtype=np.float64)
    rows = np.clip(np.searchsorted(motion.stamps_us, stamps_us), 0, len(motion.stamps_us) - 1)
    R_d = np.array([moment.R_d for moment in turning])
    R_c = np.array([moment.R_c for moment in turning])
    true = motion.rotations[rows]
    # The target starts where the host believes the object to be, and has gone a tick already.
    target, believed, truth = R_d @ R_c[0].T, R_c @ R_c[0].T, true @ true[0].T
    missing = [rotation.angle_deg(a @ b.T) for a, b in zip(target, truth, strict=True)]
    unseen = [rotation.angle_deg(a @ b.T) for a, b in zip(believed, truth, strict=True)]
    times_s = (stamps_us - begin_us) / 1e6
    steps = [
        TurnStep(
            rpy_deg=rpy_deg,
            begin_s=float(times_s[first]),
            end_s=float(times_s[last]),
            error_deg=missing[last],
            believed_error_deg=unseen[last],
            slip_mm=_three(motion.slip_mm[rows[last]] - motion.slip_mm[rows[first]]),
            friction_ratio=_friction_ratio(motion, slice(rows[first], rows[last] + 1)),
            pace=motion.pace(rows[first], rows[last]),
        )
        for rpy_deg, first, last in _steps(stamps_us, asked)
    ]
    held_N = motion.force_N[rows[0] : rows[-1] + 1]
    figures = TurnFigures(
        steps=tuple(steps),
        largest_N=float(held_N.max()),
        smallest_N=float(held_N.min()),
        sunk_mm=float(1e3 * (motion.pose[rows[0], 2] - motion.pose[rows[-1], 2])),
        pace=motion.pace(rows[0], rows[-1]),
    )
    turn = Turn(times_s, _rpy_deg(target), _rpy_deg(believed), _rpy_deg(truth), np.array(missing))
    return turn, figures


def _rpy_deg(turns: Array) -> Array:
    return np.array([rotation.to_rpy_deg(R) for R in turns])


def _steps(stamps_us: Array, asked: Sequence[Asked]) -> list[tuple[tuple[float, float, float], int, int]]:
    """Of each turn roll, pitch, yaw and its first and last tick."""
    begins = [0, *(int(np.searchsorted(stamps_us, after_us)) for after_us, _ in asked[1:])]
    spans = pairwise([*begins, len(stamps_us) - 1])
    turns = zip(asked, spans, strict=True)
    return [(rpy_deg, first, last) for (_, rpy_deg), (first, last) in turns if first < last]


def _friction_ratio(motion: TrueMotion, span: slice) -> float:
    normal, tangential = motion.force_N[span], motion.friction_N[span]
    bearing = normal > 0.0
    return float((tangential[bearing] / normal[bearing]).max()) if bearing.any() else 0.0


def _three(values: Array) -> tuple[float, float, float]:
    a, b, c = (float(value) for value in values)
    return a, b, c
