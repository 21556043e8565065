"""A hand of four fingers without links: each joint is a coordinate of a tip, so every reach is known in
closed form. Its tips roll on a cube without turning themselves."""

import numpy as np

from palpate_host.control.gait.finger_reach import FingerReach, ObjectPath, Touch
from palpate_host.control.gait.object_shape import hull_of

HALF_M, RADIUS_M, ROLLING_M = 0.04, 0.03, 0.027
PLACE_M = np.array([0.0, 0.0, 0.1])
OUT = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""The direction of each finger from the object."""


def cube():
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return hull_of(HALF_M * corners)[0]


def turn_about(axis):
    return ObjectPath(PLACE_M, np.eye(3), np.array(axis, dtype=float))


def middles_rad():
    """The joints with which the tips touch the middles of four faces."""
    return (PLACE_M + (HALF_M + ROLLING_M) * OUT).ravel()


class IdealReach(FingerReach):
    """within_m: farthest that a tip gets from where it touches the middle of its first face."""

    def __init__(self, within_m=0.07, radius_m=RADIUS_M, rolling_m=ROLLING_M, fingers=4):
        self.radius_m, self.rolling_radius_m = radius_m, rolling_m
        self.columns = [slice(3 * finger, 3 * finger + 3) for finger in range(fingers)]
        self._home_m = PLACE_M + (HALF_M + rolling_m) * OUT
        self._within_m = within_m

    def tips_m(self, q_rad):
        return q_rad.reshape(-1, 3)

    def with_tip_at(self, finger, q_rad, centre_m):
        q = np.array(q_rad)
        q[self.columns[finger]] = centre_m
        return q if self._is_inside(finger, q) else None

    def problem(self, finger, touch, _R, steepest):
        beside_m = np.linalg.norm(touch.point_m - HALF_M * touch.face.normal)
        if not self._is_inside(finger, touch.q_rad):
            return "joint range"
        return "friction" if beside_m > steepest * HALF_M else ""

    def _rolled(self, finger, touch, path, angle_rad, step_rad):
        """A sphere that does not turn rolls back by its radius times the angle."""
        along = np.cross(path.axis, touch.face.normal)
        point_m = touch.point_m - self.rolling_radius_m * step_rad * along
        q = np.array(touch.q_rad)
        centre_m = point_m + self.rolling_radius_m * touch.face.normal
        q[self.columns[finger]] = path.place_m + path.at(angle_rad) @ centre_m
        return Touch(touch.face, q, point_m)

    def _is_inside(self, finger, q_rad):
        tip_m = q_rad[self.columns[finger]]
        return bool(np.linalg.norm(tip_m - self._home_m[finger]) <= self._within_m)
