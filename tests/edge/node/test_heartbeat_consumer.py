"""The heartbeat consumer and what 1029h makes of a node that fell silent (CiA 301, 7.2.8.3.2, 7.5.2.19)."""

from __future__ import annotations

import struct

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.emcy import EmcyCode
from palpate_edge.node.events import AcceptIdsChanged, HeartbeatLost, NmtStateChanged
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.nmt import NmtState
from palpate_edge.node.slave import Slave

HOST = 0x7F
ALIVE = CanFrame(0x77F, b"\x05")
BOOT_UP = CanFrame(0x77F, b"\x00")
PRE_OPERATIONAL = CanFrame(0x000, b"\x80\x10")
START = CanFrame(0x000, b"\x01\x10")
LOST = CanFrame(0x090, bytes.fromhex("30 81 11 7f 00 00 00 00"))
BACK = CanFrame(0x090, bytes(8))


def write(index: int, subindex: int, value: int, code: str = "<I") -> CanFrame:
    data = struct.pack(code, value)
    head = struct.pack("<BHB", 0x23 | (4 - len(data)) << 2, index, subindex)
    return CanFrame(0x610, head + data.ljust(4, b"\x00"))


def emergencies(slave: Slave, now_us: int, *frames: CanFrame) -> list[CanFrame]:
    return [frame for frame in slave.process(now_us, frames).frames_out if frame.can_id == 0x090]


@pytest.fixture
def slave(fingertip: FingertipNode) -> Slave:
    """In OPERATIONAL, watching the host with 200 ms."""
    fingertip.process(0, (write(0x1016, 1, HOST << 16 | 200), START))
    return fingertip.slave


def test_watching_begins_with_the_first_heartbeat(slave: Slave) -> None:
    assert emergencies(slave, 900_000) == []
    assert emergencies(slave, 1_000_000, ALIVE) == []
    assert emergencies(slave, 1_199_999) == []
    assert emergencies(slave, 1_200_000) == [LOST]


def test_the_slave_asks_to_be_called_when_a_heartbeat_is_missing(slave: Slave) -> None:
    slave.process(1, (PRE_OPERATIONAL, write(0x1017, 0, 0, "<H"), write(0x1803, 5, 0, "<H"), START))
    assert slave.process(1_000, (ALIVE,)).next_due_us == 201_000


def test_each_heartbeat_and_a_boot_up_is_a_sign_of_life(slave: Slave) -> None:
    for at_us in range(0, 1_000_000, 150_000):
        assert emergencies(slave, at_us, BOOT_UP if at_us == 300_000 else ALIVE) == []


def test_silence_is_told_once_and_taken_back(slave: Slave) -> None:
    slave.process(0, (ALIVE,))
    assert HeartbeatLost(HOST) in slave.process(200_000, ()).events
    assert slave.read(0x1001) == 0x11
    later = slave.process(200_001, (START,))
    assert HeartbeatLost(HOST) not in later.events
    assert slave.state is NmtState.OPERATIONAL
    assert emergencies(slave, 900_000) == []
    assert emergencies(slave, 900_001, ALIVE) == [BACK]
    assert slave.read(0x1001) == 0
    assert emergencies(slave, 1_100_001) == [LOST]


@pytest.mark.parametrize(
    ("behaviour", "state"),
    [
        (0, NmtState.PRE_OPERATIONAL),
        (1, NmtState.OPERATIONAL),
        (2, NmtState.STOPPED),
    ],
)
def test_error_behaviour(slave: Slave, behaviour: int, state: NmtState) -> None:
    slave.process(0, (PRE_OPERATIONAL, write(0x1029, 1, behaviour, "<B"), START, ALIVE))
    output = slave.process(200_000, ())
    assert slave.state is state
    assert (NmtStateChanged(state, None) in output.events) is (state is not NmtState.OPERATIONAL)


def test_error_behaviour_leaves_the_other_states_alone(slave: Slave) -> None:
    slave.process(0, (PRE_OPERATIONAL, write(0x1029, 1, 2, "<B"), ALIVE))
    slave.process(200_000, ())
    assert slave.state is NmtState.PRE_OPERATIONAL


def test_a_lost_bus_behaves_the_same(slave: Slave) -> None:
    slave.communication_error(EmcyCode.BUS_OFF_RECOVERED)
    output = slave.process(1, ())
    assert CanFrame(0x090, bytes.fromhex("40 81 11 00 00 00 00 00")) in output.frames_out
    assert NmtStateChanged(NmtState.PRE_OPERATIONAL, None) in output.events


def test_two_nodes_are_watched_apart(slave: Slave) -> None:
    slave.process(
        0, (PRE_OPERATIONAL, write(0x1016, 2, 0x01 << 16 | 100), START, ALIVE, CanFrame(0x701, b"\x05"))
    )
    assert emergencies(slave, 100_000) == [CanFrame(0x090, bytes.fromhex("30 81 11 01 00 00 00 00"))]
    assert emergencies(slave, 150_000, CanFrame(0x701, b"\x7f")) == [BACK]
    assert emergencies(slave, 200_000) == [LOST]


def test_another_entry_leaves_a_watch_as_it_is(slave: Slave) -> None:
    slave.process(0, (ALIVE,))
    slave.process(150_000, (PRE_OPERATIONAL, write(0x1016, 2, 0x01 << 16 | 100)))
    assert slave.read(0x1016, 2) == 0x01 << 16 | 100
    assert emergencies(slave, 200_000) == [LOST]


def test_a_node_that_is_watched_no_longer_is_no_error(slave: Slave) -> None:
    slave.process(0, (ALIVE,))
    assert emergencies(slave, 200_000) == [LOST]
    assert emergencies(slave, 200_001, write(0x1016, 1, 0)) == [BACK]
    assert slave.read(0x1001) == 0


@pytest.mark.parametrize(
    ("value", "answer"),
    [
        (HOST << 16 | 100, "80 16 10 02 43 00 04 06"),  # watched by sub-index 1 already
        (HOST << 16, "60 16 10 02 00 00 00 00"),  # time 0: not used
        (0x80 << 16 | 100, "60 16 10 02 00 00 00 00"),  # no such node: not used
        (1 << 24 | 1 << 16 | 100, "80 16 10 02 30 00 09 06"),  # reserved bits
    ],
)
def test_what_1016h_takes(slave: Slave, value: int, answer: str) -> None:
    output = slave.process(1, (PRE_OPERATIONAL, write(0x1016, 2, value)))
    assert [frame.data.hex(" ") for frame in output.frames_out if frame.can_id == 0x590] == [answer]


def test_the_receive_filter_follows(fingertip: FingertipNode) -> None:
    fingertip.process(0, ())
    assert 0x77F not in fingertip.slave.accept_ids()
    output = fingertip.process(1, (write(0x1016, 1, HOST << 16 | 200),))
    assert 0x77F in fingertip.slave.accept_ids()
    assert AcceptIdsChanged(fingertip.slave.accept_ids()) in output.events


def test_a_reset_ends_the_watch(slave: Slave) -> None:
    slave.process(0, (ALIVE, CanFrame(0x000, b"\x82\x10")))
    assert slave.read(0x1016, 1) == 0
    assert emergencies(slave, 900_000) == []


@pytest.mark.parametrize("data", [b"", b"\x05\x00", bytes(8)])
def test_a_message_of_another_length_is_no_heartbeat(slave: Slave, data: bytes) -> None:
    assert emergencies(slave, 0, ALIVE) == []
    assert emergencies(slave, 150_000, CanFrame(0x77F, data)) == []
    assert emergencies(slave, 200_000) == [LOST]
    assert emergencies(slave, 250_000, CanFrame(0x77F, data)) == []
