"""Follows the grasped object's orientation through the contacts: M = R_vir^T R_c, kept and smoothed.

Each finger's normal arrives alone, already in R_vir of its own exposure (virtual_frame.py says why). The
first ones are averaged to references; from then on every new normal refits M to all. When a finger lets go,
the object is taken to have moved with the virtual frame until it is touched anew: M stays, and the new
contacts' references are chosen so that it does. So the desired frame never jumps.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.control.kinematics import HandPose
from palpate_host.control.virtual_frame import (
    FrameError,
    contact_frame,
    fit_contact_frame,
    fit_residual_deg,
    low_pass,
)


class ObjectOrientation:
    """The estimate of M (3, 3); None until the first references are complete."""

    def __init__(self, fingers: int, reference_frames: int, time_constant_s: float) -> None:
        self.M: Array | None = None
        self.problem = ""
        self.residual_deg = 0.0
        self._needed = reference_frames
        self._time_constant_s = time_constant_s
        self._collected: list[list[Array]] = [[] for _ in range(fingers)]
        self._reference: Array | None = None
        self._latest: list[Array] = [np.zeros(3)] * fingers
        self._updated_us: int | None = None

    @property
    def is_following(self) -> bool:
        """Every finger has its reference and the last fit was possible."""
        return self._reference is not None and not self.problem

    def release(self, finger: int) -> None:
        """The finger touches nothing: its next contact is another place on the object."""
        self._collected[finger].clear()
        self._reference = None
        self._updated_us = None

    def add(self, finger: int, normal_in_vir: Array, exposed_at_us: int) -> None:
        """A new contact normal (3,) of one finger, in R_vir at its exposure."""
        self._latest[finger] = normal_in_vir
        try:
            if self._reference is None:
                self._collect(finger, normal_in_vir)
            else:
                self._follow(self._reference, exposed_at_us)
        except FrameError as exc:
            self.problem = str(exc)
        else:
            self.problem = ""

    def _collect(self, finger: int, normal: Array) -> None:
        mine = self._collected[finger]
        mine.append(normal)
        del mine[: -self._needed]
        if any(len(normals) < self._needed for normals in self._collected):
            return
        mean = np.array([np.mean(normals, axis=0) for normals in self._collected])
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        frame = contact_frame(mean)
        if self.M is None:
            self.M = frame
        self._reference = mean @ self.M
        self.residual_deg = 0.0

    def _follow(self, reference: Array, exposed_at_us: int) -> None:
        assert self.M is not None
        normals = np.array(self._latest)
        measured = fit_contact_frame(reference, normals)
        self.residual_deg = fit_residual_deg(measured, reference, normals)
        last_us = exposed_at_us if self._updated_us is None else self._updated_us
        dt_s = max(0, exposed_at_us - last_us) * 1e-6
        self.M = low_pass(self.M, measured, dt_s, self._time_constant_s)
        self._updated_us = max(last_us, exposed_at_us)


def contact_normal(pose: HandPose, finger: int, position_mm: tuple[float, float, float]) -> Array | None:
    """d_i = (x_ci - x_i)/|x_ci - x_i| (3,) in the hand's frame, Eq. (16), at the pose of the exposure.

    The contact point in F is measured from the dome's centre, so d_i is that direction turned round. None
    when the point is the centre itself, which no contact is.
    """
    point = np.array(position_mm)
    distance = float(np.linalg.norm(point))
    if distance == 0.0:
        return None
    return np.asarray(pose.tip_rotation[finger] @ (point / -distance))
