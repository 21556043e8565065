"""The grasped object's orientation from the contacts: M = R_vir^T R_c, kept and smoothed.

Each finger's normal arrives on its own, expressed in R_vir at its own exposure (virtual_frame.py). The first
ones are averaged to references, one normal of the object a finger; each later normal leads to a new fit of M
to all. Four rules keep M when contacts are doubtful:

- While a finger is without contact, M is kept: the object is assumed to move with the virtual frame. The
  references are kept for `REFERENCE_KEPT_US`, since a single frame without contact is more often false than
  true. After that the finger's next contact may be elsewhere on the object, and new references are chosen to
  agree with M, so that the desired frame never jumps.
- A normal more than `GATE_DEG` from M's prediction does not take part in the fit, as long as those that agree
  are the majority. A finger that stays outside for `LEFT_OUT_US` is named in `left_out`.
- Three normals have one surplus measurement, so a slow tilt of one of them pulls M and shows late, and not at
  which finger. A finger that alone has given exactly the same place for `FROZEN_US` is compared with the
  others' fit, and left out from `FROZEN_GATE_DEG` on.
- Without a majority the normals count only if one rotation fits all of them. If none does for
  `LEFT_OUT_US`, they belong to no single rigid object, and `problem` names that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.control.kinematics import HandPose
from palpate_host.control.virtual_frame import (
    FrameError,
    contact_frame,
    fit_contact_frame,
    low_pass,
    misfits_deg,
)

GATE_DEG = 4.0
"""Largest accepted angle between a normal and its prediction: 2 mm on a dome of 30 mm radius, 25 times the
sensor's noise and less than a slip that turns an object."""
REFERENCE_KEPT_US = 150_000
FROZEN_US = 150_000
FROZEN_GATE_DEG = 1.0
LEFT_OUT_US = 300_000
NO_SINGLE_OBJECT = (
    f"the contacts do not fit one object within {GATE_DEG:g} deg: release the object and grasp it again"
)


class _FingerNormals:
    """The normals of one finger: reference in the object, latest and collected ones in R_vir."""

    def __init__(self) -> None:
        self.reference: Array | None = None
        self.collected: list[Array] = []
        self.latest = np.zeros(3)
        self.seen_us = 0
        self.position_mm: tuple[float, float, float] | None = None
        self.moved_us = 0
        self.without_contact_since_us: int | None = None
        self.outside_since_us: int | None = None

    @property
    def is_frozen(self) -> bool:
        """True when the contact has been in exactly one place for `FROZEN_US`, which noise prevents."""
        return self.seen_us - self.moved_us >= FROZEN_US

    def mean_normal(self) -> Array:
        """Return the mean direction (3,) of the collected normals."""
        mean = np.mean(self.collected, axis=0)
        return np.asarray(mean / np.linalg.norm(mean))

    def forget(self) -> None:
        """Drop the reference and what was collected for it."""
        self.reference = self.outside_since_us = None
        self.collected.clear()


class ObjectOrientation:
    """The estimate of M (3, 3), None until the first references are complete.

    residual_deg: the largest angle between a finger's latest normal and the last fit, doubtful fingers
    included.
    """

    def __init__(self, fingers: int, reference_frames: int, time_constant_s: float) -> None:
        self.M: Array | None = None
        self.problem = ""
        self.residual_deg = 0.0
        self._needed = reference_frames
        self._time_constant_s = time_constant_s
        self._fingers = [_FingerNormals() for _ in range(fingers)]
        self._updated_us: int | None = None
        self._no_fit_since_us: int | None = None

    @property
    def is_following(self) -> bool:
        """True when the fingers have their references and the contacts fit one object."""
        return not self.problem and self._fingers[0].reference is not None

    @property
    def left_out(self) -> tuple[int, ...]:
        """The fingers whose contacts have been outside the gate for `LEFT_OUT_US`, numbered from 0."""
        return tuple(
            number
            for number, finger in enumerate(self._fingers)
            if finger.outside_since_us is not None and finger.seen_us - finger.outside_since_us >= LEFT_OUT_US
        )

    def without_contact(self, number: int, exposed_at_us: int) -> None:
        """Take a valid frame of finger `number` without contact."""
        finger = self._fingers[number]
        if finger.without_contact_since_us is None:
            finger.without_contact_since_us = exposed_at_us
        elif exposed_at_us - finger.without_contact_since_us >= REFERENCE_KEPT_US:
            for one in self._fingers:
                one.forget()
            self._updated_us = self._no_fit_since_us = None

    def add(
        self,
        number: int,
        normal_in_vir: Array,
        exposed_at_us: int,
        position_mm: tuple[float, float, float] | None = None,
    ) -> None:
        """Take a contact normal (3,) of one finger, expressed in R_vir at its exposure.

        position_mm: the contact in the dome's frame F, which shows whether a finger is frozen.
        """
        finger = self._fingers[number]
        if position_mm is None or position_mm != finger.position_mm:
            finger.position_mm, finger.moved_us = position_mm, exposed_at_us
        finger.latest, finger.seen_us = normal_in_vir, exposed_at_us
        finger.without_contact_since_us = None
        try:
            if finger.reference is None:
                self._collect(finger)
            else:
                self._follow(exposed_at_us)
        except FrameError as exc:
            self.problem = str(exc)

    def _collect(self, finger: _FingerNormals) -> None:
        """Collect for the references, which are taken when every finger has enough normals."""
        finger.collected.append(finger.latest)
        del finger.collected[: -self._needed]
        if any(len(one.collected) < self._needed for one in self._fingers):
            return
        means = np.array([one.mean_normal() for one in self._fingers])
        frame = contact_frame(means)
        if self.M is None:
            self.M = frame
        for one, mean in zip(self._fingers, means, strict=True):
            one.reference = mean @ self.M
        self.problem, self.residual_deg = "", 0.0

    def _follow(self, exposed_at_us: int) -> None:
        assert self.M is not None
        if any(finger.without_contact_since_us is not None for finger in self._fingers):
            return
        angles_deg = _misfits_deg(self.M, self._fingers)
        believed = self._without_frozen() or [
            one for one, angle in zip(self._fingers, angles_deg, strict=True) if angle <= GATE_DEG
        ]
        if len(believed) >= 2 and 2 * len(believed) > len(self._fingers):
            measured = _fit(believed)
        else:
            measured, believed = _fit(self._fingers), self._fingers
            if _misfits_deg(measured, self._fingers).max() > GATE_DEG:
                self.residual_deg = float(angles_deg.max())
                self._no_fit(exposed_at_us)
                return
        self._no_fit_since_us, self.problem = None, ""
        for finger in self._fingers:
            if any(finger is one for one in believed):
                finger.outside_since_us = None
            elif finger.outside_since_us is None:
                finger.outside_since_us = finger.seen_us
        self.residual_deg = float(_misfits_deg(measured, self._fingers).max())
        last_us = exposed_at_us if self._updated_us is None else self._updated_us
        dt_s = max(0, exposed_at_us - last_us) * 1e-6
        self.M = low_pass(self.M, measured, dt_s, self._time_constant_s)
        self._updated_us = max(last_us, exposed_at_us)

    def _without_frozen(self) -> list[_FingerNormals]:
        """Return the other fingers when one is frozen and does not fit them; empty otherwise."""
        moving = [one for one in self._fingers if not one.is_frozen]
        if len(moving) != len(self._fingers) - 1:
            return []
        try:
            others = _fit(moving)
        except FrameError:  # two opposed normals leave a rotation open
            return []
        return moving if _misfits_deg(others, self._fingers).max() > FROZEN_GATE_DEG else []

    def _no_fit(self, exposed_at_us: int) -> None:
        """M is kept; after `LEFT_OUT_US` that is a problem."""
        if self._no_fit_since_us is None:
            self._no_fit_since_us = exposed_at_us
        if exposed_at_us - self._no_fit_since_us >= LEFT_OUT_US:
            self.problem = NO_SINGLE_OBJECT


def _fit(fingers: Sequence[_FingerNormals]) -> Array:
    """Return the rotation (3, 3) that turns the references best into the latest normals."""
    return fit_contact_frame(*_normals(fingers))


def _normals(fingers: Sequence[_FingerNormals]) -> tuple[Array, Array]:
    """Return the references and the latest normals (n, 3)."""
    return np.array([finger.reference for finger in fingers]), np.array([one.latest for one in fingers])


def _misfits_deg(M: Array, fingers: Sequence[_FingerNormals]) -> Array:
    """Return the angle of each finger's latest normal to its reference turned by M."""
    return misfits_deg(M, *_normals(fingers))


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
