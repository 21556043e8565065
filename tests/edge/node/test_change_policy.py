"""The policy for changes: what a master may write in which NMT state, and how often (docs/bus.md)."""

from __future__ import annotations

import struct
from dataclasses import replace

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact
from palpate_edge.node.change_policy import RULES
from palpate_edge.node.eds import load_eds
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.nmt import NmtState
from palpate_edge.node.object_dictionary import DataType, Entry
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.slave import Slave

OPERATIONAL_TOO = {0x1003, 0x1013, 0x1017, 0x2003, 0x2030, 0x6125}
"""Objects that a master writes while the hand runs: history, time, heartbeat, name, light, tare."""

OD = load_eds(FINGERTIP_EDS, 0x10)
WRITABLE = [entry for entry in OD.entries.values() if entry.access.writable]
SAVE, LOAD, ZERO = (int.from_bytes(text, "little") for text in (b"save", b"load", b"zero"))
COMMANDS = {0x1010: SAVE, 0x1011: LOAD, 0x6125: ZERO}
DEVICE_STATE, LOCAL_CONTROL, DONE = 0x0800_0022, 0x0800_0021, None
S = 1_000_000
TOUCH = Contact(1, 0, True, True, (0.0, 9.0, 12.0), 2.0, None, 1.0, "", 31, 31)


def nmt(command: int) -> CanFrame:
    return CanFrame(0x000, bytes((command, 0)))


START, STOP, PRE_OPERATIONAL = nmt(0x01), nmt(0x02), nmt(0x80)


def write(index: int, subindex: int, value: int, size: int = 4) -> CanFrame:
    head = struct.pack("<BHB", 0x23 | (4 - size) << 2, index, subindex)
    return CanFrame(0x610, head + value.to_bytes(size, "little").ljust(4, b"\0"))


def write_of(entry: Entry, value: int) -> CanFrame:
    if entry.data_type is DataType.VISIBLE_STRING:
        return write(*entry.key, value & 0x7F7F7F7F)
    assert entry.size_bytes is not None
    return write(*entry.key, value % (1 << 8 * entry.size_bytes), entry.size_bytes)


def lss(data: str) -> CanFrame:
    return CanFrame(0x7E5, bytes.fromhex(data).ljust(8, b"\0"))


def answers(node: FingertipNode, now_us: int, *frames: CanFrame) -> list[int | None]:
    """Return the abort codes of the SDO responses, DONE without an abort; every save succeeds."""
    output = node.process(now_us, frames)
    for event in output.events:
        if isinstance(event, StoreRequested):
            node.slave.store_finished(True, event.parameters)
    sent = output.frames_out + node.process(now_us, ()).frames_out
    data = [frame.data for frame in sent if frame.can_id == 0x590]
    return [struct.unpack_from("<I", d, 4)[0] if d[0] == 0x80 else DONE for d in data]


@pytest.fixture
def node() -> FingertipNode:
    node = FingertipNode(0x10, MethodCode.CORRECTED, "0123456789abcdef", has_led=True)
    node.process(0, ())
    return node


def test_every_writable_object_has_one_rule() -> None:
    assert {entry.index: sum(entry.index in r.indices for r in RULES) for entry in WRITABLE} == dict.fromkeys(
        (entry.index for entry in WRITABLE), 1
    )


def test_no_rule_is_for_nothing() -> None:
    indices = {entry.index for entry in WRITABLE}
    assert [rule.content for rule in RULES if not indices & set(rule.indices)] == []


def test_every_object_in_operational(node: FingertipNode) -> None:
    """Each gets its present value, which PRE-OPERATIONAL would take."""
    node.process(1, (START,))
    refused = {
        entry.index: answers(node, 1, write_of(entry, COMMANDS.get(entry.index, present(node, entry))))
        for entry in WRITABLE
    }
    expected = {i: [DONE] if i in OPERATIONAL_TOO else [DEVICE_STATE] for i in refused}
    assert refused == expected


def present(node: FingertipNode, entry: Entry) -> int:
    value = node.slave.read(*entry.key)
    return value if isinstance(value, int) else 0


@pytest.mark.parametrize(
    ("index", "subindex", "value", "size"),
    [
        (0x1005, 0, 0x81, 4),
        (0x1007, 0, 1000, 4),
        (0x1010, 1, SAVE, 4),
        (0x1011, 1, LOAD, 4),
        (0x1012, 0, 0x100, 4),
        (0x1014, 0, 0x8000_0090, 4),
        (0x1015, 0, 10, 2),
        (0x1016, 1, 0x7F << 16 | 200, 4),
        (0x1019, 0, 10, 1),
        (0x1020, 1, 15_000, 4),
        (0x1029, 1, 1, 1),
        (0x1400, 2, 1, 1),
        (0x1800, 1, 0xC000_0190, 4),
        (0x1800, 2, 1, 1),
        (0x1803, 5, 500, 2),
    ],
)
def test_a_change_waits_for_pre_operational(
    node: FingertipNode, index: int, subindex: int, value: int, size: int
) -> None:
    request = write(index, subindex, value, size)
    before = node.slave.read(index, subindex)
    node.process(1, (START,))
    assert answers(node, 1, request) == [DEVICE_STATE]
    assert node.slave.read(index, subindex) == before
    node.process(2, (PRE_OPERATIONAL,))
    assert answers(node, 2, request) == [DONE]


@pytest.mark.parametrize(
    "requests",
    [
        ("21 20 10 01 04 00 00 00", "07 98 3a 00 00 00 00 00"),  # segmented
        ("c2 20 10 01 04 00 00 00", "81 98 3a 00 00 00 00 00", "cd 00 00 00 00 00 00 00"),  # block
    ],
)
def test_every_transfer_is_refused(node: FingertipNode, requests: tuple[str, ...]) -> None:
    frames = [CanFrame(0x610, bytes.fromhex(request)) for request in requests]
    node.process(1, (START,))
    assert answers(node, 1, *frames)[-1] == DEVICE_STATE
    node.process(2, (PRE_OPERATIONAL,))
    assert answers(node, 2, *frames)[-1] is DONE
    assert node.slave.read(0x1020, 1) == 15_000


def test_a_conflict_opens_no_door(node: FingertipNode) -> None:
    """One foreign frame makes the node PRE-OPERATIONAL for a while: it returns with its parameters."""
    node.process(1, (START,))
    node.slave.hold()
    assert node.slave.state is NmtState.PRE_OPERATIONAL
    assert answers(node, 2, write(0x1803, 5, 500, 2)) == [DEVICE_STATE]
    node.process(3, (PRE_OPERATIONAL,))
    assert answers(node, 3, write(0x1803, 5, 500, 2)) == [DONE]


def lss_answers(slave: Slave, *requests: str) -> list[str]:
    output = slave.process(1, [lss(request) for request in requests])
    return [frame.data.hex(" ")[:8] for frame in output.frames_out if frame.can_id == 0x7E4]


def test_no_other_node_id_while_operational(node: FingertipNode) -> None:
    """CiA 305: error code FFh, with a specific error in the next byte."""
    node.process(1, (START,))
    assert lss_answers(node.slave, "04 01", "11 20", "17", "5e") == ["11 ff 01", "17 ff 01", "5e 10 00"]
    node.process(2, (nmt(0x82),))
    assert node.slave.node_id == 0x10


@pytest.mark.parametrize("state", [STOP, PRE_OPERATIONAL])
def test_another_node_id_in_the_other_states(node: FingertipNode, state: CanFrame) -> None:
    node.process(1, (START, state))
    assert lss_answers(node.slave, "04 01", "11 20") == ["11 00 00"]


def test_another_node_id_ends_a_conflict(node: FingertipNode) -> None:
    node.process(1, (START,))
    node.slave.hold()
    assert lss_answers(node.slave, "04 01", "11 20") == ["11 00 00"]


def test_saves_are_bounded(node: FingertipNode) -> None:
    def change_and_save(number: int, now_us: int) -> int | None:
        return answers(node, now_us, write(0x1017, 0, 100 + number, 2), write(0x1010, 1, SAVE))[1]

    assert [change_and_save(n, S) for n in range(25)] == [DONE] * 20 + [LOCAL_CONTROL] * 5
    assert [change_and_save(n, 61 * S) for n in range(30, 33)] == [DONE, LOCAL_CONTROL, LOCAL_CONTROL]
    assert answers(node, 61 * S, write(0x1011, 1, LOAD)) == [LOCAL_CONTROL]
    node.process(61 * S, (lss("04 01"), lss("11 20")))
    assert [f.data[:2] for f in node.process(61 * S, (lss("17"),)).frames_out] == [b"\x17\x02"]


def test_a_save_that_changes_nothing_is_not_counted(node: FingertipNode) -> None:
    answers(node, S, write(0x1017, 0, 250, 2))
    assert [answers(node, S, write(0x1010, 1, SAVE)) for _ in range(100)] == [[DONE]] * 100


def test_tares_are_bounded(node: FingertipNode) -> None:
    """Two for each of 22 channels at once, and then one a second."""
    assert [answers(node, S, write(0x6125, 1, ZERO)) for _ in range(46)] == [[DONE]] * 44 + [
        [LOCAL_CONTROL]
    ] * 2
    assert [answers(node, 2 * S, write(0x6125, 1, ZERO)) for _ in range(2)] == [[DONE], [LOCAL_CONTROL]]


def test_a_tare_in_contact_is_refused_and_not_counted(
    node: FingertipNode,
) -> None:
    node.publish(TOUCH, 0)
    assert [answers(node, S, write(0x6125, 1, ZERO)) for _ in range(50)] == [[DEVICE_STATE]] * 50
    node.publish(replace(TOUCH, in_contact=False), 0)
    assert answers(node, S, write(0x6125, 1, ZERO)) == [DONE]


class Strangers(RuleBasedStateMachine):
    """Any master's NMT, SDO and LSS requests, and foreign frames, in any order."""

    def __init__(self) -> None:
        super().__init__()
        self.node = FingertipNode(0x10, MethodCode.CORRECTED, "0123456789abcdef")
        self.now_us = 0

    @property
    def configuration(self) -> list[object]:
        slave = self.node.slave
        keys = [
            e.key for e in WRITABLE if e.index in range(0x1000, 0x2000) and e.index not in OPERATIONAL_TOO
        ]
        return [slave.node_id, *map(slave.read, *zip(*keys, strict=True))]

    def ask(self, request: CanFrame) -> None:
        self.send(CanFrame(0x600 + self.node.slave.node_id, request.data))

    def send(self, frame: CanFrame) -> None:
        """Send one frame; in OPERATIONAL the node keeps its configuration and stores nothing."""
        slave, before = self.node.slave, self.configuration
        was = slave.state
        self.now_us += 1_000
        output = self.node.process(self.now_us, (frame,))
        requests = [event for event in output.events if isinstance(event, StoreRequested)]
        if was is slave.state is NmtState.OPERATIONAL:
            assert self.configuration == before
            assert requests == []
            assert not {f.data[:2] for f in output.frames_out if f.can_id == 0x7E4} & {b"\x11\0", b"\x17\0"}
        for request in requests:
            slave.store_finished(True, request.parameters)

    @rule(command=st.sampled_from((0x01, 0x01, 0x02, 0x80, 0x82)))
    def command(self, command: int) -> None:
        self.send(nmt(command))

    @rule(entry=st.sampled_from(WRITABLE), value=st.integers(0, 0xFFFF_FFFF))
    def write(self, entry: Entry, value: int) -> None:
        self.ask(write_of(entry, COMMANDS.get(entry.index, value)))

    @rule(number=st.integers(0, 8), kind=st.sampled_from((0, 1, 240, 254)), word=st.sampled_from((1, 2)))
    def remap(self, number: int, kind: int, word: int) -> None:
        """Exchange the objects of a TPDO by the procedure of CiA 301."""
        cob_id = OD.default_number(0x1800 + number, 1)
        self.ask(write(0x1800 + number, 1, cob_id | 0x8000_0000))
        self.ask(write(0x1A00 + number, 0, 0, 1))
        self.ask(write(0x1A00 + number, 1, OD.default_number(0x1A00 + number, word)))
        self.ask(write(0x1A00 + number, 0, 1, 1))
        self.ask(write(0x1800 + number, 2, kind, 1))
        self.ask(write(0x1800 + number, 1, cob_id & 0x7FFF_FFFF))

    @rule(node_id=st.integers(0x10, 0x12))
    def assign(self, node_id: int) -> None:
        for request in ("04 01", f"11 {node_id:02x}", "17", "04 00"):
            self.send(lss(request))

    @rule(released=st.booleans())
    def conflict(self, released: bool) -> None:
        before = self.configuration
        running = self.node.slave.state is NmtState.OPERATIONAL
        self.node.slave.hold()
        self.ask(write(0x1803, 5, 777, 2))
        self.ask(write(0x1010, 1, SAVE))
        if released:
            self.node.slave.release()
            if running:
                assert self.configuration == before


Strangers.TestCase.settings = settings(max_examples=25, stateful_step_count=25, deadline=None)
test_no_stranger_changes_a_running_node = Strangers.TestCase
