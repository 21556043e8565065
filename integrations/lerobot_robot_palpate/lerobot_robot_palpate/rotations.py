"""Rotation matrices and roll, pitch, yaw about fixed axes, as the host defines them. Pure."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
GIMBAL_LOCK = 1e-9
"""Cosine of the pitch below which roll and yaw turn about one axis."""
RPY = ("roll_deg", "pitch_deg", "yaw_deg")


def from_rpy_deg(roll_deg: float, pitch_deg: float, yaw_deg: float) -> Matrix:
    """Return the matrix (3, 3) of a roll, then a pitch, then a yaw."""
    (sr, cr), (sp, cp), (sy, cy) = (
        (math.sin(math.radians(angle)), math.cos(math.radians(angle)))
        for angle in (roll_deg, pitch_deg, yaw_deg)
    )
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def to_rpy_deg(R: Matrix) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of `R`, the inverse of `from_rpy_deg`; yaw is 0 at a pitch of 90 deg."""
    cosine = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], cosine)
    if cosine < GIMBAL_LOCK:
        roll, yaw = math.atan2(-R[1, 2], R[1, 1]), 0.0
    else:
        roll, yaw = math.atan2(R[2, 1], R[2, 2]), math.atan2(R[1, 0], R[0, 0])
    return math.degrees(roll), math.degrees(pitch), math.degrees(yaw)


def angle_deg(R: Matrix) -> float:
    """Return the angle of rotation, 0 to 180, exact for small angles too."""
    sine = 0.5 * math.hypot(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
    return math.degrees(math.atan2(sine, 0.5 * (float(np.trace(R)) - 1.0)))
