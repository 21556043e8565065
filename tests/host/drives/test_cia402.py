"""The master's side of the 402 drive: the standard's tables, scales, frames; start-up questions; NMT."""

import math
import struct

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_bus.eds.cia402 import Controlword, DriveState, state_of
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_host.common.joint_command import DriveGoal, Follows, JointCommand
from palpate_host.config import hand_reader
from palpate_host.config.hand_config import HomingConfig
from palpate_host.config.packaged import MODELS
from palpate_host.drives.axis_master import controlword_for
from palpate_host.drives.cia402 import Cia402Drive
from palpate_host.drives.cia402_modes import OperationMode
from palpate_host.drives.cia402_scale import DriveScale
from palpate_host.drives.drive import DriveNeeds
from palpate_host.drives.identify import DriveIdentification
from palpate_host.network.nmt_master import Network

TABLE_4_SCALE = DriveScale(rated_torque_mNm=1900, increments_per_turn=360_000)


@pytest.mark.parametrize(
    ("pattern", "state"),
    # CiA 402-2, table "device state bits" (x is any).
    [
        ("x0xx0000", DriveState.NOT_READY),
        ("x1xx0000", DriveState.SWITCH_ON_DISABLED),
        ("x01x0001", DriveState.READY_TO_SWITCH_ON),
        ("x01x0011", DriveState.SWITCHED_ON),
        ("x01x0111", DriveState.OPERATION_ENABLED),
        ("x00x0111", DriveState.QUICK_STOP_ACTIVE),
        ("x0xx1111", DriveState.FAULT_REACTION),
        ("x0xx1000", DriveState.FAULT),
    ],
)
def test_statusword(pattern, state):
    free = [bit for bit in range(16) if bit >= 8 or pattern[7 - bit] == "x"]
    fixed = sum(1 << bit for bit in range(8) if pattern[7 - bit] == "1")
    for choice in range(0, 1 << len(free), 7):
        word = fixed | sum(1 << bit for k, bit in enumerate(free) if choice >> k & 1)
        assert state_of(word) is state


@pytest.mark.parametrize(
    ("state", "goal", "last", "word"),
    [
        (DriveState.SWITCH_ON_DISABLED, DriveGoal.TORQUE, 0x00, 0x06),
        (DriveState.READY_TO_SWITCH_ON, DriveGoal.TORQUE, 0x06, 0x07),
        (DriveState.SWITCHED_ON, DriveGoal.TORQUE, 0x07, 0x0F),
        (DriveState.OPERATION_ENABLED, DriveGoal.TORQUE, 0x0F, 0x0F),
        (DriveState.FAULT, DriveGoal.TORQUE, 0x0F, 0x80),
        (DriveState.FAULT, DriveGoal.TORQUE, 0x80, 0x00),  # the next reset needs a rising edge
        (DriveState.QUICK_STOP_ACTIVE, DriveGoal.TORQUE, 0x02, 0x00),
        (DriveState.NOT_READY, DriveGoal.TORQUE, 0x00, 0x00),
        (None, DriveGoal.TORQUE, 0x00, 0x00),
        (DriveState.OPERATION_ENABLED, DriveGoal.QUICK_STOP, 0x0F, 0x02),
        (DriveState.QUICK_STOP_ACTIVE, DriveGoal.QUICK_STOP, 0x02, 0x02),
        (DriveState.SWITCHED_ON, DriveGoal.QUICK_STOP, 0x07, 0x00),
        (DriveState.OPERATION_ENABLED, DriveGoal.OFF, 0x0F, 0x00),
    ],
)
def test_controlword(state, goal, last, word):
    assert controlword_for(state, goal, Controlword(last)) == word


@given(st.floats(-3, 3))
def test_torque_never_passes_what_was_asked_nor_the_rating(torque_Nm):
    per_mille = TABLE_4_SCALE.to_per_mille(torque_Nm)
    assert abs(per_mille) <= 1000
    assert abs(TABLE_4_SCALE.to_Nm(per_mille)) <= abs(torque_Nm) + 1e-12
    if abs(torque_Nm) <= 1.9:
        assert abs(TABLE_4_SCALE.to_Nm(per_mille) - torque_Nm) < 0.0019 + 1e-9


def enabled_drive(direction=1, zero_offset_rad=0.0):
    drive = Cia402Drive(needs(direction=direction, zero_offset_rad=zero_offset_rad))
    answer(drive.identification, TABLE_4_DRIVE)
    drive.receive(1, CanFrame(0x284, struct.pack("<Hbh", 0x0237, 10, 100)))
    return drive


def test_frames_of_an_enabled_drive():
    drive = enabled_drive(direction=-1, zero_offset_rad=0.5)
    drive.receive(77, CanFrame(0x184, struct.pack("<ii", 90_000, -180_000)))
    assert drive.state is DriveState.OPERATION_ENABLED
    assert drive.torque_Nm == pytest.approx(-0.19)
    assert drive.joint.stamp_us == 77
    assert drive.joint.position_rad == pytest.approx(0.5 - math.pi / 2)
    assert drive.joint.velocity_rad_s == pytest.approx(math.pi)
    (frame,) = drive.command(JointCommand(DriveGoal.TORQUE, 0.19))
    assert (frame.can_id, frame.data) == (0x204, struct.pack("<Hbh", 0x0F, 10, -100))
    (frame,) = drive.command(JointCommand(DriveGoal.QUICK_STOP, 0.19))
    assert frame.data == struct.pack("<Hbh", 0x02, 10, 0)


def test_wrong_length_names_the_pdo():
    with pytest.raises(BusError, match="node 4 TPDO 1: 7 bytes, expected 8"):
        enabled_drive().receive(1, CanFrame(0x184, bytes(7)))


def needs(follows=Follows.TORQUE, homing=None, **joint_keys):
    """Of node 4, the joint abduction_2 of Table 4's hand."""
    config = hand_reader.load(MODELS / "table4.toml")
    joint = msgspec.structs.replace(config.joints[3], home_rad=0.25 * math.pi, **joint_keys)
    control = msgspec.structs.replace(config.control, drives_follow=follows)
    return DriveNeeds(4, joint, control, homing)


def answer(identification, values, refused=()):
    """Serve the questions with expedited 4-byte uploads, or an abort where the value is None; take what is
    written, but for what is refused. Returns what was asked and what was written."""
    now_us = 0
    asked, written = [], []
    while (frame := identification.due(now_us)) is not None:
        now_us += 1000
        command, index, sub = struct.unpack("<BHB", frame.data[:4])
        if command == 0x40:
            asked.append((frame.can_id, command, index, sub))
            value = values[index]
            head = (0x80, index, sub, 0x06020000) if value is None else (0x43, index, sub, value)
        else:
            size = {0x2F: 1, 0x2B: 2, 0x23: 4}[command]
            written.append((index, sub, size, int.from_bytes(frame.data[4 : 4 + size], "little")))
            assert not any(frame.data[4 + size :])
            head = (0x80, index, sub, 0x06020000) if index in refused else (0x60, index, sub, 0)
        identification.receive(CanFrame(0x584, struct.pack("<BHBI", *head)))
    return asked, written


TABLE_4_DRIVE = {0x6502: 0x3A5, 0x6076: 1900, 0x6092: 360_000}


def test_identification_asks_and_scales():
    identification = DriveIdentification(needs())
    asked, written = answer(identification, {0x6502: 0x280, 0x6076: 1900, 0x6092: 360_000})
    assert asked == [(0x604, 0x40, 0x6502, 0), (0x604, 0x40, 0x6076, 0), (0x604, 0x40, 0x6092, 1)]
    assert written == []
    assert identification.scale == TABLE_4_SCALE


def test_a_drive_that_limits_its_current_alone_gets_that_limit():
    identification = DriveIdentification(needs(Follows.VELOCITY))
    _, written = answer(identification, TABLE_4_DRIVE, refused=(0x6072,))
    assert written[0] == (0x6072, 0, 2, math.floor(1000 * needs().joint.torque_limit_Nm / 1.9))
    assert [(index, value) for index, _, _, value in written][1] == (0x6073, written[0][3])


def test_a_drive_that_follows_velocity_gets_another_mapping():
    """The five steps of CiA 301: invalid, no objects, the objects, how many, valid."""
    identification = DriveIdentification(needs(Follows.VELOCITY))
    _, written = answer(identification, TABLE_4_DRIVE)
    assert identification.mode is OperationMode.CYCLIC_VELOCITY
    assert written[1:] == [
        (0x1400, 1, 4, 0x80000204),
        (0x1600, 0, 1, 0),
        (0x1600, 1, 4, 0x60400010),
        (0x1600, 2, 4, 0x60600008),
        (0x1600, 3, 4, 0x60FF0020),
        (0x1600, 0, 1, 3),
        (0x1400, 1, 4, 0x204),
    ]


# CiA 402-2, 6502h: bits 0 pp, 2 pv, 3 tq, 7 csp, 8 csv, 9 cst.
@pytest.mark.parametrize(
    ("follows", "bits", "mode"),
    [
        (Follows.TORQUE, 0x208, 10),
        (Follows.TORQUE, 0x008, 4),
        (Follows.VELOCITY, 0x104, 9),
        (Follows.VELOCITY, 0x004, 3),
        (Follows.POSITION, 0x081, 8),
        (Follows.POSITION, 0x001, 1),
    ],
)
def test_the_mode_is_the_best_that_6502_has(follows, bits, mode):
    identification = DriveIdentification(needs(follows))
    answer(identification, {**TABLE_4_DRIVE, 0x6502: bits})
    assert identification.mode == mode


def test_homing_writes_its_objects():
    homing = HomingConfig(
        method=17, search_rad_s=math.pi / 180, zero_rad_s=math.pi / 360, acceleration_rad_s2=1
    )
    _, written = answer(DriveIdentification(needs(homing=homing)), TABLE_4_DRIVE)
    degrees = needs().joint.direction * (45_000 - 1000 * math.degrees(needs().joint.zero_offset_rad))
    assert written[1:] == [
        (0x6098, 0, 1, 17),
        (0x6099, 1, 4, 1000),
        (0x6099, 2, 4, 500),
        (0x609A, 0, 4, 57296),
        (0x607C, 0, 4, round(degrees) & 0xFFFFFFFF),
    ]


@pytest.mark.parametrize(
    ("follows", "homing", "values", "refused", "says"),
    [
        ("torque", None, {0x6502: 0x100}, (), "lacks.*profile torque.*drives_follow to velocity$"),
        ("velocity", None, {0x6502: 0x200}, (), "lacks.*profile velocity.*drives_follow to torque$"),
        ("position", None, {0x6502: 0x020}, (), "use a drive that has one$"),
        ("torque", HomingConfig(method=17), {0x6502: 0x200}, (), "lacks homing"),
        ("torque", HomingConfig(method=17), {}, (0x6098,), "aborts the .* 6098h:00 = 17.*the homing method"),
        ("velocity", None, {}, (0x1600,), "aborts the download of 1600h:00 = 0"),
        ("velocity", None, {}, (0x6072, 0x6073), "aborts the download of 6073h.*no limit of its own"),
        ("torque", None, {0x6076: 0}, (), "6076h = 0"),
        ("torque", None, {0x6502: None}, (), "aborts the upload of 6502h:00 .abort 06020000h"),
    ],
)  # fmt: skip
def test_identification_refuses(follows, homing, values, refused, says):
    identification = DriveIdentification(needs(Follows(follows), homing))
    with pytest.raises(BusError, match=f"drive of abduction_2 .node 0x04.*{says}"):
        answer(identification, {**TABLE_4_DRIVE, **values}, refused)


def test_an_unanswered_question_is_asked_again_after_200_ms():
    identification = DriveIdentification(needs())
    assert identification.due(0) is not None
    assert identification.due(199_999) is None
    assert identification.due(200_000) is not None


def test_network_resets_starts_and_notices_silence():
    network = Network({1: "a", 2: "b"}, 0x7F, 100_000, 500_000)
    first = network.due(0, ())
    assert first == [CanFrame(0x77F, b"\x05"), CanFrame(0, b"\x82\x01"), CanFrame(0, b"\x82\x02")]
    assert network.due(50_000, ()) == []
    assert network.receive(60_000, CanFrame(0x701, b"\x00")) == 1
    assert network.due(70_000, ()) == []  # not ready yet
    assert network.due(80_000, (1,)) == [CanFrame(0, b"\x01\x01")]
    assert network.due(90_000, (1,)) == []
    assert network.receive(95_000, CanFrame(0x701, b"\x05")) is None
    assert network.operates(1) and network.not_operating() == [2]
    assert CanFrame(0, b"\x82\x02") in network.due(1_000_000, (1,))  # the unheard one is asked again
    assert not network.heartbeat_timed_out(1, 595_000) and network.heartbeat_timed_out(1, 595_001)
    assert not network.heartbeat_timed_out(2, 10_000_000)
    assert network.stop_all() == [CanFrame(0, b"\x02\x01"), CanFrame(0, b"\x02\x02")]


def test_what_was_said_before_the_reset_does_not_count():
    network = Network({1: "a"}, 0x7F, 100_000, 500_000)
    network.receive(0, CanFrame(0x701, b"\x05"))
    assert CanFrame(0, b"\x82\x01") in network.due(1, (1,))
