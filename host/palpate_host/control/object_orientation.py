"""The grasped object's orientation from the contacts: M = R_vir^T R_c, kept and smoothed.

Each finger's normal arrives on its own, expressed in R_vir at its own exposure (virtual_frame.py). The first
ones are averaged to references; each later normal leads to a new fit of M to all. When a finger loses
contact, the object is assumed to move with the virtual frame until the finger is in contact again: M is kept,
and the new references are chosen to agree with it, so that the desired frame never jumps.
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
    """The estimate of M (3, 3), None until the first references are complete."""

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
        """True when every finger has its reference and the last fit succeeded."""
        return self._reference is not None and not self.problem

    def release(self, finger: int) -> None:
        """Forget the finger's reference: it lost contact, its next contact is elsewhere on the object."""
        self._collected[finger].clear()
        self._reference = None
        self._updated_us = None

    def add(self, finger: int, normal_in_vir: Array, exposed_at_us: int) -> None:
        """Take a contact normal (3,) of one finger, expressed in R_vir at its exposure."""
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
        own = self._collected[finger]
        own.append(normal)
        del own[: -self._needed]
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
    """Return d_i = (x_ci - x_i)/|x_ci - x_i| (3,) in the hand frame, Eq. (16), at the pose of the exposure.

    The contact point in frame F starts at the dome's centre, so d_i is its opposite direction. None for a
    point in the centre, where no contact can be.
    """
    point = np.array(position_mm)
    distance = float(np.linalg.norm(point))
    if distance == 0.0:
        return None
    return np.asarray(pose.tip_rotation[finger] @ (point / -distance))
