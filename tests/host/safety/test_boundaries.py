"""The exact limits of the modes' ladder and of measured quantities: at the limit, and just beyond it."""

import dataclasses
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from tests.host.safety.test_supervisor import FRESH, GOOD, TIERS, at, with_finger

from palpate_host.common.joint_command import DriveGoal
from palpate_host.common.mode import Mode
from palpate_host.config.packaged import MODELS
from palpate_host.safety.drive_shutdown import DriveShutdown
from palpate_host.safety.runaway import force_fault, joint_fault
from palpate_host.safety.supervisor import Goal, decide
from palpate_host.service.host import load_hand


@pytest.mark.parametrize(
    ("changes", "within", "mode"),
    [
        ("contact_age_us", TIERS.freeze_us, Mode.BLIND),
        ("contact_age_us", TIERS.hold_us, Mode.HOLD),
        ("frame_age_us", TIERS.stop_us, Mode.FAULT),
    ],
)
def test_an_age_at_its_limit_is_young_enough(changes, within, mode):
    def next_mode(age_us):
        return decide(at(Mode.MANIPULATE), with_finger(**{changes: age_us}), TIERS).mode

    before = Mode.BLIND if mode is Mode.HOLD else Mode.MANIPULATE
    assert (next_mode(within), next_mode(within + 1)) == (before, mode)


@pytest.mark.parametrize(("age_us", "warning"), [(100, ""), (101, "finger-2: contact 0 ms old")])
def test_a_contact_older_than_the_first_limit_is_a_warning(age_us, warning):
    assert decide(at(Mode.MANIPULATE), with_finger(contact_age_us=age_us), TIERS).warning == warning


@pytest.mark.parametrize(
    ("age_us", "mode"), [(200, Mode.MANIPULATE), (201, Mode.BLIND), (1000, Mode.BLIND), (1001, Mode.HOLD)]
)
def test_the_frames_of_a_lifted_finger_at_their_limits(age_us, mode):
    lifted = with_finger(is_lifted=True, in_contact=False, contact_age_us=None, frame_age_us=age_us)
    four = dataclasses.replace(lifted, fingers=(*lifted.fingers, FRESH))
    assert decide(at(Mode.MANIPULATE), four, TIERS).mode is mode


@pytest.mark.parametrize(
    ("contact_age_us", "frame_age_us", "is_lost"),
    [(249, 30, False), (250, 30, True), (250, 100, True), (250, 101, False)],
)
def test_an_object_is_lost_by_fresh_frames_without_contact(contact_age_us, frame_age_us, is_lost):
    empty = dataclasses.replace(
        FRESH, in_contact=False, contact_age_us=contact_age_us, frame_age_us=frame_age_us
    )
    inputs = dataclasses.replace(GOOD, fingers=(FRESH, empty, empty))
    found = decide(at(Mode.HOLD), inputs, TIERS)
    assert (found.mode is Mode.FAULT) is is_lost
    if is_lost:
        assert found.reason.startswith("the object is lost: no contact of finger-1, finger-1 for 0 ms")


@pytest.mark.parametrize(("since_us", "is_held"), [(9_750, True), (9_751, False)])
def test_a_grasp_is_a_hold_once_every_finger_has_touched_since_its_begin(since_us, is_held):
    empty = dataclasses.replace(FRESH, in_contact=False, contact_age_us=250)
    inputs = dataclasses.replace(GOOD, fingers=(FRESH, empty, empty))
    assert (decide(at(Mode.GRASP, since_us), inputs, TIERS).mode is Mode.FAULT) is is_held


@pytest.mark.parametrize(("waited_us", "mode"), [(499, Mode.GRASP), (500, Mode.BLIND)])
def test_the_blind_law_waits_for_the_grasp_to_settle(waited_us, mode):
    inputs = dataclasses.replace(GOOD, blind_by_choice=True, goal=Goal.TURN)
    assert decide(at(Mode.GRASP, GOOD.now_us - waited_us), inputs, TIERS).mode is mode


@pytest.fixture(scope="module")
def config():
    return load_hand(MODELS / "table4.toml")[0]


def contact(normal_N, shear_N):
    return SimpleNamespace(normal_force_N=normal_N, shear_N=shear_N)


@pytest.mark.parametrize(
    ("normal_N", "shear_N", "is_fault"),
    [
        (10.0, (0.0, 0.0), False),
        (10.1, (0.0, 0.0), True),
        (1.0, (6.0, 8.0), False),
        (1.0, (6.0, -8.1), True),
        (None, None, False),
        (None, (9.0, 9.0), True),
    ],
)
def test_normal_and_shear_force_have_one_limit(config, normal_N, shear_N, is_fault):
    limits = msgspec.structs.replace(config.limits, contact_force_N=10.0)
    text = force_fault("finger-1", contact(normal_N, shear_N), limits)
    assert bool(text) is is_fault
    assert not text or text.endswith(" N, limits.contact_force_N is 10")


def test_the_fastest_joint_is_named_before_a_torque(config):
    joints = config.joints
    limits = msgspec.structs.replace(config.limits, joint_speed_rad_s=2.0, torque_ratio=1.5)
    speed, torque = np.zeros(len(joints)), [0.0] * len(joints)
    speed[1], speed[4] = 2.0, -2.0
    torque[3] = -1.5 * joints[3].torque_limit_Nm
    assert joint_fault(joints, torque, speed, limits) == ""
    torque[3] *= 1.001
    assert joint_fault(joints, torque, speed, limits).startswith(f"{joints[3].name}: its drive reports -")
    speed[1], speed[4] = 2.1, -2.5
    found = joint_fault(joints, torque, speed, limits)
    assert found == f"{joints[4].name}: 2.5 rad/s, limits.joint_speed_rad_s is 2"


def test_drives_are_off_when_none_has_power_or_after_half_a_second():
    quick = DriveShutdown()
    assert quick.goal(1_499_999, 1_000_000, any_powered=True) is DriveGoal.QUICK_STOP
    assert not quick.is_off and not quick.is_finished(10**9)
    assert quick.goal(1_500_000, 1_000_000, any_powered=True) is DriveGoal.OFF
    assert quick.is_off and not quick.is_finished(1_549_999) and quick.is_finished(1_550_000)
    assert quick.goal(1_600_000, 1_000_000, any_powered=True) is DriveGoal.OFF
    idle = DriveShutdown()
    assert idle.goal(1_000_000, 1_000_000, any_powered=False) is DriveGoal.OFF
