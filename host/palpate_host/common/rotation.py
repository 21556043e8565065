"""Rotations as 3 x 3 matrices: exponential, logarithm and roll-pitch-yaw. Active, in rad."""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rows

_SMALL_ANGLE_RAD = 1e-8
_NEAR_HALF_TURN = 1e-6
_GIMBAL_LOCK = 1e-9
"""Cosine of the pitch below which roll and yaw turn about one axis."""


def cross(a: Array, b: Array) -> Array:
    """a x b of two vectors (3,); numpy's own spends most of its time on shapes."""
    return np.array(rows.cross(a.tolist(), b.tolist()))


def norm(v: Array) -> float:
    """|v| of a vector (3,)."""
    x, y, z = v.tolist()
    return math.sqrt(x * x + y * y + z * z)


def log(R: Array) -> Array:
    """Rotation vector (3,) of `R`, angle in 0..pi; the axis' sign is arbitrary at pi."""
    return np.array(vector_of(R))


def vector_of(R: Array) -> tuple[float, float, float]:
    """Return the rotation vector of `R` as `log`, in plain floats."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R.tolist()
    x, y, z = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)
    sine, cosine = math.sqrt(x * x + y * y + z * z), 0.5 * (xx + yy + zz - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > _NEAR_HALF_TURN:
        per_sine = angle / sine
        return per_sine * x, per_sine * y, per_sine * z
    if cosine > 0.0:
        return x, y, z
    s = np.array([x, y, z])
    # (R + R^T)/2 = 2 a a^T - I at half a turn: the largest column of a a^T is the axis, up to its length.
    columns = 0.25 * (R + R.T) + 0.5 * np.eye(3)
    axis = columns[:, int(np.argmax(np.diag(columns)))]
    if axis @ s < 0.0:
        axis = -axis
    x, y, z = (axis * (angle / norm(axis))).tolist()
    return x, y, z


def exp(rotation_vector_rad: Array) -> Array:
    """Rodrigues' formula: the rotation by |v| about v."""
    x, y, z = rotation_vector_rad.tolist()
    return about(x, y, z)


def about(x: float, y: float, z: float) -> Array:
    """Return the rotation `exp` of a vector in plain floats."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < _SMALL_ANGLE_RAD:
        return np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])
    x, y, z = x / angle, y / angle, z / angle
    s, c = math.sin(angle), math.cos(angle)
    vx, vy, vz = (1.0 - c) * x, (1.0 - c) * y, (1.0 - c) * z
    sx, sy, sz = s * x, s * y, s * z
    rows = (
        *(c + vx * x, vx * y - sz, vx * z + sy),
        *(vx * y + sz, c + vy * y, vy * z - sx),
        *(vx * z - sy, vy * z + sx, c + vz * z),
    )
    return np.array(rows).reshape(3, 3)  # in half the time of nested rows


def from_rpy_deg(roll_deg: float, pitch_deg: float, yaw_deg: float) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll): turns about the fixed axes x, then y, then z."""
    x, y, z = np.eye(3)
    rx, ry, rz = (
        exp(axis * math.radians(angle)) for axis, angle in ((x, roll_deg), (y, pitch_deg), (z, yaw_deg))
    )
    return np.asarray(rz @ ry @ rx)


def to_rpy(R: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of `R` in rad: Rz(yaw) Ry(pitch) Rx(roll).

    Yaw is 0 at a pitch of 90 deg, where it equals a roll. For borders and people, never for control.
    """
    cosine = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], cosine)
    if cosine < _GIMBAL_LOCK:
        return math.atan2(-R[1, 2], R[1, 1]), pitch, 0.0
    return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])


def to_rpy_deg(R: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of `R` in degrees, the inverse of `from_rpy_deg`."""
    roll, pitch, yaw = to_rpy(R)
    return math.degrees(roll), math.degrees(pitch), math.degrees(yaw)


def angle_deg(R: Array) -> float:
    """Angle of the rotation `R`, 0..180."""
    return math.degrees(norm(log(R)))
