"""The fingertip in virtual time: what goes on the bus, and by when, if frames, beads, bus or clock fail."""

from __future__ import annotations

import dataclasses
import struct

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.reconnecting_bus import BusState, BusStateChange
from palpate_edge.common.contact import Contact, refused_contact
from palpate_edge.common.errors import CameraLostError, CameraStalledError
from palpate_edge.daemon.fingertip_core import FingertipCore
from palpate_edge.node.eds import load_eds
from palpate_edge.node.events import ObjectWritten
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import ContactFlag, Health, MethodCode
from palpate_edge.node.id_conflict import QUIET_US
from palpate_edge.node.nmt import NmtState
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_codec import PdoDirection, pdo_codec

NODE = 0x10
START_US = 1_700_000_000_000_000
PERIOD_US = 33_333
TIMEOUT_US = 200_000
EMCY, TPDO_2, TPDO_3, SDO_ANSWER = 0x80 + NODE, 0x280 + NODE, 0x380 + NODE, 0x580 + NODE
CODECS = {
    can_id: pdo_codec(load_eds(FINGERTIP_EDS, NODE), PdoDirection.TRANSMIT, n)
    for n, can_id in ((2, TPDO_2), (3, TPDO_3))
}
TOUCH = Contact(0, 0, True, True, (0.0, 0.0, 30.0), 1.0, None, 1.0, "", 85, 85)


class Rig:
    """A core, a clock, and all that it has sent, with times."""

    def __init__(self):
        node = FingertipNode(NODE, MethodCode.PAPER, "0" * 16)
        self.now_us = START_US
        self.core = FingertipCore(node, TIMEOUT_US, START_US)
        self.sent = []
        self.dropped = 0
        self.sequence = -1
        self.until(START_US)
        self.hear(CanFrame(0x000, bytes([1, NODE])))

    def until(self, end_us):
        """Poll when the core asks for it, as the loop does."""
        while True:
            step = self.core.poll(self.now_us)
            self.sent += [(self.now_us, frame) for frame in step.frames_out]
            if step.next_due_us > end_us:
                self.now_us = end_us
                return
            self.now_us = max(self.now_us + 1, step.next_due_us)

    def hear(self, *frames, at_us=None):
        self.core.receive(self.now_us, [(at_us or self.now_us, frame) for frame in frames])
        self.until(self.now_us)

    def see(self, seconds=0.0, contact=TOUCH, frames=1):
        """Frames at 30 a second, estimated 3 ms after their exposure."""
        for _ in range(max(frames, round(seconds * 1e6 / PERIOD_US))):
            self.until(self.now_us + PERIOD_US)
            self.sequence += 1
            seen = dataclasses.replace(contact, sequence=self.sequence, exposed_at_us=self.now_us - 3_000)
            self.sent += [(self.now_us, frame) for frame in self.core.contact(self.now_us, seen)]
            self.core.frame_seen(self.now_us, seen, Health(None, self.dropped, 0))
            self.until(self.now_us)

    def wait(self, seconds):
        self.until(self.now_us + round(seconds * 1e6))

    def flags(self):
        """(time, flags) of each TPDO 2."""
        return [
            (at_us, CODECS[TPDO_2].decode(frame.data)[0x2010, 0])
            for at_us, frame in self.sent
            if frame.can_id == TPDO_2
        ]

    def exposures(self):
        values = [CODECS[TPDO_3].decode(frame.data) for _, frame in self.sent if frame.can_id == TPDO_3]
        return [(value[0x2012, 0], value[0x2013, 0]) for value in values]

    def emergencies(self):
        return [struct.unpack_from("<H", frame.data)[0] for _, frame in self.sent if frame.can_id == EMCY]


@pytest.fixture
def rig():
    return Rig()


VALID_TOUCH = ContactFlag.VALID | ContactFlag.CONTACT


def test_a_contact_goes_out_at_once_and_stays_valid_while_frames_come(rig):
    rig.see(seconds=2)
    assert rig.core.state is NmtState.OPERATIONAL
    assert {flags for _, flags in rig.flags()} == {VALID_TOUCH}
    assert len(rig.flags()) == 60
    assert rig.emergencies() == []


def test_without_frames_the_contact_is_withdrawn_within_the_timeout(rig):
    rig.see(seconds=1)
    last_us = rig.now_us
    rig.wait(1.0)
    (at_us, flags) = rig.flags()[-1]
    assert flags == 0
    assert at_us - last_us == TIMEOUT_US
    assert [flags for _, flags in rig.flags()].count(0) == 1  # said once
    assert rig.emergencies() == [0xFF02]


def test_frames_again_end_the_stall_and_sequence_numbers_go_on(rig):
    rig.see(seconds=1)
    rig.wait(1.0)
    rig.see(frames=3)
    assert rig.flags()[-1][1] == VALID_TOUCH
    assert rig.emergencies() == [0xFF02, 0x0000]
    numbers = [sequence for _, sequence in rig.exposures()]
    assert numbers == list(range(len(numbers)))


@pytest.mark.parametrize(
    ("error", "code"), [(CameraLostError("unplugged"), 0xFF01), (CameraStalledError("silent"), 0xFF02)]
)
def test_a_camera_that_fails_withdraws_the_contact_at_once(rig, error, code):
    rig.see(seconds=1)
    rig.core.capture_failed(rig.now_us, error)
    failed_us = rig.now_us
    for _ in range(5):  # each attempt to open it again
        rig.wait(0.5)
        rig.core.capture_failed(rig.now_us, error)
    assert rig.flags()[-1] == (failed_us, 0)
    assert rig.emergencies() == [code]
    rig.see(frames=1)
    assert rig.emergencies() == [code, 0x0000]
    assert rig.flags()[-1][1] == VALID_TOUCH


def test_a_fingertip_that_is_stopped_leaves_nothing_valid_behind(rig):
    rig.see(seconds=1)
    rig.core.stop(rig.now_us)
    rig.wait(0.0)
    assert rig.flags()[-1] == (rig.now_us, 0)
    assert rig.emergencies() == []


def test_a_camera_may_take_its_time_for_a_first_frame(rig):
    rig.wait(2.9)
    assert rig.emergencies() == []
    rig.wait(0.2)
    assert rig.emergencies() == [0xFF02]
    assert rig.flags() == []  # nothing was valid that could be withdrawn


def test_beads_that_are_gone_for_half_a_second_are_an_emergency(rig):
    few = refused_contact(0, 0, "only 20 of 85 beads found", 20, 85)
    rig.see(seconds=1)
    rig.see(seconds=0.4, contact=few)
    assert rig.emergencies() == []
    assert rig.flags()[-1][1] == 0
    rig.see(seconds=0.2, contact=few)
    rig.see(frames=1)
    assert rig.emergencies() == [0xFF03, 0x0000]


def test_another_refusal_is_no_loss_of_beads(rig):
    rig.see(seconds=2, contact=refused_contact(0, 0, "tare in progress", 85, 85))
    assert rig.emergencies() == []


def test_frames_that_are_dropped_in_numbers_are_an_overrun(rig):
    for _ in range(40):
        rig.see(frames=1)
        rig.dropped += 1
    assert rig.emergencies() == [0xFF04]
    rig.see(seconds=1.5)
    assert rig.emergencies() == [0xFF04, 0x0000]


def test_a_frame_dropped_now_and_then_is_none(rig):
    for _ in range(20):
        rig.see(frames=9)
        rig.dropped += 1
    assert rig.emergencies() == []


def test_a_bus_that_came_back_from_bus_off_is_told_and_1029h_obeyed(rig):
    rig.see(seconds=1)
    rig.core.bus_state_changed(BusStateChange(BusState.BUS_OFF, "bus-off", True))
    rig.see(seconds=1)
    rig.core.bus_state_changed(BusStateChange(BusState.UP, "", True))
    rig.wait(0.01)
    assert rig.emergencies() == [0x8140, 0x0000]
    assert rig.core.state is NmtState.PRE_OPERATIONAL  # 1029h:01 = 0


def test_a_bus_that_was_only_away_needs_no_emergency(rig):
    rig.core.bus_state_changed(BusStateChange(BusState.DOWN, "Network is down", False))
    rig.core.bus_state_changed(BusStateChange(BusState.UP, "", False))
    rig.wait(0.01)
    assert rig.emergencies() == []
    assert rig.core.state is NmtState.OPERATIONAL


def test_error_passive_and_its_end(rig):
    for passive in (True, True, False):
        rig.core.error_passive(passive)
    rig.wait(0.01)
    assert rig.emergencies() == [0x8120, 0x0000]


def test_what_lasts_is_told_again_after_an_nmt_reset(rig):
    rig.see(seconds=1)
    rig.core.capture_failed(rig.now_us, CameraLostError("unplugged"))
    rig.wait(0.1)
    rig.hear(CanFrame(0x000, bytes([0x81, NODE])))
    rig.wait(0.1)
    assert rig.emergencies() == [0xFF01, 0xFF01]


def stamp_the_bus(rig, seconds, ahead_us, frames=True):
    """SYNC and 1013h of a bus whose clock is `ahead_us` ahead of ours."""
    for _ in range(round(seconds / 0.05)):
        rig.wait(0.05)
        sent_us = (rig.now_us + ahead_us) & 0xFFFF_FFFF
        rig.hear(CanFrame(0x080), CanFrame(0x1FF, sent_us.to_bytes(4, "little")))


def test_exposures_are_told_on_the_buss_clock(rig):
    stamp_the_bus(rig, 2.0, ahead_us=-7_000_000_123)
    rig.see(frames=1)
    (exposed, _) = rig.exposures()[-1]
    assert exposed == (rig.now_us - 3_000 - 7_000_000_123) & 0xFFFF_FFFF
    assert rig.core.poll(rig.now_us) is not None
    clock = [rig.core._node.slave.read(0x2042, sub) for sub in (1, 2, 3)]
    assert clock[0] == 1


def test_both_frames_in_one_batch_are_paired_and_stamped_on_arrival(rig):
    """The loop was late: what counts is when the kernel had them."""
    for _ in range(30):
        rig.wait(0.05)
        arrived_us = rig.now_us - 4_000
        stamp = (arrived_us + 1_000_000) & 0xFFFF_FFFF
        rig.hear(CanFrame(0x080), CanFrame(0x1FF, stamp.to_bytes(4, "little")), at_us=arrived_us)
    assert rig.core.clock.to_bus_us(rig.now_us) == rig.now_us + 1_000_000


def test_a_clock_that_is_lost_is_told_and_followed_on(rig):
    stamp_the_bus(rig, 2.0, ahead_us=5_000_000)
    rig.see(seconds=6)
    assert rig.emergencies() == [0xFF05]
    assert rig.exposures()[-1][0] == (rig.now_us - 3_000 + 5_000_000) & 0xFFFF_FFFF
    stamp_the_bus(rig, 0.1, ahead_us=5_000_000)
    assert 0x0000 in rig.emergencies()


FOREIGN = CanFrame(0x180 + NODE, bytes(8))


def test_a_foreign_frame_withdraws_the_contact_and_tells_once(rig):
    rig.see(seconds=1)
    begun = len(rig.sent)
    rig.hear(FOREIGN)
    rig.until(rig.now_us + 1)
    sent = [frame for _, frame in rig.sent[begun:]]
    assert [frame.can_id - NODE for frame in sent] == [0x180, 0x280, 0x300, 0x380, 0x080]
    assert rig.flags()[-1][1] == 0
    assert sent[-1].data == bytes.fromhex("5081119001000000")  # 8150h, generic and communication, 0x190
    assert rig.core.state is NmtState.PRE_OPERATIONAL
    expected = "node id 0x10 is used twice: a frame 0x190 came from another node"
    assert rig.core.conflict_problem.startswith(expected)  # the log puts the fingertip's name in front
    assert rig.core.emergencies.names() == ["id collision"]


@pytest.mark.parametrize("end", ["conflict", "stop"])
def test_the_last_withdrawal_does_not_wait_for_the_inhibit_time(rig, end):
    """1801h:03 = 500 ms: the node would be silent before it ends."""
    rig.hear(CanFrame(0x000, bytes([0x80, NODE])))
    for data in ("230118019002 00c0", "2b011803 8813 0000", "230118019002 0040"):
        rig.hear(CanFrame(0x600 + NODE, bytes.fromhex(data)))
        assert rig.sent[-1][1].data[0] == 0x60
    rig.hear(CanFrame(0x000, bytes([0x01, NODE])))
    rig.wait(0.6)
    rig.see(frames=2)
    assert rig.flags()[-1][1] == VALID_TOUCH
    if end == "conflict":
        rig.hear(FOREIGN)
    else:
        rig.core.stop(rig.now_us)
        rig.until(rig.now_us)
    assert rig.flags()[-1] == (rig.now_us, 0)


def test_contacts_return_by_themselves_when_the_stranger_is_silent(rig):
    rig.see(seconds=1)
    rig.hear(FOREIGN)
    begun_us, begun = rig.now_us, len(rig.flags())
    rig.see(seconds=1)
    at_us, flags = rig.flags()[begun]
    assert flags == VALID_TOUCH
    assert QUIET_US <= at_us - begun_us <= QUIET_US + PERIOD_US
    assert rig.core.state is NmtState.OPERATIONAL
    rig.see(seconds=10)
    assert rig.emergencies() == [0x8150, 0x0000]
    assert rig.core.conflict_problem == ""
    assert rig.core.conflict.frames == 1


def test_a_stranger_once_a_second_for_a_minute(rig):
    """One EMCY in all; no contact is valid within the quiet time after a foreign frame."""
    for _ in range(60):
        rig.see(seconds=1)
        rig.hear(FOREIGN)
    last_us = rig.now_us
    rig.see(seconds=1)
    assert rig.emergencies() == [0x8150]
    valid_us = [at_us for at_us, flags in rig.flags() if flags]
    assert not any(last_us < at_us < last_us + QUIET_US for at_us in valid_us)
    assert last_us < valid_us[-1] <= last_us + 1_000_000
    assert rig.core.conflict.frames == 60


def test_a_second_node_that_stays_keeps_this_one_silent_and_answering(rig):
    rig.see(seconds=1)
    rig.hear(FOREIGN)
    begun = len(rig.sent)
    for _ in range(100):
        rig.see(seconds=0.1)
        rig.hear(CanFrame(0x700 + NODE, b"\x05"))
    ids = {frame.can_id for _, frame in rig.sent[begun:]}
    assert ids <= {EMCY, 0x700 + NODE}
    rig.hear(CanFrame(0x600 + NODE, bytes.fromhex("4000100000000000")))
    assert rig.sent[-1][1].can_id == SDO_ANSWER
    assert rig.emergencies() == [0x8150]


@pytest.mark.parametrize(
    ("commands", "state"),
    [
        ([], NmtState.OPERATIONAL),
        ([0x80], NmtState.PRE_OPERATIONAL),
        ([0x02], NmtState.STOPPED),
        ([0x80, 0x01], NmtState.OPERATIONAL),
        ([0x02, 0x01], NmtState.OPERATIONAL),
        ([0x81], NmtState.PRE_OPERATIONAL),
        ([0x82, 0x01], NmtState.OPERATIONAL),
    ],
)
def test_nmt_commands_meanwhile_count_when_the_node_returns(rig, commands, state):
    rig.hear(FOREIGN)
    for command in commands:
        rig.hear(CanFrame(0x000, bytes([command, NODE])))
        assert rig.core.state is not NmtState.OPERATIONAL
    rig.wait(0.8)
    assert rig.core.state is state


def test_a_new_node_id_by_lss_ends_the_conflict(rig):
    rig.see(seconds=1)
    rig.hear(FOREIGN)
    lss = [bytes.fromhex(one) for one in ("0401000000000000", "1121000000000000", "0400000000000000")]
    rig.hear(*[CanFrame(0x7E5, one) for one in lss])
    rig.hear(CanFrame(0x000, bytes([0x82, 0])))
    assert rig.core.conflict_problem == ""
    rig.hear(CanFrame(0x000, bytes([0x01, 0])))
    assert rig.core.state is NmtState.OPERATIONAL
    rig.hear(FOREIGN)  # now another node's
    assert rig.core.state is NmtState.OPERATIONAL


@pytest.mark.parametrize(("has_led", "answer"), [(False, 0x0800_0022), (True, None)])
def test_an_led_that_is_not_there_takes_no_level(has_led, answer):
    node = FingertipNode(NODE, MethodCode.PAPER, "0" * 16, has_led=has_led)
    node.process(0, [])
    request = CanFrame(0x600 + NODE, bytes.fromhex("2f30200080000000"))
    (frame,) = (one for one in node.process(1, [request]).frames_out if one.can_id == SDO_ANSWER)
    if answer is None:
        assert frame.data[0] == 0x60
    else:
        assert frame.data == struct.pack("<BHBI", 0x80, 0x2030, 0, answer)


FREE = dataclasses.replace(TOUCH, in_contact=False, position_mm=None, normal_force_N=0.0)


@pytest.mark.parametrize(
    ("contacts", "signature", "code"),
    [
        ([], b"zero", None),
        ([FREE], b"zero", None),
        ([TOUCH], b"zero", 0x0800_0022),
        ([TOUCH, FREE], b"zero", None),
        # A refused frame tells nothing about the touch before it.
        ([TOUCH, refused_contact(0, 0, "frame is blank", 0, 85)], b"zero", 0x0800_0022),
        ([FREE, refused_contact(0, 0, "all beads moved together", 85, 85)], b"zero", None),
        ([TOUCH], b"ZERO", None),
        ([TOUCH], b"Zero", 0x0800_0020),
    ],
)
def test_a_tare_while_touched_is_refused(rig, contacts, signature, code):
    """6125h is write only: the answer and the event are all that a tare is in the core."""
    for contact in contacts:
        rig.see(contact=contact)
    rig.core.receive(rig.now_us, [(rig.now_us, CanFrame(0x600 + NODE, b"\x23\x25\x61\x01" + signature))])
    step = rig.core.poll(rig.now_us)
    (answer,) = [frame.data for frame in step.frames_out if frame.can_id == SDO_ANSWER]
    written = [event for event in step.events if isinstance(event, ObjectWritten)]
    if code is None:
        assert answer == bytes.fromhex("6025610100000000")
        assert [event.index for event in written] == [0x6125]
    else:
        assert answer == struct.pack("<BHBI", 0x80, 0x6125, 1, code)
        assert written == []


def test_a_hot_led_and_a_lost_controller_are_told_once_and_taken_back(rig):
    rig.see(frames=3)
    for _ in range(3):
        rig.core.light(lost=False, too_hot=True)
        rig.see(frames=3)
    rig.core.light(lost=True, too_hot=False)
    rig.see(frames=3)
    rig.core.light(lost=False, too_hot=False)
    rig.see(frames=3)
    assert [code for code in rig.emergencies() if code] == [0x4200, 0xFF06]
    assert rig.emergencies()[-1] == 0x0000


def test_lost_frames_of_the_controller_are_emcy_8110h_until_a_second_passes_without_one(rig):
    rig.core.receive_overruns(rig.now_us, 0)
    rig.wait(0.1)
    assert rig.emergencies() == []
    rig.core.receive_overruns(rig.now_us, 1)
    rig.wait(0.6)
    rig.core.receive_overruns(rig.now_us, 3)
    begun_us = rig.now_us
    rig.wait(0.9)
    rig.core.receive_overruns(rig.now_us, 3)
    assert rig.emergencies() == [0x8110]
    assert rig.core.emergencies.names() == ["receive overrun"]
    assert rig.core._node.slave.read(0x1001) == 0x11  # generic, communication
    rig.wait(1.0)
    cleared_us = [at_us for at_us, frame in rig.sent if frame.can_id == EMCY][-1]
    assert rig.emergencies() == [0x8110, 0x0000]
    assert cleared_us - begun_us == 1_000_000
    assert rig.core.emergencies.names() == []
    assert rig.core._node.slave.read(0x1001) == 0
