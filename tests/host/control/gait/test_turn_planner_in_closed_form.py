"""Plans for a hand whose reach is known in closed form, about a cube with four fingers on four faces.

A contact wanders by radius times angle, so a finger that begins in the middle of its face is at the tangent
27 mm / 40 mm times the angle from there. Angles are multiples of the planner's step, 2 deg.
"""

import math

import numpy as np
import pytest
from tests.host.control.gait.ideal_reach import (
    HALF_M,
    OUT,
    PLACE_M,
    ROLLING_M,
    IdealReach,
    cube,
    middles_rad,
    turn_about,
)

from palpate_host.common.gait_plan import GaitRefusal, GaitRefusedError, Regrasp, TurnTo
from palpate_host.control.gait.finger_reach import Touch
from palpate_host.control.gait.turn_planner import STEEPEST, plan_turn

Z, X = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
SLOPE = ROLLING_M / HALF_M
"""Tangent of the friction angle for each rad of a turn."""


def planned(angle_deg, friction=0.9, axis=Z, **reach):
    return plan_turn(
        IdealReach(**reach), cube(), turn_about(axis), middles_rad(), math.radians(angle_deg), friction
    )


def farthest_deg(steepest):
    """The last multiple of 2 deg at which a contact is within the limit."""
    return 2.0 * math.floor(math.degrees(steepest / SLOPE) / 2.0)


def split(plan):
    turns = [step for step in plan.steps if isinstance(step, TurnTo)]
    return turns, [step for step in plan.steps if isinstance(step, Regrasp)]


def test_a_short_turn_needs_the_friction_of_its_end():
    plan = planned(20.0)
    (turn,), regrasps = split(plan)
    assert regrasps == []
    assert turn.angle_rad == plan.angle_rad == pytest.approx(math.radians(20.0))
    assert turn.friction == pytest.approx(SLOPE * math.radians(20.0))
    assert turn.share == (1.0, 1.0, 1.0, 1.0)
    assert (plan.axis, plan.normals) == (Z, tuple(map(tuple, OUT)))


@pytest.mark.parametrize(("angle_deg", "shift_m"), [(40.0, 0.002), (50.0, 0.006)])
def test_fingers_take_hold_where_the_rest_of_the_turn_is_least_steep(angle_deg, shift_m):
    """After 28 deg; of places 2 mm apart the one whose larger end of the way is nearest to the middle:
    27 mm times 12 deg are 5.7 mm, from +2 to -3.7 mm; times 22 deg 10.4 mm, from +6 to -4.4 mm."""
    turns, regrasps = split(planned(angle_deg))
    assert [turn.angle_rad for turn in turns] == pytest.approx(np.radians([28.0, angle_deg]))
    assert turns[0].friction == pytest.approx(SLOPE * math.radians(28.0))
    rest_m = ROLLING_M * math.radians(angle_deg - 28.0) - shift_m
    assert turns[1].friction == pytest.approx(max(shift_m, rest_m) / HALF_M)
    assert sorted(step.finger for step in regrasps) == [0, 1, 2, 3]
    for step in regrasps:
        np.testing.assert_allclose(step.normal, OUT[step.finger], atol=1e-12)
        point_m = HALF_M * OUT[step.finger] + shift_m * np.cross(Z, OUT[step.finger])
        np.testing.assert_allclose(step.point_m, point_m, atol=1e-12)
        assert step.clearance_m == 0.006
        assert [share == 0.0 for share in step.share] == [finger == step.finger for finger in range(4)]
        assert step.share_after == (1.0, 1.0, 1.0, 1.0)
        assert step.friction <= 0.85


def test_fingers_on_the_axis_follow_without_taking_hold_again():
    """About x the contacts on the faces of x only turn about themselves."""
    turns, regrasps = split(planned(40.0, axis=X))
    assert sorted(step.finger for step in regrasps) == [1, 3]
    assert [turn.angle_rad for turn in turns] == pytest.approx(np.radians([28.0, 40.0]))
    for step in regrasps:
        point_m = HALF_M * OUT[step.finger] + 0.002 * np.cross(X, OUT[step.finger])
        np.testing.assert_allclose(step.point_m, point_m, atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("friction", [0.4, 0.45])
def test_less_friction_makes_shorter_steps_at_the_next_limit_that_fits(friction):
    turns, regrasps = split(planned(40.0, friction=friction))
    first_deg = math.degrees(turns[0].angle_rad)
    assert first_deg in [pytest.approx(farthest_deg(steepest)) for steepest in STEEPEST[1:]]
    assert all(step.friction <= friction - 0.05 for step in regrasps)
    assert len(regrasps) == 4


@pytest.mark.long
def test_without_friction_enough_the_refusal_has_what_the_first_limit_needs():
    with pytest.raises(
        GaitRefusedError, match=r"at 28 deg, without finger .*pose_law.friction leaves 0.05"
    ) as no:
        planned(40.0, friction=0.1)
    assert no.value.reason is GaitRefusal.FRICTION


@pytest.mark.long
@pytest.mark.parametrize(
    ("reach", "why"),
    [({"within_m": 0.03}, r"at 28 deg finger 1 .*\(friction\)"), ({"within_m": 0.008}, r"\(joint range\)")],
)
def test_a_finger_that_gets_no_farther_is_refused(reach, why):
    with pytest.raises(GaitRefusedError, match=why) as refused:
        planned(90.0, **reach)
    assert refused.value.reason is GaitRefusal.REACH


@pytest.mark.long
def test_large_tips_are_in_each_others_way():
    """Tips of 100 mm beside faces 40 mm away: neighbours are 140 mm times sqrt 2 apart, 198 < 204 mm."""
    wide = IdealReach(within_m=0.2, radius_m=0.1, rolling_m=0.1)
    q_rad = (PLACE_M + 0.14 * OUT).ravel()
    with pytest.raises(GaitRefusedError, match="clears the object and the other tips") as refused:
        plan_turn(wide, cube(), turn_about(Z), q_rad, math.radians(90.0), 0.9)
    assert refused.value.reason is GaitRefusal.TIPS


def test_a_finger_is_followed_in_equal_steps_of_2_deg_at_most():
    one, face = IdealReach(), cube().nearest_face(np.array([1.0, 0.0, 0.0]))
    touch = Touch(face, middles_rad(), HALF_M * OUT[0])
    end = math.radians(5.0)
    found, why = one.follow(0, touch, turn_about(Z), 0.0, end, 1.0)
    assert (why, [angle for angle, _ in found]) == ("", pytest.approx([0.0, end / 3, 2 * end / 3, end]))
    assert found[-1][1].point_m[1] == pytest.approx(-ROLLING_M * end)
    found, why = one.follow(0, touch, turn_about(Z), 0.0, end, SLOPE * math.radians(4.0))
    assert (why, len(found)) == ("friction", 3)
