"""The reach of one finger: places for its tip, and how far it follows a turning object.

A tip rolls on its face without slip (Eq. (6)). The object turns about its place by a known rotation, so each
finger can be followed alone: its contact moves with the object, J_xi dq = w x (x_i - x_o), which gives the
joints; where the contact is on the object follows from the joints.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.gait.object_shape import ShapeFace
from palpate_host.control.kinematics import HandKinematics, HandPose

STEP_RAD = math.radians(2.0)
JOINT_MARGIN_RAD = 0.02
"""Distance from `soft_limit_rad` before a joint's end that a plan keeps."""
EDGE_M = 0.003
"""Smallest distance of a planned contact from the edges of its face."""
LEAST_GAIN_M = 0.02
"""Smallest singular value of a finger's Jacobian: below it a finger is nearly stretched."""
WIDEST_DOME_DEG = 70.0
"""Largest angle of a contact from the dome's apex; fingertips measure up to 74 degrees."""
NEAR_M, MOST_STEPS = 1e-5, 12


@dataclass(frozen=True, slots=True)
class ObjectPath:
    """The object's turn: place_m (3,) about which it turns, orientation R (3, 3) at angle 0, axis (3,)."""

    place_m: Array
    R: Array
    axis: Array

    def at(self, angle_rad: float) -> Array:
        """Return the object's orientation (3, 3) at this angle."""
        return np.asarray(rotation.exp(angle_rad * self.axis) @ self.R)


@dataclass(frozen=True, slots=True)
class Touch:
    """A tip on a face at one angle. q_rad: (nq,) with this finger's joints; point_m: (3,) in the object."""

    face: ShapeFace
    q_rad: Array
    point_m: Array


class FingerReach:
    """The reach of each finger of a hand within the limits of hand.toml."""

    def __init__(self, hand: HandKinematics, config: HandConfig, depth_m: float) -> None:
        """depth_m: indentation of a loaded tip, which rolls with so much less than its radius."""
        self._hand = hand
        self.radius_m = config.control.tip_radius_m
        self.rolling_radius_m = self.radius_m - depth_m
        ends = itertools.accumulate((len(finger.joints) for finger in config.fingers), initial=0)
        self.columns = [slice(first, last) for first, last in itertools.pairwise(ends)]
        margin = config.control.soft_limit_rad + JOINT_MARGIN_RAD
        self._low = np.array([joint.min_rad + margin for joint in config.joints])
        self._high = np.array([joint.max_rad - margin for joint in config.joints])

    @property
    def fingers(self) -> int:
        """The number of fingers."""
        return len(self.columns)

    def tips_m(self, q_rad: Array) -> Array:
        """Return the tips' centres (n, 3)."""
        return self._hand.tip_centres_m(q_rad)

    def with_tip_at(self, finger: int, q_rad: Array, centre_m: Array) -> Array | None:
        """Return q (nq,) with the finger's tip centre at (3,), None beyond reach; other joints stay.

        Newton's method from the present joints, with least squares where a finger has more than three.
        """
        q, columns = np.array(q_rad), self.columns[finger]
        for _ in range(MOST_STEPS):
            pose = self._hand.pose(q)
            missing = centre_m - pose.tip_centre_m[finger]
            if rotation.norm(missing) < NEAR_M:
                return q if self._is_inside(finger, q) else None
            J = pose.tip_jacobian_m[finger][:, columns]
            step = np.linalg.pinv(J, rcond=1e-3) @ missing
            q[columns] += step * min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-12))
        return None

    def problem(self, finger: int, touch: Touch, R: Array, steepest: float) -> str:
        """Return why a touch is not allowed, or nothing.

        steepest: largest tangent of the angle between the normal and the line from the object's place.
        """
        along, out = touch.face.normal, touch.point_m
        height = float(along @ out)
        if not self._is_inside(finger, touch.q_rad):
            return "joint range"
        if touch.face.inset_m(touch.point_m) < EDGE_M:
            return "edge of the face"
        if height <= 0.0 or rotation.norm(out - height * along) > steepest * height:
            return "friction"
        pose = self._hand.pose(touch.q_rad)
        J = pose.tip_jacobian_m[finger][:, self.columns[finger]]
        if float(np.linalg.svd(J, compute_uv=False)[-1]) < LEAST_GAIN_M:
            return "finger nearly stretched"
        if -float(pose.tip_rotation[finger][:, 2] @ (R @ along)) < math.cos(math.radians(WIDEST_DOME_DEG)):
            return "side of the dome"
        return ""

    def follow(
        self, finger: int, touch: Touch, path: ObjectPath, start_rad: float, end_rad: float, steepest: float
    ) -> tuple[list[tuple[float, Touch]], str]:
        """Return the touches while the object turns from one angle to the other, and why they end early."""
        steps = max(1, math.ceil((end_rad - start_rad) / STEP_RAD - 1e-9))
        step_rad = (end_rad - start_rad) / steps
        found = [(start_rad, touch)]
        for number in range(1, steps + 1):
            angle = start_rad + number * step_rad
            touch = self._rolled(finger, touch, path, angle, step_rad)
            why = self.problem(finger, touch, path.at(angle), steepest)
            if why:
                return found, why
            found.append((angle, touch))
        return found, ""

    def _rolled(
        self, finger: int, touch: Touch, path: ObjectPath, angle_rad: float, step_rad: float
    ) -> Touch:
        """Return the touch one step later: half the step from the start's Jacobian, half from the end's."""
        before, columns = path.at(angle_rad - step_rad), self.columns[finger]
        moved_m = rotation.cross(path.axis * step_rad, before @ touch.point_m)
        first = self._joint_step(finger, self._hand.pose(touch.q_rad), before @ touch.face.normal, moved_m)
        q = np.array(touch.q_rad)
        q[columns] += first
        R = path.at(angle_rad)
        pose = self._hand.pose(q)
        moved_m = rotation.cross(path.axis * step_rad, R @ touch.point_m)
        second = self._joint_step(finger, pose, R @ touch.face.normal, moved_m)
        q[columns] += 0.5 * (second - first)
        normal = R @ touch.face.normal
        tip_m = self.tips_m(q)[finger]
        off_m = float(normal @ (tip_m - path.place_m)) - touch.face.distance_m - self.rolling_radius_m
        q[columns] += self._joint_step(finger, pose, normal, -off_m * normal)
        contact_m = self.tips_m(q)[finger] - self.rolling_radius_m * normal
        return Touch(touch.face, q, R.T @ (contact_m - path.place_m))

    def _joint_step(self, finger: int, pose: HandPose, normal: Array, moved_m: Array) -> Array:
        """Return the finger's joint step with which its skin at the contact moves by (3,)."""
        turn = pose.tip_turn_jacobian
        assert turn is not None
        columns = self.columns[finger]
        J = pose.tip_jacobian_m[finger][:, columns] + np.cross(
            turn[finger][:, columns], -self.rolling_radius_m * normal, axis=0
        )
        return np.asarray(np.linalg.pinv(J, rcond=1e-3) @ moved_m)

    def _is_inside(self, finger: int, q_rad: Array) -> bool:
        columns = self.columns[finger]
        q = q_rad[columns]
        return bool(np.all(q >= self._low[columns]) and np.all(q <= self._high[columns]))
