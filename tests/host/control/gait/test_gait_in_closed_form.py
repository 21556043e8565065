"""A gait tick by tick on an ideal hand: each joint is a coordinate of a tip, the object follows its target.

Durations follow from the module's speeds: a smooth step takes 1.5 times as long as one at constant speed.
The tips' plant is a pure damper, b dx/dt = u: the fed-forward damping leads a tip along its path, and the
spring, which sees the path one tick earlier, adds up to one tick's way (`LEAD_M`).
"""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from tests.host.control.gait.ideal_reach import HALF_M, OUT, PLACE_M, RADIUS_M, ROLLING_M

from palpate_host.common import rotation
from palpate_host.common.gait_plan import GaitPlan, Regrasp, TurnTo
from palpate_host.control.gains import Gains
from palpate_host.control.gait.gait import Gait, GaitPhase
from palpate_host.control.holding.pose_target import PoseTarget
from palpate_host.control.holding.virtual_object import VirtualObject
from palpate_host.control.kinematics import HandPose

DT_S = 0.01
DAMPING = 2.0
LEAD_M = 4e-4
STIFFNESS_N_M = 50.0  # 0.5 D/T, D = 2 N s/m, T = 2 ticks of 10 ms
FIRST, LAST = math.radians(20.0), math.radians(40.0)
CLEARANCE_M, SHIFT_M = 0.006, 0.008
FINGER = 2
EQUAL, LIFTED, AFTER = (1.0, 1.0, 1.0, 1.0), (1.0, 0.7, 0.0, 0.7), (1.0, 1.0, 0.5, 1.0)
NEW_POINT_M = HALF_M * OUT[FINGER] + SHIFT_M * np.cross((0, 0, 1), OUT[FINGER])
PLAN = GaitPlan(
    (0.0, 0.0, 1.0),
    LAST,
    tuple(map(tuple, OUT)),
    (
        TurnTo(FIRST, EQUAL, 0.1),
        Regrasp(FINGER, tuple(OUT[FINGER]), tuple(NEW_POINT_M), CLEARANCE_M, LIFTED, AFTER, 0.3),
        TurnTo(LAST, EQUAL, 0.1),
    ),
)
GAINS = Gains(
    f_d_N=1.0,
    K_r=1.0,
    B_Nms_rad=np.full(12, DAMPING),
    tip_radius_m=RADIUS_M,
    friction_ratio=0.5,
    torque_limit_Nm=np.ones(12),
    q_min_rad=np.full(12, -1.0),
    q_max_rad=np.ones(12),
)
JACOBIAN = np.eye(12).reshape(4, 3, 12)


@dataclass
class HeldObject:
    """A pose law with the parts that a gait uses. renewals: (time over which the stiffness changes)."""

    object: VirtualObject
    target: PoseTarget
    is_firm: bool = False
    renewals: list = field(default_factory=list)
    held_here: int = 0

    def renew_stiffness(self, _pose, _dt_s, over_s=0.0):
        self.renewals.append(over_s)

    def hold_here(self):
        self.held_here += 1
        self.target.stay(self.object.place_m, self.object.R)


class Walk:
    """A gait, its hand and its object, from the first tick on. follows: whether the object turns along.

    phases: (phase, its first tick), torque: of the last tick.
    """

    def __init__(self, plan=PLAN, follows=True):
        self.follows, self.count, self.phases = follows, 0, []
        self.tips_m = PLACE_M + (HALF_M + ROLLING_M) * OUT
        held = VirtualObject(self.pose(), OUT, np.eye(3), np.full(4, ROLLING_M), 8.0)
        held.place_m = PLACE_M
        self.law = HeldObject(held, PoseTarget(PLACE_M, np.eye(3)))
        self.gait = Gait(plan, self.law, GAINS)
        self.torque_Nm = np.zeros(12)

    def pose(self):
        turned = np.tile(np.eye(3), (4, 1, 1))
        return HandPose(self.tips_m.ravel(), self.tips_m, JACOBIAN, turned, np.zeros(12))

    def tick(self, **options):
        self.torque_Nm = self.gait.advance(self.law, self.pose(), DT_S, **options)
        self.count += 1
        if not self.phases or self.phases[-1][0] is not self.gait.phase:
            self.phases.append((self.gait.phase, self.count))
        self.tips_m = self.tips_m + DT_S * self.torque_Nm.reshape(4, 3) / DAMPING
        if self.follows:
            held, R = self.law.object, self.law.target.R
            held.R, held.grip = R, held.grip._replace(normal=OUT @ R.T)

    def until(self, phase, most=2000):
        while self.gait.phase is not phase:
            assert self.count < most and not self.gait.is_over, (self.gait.phase, self.gait.reason)
            self.tick()
        return self

    def lifted(self):
        """Walk to CARRY, with a frame that reports no contact of the lifted tip."""
        self.until(GaitPhase.LIFT)
        self.gait.note_contact(FINGER, False)
        return self.until(GaitPhase.CARRY)

    def seconds_in(self, phase):
        start = next(count for one, count in self.phases if one is phase)
        end = next(count for _, count in self.phases if count > start)
        return (end - start) * DT_S


def to_the_end():
    walk = Walk().lifted().until(GaitPhase.APPROACH)
    for _ in range(30):
        walk.tick()
    walk.gait.note_contact(FINGER, True)
    return walk.until(GaitPhase.DONE)


def test_the_phases_follow_each_other_and_end_at_the_target():
    walk = to_the_end()
    names = ["turn", "unload", "lift", "carry", "approach", "load", "turn", "done"]
    assert [phase.value for phase, _ in walk.phases] == names
    assert rotation.angle_deg(walk.law.object.R) == pytest.approx(40.0)
    np.testing.assert_allclose(rotation.log(walk.law.target.R), [0.0, 0.0, LAST], atol=1e-9)
    assert (walk.gait.regrasped, walk.gait.away, walk.gait.reason) == (1, None, "")
    assert walk.gait.is_over and not walk.law.is_firm
    assert walk.law.object.grip.share is None
    assert walk.law.renewals == [1.2, 1.2, 0.0, 1.2, 1.2]
    np.testing.assert_array_equal(walk.torque_Nm, 0.0)


@pytest.mark.parametrize(
    ("phase", "seconds"),
    [
        (GaitPhase.TURN, 1.5 * 20.0 / 12.0 + 0.3),
        (GaitPhase.UNLOAD, 1.2),
        (GaitPhase.LIFT, 1.5 * CLEARANCE_M / 0.04),
        (GaitPhase.APPROACH, 0.31),
        (GaitPhase.LOAD, 1.2),
    ],
)
def test_the_duration_of_each_phase(phase, seconds):
    assert to_the_end().seconds_in(phase) == pytest.approx(seconds, abs=1.1 * DT_S)


def test_a_turn_is_a_smooth_step():
    """Half the angle at half the time, 3/4 - 2/8 = 0.15625 at a quarter, the largest speed 12 deg/s."""
    walk, angles = Walk(), []
    for _ in range(250):
        walk.tick()
        angles.append(rotation.angle_deg(walk.law.target.R))
    assert angles[124] == pytest.approx(10.0) and angles[-1] == pytest.approx(20.0)
    assert angles[61] == pytest.approx(20.0 * (0.248**2 * (3 - 2 * 0.248)), rel=1e-6)
    assert max(np.diff(angles)) / DT_S == pytest.approx(12.0, rel=1e-3)


def test_shares_shift_evenly_in_the_unloading_and_back():
    walk = Walk().until(GaitPhase.UNLOAD)
    for _ in range(60):
        walk.tick()
    np.testing.assert_allclose(walk.law.object.grip.share, [1.0, 0.85, 0.5, 0.85], atol=0.01)
    assert walk.gait.away is None and walk.law.is_firm
    walk.lifted()
    np.testing.assert_allclose(walk.law.object.grip.share, LIFTED)
    assert walk.gait.away == FINGER
    walk.until(GaitPhase.APPROACH).tick()
    walk.gait.note_contact(FINGER, True)
    walk.until(GaitPhase.LOAD)
    for _ in range(60):
        walk.tick()
    np.testing.assert_allclose(walk.law.object.grip.share, [1.0, 0.85, 0.25, 0.85], atol=0.01)
    walk.until(GaitPhase.TURN)
    np.testing.assert_allclose(walk.law.object.grip.share, AFTER)


def test_the_tip_lifts_along_the_old_normal_and_is_carried_over_the_new_place():
    walk = Walk().until(GaitPhase.LIFT)
    start_m, R = walk.tips_m[FINGER], walk.law.object.R
    walk.lifted()
    np.testing.assert_allclose(walk.tips_m[FINGER], start_m + CLEARANCE_M * (R @ OUT[FINGER]), atol=LEAD_M)
    walk.until(GaitPhase.APPROACH)
    over_m = NEW_POINT_M + (RADIUS_M + CLEARANCE_M) * OUT[FINGER]
    np.testing.assert_allclose(walk.tips_m[FINGER], PLACE_M + R @ over_m, atol=LEAD_M)
    for _ in range(40):
        walk.tick()
    closer_m = NEW_POINT_M + (RADIUS_M + CLEARANCE_M - (0.4 + DT_S) * 0.015) * OUT[FINGER]
    np.testing.assert_allclose(walk.tips_m[FINGER], PLACE_M + R @ closer_m, atol=1e-6)
    np.testing.assert_array_equal(np.delete(walk.torque_Nm.reshape(4, 3), FINGER, axis=0), 0.0)


def test_a_tip_that_has_touched_is_pressed_in_by_the_depth_of_before():
    walk = Walk().lifted().until(GaitPhase.APPROACH)
    walk.tick()
    walk.gait.note_contact(FINGER, True)
    touched_m = walk.tips_m[FINGER]
    walk.until(GaitPhase.LOAD)
    for _ in range(118):
        walk.tick()
    inward_m = touched_m - walk.tips_m[FINGER]
    depth_m = RADIUS_M - ROLLING_M
    np.testing.assert_allclose(inward_m, depth_m * (walk.law.object.R @ OUT[FINGER]), atol=3e-4)


def test_a_displaced_tip_is_pulled_back_with_the_stable_stiffness():
    walk = Walk().until(GaitPhase.LIFT)
    walk.tick()
    steady = walk.gait.advance(walk.law, walk.pose(), DT_S, rests=True).reshape(4, 3)[FINGER]
    walk.tips_m[FINGER] += (0.0, 0.0, 0.001)
    pulled = walk.gait.advance(walk.law, walk.pose(), DT_S, rests=True).reshape(4, 3)[FINGER]
    np.testing.assert_allclose(pulled - steady, [0.0, 0.0, -0.001 * STIFFNESS_N_M], atol=1e-12)


def test_a_finger_that_cannot_move_in_one_direction_has_no_stable_stiffness():
    walk = Walk()
    flat = np.array(JACOBIAN[FINGER])
    flat[2] = 0.0
    damping, softest = walk.gait._tip_damping(flat)
    np.testing.assert_allclose(damping, np.diag([DAMPING, DAMPING, 0.0]), atol=1e-12)
    assert softest == pytest.approx(0.0, abs=1e-12)
    damping, softest = walk.gait._tip_damping(np.diag([1.0, 0.5, 2.0]) @ JACOBIAN[FINGER])
    np.testing.assert_allclose(damping, np.diag([2.0, 8.0, 0.5]), atol=1e-9)
    assert softest == pytest.approx(0.5)


def test_a_rest_keeps_target_and_phase():
    walk = Walk()
    for _ in range(50):
        walk.tick()
    R_d = walk.law.target.R
    for _ in range(300):
        walk.tick(rests=True)
    np.testing.assert_array_equal(walk.law.target.R, R_d)
    assert walk.gait.phase is GaitPhase.TURN


def stopped(walk, reason):
    assert walk.gait.phase is GaitPhase.STOPPED and walk.gait.is_over
    assert walk.gait.reason == f"gait stopped: {reason}"
    assert walk.law.held_here == 1
    walk.tick()
    assert not walk.law.is_firm
    np.testing.assert_array_equal(walk.law.target.R, walk.law.object.R)


def test_three_frames_without_contact_of_a_finger_that_holds_stop_the_gait():
    walk = Walk()
    walk.tick()
    for in_contact in (False, False, True, False, False):
        walk.gait.note_contact(1, in_contact)
    walk.tick()
    assert walk.gait.phase is GaitPhase.TURN
    walk.gait.note_contact(1, False)
    walk.tick()
    stopped(walk, "finger 2 lost the object")


def test_the_lifted_finger_may_lose_the_object():
    walk = Walk().lifted()
    for _ in range(5):
        walk.gait.note_contact(FINGER, False)
    walk.tick()
    assert walk.gait.phase is GaitPhase.CARRY


def test_an_object_that_does_not_follow_stops_the_gait():
    walk = Walk(follows=False)
    for _ in range(250 + 299):
        walk.tick()
    assert walk.gait.phase is GaitPhase.TURN
    for _ in range(3):
        walk.tick()
    stopped(walk, "the object does not follow the turn")


def test_a_tip_that_still_touches_after_the_lift_stops_the_gait():
    walk = Walk().until(GaitPhase.CARRY)
    begun = walk.count
    while not walk.gait.is_over:
        walk.tick()
    stopped(walk, "finger 3 still reports contact after it was lifted")
    R = walk.law.object.R
    lifted_m = (HALF_M + ROLLING_M) * OUT[FINGER] + CLEARANCE_M * (R @ OUT[FINGER])
    over_m = R @ (NEW_POINT_M + (RADIUS_M + CLEARANCE_M) * OUT[FINGER])
    distance_m = np.linalg.norm(over_m - lifted_m)
    carry_s = 1.5 * distance_m / 0.10 + 1.0
    assert (walk.count - 1 - begun) * DT_S == pytest.approx(carry_s, abs=1.1 * DT_S)


def test_a_tip_that_finds_no_object_stops_the_gait():
    """6 mm of clearance and 6 mm beyond, at 15 mm/s."""
    walk = Walk().lifted().until(GaitPhase.APPROACH)
    begun = walk.count
    while not walk.gait.is_over:
        walk.tick()
    assert (walk.count - begun) * DT_S == pytest.approx(0.8, abs=1.1 * DT_S)
    stopped(walk, "finger 3 found no object where it should take hold")
    assert walk.gait.away == FINGER


def test_a_contact_counts_only_after_the_tip_was_free_and_on_its_approach():
    walk = Walk().lifted()
    walk.gait.note_contact(FINGER, True)
    walk.until(GaitPhase.APPROACH).tick()
    assert walk.gait.phase is GaitPhase.APPROACH
    walk.gait.note_contact(0, True)
    walk.tick()
    assert walk.gait.phase is GaitPhase.APPROACH


def test_a_closed_gait_puts_the_lifted_finger_down_first():
    walk = Walk().lifted()
    walk.gait.close(walk.law)
    walk.until(GaitPhase.APPROACH).tick()
    walk.gait.note_contact(FINGER, True)
    while not walk.gait.is_over:
        walk.tick()
    assert (walk.gait.phase, walk.gait.away) == (GaitPhase.STOPPED, None)
    assert walk.gait.reason == "gait stopped: ended by a command"
    assert rotation.angle_deg(walk.law.target.R) == pytest.approx(20.0, abs=1e-6)


def test_a_stopped_gait_can_be_closed_as_well():
    walk = Walk().lifted()
    walk.gait.stop(walk.law, "by a test")
    walk.gait.note_contact(0, False)
    walk.tick()
    walk.gait.close(walk.law)
    assert (walk.gait.phase, walk.gait.reason) == (GaitPhase.CARRY, "")
    walk.until(GaitPhase.APPROACH)
