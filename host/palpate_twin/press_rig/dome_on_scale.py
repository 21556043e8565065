"""Ball and dome: where the ball of the printer touches first, what it presses, and how strongly.

The skin sticks to the ball: the point of first touch stays until the ball leaves the dome, and how far the
ball moves from there is depth and slide of the library's press.
"""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_twin.camera.deformation import ProbePress
from palpate_twin.camera.renderer import CameraView
from palpate_twin.dome.field_grid import SHEAR_SHARES
from palpate_twin.dome.probe import Probe

BALL = Probe.SPHERE5
MOST_THETA_RAD = math.radians(75.0)


class DomeOnScale:
    """One fingertip on the scale. press: of the ball at its last position, None without contact.

    centre_mm: (3,) printer position at which ball and dome would be concentric; to_printer: rotation (3, 3)
    from F to the printer's axes.
    """

    def __init__(self, view: CameraView, centre_mm: Array, to_printer: Array) -> None:
        self.press: ProbePress | None = None
        self._view = view
        self._centre_mm, self._to_printer = centre_mm, to_printer
        radius_mm = BALL.radius_mm
        assert radius_mm is not None
        self._reach_mm = view.twin.sensor.dome.outer_radius_mm + radius_mm
        self._ball_mm = np.array([0.0, 0.0, math.inf])
        self._touched: Array | None = None  # outward direction (3,) of first touch, in F

    def move(self, position_mm: Array) -> None:
        """Bring the ball to a printer position (3,) on a straight way."""
        ball_mm = (position_mm - self._centre_mm) @ self._to_printer
        distance_mm = float(np.linalg.norm(ball_mm))
        if distance_mm >= self._reach_mm:
            self._touched = None
        elif self._touched is None:
            self._touched = self._first_touch(ball_mm)
        self._ball_mm = ball_mm
        self.press = None if self._touched is None else self._press(self._touched, ball_mm)

    @property
    def force_N(self) -> Array:
        """Return the force (3,) on the dome, in the printer's axes."""
        if self.press is None:
            return np.zeros(3)
        force = self._view.dome.press(self.press).force_per_mu_mm2 * self._view.twin.shear_modulus_N_mm2
        return np.asarray(self._to_printer @ force)

    def _first_touch(self, ball_mm: Array) -> Array:
        """Return the outward direction (3,) where the way from the last position enters the dome."""
        start, step = self._ball_mm, ball_mm - self._ball_mm
        if not np.isfinite(start).all():
            return np.asarray(ball_mm / np.linalg.norm(ball_mm))
        along, length2 = float(start @ step), float(step @ step)
        outside = float(start @ start) - self._reach_mm**2
        share = (-along - math.sqrt(max(0.0, along**2 - length2 * outside))) / length2
        place = start + min(1.0, max(0.0, share)) * step
        return np.asarray(place / np.linalg.norm(place))

    def _press(self, touched: Array, ball_mm: Array) -> ProbePress | None:
        theta = math.acos(min(1.0, touched[2]))
        azimuth = math.atan2(touched[1], touched[0])
        if theta > MOST_THETA_RAD:
            return None  # past the side of the dome, where the library has no presses
        moved = ball_mm - self._reach_mm * touched
        towards_base = np.array(
            [math.cos(theta) * math.cos(azimuth), math.cos(theta) * math.sin(azimuth), -math.sin(theta)]
        )
        along_azimuth = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        depth_mm = min(float(-moved @ touched), self._view.dome.largest_depth_mm(theta, BALL))
        if depth_mm <= 0:
            return None
        slide = np.array([moved @ towards_base, moved @ along_azimuth])
        slide *= min(1.0, SHEAR_SHARES[-1] * depth_mm / max(float(np.hypot(*slide)), 1e-9))
        return ProbePress(theta, azimuth, depth_mm, (float(slide[0]), float(slide[1])), BALL)
