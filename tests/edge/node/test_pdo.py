"""TPDO and RPDO services and their emergencies (CiA 301, 7.2.2 and 7.2.7), on the drive's dictionary."""

from __future__ import annotations

import struct

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_edge.node.events import ObjectWritten, RpdoReceived, RpdoTimedOut, SyncReceived
from palpate_edge.node.object_dictionary import ObjectDictionary
from palpate_edge.node.slave import Slave

START = CanFrame(0x000, b"\x01\x10")
PRE_OPERATIONAL = CanFrame(0x000, b"\x80\x10")
SYNC = CanFrame(0x080)
COMMAND = struct.pack("<Hbh", 0x000F, 10, -250)
TPDO_1, TPDO_2, EMCY = 0x190, 0x290, 0x090


@pytest.fixture
def slave(drive_od: ObjectDictionary) -> Slave:
    """Node 0x10 in PRE-OPERATIONAL without heartbeat; TPDO 1 of SYNC type 1, TPDO 2 of event type 255."""
    slave = Slave(drive_od)
    slave.process(0, (write(0x1017, 0, "<H", 0),))
    return slave


def write(index: int, subindex: int, code: str, value: int) -> CanFrame:
    data = struct.pack(code, value)
    head = struct.pack("<BHB", 0x23 | (4 - len(data)) << 2, index, subindex)
    return CanFrame(0x610, head + data.ljust(4, b"\x00"))


def sent(slave: Slave, now_us: int, *frames: CanFrame) -> list[int]:
    """Identifiers of what goes out, without SDO answers."""
    return [frame.can_id for frame in slave.process(now_us, frames).frames_out if frame.can_id != 0x590]


def test_no_pdo_outside_operational(slave: Slave) -> None:
    slave.trigger((1, 2))
    assert sent(slave, 1, SYNC) == []
    assert slave.process(1, (CanFrame(0x210, COMMAND),)).events == ()
    slave.process(2, (START, CanFrame(0x000, b"\x02\x10")))
    slave.trigger((2,))
    assert sent(slave, 3, SYNC, CanFrame(0x210, COMMAND)) == []
    assert slave.read(0x6071) == 0


@pytest.mark.parametrize(("kind", "answered"), [(1, [1, 2, 3, 4, 5, 6, 7]), (3, [3, 6]), (240, [])])
def test_every_nth_sync(slave: Slave, kind: int, answered: list[int]) -> None:
    slave.process(1, (write(0x1800, 2, "<B", kind), START))
    assert [n for n in range(1, 8) if TPDO_1 in sent(slave, 10 + n, SYNC)] == answered


def test_type_240_answers_the_240th_sync(slave: Slave) -> None:
    slave.process(1, (write(0x1800, 2, "<B", 240), START))
    assert sent(slave, 2, *[SYNC] * 239) == []
    assert sent(slave, 3, SYNC) == [TPDO_1]


def test_type_0_answers_a_sync_after_an_event(slave: Slave) -> None:
    slave.process(1, (write(0x1800, 2, "<B", 0), START))
    assert sent(slave, 2, SYNC) == []
    slave.trigger((1,))
    assert sent(slave, 3) == []
    assert sent(slave, 4, SYNC) == [TPDO_1]
    assert sent(slave, 5, SYNC) == []


def test_an_event_sends_the_values_of_that_moment(slave: Slave) -> None:
    slave.process(1, (START,))
    slave.write(0x6041, 0, 0x1234)
    slave.write(0x6077, 0, -2)
    slave.trigger((2,))
    assert slave.process(2, ()).frames_out == (CanFrame(TPDO_2, b"\x34\x12\x00\xfe\xff"),)
    assert sent(slave, 3) == []


def test_event_timer_counts_from_the_last_transmission(slave: Slave) -> None:
    slave.process(0, (START,))
    assert sent(slave, 99_999) == []
    assert sent(slave, 100_000) == [TPDO_2]
    slave.trigger((2,))
    assert sent(slave, 150_000) == [TPDO_2]
    assert sent(slave, 249_999) == []
    assert slave.process(250_000, ()).next_due_us == 350_000


def test_inhibit_time_delays_and_joins_events(slave: Slave) -> None:
    """3 ms, in units of 100 us; it may be written while the PDO is not valid."""
    off, on = 0xC000_0290, 0x4000_0290
    slave.process(0, (write(0x1801, 1, "<I", off), write(0x1801, 3, "<H", 30), write(0x1801, 1, "<I", on)))
    slave.process(0, (START,))
    slave.trigger((2,))
    assert sent(slave, 1_000) == [TPDO_2]
    slave.trigger((2,))
    held = slave.process(2_000, ())
    assert (held.frames_out, held.next_due_us) == ((), 4_000)
    slave.trigger((2,))
    assert sent(slave, 4_000) == [TPDO_2]
    assert sent(slave, 8_000) == []


def test_a_tpdo_that_is_not_valid_is_not_sent(slave: Slave) -> None:
    slave.process(0, (write(0x1800, 1, "<I", 0xC000_0190), START))
    assert sent(slave, 1, SYNC) == []
    slave.process(2, (PRE_OPERATIONAL, write(0x1800, 1, "<I", 0x4000_0310), START))
    assert sent(slave, 3, SYNC) == [0x310]
    assert 0x310 in slave.accept_ids()


def test_an_unknown_tpdo_is_refused(slave: Slave) -> None:
    with pytest.raises(BusError, match="no TPDO 3"):
        slave.trigger((3,))


def test_an_event_rpdo_acts_at_once(slave: Slave) -> None:
    output = slave.process(1, (START, CanFrame(0x210, COMMAND)))
    assert output.events[-1] == RpdoReceived(1, {(0x6040, 0): 15, (0x6060, 0): 10, (0x6071, 0): -250})
    assert slave.read(0x6071) == -250


@pytest.mark.parametrize("kind", [0, 1, 240])
def test_a_synchronous_rpdo_acts_at_the_next_sync(slave: Slave, kind: int) -> None:
    slave.process(1, (write(0x1400, 2, "<B", kind), START, CanFrame(0x210, COMMAND)))
    assert slave.read(0x6071) == 0
    assert slave.process(2, (SYNC,)).events == (
        SyncReceived(2, None),
        RpdoReceived(1, {(0x6040, 0): 15, (0x6060, 0): 10, (0x6071, 0): -250}),
    )
    assert slave.process(3, (SYNC,)).events == (SyncReceived(3, None),)


def test_a_short_rpdo_is_not_taken_and_reported_once(slave: Slave) -> None:
    slave.process(0, (START,))
    short = CanFrame(0x210, COMMAND[:4])
    output = slave.process(1, (short,))
    assert output.frames_out == (CanFrame(EMCY, bytes.fromhex("10 82 11 00 00 00 00 00")),)
    assert slave.read(0x6071) == 0
    assert slave.read(0x1001) == 0x11
    assert slave.process(2, (short,)).frames_out == ()
    good = slave.process(3, (CanFrame(0x210, COMMAND),))
    assert good.frames_out == (CanFrame(EMCY, bytes(8)),)
    assert slave.read(0x1001) == 0


def test_a_long_rpdo_is_taken_and_reported(slave: Slave) -> None:
    slave.process(0, (START,))
    output = slave.process(1, (CanFrame(0x210, COMMAND + b"\x01"),))
    assert output.frames_out == (CanFrame(EMCY, bytes.fromhex("20 82 11 00 00 00 00 00")),)
    assert slave.read(0x6071) == -250


def test_the_deadline_of_an_rpdo_counts_from_its_first_reception(slave: Slave) -> None:
    slave.process(0, (write(0x1801, 5, "<H", 0), START))
    assert slave.process(900_000, ()).events == ()
    slave.process(1_000_000, (CanFrame(0x210, COMMAND),))
    assert slave.process(1_199_999, ()).events == ()
    output = slave.process(1_200_000, ())
    assert output.events == (RpdoTimedOut(1),)
    assert output.frames_out == (CanFrame(EMCY, bytes.fromhex("50 82 11 00 00 00 00 00")),)
    assert slave.process(1_500_000, ()).events == ()


def test_a_reset_forgets_the_errors(slave: Slave) -> None:
    slave.process(0, (START, CanFrame(0x210, b"")))
    assert slave.read(0x1001) == 0x11
    slave.process(1, (CanFrame(0x000, b"\x82\x10"),))
    assert slave.read(0x1001) == 0
    assert EMCY not in sent(slave, 2, START)


def test_an_emergency_in_stopped_waits(slave: Slave) -> None:
    slave.process(0, (START, CanFrame(0x210, b""), CanFrame(0x000, b"\x02\x10")))
    assert EMCY not in sent(slave, 1)
    assert EMCY in sent(slave, 2, START)


def test_a_write_by_sdo_is_told(slave: Slave) -> None:
    assert slave.process(1, (write(0x6071, 0, "<h", -5),)).events == (ObjectWritten(0x6071, 0, -5),)


def test_a_tpdo_without_mapped_objects_is_not_sent(slave: Slave) -> None:
    """It is valid and maps nothing: before, a frame without data at each event and SYNC."""
    empty = [
        frame
        for number in (0, 1)
        for frame in (
            write(0x1800 + number, 1, "<I", 0xC000_0190 + 0x100 * number),
            write(0x1A00 + number, 0, "<B", 0),
            write(0x1800 + number, 1, "<I", 0x4000_0190 + 0x100 * number),
        )
    ]
    slave.process(1, (*empty, START))
    slave.trigger((1, 2))
    assert sent(slave, 2, SYNC) == []
    assert sent(slave, 2_000_000, SYNC) == []


def test_an_error_that_flickers_does_not_fill_the_bus(slave: Slave) -> None:
    """1,000 RPDOs in 100 ms, every second one too short: 32 EMCYs at once, then one in 10 ms."""
    slave.process(1, (START,))
    frames = [CanFrame(0x210, COMMAND[: 1 + 4 * (number % 2)]) for number in range(1_000)]
    ids = [can_id for number, frame in enumerate(frames) for can_id in sent(slave, 100 * number, frame)]
    assert 32 <= ids.count(EMCY) <= 32 + 10
    assert slave.read(0x1001) in (0, 0x11)
