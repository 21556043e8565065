"""The desired orientation of the object: the ramp of a turn, and the integral that follows it.

The paper's proportional law leaves an error; the integral, which the paper does not have, moves the target
until the error is gone. It starts at the end of the ramp: the last degrees need the most friction, and the
slower they are turned the less. Under the law `pose`, whose integral always runs, the ramp itself starts and
ends at rest: what damping resists a steady turn with is learned as a load, which turns an object on that the
ramp stops at once.
"""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.easing import eased
from palpate_host.control.virtual_frame import desired_virtual_frame

TRIM_LIMIT_RAD = math.radians(15.0)
"""Limit of the integral: Eq. (14) leaves an error of a few degrees, a larger one is a jammed object."""


class TurnRamp:
    """One turn after another, each from the last desired orientation.

    R_d (3, 3): the desired orientation; R_d_vir (3, 3): that of the virtual frame, Eq. (15); both None while
    nothing is desired.
    """

    def __init__(
        self,
        rpy_deg: tuple[float, float, float],
        ramp_s: float,
        integral_per_s: float,
        *,
        is_eased: bool = False,
    ) -> None:
        """Take the first turn, and the gain of the integral, 1/s. is_eased: turns start and end at rest."""
        self.R_d: Array | None = None
        self.R_d_vir: Array | None = None
        self._start: Array | None = None
        self._integral_per_s, self._trim_rad = integral_per_s, np.zeros(3)
        self._is_eased = is_eased
        self.begin(rpy_deg, ramp_s)

    @property
    def share(self) -> float:
        """The share of the turn that is desired by now, 0 to 1."""
        passed = 1.0 if self._ramp_s <= 0.0 else min(1.0, self._turned_s / self._ramp_s)
        return eased(passed) if self._is_eased else passed

    def begin(self, rpy_deg: tuple[float, float, float], ramp_s: float) -> None:
        """Start a turn from the desired orientation, or from the measured one when there is none."""
        self._turn_rad = rotation.log(rotation.from_rpy_deg(*rpy_deg))
        self._ramp_s, self._turned_s = ramp_s, 0.0
        self._start, self._leads = self.R_d, False

    def lead_elsewhere(self, R: Array) -> None:
        """Take an orientation that somebody else leads; this ramp goes on from its own."""
        self.R_d, self._leads = R, False

    def forget(self) -> None:
        """Forget the desired orientation: the next turn starts from the measured one."""
        self.R_d = self.R_d_vir = self._start = None
        self._trim_rad = np.zeros(3)

    def advance(self, R_vir: Array, M: Array, dt_s: float) -> Array:
        """Advance by dt_s, back if negative, and return R_d; R_vir M is the measured orientation R_c."""
        if self._start is None:
            self._start = R_vir @ M
        turned_s = max(0.0, min(self._turned_s + dt_s, self._ramp_s))
        is_there = self._leads and turned_s == self._turned_s
        self._turned_s, self._leads = turned_s, True
        desired = self.R_d
        if desired is None or not is_there:
            desired = rotation.exp(self.share * self._turn_rad).dot(self._start)
        self.R_d, trimmed = desired, desired
        if self._integral_per_s > 0.0:
            if self.share >= 1.0:
                self._trim_rad = self._trim(desired @ (R_vir @ M).T, dt_s)
            trimmed = rotation.exp(self._trim_rad) @ desired
        self.R_d_vir = desired_virtual_frame(trimmed, M)
        return desired

    def _trim(self, remaining: Array, dt_s: float) -> Array:
        """Return the integral of the remaining turn as a rotation vector (3,) of bounded length."""
        trim = self._trim_rad + self._integral_per_s * dt_s * rotation.log(remaining)
        return np.asarray(trim * min(1.0, TRIM_LIMIT_RAD / max(TRIM_LIMIT_RAD, float(np.linalg.norm(trim)))))
