"""The whole host core against nine simulated drives and three fingertip nodes, in virtual time."""

import dataclasses
import struct
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_bus.eds.cia402 import DriveState
from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.bus_counters import BusCounters
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact_quantities import SensorOutputs
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus
from palpate_host.config.control_config import ControlMode
from palpate_host.control.virtual_frame import FrameError, virtual_frame
from palpate_host.service.host_core import HostCore
from palpate_host.service.replay import replay

START_UP = (Mode.INIT, Mode.CHECK, Mode.READY, Mode.GRASP)


def modes_of(bench):
    modes = []
    for status in bench.statuses:
        if not modes or modes[-1] is not status.mode:
            modes.append(status.mode)
    return modes


def changed(config, section, **values):
    part = msgspec.structs.replace(getattr(config, section), **values)
    return msgspec.structs.replace(config, **{section: part})


def drives_are_off(bench):
    return all(drive.state is DriveState.SWITCH_ON_DISABLED for drive in bench.drives)


@pytest.fixture
def rig(bench, table_4):
    config, hand = table_4
    return bench.VirtualBench(config, hand)


def test_start_up_to_manipulation_and_an_orderly_stop(rig):
    status = rig.run(1.5)
    assert modes_of(rig) == [*START_UP, Mode.MANIPULATE]
    assert all(drive.state is DriveState.OPERATION_ENABLED for drive in rig.drives)
    assert [finger.frames_per_s for finger in status.fingers] == pytest.approx([30] * 3, abs=2)
    assert status.fingers[0].lost_frames == 0 and status.counters.foreign_frames <= 12
    rig.core.request_stop()
    status = rig.run(2.0)
    assert (status.mode, status.reason) == (Mode.STOP, "stopped by the operator")
    assert rig.output.finished and rig.output.failure == ""
    assert drives_are_off(rig)
    quick_stops = {f.can_id for _, f in rig.log if 0x200 < f.can_id < 0x20A and f.data[:2] == b"\x02\x00"}
    assert quick_stops == set(range(0x201, 0x20A))
    # NMT stop to each of the twelve nodes is the last thing said.
    assert [f.data[:1] for _, f in rig.log[-12:] if f.can_id == 0] == [b"\x02"] * 12


@pytest.mark.parametrize(
    ("outputs", "limit_N", "modes", "reason"),
    [
        (SensorOutputs(force=False), 20.0, START_UP[:-1], "finger-1: gives no contact force"),
        (SensorOutputs(force=False), float("inf"), (*START_UP, Mode.MANIPULATE), "every finger in contact"),
        (SensorOutputs(place=False), 20.0, START_UP, "finger-1: gives no contact place"),
    ],
    ids=["no force", "no force and no limit", "no place"],
)
def test_the_hand_does_not_move_on_what_a_fingertip_never_gives(
    bench, table_4, outputs, limit_N, modes, reason
):
    config, hand = table_4
    rig = bench.VirtualBench(changed(config, "limits", contact_force_N=limit_N), hand)
    rig.tips[0] = FingertipNode(0x10, MethodCode.PAPER, "0" * 16, outputs=outputs)
    status = rig.run(1.5)
    assert tuple(modes_of(rig)) == modes
    assert status.reason.startswith(reason)
    first = status.fingers[0]
    assert first.valid and first.in_contact
    assert (first.position_mm is None, first.normal_force_N is None) == (not outputs.place, not outputs.force)


def test_one_sync_and_one_command_a_drive_each_tick(rig):
    rig.run(1.5)
    ticks = rig.statuses[-1].counters.ticks
    syncs = [stamp for stamp, frame in rig.log if frame.can_id == 0x080]
    assert len(syncs) == ticks and set(np.diff(syncs)) == {10_000}
    last = [frame.can_id for stamp, frame in rig.log if stamp == syncs[-1]]
    assert last.index(0x080) < last.index(0x201)
    assert [can_id for can_id in last if 0x200 < can_id < 0x280] == list(range(0x201, 0x20A))


class RigidObject:
    """An object that the tips roll on: it turns by itself about z while the tips hold still.

    Its three faces look outwards at 0, 120 and 240 degrees; the dome touches where the face's normal meets
    it.
    """

    def __init__(self, rate_deg_s, start_us):
        self.rate_deg_s = rate_deg_s
        self.start_us = start_us

    def rotation(self, time_us):
        return Rotation.from_euler("z", self.rate_deg_s * (time_us - self.start_us) * 1e-6, degrees=True)

    def __call__(self, finger, time_us, pose):
        azimuth = 2 * np.pi * finger / 3
        outwards = self.rotation(time_us).apply([np.cos(azimuth), np.sin(azimuth), 0.0])
        in_dome = pose.tip_rotation[finger].T @ -outwards
        return tuple(30.0 * in_dome)


def test_object_orientation_is_followed_through_delay(bench, table_4):
    """The estimate follows an object that turns under still tips, from frames 40 ms old."""
    config, hand = table_4
    config = changed(config, "control", contact_filter_s=0.0, K_r=0.0)
    thing = RigidObject(2.0, bench.START_US)
    rig = bench.VirtualBench(config, hand, feel=thing)
    rig.run(1.0)
    start = rig.statuses[-1]
    status = rig.run(2.0)
    turned = np.array(status.R_c) @ np.array(start.R_c).T
    angle = Rotation.from_matrix(turned).as_rotvec(degrees=True)
    # 2 s at 2 deg/s. INT16 positions of 0.01 mm on 30 mm leave 0.02 deg.
    np.testing.assert_allclose(angle, [0, 0, 4.0], atol=0.2)
    assert status.fit_residual_deg < 0.1


def test_contacts_are_paired_with_the_pose_of_their_exposure(bench, table_4):
    """The object turns with the moving virtual frame, so M must stay, though every frame is 40 ms late.

    The fingers swing by 0.2 rad at 1 Hz: the pose of now, or of the nearest tick, would be wrong by degrees.
    """
    config, hand = table_4
    config = changed(config, "control", contact_filter_s=0.0, K_r=0.0)

    def feel(finger, _time_us, pose):
        azimuth = 2 * np.pi * finger / 3
        outwards = virtual_frame(pose.tip_centre_m) @ [np.cos(azimuth), np.sin(azimuth), 0.0]
        return tuple(30.0 * (pose.tip_rotation[finger].T @ -outwards))

    rig = bench.VirtualBench(config, hand, feel=feel)
    rig.run(1.0)
    resting = [drive.plant.parameters for drive in rig.drives]
    begun = len(rig.statuses)
    for step in range(150):
        for joint in (0, 3, 6):
            angle_rad = 0.2 * np.sin(2 * np.pi * step / 100)
            rig.drives[joint].plant.parameters = dataclasses.replace(
                resting[joint], grasp_rad=angle_rad, load_stiffness_Nm_rad=40.0
            )
        rig.run(0.01)
    swing = [np.array(status.R_vir) for status in rig.statuses[begun:]]
    widest = max(Rotation.from_matrix(R @ swing[0].T).magnitude() for R in swing)
    M = [R.T @ np.array(status.R_c) for R, status in zip(swing, rig.statuses[begun:], strict=True)]
    wobble = max(Rotation.from_matrix(m @ M[0].T).magnitude() for m in M)
    assert np.degrees(widest) > 10.0
    assert np.degrees(wobble) < 0.3


def test_the_loop_turns_the_desired_frame_against_what_the_object_does(bench, table_4):
    """Target 0: an object that turns by +z is answered by a virtual frame wanted at -z of the same size."""
    config, hand = table_4
    config = changed(config, "control", contact_filter_s=0.0)
    config = changed(config, "target", rpy_deg=(0.0, 0.0, 0.0))
    rig = bench.VirtualBench(config, hand, feel=RigidObject(2.0, bench.START_US))
    rig.run(1.5)
    before = rig.statuses[-1]
    after = rig.run(1.0)
    wanted = Rotation.from_matrix(np.array(after.R_d_vir) @ np.array(before.R_d_vir).T).as_rotvec(
        degrees=True
    )
    assert wanted[2] < -1.0
    torque = np.array([joint.command_Nm for joint in after.joints]).reshape(3, 3)
    # Abduction (about +x, inwards) by a positive angle moves a tip towards -y of its base frame: +azimuth.
    assert np.all(torque[:, 0] < 0.0)


def test_gain_and_loss_of_contact_switch_cleanly(bench, table_4):
    """Finger 2 lets go for 0.4 s and touches elsewhere: blind, then proposed, and R_d_vir never jumps."""
    config, hand = table_4
    lost = (bench.START_US + 1_500_000, bench.START_US + 1_900_000)

    def feel(finger, time_us, pose):
        if finger == 1 and lost[0] <= time_us < lost[1]:
            return None
        return (0.0, 12.0, 27.495) if finger == 1 and time_us >= lost[1] else (0.0, 0.0, 30.0)

    rig = bench.VirtualBench(config, hand, feel=feel)
    rig.run(3.0)
    assert modes_of(rig) == [
        *START_UP, Mode.MANIPULATE, Mode.BLIND, Mode.MANIPULATE,
    ]  # fmt: skip
    turning = [np.array(status.R_d_vir) for status in rig.statuses if status.R_d_vir is not None]
    jumps = [np.degrees(Rotation.from_matrix(b @ a.T).magnitude()) for a, b in pairwise(turning)]
    assert max(jumps) < 0.3
    blind = [status.R_d_vir for status in rig.statuses if status.mode is Mode.BLIND]
    assert blind and all(blind[0] == R for R in blind)


@pytest.mark.long
def test_contacts_that_jump_about_never_pass_the_limits(bench, table_4):
    """Recorded presses do not follow the hand: random places, coming and going. The limits hold."""
    config, hand = table_4
    config = changed(config, "staleness", lost_ms=10_000)  # an empty hand is not this test's subject
    limits = [joint.torque_limit_Nm for joint in config.joints]

    def feel(finger, time_us, _pose):
        rng = np.random.default_rng([finger, time_us // 400_000])
        if rng.random() < 0.3:
            return None
        point = rng.normal(size=3) * [1, 1, 0.3] + [0, 0, 0.3]
        return tuple(30.0 * np.abs(point) / np.linalg.norm(point))

    rig = bench.VirtualBench(config, hand, feel=feel)
    rig.run(6.0)
    assert rig.statuses[-1].mode is not Mode.FAULT
    assert {Mode.HOLD, Mode.MANIPULATE, Mode.BLIND} <= set(modes_of(rig))
    for status in rig.statuses:
        assert all(abs(j.command_Nm) <= limit for j, limit in zip(status.joints, limits, strict=True))
    sent = [f.data for _, f in rig.log if 0x200 < f.can_id < 0x20A and len(f.data) == 5]
    assert max(abs(struct.unpack("<Hbh", data)[2]) for data in sent) <= 0.5 / 1.9 * 1000


def test_blind_by_choice_reaches_the_target_of_the_virtual_frame_without_fingertips(bench, table_4):
    config, hand = table_4
    config = changed(config, "control", mode=ControlMode.BLIND, friction_ratio=10.0)
    config = changed(config, "target", rpy_deg=(0.0, 0.0, 2.0), ramp_s=1.0)
    rig = bench.VirtualBench(config, hand, feel=lambda *_: None)
    rig.run(0.4)
    R_start = virtual_frame(rig.pose().tip_centre_m)
    rig.run(2.5)
    assert modes_of(rig) == [*START_UP, Mode.BLIND]
    turned = Rotation.from_matrix(virtual_frame(rig.pose().tip_centre_m) @ R_start.T).as_rotvec(degrees=True)
    # A proportional law against the load's spring: on the way, and the right way round.
    assert 0.3 < turned[2] <= 2.0


def test_a_silent_fingertip_goes_down_the_ladder(rig):
    rig.run(1.5)
    rig.silent.add(0x11)
    rig.run(6.0)
    assert modes_of(rig)[4:] == [Mode.MANIPULATE, Mode.BLIND, Mode.HOLD, Mode.FAULT]
    assert rig.output.finished and "finger-2: no valid frame for more than 3000 ms" in rig.output.failure
    assert drives_are_off(rig)


def test_a_silent_drive_stops_the_hand(rig):
    rig.run(1.5)
    rig.silent.add(5)
    rig.run(2.0)
    assert rig.output.finished
    assert "drive of flexion_2 (node 0x05)" in rig.output.failure
    assert all(d.state is DriveState.SWITCH_ON_DISABLED for d in rig.drives if d.slave.node_id != 5)


def stand_still(rig, stall_s):
    """The host gets no processor; everybody else goes on."""
    rig.silent.add(rig.host_id)
    rig.run(stall_s)
    rig.silent.remove(rig.host_id)


def test_a_host_that_got_no_processor_blames_no_drive(rig):
    """150 ms are below the drives' own deadline of 200 ms: nobody was asked, and all go on."""
    rig.run(1.5)
    stand_still(rig, 0.15)
    rig.run(0.5)
    assert modes_of(rig) == [*START_UP, Mode.MANIPULATE]
    assert rig.statuses[-1].counters.late_ticks == 15


def test_the_log_of_a_host_that_got_no_processor_is_replayed_with_its_gap(rig, table_4):
    rig.run(1.5)
    stand_still(rig, 0.15)
    rig.run(0.5)
    sent = [(stamp, frame) for stamp, frame in rig.log if 0x200 < frame.can_id < 0x20A]
    result = replay([LogRecord(*entry) for entry in rig.log], *table_4)
    assert result.modes == tuple(modes_of(rig))
    assert result.status.counters.late_ticks == 15
    again = [(r.stamp_us, r.frame) for r in result.records if 0x200 < r.frame.can_id < 0x20A]
    assert again == sent


@pytest.mark.parametrize(("stall_s", "stops_after_s"), [(0.05, 0.15), (0.18, 0.20)])
def test_a_drive_that_dies_while_the_host_gets_no_processor_stops_the_hand(rig, stall_s, stops_after_s):
    """The host's own delay is added to the 100 ms, up to as much again."""
    rig.run(1.5)
    begun_us = rig.now_us
    rig.silent.add(5)
    stand_still(rig, stall_s)
    rig.run(1.0)
    stopped_us = next(status.time_us for status in rig.statuses if status.mode is Mode.FAULT)
    assert "drive of flexion_2 (node 0x05): no position" in rig.output.failure
    assert stops_after_s - 0.01 < 1e-6 * (stopped_us - begun_us) <= stops_after_s + 0.01


def test_a_missing_node_is_named_while_the_host_waits(rig):
    rig.silent.add(0x12)
    status = rig.run(1.5)
    assert status.mode is Mode.INIT
    assert status.reason == "waiting for fingertip of finger-3 (node 0x12)"
    assert all(joint.command_Nm == 0.0 for joint in status.joints)
    assert len([f for _, f in rig.log if f == CanFrame(0, b"\x82\x12")]) == 2
    rig.silent.clear()
    assert rig.run(2.0).mode is Mode.MANIPULATE


def test_a_pdo_of_the_wrong_length_stops_the_hand_safely(bench, table_4):
    broken_from = bench.START_US + 1_500_000

    def cut(stamp_us, frame):
        short = frame.can_id == 0x291 and stamp_us > broken_from
        return [(stamp_us, CanFrame(frame.can_id, frame.data[:7]) if short else frame)]

    rig = bench.VirtualBench(*table_4, to_host=cut)
    status = rig.run(3.0)
    assert status.mode is Mode.FAULT and rig.output.finished
    assert (
        rig.output.failure.startswith("node 17 TPDO 2: 7 bytes, expected 8")
        and "\n" not in rig.output.failure
    )
    assert drives_are_off(rig)


def test_late_ticks_are_left_out_and_counted(table_4, bench):
    core = HostCore(*table_4)
    first = core.process(1_000_000, ())
    assert first.next_due_us == 1_010_000
    late = core.process(1_045_000, ())
    assert late.status.counters.late_ticks == 3 and late.next_due_us == 1_050_000
    assert sum(frame.can_id == 0x080 for frame in late.frames_out) == 1


def test_clockwise_fingers_are_refused_at_the_start(table_4):
    config, hand = table_4
    config = msgspec.structs.replace(config, fingers=config.fingers[::-1])
    mirrored = dataclasses.make_dataclass("Mirrored", ["tip_centres_m"])(
        lambda q: hand.tip_centres_m(q)[::-1]
    )
    with pytest.raises(FrameError, match="numbered clockwise"):
        HostCore(config, mirrored)


def test_random_frames_never_raise(table_4, bench):
    core = HostCore(*table_4)
    rng = np.random.default_rng(1)
    now_us = bench.START_US
    for _ in range(3000):
        now_us += 500
        frame = CanFrame(
            int(rng.choice(core.accept_ids)),
            rng.bytes(int(rng.integers(0, 9))),
            remote=bool(rng.random() < 0.05),
        )
        output = core.process(now_us, [(now_us, frame)])
    assert output.status.mode is Mode.FAULT


def test_status_survives_json(rig):
    status = rig.run(1.5)
    back = msgspec.json.decode(msgspec.json.encode(status), type=HostStatus)
    assert back == status


def test_every_counter_of_the_hosts_bus_is_in_its_status(rig):
    bus = BusCounters(1, 2, send_retries=3, error_frames=4, foreign_frames=5, receive_overruns=6, restarts=7)
    before = rig.run(0.1).counters
    rig.core.set_io_counters(bus, 8)
    counters = rig.run(0.1).counters
    assert (counters.transmit_retries, counters.error_frames) == (3, 4)
    assert (counters.receive_overruns, counters.bus_restarts, counters.status_lines_lost) == (6, 7, 8)
    assert counters.foreign_frames >= before.foreign_frames + 5
