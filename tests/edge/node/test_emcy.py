"""The emergency producer: 1001h, 1003h, 1014h, 1015h (CiA 301, 7.2.7 and 7.5.2.3)."""

from __future__ import annotations

import struct

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.emcy import ErrorRegister, is_temperature
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.slave import Slave

CAMERA_LOST, TOO_HOT = 0xFF01, 0x4200


def write(index: int, subindex: int, value: int, code: str = "<I") -> CanFrame:
    data = struct.pack(code, value)
    head = struct.pack("<BHB", 0x23 | (4 - len(data)) << 2, index, subindex)
    return CanFrame(0x610, head + data.ljust(4, b"\x00"))


@pytest.fixture
def slave(fingertip: FingertipNode) -> Slave:
    fingertip.process(0, ())
    return fingertip.slave


def sent(slave: Slave, now_us: int, *frames: CanFrame) -> list[str]:
    output = slave.process(now_us, frames)
    return [frame.data.hex(" ") for frame in output.frames_out if frame.can_id == 0x090]


def answer(slave: Slave, frame: CanFrame) -> str:
    (one,) = (frame for frame in slave.process(1, (frame,)).frames_out if frame.can_id == 0x590)
    return one.data.hex(" ")


def read(slave: Slave, index: int, subindex: int) -> str:
    return answer(slave, CanFrame(0x610, struct.pack("<BHB4x", 0x40, index, subindex)))


def test_errors_appear_and_go_one_by_one(slave: Slave) -> None:
    slave.emcy.report(CAMERA_LOST, ErrorRegister.MANUFACTURER, b"\x01\x02\x03\x04\x05")
    slave.emcy.report(TOO_HOT, ErrorRegister.TEMPERATURE)
    assert sent(slave, 1) == ["01 ff 81 01 02 03 04 05", "00 42 89 00 00 00 00 00"]
    slave.emcy.report(TOO_HOT, ErrorRegister.TEMPERATURE)
    assert sent(slave, 2) == []
    slave.emcy.clear(CAMERA_LOST, b"\x01\x02\x03\x04\x05")
    slave.emcy.clear(CAMERA_LOST, b"\x01\x02\x03\x04\x05")
    assert sent(slave, 3) == ["00 00 09 00 00 00 00 00"]
    slave.emcy.clear(TOO_HOT)
    assert sent(slave, 4) == ["00 00 00 00 00 00 00 00"]


def test_the_history_has_the_newest_first(slave: Slave) -> None:
    assert read(slave, 0x1003, 0) == "4f 03 10 00 00 00 00 00"
    assert read(slave, 0x1003, 1) == "80 03 10 01 24 00 00 08"  # no data available
    slave.emcy.report(CAMERA_LOST, ErrorRegister.MANUFACTURER, b"\xab\xcd")
    slave.emcy.report(TOO_HOT, ErrorRegister.TEMPERATURE)
    slave.emcy.clear(TOO_HOT)
    assert read(slave, 0x1003, 0) == "4f 03 10 00 02 00 00 00"
    assert read(slave, 0x1003, 1) == "43 03 10 01 00 42 00 00"
    assert read(slave, 0x1003, 2) == "43 03 10 02 01 ff ab cd"
    assert read(slave, 0x1003, 3) == "80 03 10 03 24 00 00 08"


def test_the_history_is_forgotten_by_a_0_and_takes_nothing_else(slave: Slave) -> None:
    slave.emcy.report(TOO_HOT, ErrorRegister.TEMPERATURE)
    assert answer(slave, write(0x1003, 0, 1, "<B")) == "80 03 10 00 30 00 09 06"
    assert answer(slave, write(0x1003, 0, 0, "<B")) == "60 03 10 00 00 00 00 00"
    assert read(slave, 0x1003, 1) == "80 03 10 01 24 00 00 08"
    assert read(slave, 0x1001, 0) == "4f 01 10 00 09 00 00 00"  # the error itself is still there


def test_the_history_keeps_the_last_eight(slave: Slave) -> None:
    for code in range(0xFF01, 0xFF0C):
        slave.emcy.report(code, ErrorRegister.MANUFACTURER)
    assert [slave.read(0x1003, sub) for sub in range(9)] == [8, *range(0xFF0B, 0xFF03, -1)]


def test_the_inhibit_time_spaces_the_messages(slave: Slave) -> None:
    """100 in units of 100 us: 10 ms."""
    slave.process(1, (write(0x1015, 0, 100, "<H"), write(0x1017, 0, 0, "<H")))
    for code in (0xFF01, 0xFF02, 0xFF03):
        slave.emcy.report(code, ErrorRegister.MANUFACTURER)
    output = slave.process(1_000, ())
    assert ([frame.data[0] for frame in output.frames_out], output.next_due_us) == ([1], 11_000)
    assert sent(slave, 10_999) == []
    assert sent(slave, 11_000)[0][:2] == "02"
    assert sent(slave, 21_000)[0][:2] == "03"


@pytest.mark.parametrize(
    ("value", "result"),
    [
        (0x0000_0091, "80 14 10 00 30 00 09 06"),  # another id while it is valid
        (0x8000_0090, "60 14 10 00 00 00 00 00"),
        (0x4000_0090, "80 14 10 00 30 00 09 06"),  # reserved bit
        (0x0000_0701, "80 14 10 00 30 00 09 06"),  # restricted id
    ],
)
def test_what_1014h_takes(slave: Slave, value: int, result: str) -> None:
    assert answer(slave, write(0x1014, 0, value)) == result


def test_another_id_and_none(slave: Slave) -> None:
    slave.process(1, (write(0x1014, 0, 0x8000_0090),))
    slave.emcy.report(TOO_HOT, ErrorRegister.TEMPERATURE)
    assert slave.process(2, ()).frames_out == ()
    slave.process(3, (write(0x1014, 0, 0x8000_00B0),))
    moved = slave.process(4, (write(0x1014, 0, 0x0000_00B0),)).frames_out
    assert CanFrame(0x0B0, bytes.fromhex("00 42 09 00 00 00 00 00")) in moved
    assert 0x0B0 in slave.accept_ids()


def test_a_storm_while_nothing_may_be_sent_keeps_the_newest_32(slave: Slave) -> None:
    slave.process(1, (CanFrame(0x000, b"\x02\x10"),))
    for _ in range(1_000):
        slave.emcy.report(CAMERA_LOST, ErrorRegister.MANUFACTURER)
        slave.emcy.clear(CAMERA_LOST)
    slave.emcy.report(TOO_HOT, ErrorRegister.TEMPERATURE)
    assert slave.process(2, ()).next_due_us > 2
    messages = sent(slave, 3, CanFrame(0x000, b"\x80\x10"))
    assert len(messages) == 32
    assert messages[-1][:5] == "00 42"


@pytest.mark.parametrize(
    ("code", "expected"),
    [(0x3FFF, False), (0x4000, True), (0x4200, True), (0x4310, True), (0x4FFF, True), (0x5000, False)],
)
def test_temperature_is_the_fourth_thousand(code: int, expected: bool) -> None:
    """CiA 301, table of emergency error codes: 40xxh to 43xxh; CiA 402-2 adds 44xxh."""
    assert is_temperature(code) is expected
