"""Compare the object's orientation in a run: desired by the host, estimated by the host, and true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.mode import Mode
from palpate_twin.demo.hand_motion import HostTick
from palpate_twin.hand.motion import TrueMotion

TURNING = (Mode.MANIPULATE, Mode.BLIND)
AXES = ("roll", "pitch", "yaw")
LARGEST_ERROR_DEG = 3.0
"""Limit of the final error of a turn by 30 deg through the whole chain."""
LARGEST_SLIP_MM = 1.0
"""Limit of a tip's sliding distance per turn; rolling by 30 deg moves the contact by 16 mm over the skin."""

Request = tuple[int, tuple[float, float, float]]
"""Time of the host's last tick before a turn was commanded, in us, and its roll, pitch, yaw in deg."""


@dataclass(frozen=True, slots=True)
class TurnStep:
    """One commanded turn, from its command to the next one. Times in s since the log's first frame.

    error_deg: angle between true and desired orientation at the end. believed_error_deg: angle between true
    and estimated orientation. slip_mm: sliding distance of each tip on the object. friction_ratio: largest
    ratio of tangential to normal force of a tip. pace: simulated time over real time.
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
    def has_missed(self) -> bool:
        """True if the final error exceeds its limit."""
        return self.error_deg > LARGEST_ERROR_DEG

    @property
    def has_slipped(self) -> bool:
        """True if a tip slid further than its limit."""
        return max(self.slip_mm) > LARGEST_SLIP_MM

    @property
    def name(self) -> str:
        """The rotation as text, such as `roll +30 deg`."""
        turns = [f"{axis} {angle:+g}" for axis, angle in zip(AXES, self.rpy_deg, strict=True) if angle]
        return f"{', '.join(turns)} deg" if turns else "no rotation"

    @property
    def outcome(self) -> str:
        """Final error and largest slip as text, each compared with its limit."""
        error, slip = f"{self.error_deg:.2f} deg", f"{max(self.slip_mm):.2f} mm"
        reached = f"reached within {error}"
        if self.has_missed:
            reached = f"MISSED by {error} (limit {LARGEST_ERROR_DEG:g} deg)"
        slipped = f"no slip ({slip})"
        if self.has_slipped:
            slipped = f"SLIPPED by {slip} (limit {LARGEST_SLIP_MM:g} mm)"
        return f"{reached}, {slipped}"

    @property
    def verdict(self) -> str:
        """The exceeded limits as text; empty if there are none."""
        faults = ("MISSED" if self.has_missed else "", "SLIPPED" if self.has_slipped else "")
        return ", ".join(fault for fault in faults if fault)


@dataclass(frozen=True, slots=True)
class TurnFigures:
    """Figures of all turns. largest_N, smallest_N: normal forces of the tips while the object was turned;
    sunk_mm: loss of height of the object; pace: simulated time over real time."""

    steps: tuple[TurnStep, ...]
    largest_N: float
    smallest_N: float
    sunk_mm: float
    pace: float


@dataclass(frozen=True, slots=True)
class TurnSeries:
    """Orientation from the first tick in which the host turned the object.

    times_s (n,); desired, estimated and true roll, pitch, yaw (n, 3) since then; error_deg (n,): angle
    between true and desired orientation.
    """

    times_s: Array
    target_deg: Array
    estimated_deg: Array
    true_deg: Array
    error_deg: Array


def analyse_turns(
    ticks: Sequence[HostTick], motion: TrueMotion, begin_us: int, requests: Sequence[Request]
) -> tuple[TurnSeries, TurnFigures] | None:
    """Return orientation over time and figures of each turn; None if the host never turned the object.

    requests: the commanded turns in order; the first one starts with the first tick that turns the object.
    """
    turning = [tick for tick in ticks if tick.mode in TURNING and tick.R_d is not None]
    turning = [tick for tick in turning if tick.R_c is not None]
    if len(turning) < 2:
        return None
    stamps_us = np.array([tick.time_us for tick in turning], dtype=np.float64)
    rows = np.clip(np.searchsorted(motion.stamps_us, stamps_us), 0, len(motion.stamps_us) - 1)
    R_d = np.array([tick.R_d for tick in turning])
    R_c = np.array([tick.R_c for tick in turning])
    true = motion.rotations[rows]
    # The target starts at the estimated orientation and is one tick ahead of it already.
    target, estimated, truth = R_d @ R_c[0].T, R_c @ R_c[0].T, true @ true[0].T
    errors_deg = [rotation.angle_deg(a @ b.T) for a, b in zip(target, truth, strict=True)]
    estimate_errors_deg = [rotation.angle_deg(a @ b.T) for a, b in zip(estimated, truth, strict=True)]
    times_s = (stamps_us - begin_us) / 1e6
    steps = [
        TurnStep(
            rpy_deg=rpy_deg,
            begin_s=float(times_s[first]),
            end_s=float(times_s[last]),
            error_deg=errors_deg[last],
            believed_error_deg=estimate_errors_deg[last],
            slip_mm=_three(motion.slip_mm[rows[last]] - motion.slip_mm[rows[first]]),
            friction_ratio=_friction_ratio(motion, slice(rows[first], rows[last] + 1)),
            pace=motion.pace(rows[first], rows[last]),
        )
        for rpy_deg, first, last in _steps(stamps_us, requests)
    ]
    forces_N = motion.force_N[rows[0] : rows[-1] + 1]
    figures = TurnFigures(
        steps=tuple(steps),
        largest_N=float(forces_N.max()),
        smallest_N=float(forces_N.min()),
        sunk_mm=float(1e3 * (motion.pose[rows[0], 2] - motion.pose[rows[-1], 2])),
        pace=motion.pace(rows[0], rows[-1]),
    )
    series = TurnSeries(times_s, _rpy_deg(target), _rpy_deg(estimated), _rpy_deg(truth), np.array(errors_deg))
    return series, figures


def _rpy_deg(turns: Array) -> Array:
    return np.array([rotation.to_rpy_deg(R) for R in turns])


def _steps(
    stamps_us: Array, requests: Sequence[Request]
) -> list[tuple[tuple[float, float, float], int, int]]:
    """Return roll, pitch, yaw, first tick and last tick of each turn."""
    begins = [0, *(int(np.searchsorted(stamps_us, after_us)) for after_us, _ in requests[1:])]
    spans = pairwise([*begins, len(stamps_us) - 1])
    turns = zip(requests, spans, strict=True)
    return [(rpy_deg, first, last) for (_, rpy_deg), (first, last) in turns if first < last]


def _friction_ratio(motion: TrueMotion, span: slice) -> float:
    normal, tangential = motion.force_N[span], motion.friction_N[span]
    loaded = normal > 0.0
    return float((tangential[loaded] / normal[loaded]).max()) if loaded.any() else 0.0


def _three(values: Array) -> tuple[float, float, float]:
    a, b, c = (float(value) for value in values)
    return a, b, c
