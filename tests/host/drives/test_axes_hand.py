"""A hand whose fingers have one drive node each, with the host, in virtual time."""

from __future__ import annotations

import struct

import msgspec
import numpy as np
import pytest
from tests.host.axes_hand import MBIT_5, on_can_fd, with_axes

from palpate_bus.load.budget import BudgetCase, budget
from palpate_bus.load.fd_bit_count import bit_times
from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.emcy import ErrorRegister
from palpate_host.common.command import Grasp, Recover
from palpate_host.common.joint_command import Follows
from palpate_host.common.mode import Mode
from palpate_host.config.control_config import ForceLaw
from palpate_host.config.hand_config import StartMode
from palpate_host.drives.cia402_device import Cia402Device
from palpate_host.drives.command_frames import torque_commands
from palpate_host.service.replay import replay
from palpate_twin.drives.drive_plant import JointParameters, JointPlant
from palpate_twin.drives.simulated_drives import PlantMotor

NODES = (1, 2, 3)
READY_S = 0.9


@pytest.fixture
def make_rig(bench, table_4):
    def make(order=(0, 1, 2)):
        config, hand = table_4
        return bench.VirtualBench(with_axes(config, order), hand)

    return make


@pytest.fixture
def rig(make_rig):
    return make_rig()


def sdo(rig, node, kind):
    """The host's SDO requests to a node: index, sub-index, value. kind: first byte's upper bits."""
    sent = [f.data for _, f in rig.log if f.can_id == 0x600 + node and f.data[0] >> 5 == kind]
    return [struct.unpack("<xHBI", data) for data in sent]


def test_the_host_maps_enables_and_sets_the_mode_of_each_axis(rig):
    rig.run(READY_S)
    expected = [(0x6060, 0, 10), (0x6860, 0, 10), (0x7060, 0, 10)]
    expected += [(0x1400, 1, 1 << 31 | 0x202), (0x1600, 0, 0)]
    expected += [(0x1600, 1, 0x6040_0010), (0x1600, 2, 0x6071_0010), (0x1600, 3, 0x6840_0010)]
    expected += [(0x1600, 4, 0x6871_0010), (0x1600, 5, 0x7040_0010), (0x1600, 6, 0x7071_0010)]
    expected += [(0x1600, 0, 6), (0x1400, 1, 0x202)]
    expected += [(0x1800, 1, 3 << 30 | 0x182), (0x1A00, 0, 0)]
    for axis, base in enumerate((0x6000, 0x6800, 0x7000)):
        objects = ((0x41, 16), (0x64, 32), (0x6C, 32), (0x77, 16))
        words = [base + number << 16 | bits for number, bits in objects]
        expected += [(0x1A00, 1 + 4 * axis + place, word) for place, word in enumerate(words)]
    expected += [(0x1A00, 0, 12), (0x1800, 1, 1 << 30 | 0x182)]
    assert sdo(rig, 2, 1) == expected
    reads = [key[:2] for key in sdo(rig, 2, 2)]
    bases = (0x6000, 0x6800, 0x7000)
    identity = [(base + number, sub) for base in bases for number, sub in ((0x502, 0), (0x76, 0), (0x92, 1))]
    assert [key for key in reads if key[0] >= 0x6000] == [*identity, *[(base + 0x61, 0) for base in bases]]


def test_one_can_fd_frame_each_way_a_tick(rig):
    rig.run(READY_S)
    begin_us = rig.now_us
    rig.run(1.0)
    frames = [frame for stamp_us, frame in rig.log if stamp_us >= begin_us]
    for node in NODES:
        sent = {f.can_id: 0 for f in frames if f.can_id & 0x7F == node and f.can_id < 0x580}
        for frame in frames:
            if frame.can_id in sent:
                sent[frame.can_id] += 1
                assert (frame.fd, len(frame.data)) == (True, {0x200: 12, 0x180: 48}[frame.can_id & 0x780])
        assert sent == {0x200 + node: 100, 0x180 + node: 100}


def test_the_hand_is_ready_when_each_axis_is_read(waiting):
    """pytest -s prints the time from the host's first tick; one SDO request a tick goes to each node."""
    ready_us = next(status.time_us for status in waiting.statuses if status.mode is Mode.READY)
    after_us = ready_us - waiting.statuses[0].time_us
    requests = sum(frame.can_id == 0x601 for _, frame in waiting.log)
    print(f"READY after {after_us / 1e6:.2f} s, {requests} requests to a node of three axes")
    assert requests * 10_000 <= after_us <= requests * 10_000 + 100_000


def test_the_load_of_the_running_hand_is_that_of_the_budget(rig):
    """All frames of a second, without the SDO reserve, which is for masters."""
    rig.run(READY_S)
    begin_us = rig.now_us
    rig.run(1.0)
    frames = [frame for stamp_us, frame in rig.log if stamp_us >= begin_us]
    percent = 100 * sum(bit_times(frame, 1_000_000, MBIT_5) for frame in frames) / 1_000_000
    case = BudgetCase(3, 0, 30, data_bitrate=MBIT_5, axis_nodes=(3, 3, 3), sdo_per_s=0)
    assert percent == pytest.approx(budget(case).mean_percent, rel=0.05)


@pytest.mark.slow
def test_the_joints_move_as_those_of_drives_with_a_node_each(bench, table_4, rig):
    """Both begin to turn at another time, since axes take longer to be read."""
    config, hand = table_4
    classic = bench.VirtualBench(on_can_fd(config), hand)
    turned = []
    for one in (classic, rig):
        while one.run(0.01).mode is not Mode.MANIPULATE:
            assert one.now_us - bench.START_US < 3_000_000
        begin = joint_angles(one)
        one.run(1.0)
        turned.append(joint_angles(one) - begin)
    assert np.abs(turned[0]).max() > 0.02
    np.testing.assert_allclose(turned[1], turned[0], atol=2e-3)


def joint_angles(rig):
    return np.array([motor.plant.position_rad for motor in rig.plant_motors])


def test_axes_may_have_any_order(make_rig):
    """The joint with axis 2 has the last place in the frames, wherever it stands in hand.toml."""
    rig = make_rig((2, 0, 1))
    rig.run(READY_S)
    at_start = {"abduction": 0.0, "flexion": 0.348, "curl": 1.221}
    for joint in rig.statuses[-1].joints:
        assert joint.position_rad == pytest.approx(at_start[joint.name[:-2]], abs=0.05)
    first = next(f.data for _, f in rig.log if f.can_id == 0x181)
    positions = [struct.unpack_from("<i", first, 12 * slot + 2)[0] for slot in range(3)]
    turn = 360_000 / (2 * np.pi)
    assert positions == pytest.approx([0.348 * turn, 1.221 * turn, 0.0], abs=100)


def test_commands_carry_the_torque_of_each_joint_in_its_place(rig):
    rig.run(READY_S + 1.0)
    for joint, status in enumerate(rig.statuses[-1].joints):
        node, slot = 1 + joint // 3, joint % 3
        last = [f for _, f in rig.log if f.can_id == 0x200 + node][-1]
        word, per_mille = struct.unpack_from("<Hh", last.data, 4 * slot)
        assert word == 0x0F and per_mille == int(status.command_Nm * 1000 / 1.9)


@pytest.fixture
def waiting(bench, table_4):
    """A hand that waits for commands, READY."""
    config, hand = table_4
    rig = bench.VirtualBench(with_axes(config).starting(StartMode.COMMAND), hand)
    assert rig.run(READY_S).mode is Mode.READY
    return rig


def test_an_axis_in_fault_stops_the_hand_with_its_joint_and_recover_leads_back(waiting):
    waiting.core.command(Grasp())
    assert waiting.run(0.7).mode is Mode.GRASP
    waiting.drives[1].axes[2]._fail(0x2310, ErrorRegister.CURRENT)
    waiting.wake(2)
    status = waiting.run(1.0)
    assert status.mode is Mode.FAULT
    assert status.reason == (
        "drive of curl_2 (fault) left operation enabled;"
        " axes of abduction_2, flexion_2, curl_2 (node 0x02): EMCY 2310h"
    )
    states = {joint.name: joint.drive_state for joint in status.joints}
    assert states.pop("curl_2") == "fault" and set(states.values()) == {"switch on disabled"}
    waiting.core.command(Recover())
    status = waiting.run(2.0)
    assert status.mode is Mode.READY
    assert {joint.drive_state for joint in status.joints} == {"operation enabled"}


def test_a_silent_node_stops_the_hand(rig):
    rig.run(READY_S + 0.5)
    rig.silent.add(3)
    status = rig.run(0.3)
    assert status.mode is Mode.FAULT and "drive of abduction_3 (node 0x03): no position" in status.reason


def test_without_the_host_every_axis_switches_off(rig):
    rig.run(READY_S + 0.5)
    rig.silent.add(rig.host_id)
    rig.run(0.25)
    assert {axis.state.value for drive in rig.drives for axis in drive.axes} == {"fault"}


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({(0x1A00, 2): 0x606C_0020, (0x1A00, 3): 0x6064_0020}, "1A00h:02 is 0x606C0020, expected 0x60640020"),
        ({(0x1600, 4): 0x6071_0010}, "1600h:04 is 0x60710010, expected 0x68710010"),
        ({(0x1801, 1): 0x183}, "1801h:01 is 0x183, expected 0x40000282"),
        ({(0x6060 + 0x800, 0): 8}, "6861h:00 is 0x8, expected 0xA"),
    ],
)
def test_a_node_that_does_not_keep_what_the_host_wrote_is_not_started(rig, changed, named):
    node = rig.drives[1]
    process = node.process

    def altered(now_us, frames):
        output = process(now_us, frames)
        node.slave._store.values.update(changed)
        return output

    node.process = altered
    status = rig.run(1.5)
    assert status.mode is Mode.CHECK
    assert f"axes of abduction_2, flexion_2, curl_2 (node 0x02): {named}" in status.reason
    assert CanFrame(0, b"\x01\x02") not in [frame for _, frame in rig.log]


def test_a_classic_drive_in_place_of_such_a_node_is_named(rig):
    rig.drives[0] = Cia402Device(1, PlantMotor(JointPlant(JointParameters())))
    status = rig.run(0.5)
    assert status.mode is Mode.FAULT
    assert "drive of flexion_1 (node 0x01, axis 1) aborts the upload of 6D02h:00" in status.reason
    assert "cia402_axes.eds" in status.reason


def test_a_node_that_boots_while_the_hand_waits_is_configured_again(bench, waiting):
    """Its power was off for a moment."""
    waiting.drives[2] = bench.drives_of(with_axes(bench.load_table_4()[0]), bench.START_POSE_RAD)[2]
    assert waiting.drives[2].slave.read(0x1400, 1) >> 31
    waiting.wake(3)
    assert waiting.run(READY_S).mode is Mode.READY
    assert waiting.drives[2].slave.read(0x1400, 1) == 0x203
    assert {joint.drive_state for joint in waiting.statuses[-1].joints} == {"operation enabled"}


def test_a_log_has_the_commanded_torques_by_joint(table_4, rig):
    rig.run(READY_S + 1.0)
    commands = torque_commands(with_axes(table_4[0]))
    last = [f for _, f in rig.log if f.can_id == 0x203][-1]
    per_mille = commands[0x203].per_mille(last.data)
    assert list(per_mille) == [6, 7, 8]
    assert [int(j.command_Nm * 1000 / 1.9) for j in rig.statuses[-1].joints[6:]] == list(per_mille.values())
    assert commands[0x203].controlword(last.data, 8) == 0x0F


def test_a_log_is_replayed_frame_by_frame(table_4, rig):
    rig.run(READY_S + 1.0)
    records = [LogRecord(*entry) for entry in rig.log]
    sent = [r.frame for r in records if r.frame.can_id in (0x201, 0x202, 0x203)]
    result = replay(records, with_axes(table_4[0]), table_4[1])
    assert [r.frame for r in result.records if r.frame.can_id in (0x201, 0x202, 0x203)] == sent
    assert result.modes[-1] is Mode.MANIPULATE


@pytest.mark.parametrize(
    ("follows", "target", "mode"), [(Follows.VELOCITY, 0x60FF, 9), (Follows.POSITION, 0x607A, 8)]
)
def test_axes_follow_velocity_and_position(bench, table_4, follows, target, mode):
    """18 bytes of three axes, filled up to 20. Each axis has its joint's torque limit, 0.5 of 1.9 N m."""
    config, hand = table_4
    control = msgspec.structs.replace(
        config.control, drives_follow=follows, force_law=ForceLaw.ADMITTANCE, velocity_joints=True
    )
    rig = bench.VirtualBench(with_axes(msgspec.structs.replace(config, control=control)), hand)
    status = rig.run(READY_S + 0.7)
    assert {joint.drive_state for joint in status.joints} == {"operation enabled"}
    slave = rig.drives[0].slave
    for axis in range(3):
        assert slave.read(0x6061 + 0x800 * axis) == mode
        assert slave.read(0x6072 + 0x800 * axis) == 263
        words = [slave.read(0x1600, 1 + 2 * axis), slave.read(0x1600, 2 + 2 * axis)]
        assert words == [0x6040 + 0x800 * axis << 16 | 16, target + 0x800 * axis << 16 | 32]
    commands = [frame for _, frame in rig.log if frame.can_id == 0x201]
    assert {(len(frame.data), frame.fd, frame.data[18:]) for frame in commands} == {(20, True, bytes(2))}
