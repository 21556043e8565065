"""The host's commands from ROS messages of standard types. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np

from palpate_host.common.command import CommandError, Move, Reorient, Rotate
from palpate_host.common.rotation import to_rpy_deg
from palpate_host.ros.message_contents import Vector

UNIT_WITHIN = 1e-3
"""Largest deviation of a quaternion's norm from 1: a larger one is no rotation that anybody meant."""


def turn_of(rpy_rad: Vector, ramp_s: float | None = None) -> Rotate:
    """Return the command for a geometry_msgs/Vector3: roll, pitch, yaw about the hand's fixed axes."""
    roll_deg, pitch_deg, yaw_deg = map(math.degrees, rpy_rad)
    return Rotate((roll_deg, pitch_deg, yaw_deg), ramp_s)


def reorient_of(rpy_rad: Vector, corners_m: Sequence[Vector]) -> Reorient:
    """Return the command for the goal of palpate_msgs/Reorient."""
    roll_deg, pitch_deg, yaw_deg = map(math.degrees, rpy_rad)
    corners_mm = tuple((1000.0 * x, 1000.0 * y, 1000.0 * z) for x, y, z in corners_m)
    return Reorient((roll_deg, pitch_deg, yaw_deg), corners_mm)


def move_of(
    frame: str,
    hand_frame: str,
    position_m: Vector,
    quaternion: tuple[float, float, float, float],
    ramp_s: float | None = None,
) -> Move:
    """Return the command for a geometry_msgs/PoseStamped relative to the last desired pose.

    quaternion: x, y, z, w. ramp_s: the duration, None for target.ramp_s of hand.toml. Raises CommandError
    for a frame that is neither `hand_frame` nor empty, and for a quaternion that is not of unit length.
    """
    if frame not in ("", hand_frame):
        raise CommandError(f"the frame is {frame}: a pose of move is in {hand_frame}")
    x, y, z, w = quaternion
    norm = math.hypot(x, y, z, w)
    if not abs(norm - 1.0) <= UNIT_WITHIN:
        raise CommandError(f"the quaternion has the norm {norm:g}: give one of unit length")
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, np.array([w, x, y, z]) / norm)
    x_mm, y_mm, z_mm = (1000.0 * value for value in position_m)
    return Move((x_mm, y_mm, z_mm), to_rpy_deg(rotation.reshape(3, 3)), ramp_s)
