"""Place of the dome in the printer's coordinates, and positions of the ball relative to it.

A ball touches a sphere where the line between their centres meets it, so the contact normal is known from
the ball's position alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.contact import Vector3


def outward(theta_rad: float, azimuth_rad: float) -> Array:
    """Return the unit vector (3,) at a polar angle from +z and an azimuth from +x towards +y."""
    across = math.sin(theta_rad)
    return np.array([across * math.cos(azimuth_rad), across * math.sin(azimuth_rad), math.cos(theta_rad)])


def tangents(normal: Array) -> Array:
    """Return unit vectors (2, 3) at a contact normal (3,): towards the base and along increasing azimuth."""
    theta, azimuth = math.acos(min(1.0, max(-1.0, normal[2]))), math.atan2(normal[1], normal[0])
    return np.array([outward(theta + math.pi / 2, azimuth), [-math.sin(azimuth), math.cos(azimuth), 0.0]])


@dataclass(frozen=True, slots=True)
class DomePlace:
    """centre_mm: printer position at which ball and dome would be concentric; reach_mm: distance between the
    centres when the ball just touches; the sum of both radii, as measured."""

    centre_mm: Vector3
    reach_mm: float

    def ball_mm(
        self, theta_rad: float, azimuth_rad: float, depth_mm: float, slide_mm: tuple[float, float] = (0, 0)
    ) -> Array:
        """Return the printer position (3,) of a press.

        depth_mm: negative above the skin; slide_mm: towards the base and along increasing azimuth.
        """
        normal = outward(theta_rad, azimuth_rad)
        return np.asarray(
            np.asarray(self.centre_mm)
            + (self.reach_mm - depth_mm) * normal
            + np.asarray(slide_mm) @ tangents(normal)
        )

    def depth_mm(self, position_mm: Array) -> float:
        """Return how deep the ball is in the dome at a printer position (3,); negative outside."""
        return self.reach_mm - float(np.linalg.norm(position_mm - np.asarray(self.centre_mm)))

    def bypass_z_mm(self, start_mm: Array, end_mm: Array, clearance_mm: float) -> float:
        """Return the lowest z at which the ball travels level from above `start_mm` to above `end_mm`
        without coming nearer to the dome than the clearance."""
        a, b = (np.asarray(one[:2] - np.asarray(self.centre_mm)[:2]) for one in (start_mm, end_mm))
        step = b - a
        length2 = float(step @ step)
        share = 0.0 if length2 == 0 else min(1.0, max(0.0, -float(a @ step) / length2))
        nearest2 = float(((a + share * step) ** 2).sum())
        height2 = (self.reach_mm + clearance_mm) ** 2 - nearest2
        return max(float(start_mm[2]), float(end_mm[2]), self.centre_mm[2] + math.sqrt(max(0.0, height2)))
