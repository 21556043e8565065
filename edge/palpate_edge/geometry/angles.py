"""Polar angle and azimuth of points in frame F, and rotation about its axis."""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.arrays import Array


def polar_angle(points: Array) -> Array:
    """Return the angle (n,) between +z and points (n, 3), rad; 0 at the apex, pi/2 on the base plane."""
    x, y, z = points.T
    return np.asarray(np.arctan2(np.hypot(x, y), z))


def azimuth(points: Array) -> Array:
    """Return the azimuth (n,) of points (n, 3) or (n, 2) about +z from +x, rad."""
    return np.asarray(np.arctan2(points[:, 1], points[:, 0]))


def rotation_about_z(angle_rad: float) -> Array:
    """Return the matrix (3, 3) that rotates by `angle_rad` about +z."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
