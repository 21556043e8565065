"""How the object turned: where it should have been, where the host believed it, where it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate_host import rotation
from palpate_host.demo.hand_motion import Moment
from palpate_host.rotation import Array
from palpate_host.supervisor import Mode
from palpate_host.twin.hand.motion import Motion

TURNING = (Mode.MANIPULATE, Mode.BLIND)
MOVING_DEG = 1e-4  # a tick of the slowest sensible ramp moves the target by more


@dataclass(frozen=True, slots=True)
class TurnStep:
    """One turn that was asked for, over once the next one begins. Times in s since the log's first frame.

    error_deg: angle between the object and where it should be at the end; believed_error_deg: between the
    object and where the host believed it. slip_mm: path of each tip's skin against the object meanwhile.
    friction_ratio: largest tangential over normal force of a tip.
    """

    rpy_deg: tuple[float, float, float]
    begin_s: float
    end_s: float
    error_deg: float
    believed_error_deg: float
    slip_mm: tuple[float, float, float]
    friction_ratio: float


@dataclass(frozen=True, slots=True)
class TurnFigures:
    """largest_N, smallest_N: of the tips' normal forces while the object was turned; sunk_mm: how much lower
    it ended than it began."""

    steps: tuple[TurnStep, ...]
    largest_N: float
    smallest_N: float
    sunk_mm: float


@dataclass(frozen=True, slots=True)
class Turn:
    """From the first tick in which the host turned the object. times_s (n,); target, believed and true roll,
    pitch, yaw (n, 3) since then; error_deg (n,) from target to truth."""

    times_s: Array
    target_deg: Array
    believed_deg: Array
    true_deg: Array
    error_deg: Array


def turn_of(moments: Sequence[Moment], motion: Motion, begin_us: int) -> tuple[Turn, TurnFigures] | None:
    """None when the host never turned the object."""
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
            rpy_deg=_asked_deg(target, first, last),
            begin_s=float(times_s[first]),
            end_s=float(times_s[last]),
            error_deg=missing[last],
            believed_error_deg=unseen[last],
            slip_mm=_three(motion.slip_mm[rows[last]] - motion.slip_mm[rows[first]]),
            friction_ratio=_friction_ratio(motion, slice(rows[first], rows[last] + 1)),
        )
        for first, last in step_bounds(target)
    ]
    held_N = motion.force_N[rows[0] : rows[-1] + 1]
    figures = TurnFigures(
        steps=tuple(steps),
        largest_N=float(held_N.max()),
        smallest_N=float(held_N.min()),
        sunk_mm=float(1e3 * (motion.pose[rows[0], 2] - motion.pose[rows[-1], 2])),
    )
    turn = Turn(times_s, _rpy_deg(target), _rpy_deg(believed), _rpy_deg(truth), np.array(missing))
    return turn, figures


def _rpy_deg(turns: Array) -> Array:
    return np.array([rotation.to_rpy_deg(R) for R in turns])


def _asked_deg(target: Array, first: int, last: int) -> tuple[float, float, float]:
    before = target[first].T if first > 0 else np.eye(3)
    return _three(np.round(rotation.to_rpy_deg(target[last] @ before), 6) + 0.0)


def step_bounds(target: Array) -> list[tuple[int, int]]:
    """First and last index of each turn of `target` (n, 3, 3): it begins to move, and the next one begins."""
    moves = [rotation.angle_deg(b @ a.T) > MOVING_DEG for a, b in pairwise(target)]
    begins = [i for i, is_moving in enumerate(moves) if is_moving and (i == 0 or not moves[i - 1])]
    return list(pairwise([*begins, len(target) - 1]))


def _friction_ratio(motion: Motion, span: slice) -> float:
    normal, tangential = motion.force_N[span], motion.friction_N[span]
    bearing = normal > 0.0
    return float((tangential[bearing] / normal[bearing]).max()) if bearing.any() else 0.0


def _three(values: Array) -> tuple[float, float, float]:
    a, b, c = (float(value) for value in values)
    return a, b, c
