"""SYNC with counter, start value and window; TIME; the time stamp 1013h (CiA 301, 7.2.5 and 7.2.6)."""

from __future__ import annotations

import struct

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.events import SyncReceived, TimeOfDayReceived, TimeStampReceived
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.slave import Slave

START, STOP = CanFrame(0x000, b"\x01\x10"), CanFrame(0x000, b"\x02\x10")
SYNC = CanFrame(0x080)
OFF, ON = 0xC000_0190, 0x4000_0190


def write(index: int, subindex: int, value: int, code: str = "<I") -> CanFrame:
    data = struct.pack(code, value)
    head = struct.pack("<BHB", 0x23 | (4 - len(data)) << 2, index, subindex)
    return CanFrame(0x610, head + data.ljust(4, b"\x00"))


def answers(slave: Slave, *frames: CanFrame) -> list[str]:
    output = slave.process(1, frames)
    return [frame.data.hex(" ") for frame in output.frames_out if frame.can_id == 0x590]


def counted(number: int) -> CanFrame:
    return CanFrame(0x080, bytes([number]))


@pytest.fixture
def slave(fingertip: FingertipNode) -> Slave:
    """TPDO 1 synchronous (type 1), no other TPDO, no heartbeat, in PRE-OPERATIONAL."""
    off = [write(0x1800 + n, 1, 0xC000_0190 + 0x100 * n) for n in (1, 2, 3)]
    fingertip.process(0, (write(0x1017, 0, 0, "<H"), write(0x1800, 2, 1, "<B"), *off))
    return fingertip.slave


def test_syncs_are_told_with_their_arrival(slave: Slave) -> None:
    output = slave.process(1_000, (SYNC, CanFrame(0x123), SYNC), arrived_us=(400, 500, 900))
    assert output.events == (SyncReceived(400, None), SyncReceived(900, None))


def test_no_sync_in_stopped(slave: Slave) -> None:
    slave.process(1, (STOP,))
    assert slave.process(2, (SYNC,)).events == ()


def test_a_counter_is_told(slave: Slave) -> None:
    slave.process(1, (write(0x1019, 0, 10, "<B"),))
    assert slave.process(2, (counted(7),)).events == (SyncReceived(2, 7),)


def test_a_sync_of_the_wrong_length_is_an_emergency(slave: Slave) -> None:
    slave.process(1, (START,))
    output = slave.process(2, (counted(1),))
    assert output.frames_out == (CanFrame(0x090, bytes.fromhex("40 82 11 00 00 00 00 00")),)
    assert output.events == ()
    good = slave.process(3, (SYNC,)).frames_out
    assert [frame.can_id for frame in good] == [0x190, 0x090]
    assert good[1].data == bytes(8)


def sync_numbers_answered(slave: Slave, overflow: int, first: int, count: int) -> list[int]:
    """Counters of the SYNCs that TPDO 1 answers; the counter runs from 1 to `overflow`."""
    seen = []
    for step in range(count):
        number = (first - 1 + step) % overflow + 1
        output = slave.process(1_000 * (step + 1), (counted(number),))
        if any(frame.can_id == 0x190 for frame in output.frames_out):
            seen.append(number)
    return seen


@pytest.mark.parametrize(
    ("kind", "start", "answered"),
    [(1, 3, [3, 4, 5, 6, 1, 2]), (3, 3, [5, 2]), (3, 2, [4, 1]), (2, 0, [3, 5, 1])],
)
def test_the_start_value_is_the_first_sync_that_counts(
    slave: Slave, kind: int, start: int, answered: list[int]
) -> None:
    """Counters 2 3 4 5 6 1 2 after the start; type n answers every nth."""
    slave.process(1, (write(0x1019, 0, 6, "<B"), write(0x1800, 1, OFF), write(0x1800, 2, kind, "<B")))
    assert answers(slave, write(0x1800, 6, start, "<B")) == ["60 00 18 06 00 00 00 00"]
    slave.process(1, (write(0x1800, 1, ON), START))
    assert sync_numbers_answered(slave, overflow=6, first=2, count=7) == answered


def test_without_a_counter_the_start_value_is_ignored(slave: Slave) -> None:
    slave.process(1, (write(0x1800, 1, OFF), write(0x1800, 6, 5, "<B"), write(0x1800, 1, ON), START))
    assert [frame.can_id for frame in slave.process(2, (SYNC,)).frames_out] == [0x190]


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        (write(0x1800, 6, 1, "<B"), "80 00 18 06 22 00 00 08"),  # start value while the TPDO is valid
        (write(0x1800, 6, 241, "<B"), "80 00 18 06 31 00 09 06"),
        (write(0x1019, 0, 1, "<B"), "80 19 10 00 30 00 09 06"),  # reserved
        (write(0x1019, 0, 241, "<B"), "80 19 10 00 31 00 09 06"),
        (write(0x1005, 0, 0x4000_0080), "80 05 10 00 30 00 09 06"),  # no SYNC producer
        (write(0x1005, 0, 0x2000_0080), "80 05 10 00 30 00 09 06"),  # 29 bits
        (write(0x1005, 0, 0x600), "60 05 10 00 00 00 00 00"),
        (write(0x1005, 0, 0x601), "80 05 10 00 30 00 09 06"),  # restricted
        (write(0x1800, 2, 252, "<B"), "80 00 18 02 30 00 09 06"),  # on remote request only: there are none
        (write(0x1800, 2, 253, "<B"), "80 00 18 02 30 00 09 06"),
        (write(0x1012, 0, 0x8000_0101), "80 12 10 00 30 00 09 06"),
        (write(0x1012, 0, 0x4000_0100), "80 12 10 00 30 00 09 06"),  # no TIME producer
        (write(0x1012, 0, 0x8000_0200), "80 12 10 00 30 00 09 06"),  # another id while it is consumed
        (write(0x1012, 0, 0x0000_0200), "60 12 10 00 00 00 00 00"),
    ],
)
def test_what_the_objects_take(slave: Slave, request_: CanFrame, answer: str) -> None:
    assert answers(slave, request_) == [answer]


def test_another_sync_id(slave: Slave) -> None:
    slave.process(1, (write(0x1005, 0, 0x0A0),))
    assert slave.process(2, (SYNC,)).events == ()
    assert slave.process(3, (CanFrame(0x0A0),)).events == (SyncReceived(3, None),)


def test_after_the_window_no_synchronous_tpdo_is_sent(slave: Slave) -> None:
    slave.process(1, (write(0x1007, 0, 500), START))
    assert len(slave.process(2_000, (SYNC,), arrived_us=(1_500,)).frames_out) == 1
    assert slave.process(3_001, (SYNC,), arrived_us=(2_500,)).frames_out == ()


def test_after_the_window_no_synchronous_rpdo_is_taken(slave: Slave) -> None:
    stamp = CanFrame(0x1FF, b"\x01\x02\x03\x04")
    slave.process(1, (write(0x1007, 0, 500), write(0x1400, 2, 1, "<B"), START))
    slave.process(1_000, (SYNC,))
    slave.process(1_501, (stamp,))
    slave.process(2_000, (SYNC,))
    assert slave.read(0x1013) == 0
    slave.process(2_500, (stamp,))
    slave.process(3_000, (SYNC,))
    assert slave.read(0x1013) == 0x04030201


def test_the_hosts_time_stamp_comes_in_rpdo_1(slave: Slave) -> None:
    slave.process(1, (START,))
    output = slave.process(700, (SYNC, CanFrame(0x1FF, b"\x01\x02\x03\xf4")), arrived_us=(600, 650))
    assert TimeStampReceived(650, 0xF403_0201) in output.events
    assert slave.read(0x1013) == 0xF403_0201


def test_time_of_day(slave: Slave) -> None:
    """2026-11-21 is day 15665 from 1984-01-01, 12:00:00.250 is 43,200,250 ms; 4 bits are reserved."""
    message = CanFrame(0x100, struct.pack("<IH", 0xF000_0000 | 43_200_250, 15_665))
    assert slave.process(9, (message,), arrived_us=(8,)).events == (TimeOfDayReceived(8, 15_665, 43_200_250),)
    assert slave.process(10, (CanFrame(0x100, bytes(5)),)).events == ()


def test_time_that_is_not_consumed(slave: Slave) -> None:
    slave.process(1, (write(0x1012, 0, 0x100),))
    assert slave.process(2, (CanFrame(0x100, bytes(6)),)).events == ()
    assert 0x100 not in slave.accept_ids()
