"""Reach of a finger, against the joints' kinematics and the rolling of a sphere that does not turn."""

import math

import numpy as np
import pytest
from tests.host.control.gait.gait_hand import DEPTH_M, path, reach, shape, start_rad

from palpate_host.control.gait.finger_reach import Touch


def first_touch(finger):
    one, along = reach(), path((0, 0, 1))
    tip = one.tips_m(start_rad())[finger] - along.place_m
    face = shape().nearest_face(tip)
    point = tip - face.normal * (face.normal @ tip - face.distance_m)
    q = one.with_tip_at(finger, start_rad(), along.place_m + point + one.rolling_radius_m * face.normal)
    return Touch(face, q, point)


def test_a_tip_is_placed_where_it_is_wanted_and_the_other_fingers_stay():
    one, q = reach(), start_rad()
    wanted = one.tips_m(q)[2] + np.array([0.004, -0.01, 0.006])
    found = one.with_tip_at(2, q, wanted)
    np.testing.assert_allclose(one.tips_m(found)[2], wanted, atol=1e-5)
    np.testing.assert_array_equal(np.delete(found.reshape(4, 3), 2, axis=0), q.reshape(4, 3)[:3])


def test_a_place_beyond_the_finger_or_its_joints_is_not_reached():
    one, q = reach(), start_rad()
    assert one.with_tip_at(0, q, np.array([0.5, 0.0, 0.1])) is None
    sideways = one.tips_m(q)[0] + np.array([0.0, 0.08, 0.0])  # abduction ends at 0.5 rad
    assert one.with_tip_at(0, q, sideways) is None


def test_a_tip_rolls_by_its_radius_times_the_angle():
    """About z an abducting tip does not turn with the object: the contact wanders by r theta."""
    one, turned = reach(), math.radians(10.0)
    found, why = one.follow(0, first_touch(0), path((0, 0, 1)), 0.0, turned, 1.0)
    assert why == ""
    wandered = found[-1][1].point_m - found[0][1].point_m
    assert found[-1][0] == pytest.approx(turned)
    assert wandered[1] == pytest.approx(-one.rolling_radius_m * turned, rel=0.02)
    assert abs(wandered[0]) < 2e-5  # on the face


def test_the_contact_keeps_its_distance_from_the_tip():
    one, along = reach(), path((1, 0, 0))
    found, _ = one.follow(1, first_touch(1), along, 0.0, math.radians(15.0), 1.0)
    for angle, touch in found:
        R = along.at(angle)
        to_tip = one.tips_m(touch.q_rad)[1] - along.place_m - R @ touch.point_m
        np.testing.assert_allclose(to_tip, (0.03 - DEPTH_M) * (R @ touch.face.normal), atol=5e-5)


@pytest.mark.parametrize(
    ("finger", "axis", "steepest", "why"),
    [(0, (0, 0, 1), 0.2, "friction"), (1, (1, 0, 0), 1.0, "edge of the face")],
)
def test_the_reason_why_a_finger_cannot_follow_is_told(finger, axis, steepest, why):
    assert reach().follow(finger, first_touch(finger), path(axis), 0.0, 1.5, steepest)[1] == why
