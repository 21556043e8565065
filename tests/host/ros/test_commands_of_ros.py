"""Poses of ROS as commands: the rotation is that of scipy, also where roll and yaw turn about one axis."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_host.common.command import CommandError
from palpate_host.ros.commands import move_of, turn_of

ROTATIONS = (
    *Rotation.random(20, random_state=3),
    *(Rotation.from_euler("xyz", (20, pitch, -40), degrees=True) for pitch in (90, -90)),
)


@pytest.mark.parametrize("rotation", ROTATIONS)
def test_a_pose_is_the_displacement_and_the_turn_about_fixed_axes(rotation: Rotation) -> None:
    x, y, z, w = rotation.as_quat()
    move = move_of("hand", "hand", (0.001, -0.002, 0.003), (x, y, z, w))
    assert move.xyz_mm == pytest.approx((1.0, -2.0, 3.0))
    again = Rotation.from_euler("xyz", move.rpy_deg, degrees=True)
    assert (again * rotation.inv()).magnitude() < 1e-7
    roll, pitch, yaw = np.radians(move.rpy_deg)
    assert turn_of((roll, pitch, yaw)).rpy_deg == pytest.approx(move.rpy_deg)


@pytest.mark.parametrize(
    "quaternion", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 1.0), (0.0, 0.0, 0.0, math.nan)]
)
def test_a_quaternion_that_is_no_rotation_is_refused(quaternion) -> None:
    with pytest.raises(CommandError, match="unit length"):
        move_of("", "hand", (0.0, 0.0, 0.0), quaternion)


def test_a_pose_in_another_frame_is_refused() -> None:
    with pytest.raises(CommandError, match="the frame is tip_1: a pose of move is in left/hand"):
        move_of("tip_1", "left/hand", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
