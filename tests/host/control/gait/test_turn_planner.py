"""Plans of large turns: what they promise is checked by geometry of its own, and refusals have a reason."""

import math

import msgspec
import numpy as np
import pytest
from tests.host.control.gait.gait_hand import loaded, path, planned, reach, shape, start_rad

from palpate_host.common.gait_plan import GaitRefusal, GaitRefusedError, Regrasp, TurnTo
from palpate_host.control.gait.finger_reach import FingerReach
from palpate_host.control.gait.turn_planner import plan_turn


def test_a_turn_within_reach_needs_no_regrasp():
    plan = planned(angle_deg=10.0)
    assert plan.regrasps == 0
    assert [type(step) for step in plan.steps] == [TurnTo]
    assert plan.steps[-1].angle_rad == pytest.approx(math.radians(10.0))


@pytest.mark.slow
@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)])
def test_a_quarter_turn_is_planned_on_faces_that_exist(axis):
    plan = planned(axis, 90.0)
    angles = [step.angle_rad for step in plan.steps if isinstance(step, TurnTo)]
    assert angles == sorted(angles)
    assert angles[-1] == pytest.approx(math.pi / 2.0)
    assert 4 <= plan.regrasps <= 12
    assert plan.friction <= 0.35
    for step in plan.steps:
        if not isinstance(step, Regrasp):
            continue
        assert step.share[step.finger] == 0.0
        assert np.count_nonzero(step.share) == 3
        assert all(share > 0.0 for share in step.share_after)
        planes = [face for face in shape().faces if np.allclose(face.normal, step.normal)]
        assert len(planes) == 1
        assert planes[0].normal @ step.point_m == pytest.approx(planes[0].distance_m)
        off_m = np.array(step.point_m) - planes[0].distance_m * np.array(step.normal)
        tangent = np.linalg.norm(off_m) / planes[0].distance_m
        assert tangent < 0.35


@pytest.mark.slow
def test_fingers_take_hold_one_after_another_ahead_of_the_turn():
    """About z each finger follows until its contact is behind, then moves to the face that comes."""
    plan = planned(angle_deg=40.0)
    fingers = [step.finger for step in plan.steps if isinstance(step, Regrasp)]
    assert sorted(fingers) == [0, 1, 2, 3]
    for step in plan.steps:
        if isinstance(step, Regrasp):
            home = math.radians(90.0 * step.finger)
            face = math.atan2(step.normal[1], step.normal[0])
            back = (face - home + math.pi) % (2.0 * math.pi) - math.pi
            assert back == pytest.approx(-math.pi / 4.0, abs=1e-6)


@pytest.mark.slow
def test_too_little_friction_is_refused():
    with pytest.raises(
        GaitRefusedError, match=r"grip needs a friction of 0\.\d+, pose_law.friction leaves"
    ) as refused:
        planned(friction=0.15)
    assert refused.value.reason is GaitRefusal.FRICTION


def test_three_fingers_are_refused():
    config, hand = loaded()
    three = FingerReach(hand, msgspec.structs.replace(config, fingers=config.fingers[:3]), 0.0)
    with pytest.raises(GaitRefusedError, match="a hand of 3 fingers holds with too few") as refused:
        plan_turn(three, shape(), path((0, 0, 1)), start_rad(), 1.0, 0.4)
    assert refused.value.reason is GaitRefusal.FINGERS


@pytest.mark.slow
def test_joints_that_end_early_are_refused():
    config, hand = loaded()
    fingers = tuple(
        msgspec.structs.replace(
            finger,
            joints=tuple(
                msgspec.structs.replace(joint, min_rad=-0.12, max_rad=0.12)
                if "abduction" in joint.name
                else joint
                for joint in finger.joints
            ),
        )
        for finger in config.fingers
    )
    stiff = FingerReach(hand, msgspec.structs.replace(config, fingers=fingers), 0.003)
    with pytest.raises(
        GaitRefusedError, match=r"cannot follow further .joint range. and reaches no better"
    ) as refused:
        plan_turn(stiff, shape(), path((0, 0, 1)), start_rad(), 1.5, 0.4)
    assert refused.value.reason is GaitRefusal.REACH


def test_the_plan_starts_from_the_faces_that_the_tips_touch():
    np.testing.assert_allclose(
        planned(angle_deg=10.0).normals, [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], atol=1e-9
    )
    assert reach().fingers == 4
