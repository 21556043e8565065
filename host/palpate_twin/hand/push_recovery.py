"""Pushes on the grasped object in a recorded motion: the distance by which it moved, and what remained."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.config.twin_config import DisturbanceConfig
from palpate_twin.hand.motion import TrueMotion

RECOVERY_S = 1.0
"""Time from the end of a push within which the object has to be back."""
LARGEST_DISTANCE_MM = 2.0
"""Limit of the distance that then remains; a turn under way moves the centre of mass by 1 mm."""


@dataclass(frozen=True, slots=True)
class PushStep:
    """One push. Times in s since the log's first frame.

    force_N: (x, y, z) in the hand's frame. moved_mm: largest distance of the object from its place before the
    push, until RECOVERY_S after its end. remaining_mm: distance RECOVERY_S after its end.
    """

    force_N: tuple[float, float, float]
    begin_s: float
    duration_s: float
    moved_mm: float
    remaining_mm: float

    @property
    def name(self) -> str:
        """The push as text, such as `push 2 N along -z for 0.2 s`."""
        size_N = math.hypot(*self.force_N)
        along = " ".join(
            f"{'-' if part < 0.0 else '+'}{axis}"
            for axis, part in zip("xyz", self.force_N, strict=True)
            if part
        )
        return f"push {size_N:g} N along {along} for {self.duration_s:g} s"

    @property
    def is_held(self) -> bool:
        """True if the distance that remains is within its limit."""
        return self.remaining_mm <= LARGEST_DISTANCE_MM

    @property
    def outcome(self) -> str:
        """Distances as text, compared with the limit."""
        moved, remaining = f"moved by {self.moved_mm:.1f} mm", f"{self.remaining_mm:.1f} mm"
        if self.is_held:
            return f"{moved}, back within {remaining} after {RECOVERY_S:g} s"
        return f"{moved}, NOT HELD: {remaining} off after {RECOVERY_S:g} s (limit {LARGEST_DISTANCE_MM:g} mm)"


def push_steps(
    pushes: Sequence[DisturbanceConfig], motion: TrueMotion, begin_us: float
) -> tuple[PushStep, ...]:
    """Return the figures of each push by a force that the motion contains with the time after it.

    begin_us: time of the log's first frame on the bus clock. A push without an end is left out.
    """
    found = []
    for push in pushes:
        end_s = push.start_s + push.duration_s + RECOVERY_S
        since_s = 1e-6 * (motion.stamps_us - motion.stamps_us[0])
        if not any(push.force_N) or end_s > since_s[-1]:
            continue
        first, last = np.searchsorted(since_s, (push.start_s, end_s))
        away_mm = _distances_mm(motion.pose[first : last + 1, :3])
        found.append(
            PushStep(
                force_N=push.force_N,
                begin_s=float(1e-6 * (motion.stamps_us[first] - begin_us)),
                duration_s=push.duration_s,
                moved_mm=float(away_mm.max()),
                remaining_mm=float(away_mm[-1]),
            )
        )
    return tuple(found)


def _distances_mm(place_m: Array) -> Array:
    return np.asarray(1e3 * np.linalg.norm(place_m - place_m[0], axis=1))
