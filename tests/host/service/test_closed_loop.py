"""What can break in the closed loop, in virtual time with an object in the hand: forces, joints, safe states.

What must hold in every schedule: the true contact force stays below limits.contact_force_N, no drive is asked
for more than its joint's limit, no joint leaves its range, and after each fault the hand is in the state, and
within the time, that docs/safety.md says. Then everything is mended, and `recover` brings the hand back with
the same nodes.
"""

import copy
import copyreg
import importlib.util
import re
import struct
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from tests.tiers import seeds

from palpate_bus.eds.cia402 import DriveState
from palpate_host.common.command import Grasp, Recover, Rotate
from palpate_host.common.mode import STOPPED, Mode
from palpate_host.config.control_config import ForceLaw
from palpate_host.config.hand_config import RunConfig, StartMode

JOINT_SLACK_RAD = 0.01  # MuJoCo's joint limits are springs


def load(name):
    path = Path(__file__).parents[1] / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"palpate_{name}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


closed_loop = load("closed_loop")
hand_faults = load("hand_faults")
FAULTS = hand_faults.FAULTS


def changed(config, section, **values):
    part = msgspec.structs.replace(getattr(config, section), **values)
    return msgspec.structs.replace(config, **{section: part})


@pytest.fixture(scope="module")
def hand_of_commands(table_4):
    """Table 4's hand with short times, so that every tier is gone through within a second or two."""
    config, hand = table_4
    config = msgspec.structs.replace(config, run=RunConfig(start=StartMode.COMMAND))
    config = changed(config, "control", settle_ms=100)
    config = changed(config, "staleness", hold_ms=500, stop_ms=1000)
    return config, hand


@pytest.fixture(scope="module")
def turning_hand(bench, hand_of_commands):
    """The hand turns the object by 10 degrees."""
    rig = closed_loop.make_closed_loop(bench, *hand_of_commands)
    until(rig, Mode.READY)
    rig.core.command(Grasp())
    rig.run(0.4)
    rig.core.command(Rotate((0.0, 0.0, 10.0), ramp_s=1.0))
    rig.run(0.1)
    assert rig.statuses[-1].mode is Mode.MANIPULATE
    return rig


@pytest.fixture
def turning(turning_hand):
    """A hand of the test's own that has come so far."""
    copyreg.pickle(struct.Struct, lambda packer: (struct.Struct, (packer.format,)))
    shared = (turning_hand.config, turning_hand.hand)
    return copy.deepcopy(turning_hand, {id(part): part for part in shared})


def test_a_copied_hand_goes_on_as_the_one_it_is_of(turning_hand, turning):
    another = copy.deepcopy(turning)
    turning.run(0.3)
    another.run(0.3)
    assert turning.log[len(turning_hand.log) :] and turning.log == another.log
    assert (
        turning.engine.q_rad.tolist() == another.engine.q_rad.tolist() != turning_hand.engine.q_rad.tolist()
    )


def until(rig, mode, most_s=3.0):
    end_us = rig.now_us + round(most_s * 1e6)
    while rig.statuses[-1:] == [] or rig.statuses[-1].mode is not mode:
        assert rig.now_us < end_us, f"{mode} did not come: {rig.statuses[-1].mode} {rig.statuses[-1].reason}"
        rig.run(0.01)


def check_limits(rig):
    config = rig.config
    assert rig.largest_force_N <= config.limits.contact_force_N
    assert rig.largest_order_ratio <= 1.0 + 1e-9
    low, high = rig.joint_reach_rad
    assert np.all(low >= [joint.min_rad - JOINT_SLACK_RAD for joint in config.joints])
    assert np.all(high <= [joint.max_rad + JOINT_SLACK_RAD for joint in config.joints])


def mode_left_us(rig, since_us, mode=Mode.MANIPULATE):
    stamps = [status.time_us for status in rig.statuses if status.mode is mode and status.time_us >= since_us]
    return max(stamps, default=since_us) - since_us


def name_of(fault):
    return fault.__name__


@pytest.mark.parametrize("fault", FAULTS, ids=name_of)
def test_one_fault(turning, fault):
    """Safe within the stated time; mended, the hand is brought back."""
    rig = turning
    no_turning_us = hand_faults.times(rig.config)[fault][1]
    began_us = rig.now_us
    deadlines = hand_faults.Deadlines(rig)
    deadlines.broken(fault, lasts_us=1_400_000)
    mend = fault(rig, np.random.default_rng(1))
    deadlines.look()
    rig.run(1.4)
    check_limits(rig)
    assert not deadlines.late()
    if no_turning_us is not None:
        assert mode_left_us(rig, began_us) <= no_turning_us
    mend()
    comes_back(rig)


def test_a_drive_that_says_it_is_too_hot_stops_the_hand_though_it_goes_on(turning):
    rig = turning
    mend = hand_faults.drive_too_hot(rig, np.random.default_rng(1))
    until(rig, Mode.FAULT, most_s=0.03)
    status = rig.statuses[-1]
    assert re.fullmatch(
        r"drive of \w+ \(node 0x0\d\): temperature beyond its limit \(EMCY 4310h\):"
        r" let it cool, then recover",
        status.reason,
    )
    assert {joint.drive_state for joint in status.joints} == {"operation enabled"}
    rig.run(0.6)  # quick stop, at most 500 ms, then off
    assert {joint.drive_state for joint in rig.statuses[-1].joints} == {"switch on disabled"}
    mend()
    comes_back(rig)


def comes_back(rig):
    """READY again with the same nodes: by itself, or by `recover` out of fault."""
    rig.run(0.3)
    if rig.statuses[-1].mode in STOPPED:
        rig.run(0.7)
        rig.core.command(Recover())
        until(rig, Mode.READY)
        rig.run(0.3)
        assert all(drive.state is DriveState.OPERATION_ENABLED for drive in rig.drives)
    assert rig.statuses[-1].mode not in STOPPED
    check_limits(rig)


def schedule(rig, seed):
    """One to three faults at random times, each mended after 20 ms to 1.5 s; then all, and back to READY."""
    rng, rig.rng = np.random.default_rng(seed), np.random.default_rng(seed)
    begin_us = rig.now_us
    deadlines = hand_faults.Deadlines(rig)
    events, mends, broken = [], [], []
    for _ in range(int(rng.integers(1, 4))):
        at_us = begin_us + int(rng.uniform(0.0, 0.8e6))
        fault = FAULTS[int(rng.integers(len(FAULTS)))]
        events.append((at_us, fault, at_us + int(rng.uniform(0.02e6, 1.5e6))))
    while rig.now_us < begin_us + 1_800_000:
        for event in [event for event in events if event[0] <= rig.now_us]:
            events.remove(event)
            _, fault, mended_us = event
            deadlines.broken(fault, mended_us - rig.now_us)
            mends.append((mended_us, fault(rig, rng)))
            broken.append(fault.__name__)
        for mend in [mend for mend in mends if mend[0] <= rig.now_us]:
            mends.remove(mend)
            mend[1]()
        deadlines.look()
        rig.run(0.005)
    assert not deadlines.late(), f"seed {seed}: {broken}"
    check_limits(rig)
    for _, mend in mends:
        mend()
    comes_back(rig)
    return broken


@pytest.mark.parametrize("seed", seeds(reduced=4, full=200))
def test_a_random_schedule_of_faults(turning, seed):
    assert schedule(turning, seed)


def squeezed_N(bench, table_4, force_law, limit_N=1000.0, for_s=1.5):
    """Largest contact force in `for_s` of grasp with velocity-commanded joints, and the last status."""
    config, hand = table_4
    config = changed(config, "control", force_law=force_law, velocity_joints=True)
    config = changed(config, "limits", contact_force_N=limit_N)
    rig = closed_loop.make_closed_loop(bench, config, hand, closed_loop.AdmittanceMotor)
    until(rig, Mode.GRASP)
    rig.largest_force_N = 0.0  # the start pose presses the domes into the object
    rig.run(for_s)
    return rig.largest_force_N, rig.statuses[-1]


def test_velocity_joints_pass_50_N_without_the_sensors_force(bench, table_4):
    """qdot = torque / B_d goes on closing on a hard object, whatever f_d asks: 2.7 N."""
    after_1_s_N, _ = squeezed_N(bench, table_4, ForceLaw.OPEN, for_s=1.0)
    after_3_s_N, _ = squeezed_N(bench, table_4, ForceLaw.OPEN, for_s=3.0)
    assert after_1_s_N < 50.0 < after_3_s_N


def test_with_the_sensors_force_in_the_loop_they_come_to_rest_at_the_force_asked_for(bench, table_4):
    _, status = squeezed_N(bench, table_4, ForceLaw.ADMITTANCE)
    assert status.mode in (Mode.GRASP, Mode.MANIPULATE)
    assert all(finger.normal_force_N is not None and finger.normal_force_N < 5.0 for finger in status.fingers)


def test_the_limit_of_force_stops_a_runaway_long_before_50_N(bench, table_4):
    force_N, status = squeezed_N(bench, table_4, ForceLaw.OPEN, limit_N=10.0)
    assert status.mode is Mode.FAULT and "limits.contact_force_N is 10" in status.reason
    assert force_N < 30.0


class WeakMotor(closed_loop.EngineMotor):
    """A drive that gives four fifths of what it is asked for: a worn gear, a wrong torque constant."""

    @property
    def joint_torque_Nm(self) -> float:
        return 0.8 * super().joint_torque_Nm


def grasped_N(bench, hand_of_commands, force_law, motor):
    """Contact force of each finger 2.5 s after the command, (3,) N: the first frame starts the grasp."""
    config, hand = hand_of_commands
    config = changed(config, "control", force_law=force_law)
    rig = closed_loop.make_closed_loop(bench, config, hand, motor)
    until(rig, Mode.READY)
    rig.core.command(Grasp())
    rig.run(2.5)
    assert rig.statuses[-1].mode in (Mode.GRASP, Mode.MANIPULATE), rig.statuses[-1].reason
    check_limits(rig)
    return np.array([touch.normal_force_N for touch in rig.engine.tip_contacts()])


def test_the_integral_of_the_sensors_force_makes_up_for_weak_drives(bench, hand_of_commands):
    sound_N = grasped_N(bench, hand_of_commands, ForceLaw.OPEN, closed_loop.EngineMotor)
    weak_N = grasped_N(bench, hand_of_commands, ForceLaw.OPEN, WeakMotor)
    trimmed_N = grasped_N(bench, hand_of_commands, ForceLaw.INTEGRAL, WeakMotor)
    assert np.all(weak_N <= 0.8 * sound_N)  # less, since the fingers' own weight takes its share first
    assert trimmed_N == pytest.approx(sound_N, rel=0.03)
