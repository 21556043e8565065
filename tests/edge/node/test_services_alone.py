"""LSS, emergencies, heartbeats, SYNC and conflicts of ids, each service on its own objects."""

from __future__ import annotations

import random
import struct

import pytest

from palpate_edge.node.eds import load_eds
from palpate_edge.node.emcy import EmergencyProducer, ErrorRegister
from palpate_edge.node.heartbeat import HeartbeatProducer
from palpate_edge.node.heartbeat_consumer import HeartbeatConsumer, consumer_entry
from palpate_edge.node.id_conflict import IdConflict
from palpate_edge.node.lss import LssSlave
from palpate_edge.node.nmt import NmtState
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError
from palpate_edge.node.sync import SyncConsumer
from palpate_edge.node.time_stamp import TimeConsumer

IDENTITY = (7, 0x404, 0x10003, 0xDEADBEEF)
UP = NmtState.OPERATIONAL


def store(node_id: int = 0x10, **values: int) -> ObjectStore:
    """The objects of a fingertip; values: "x1014" -> value of sub-index 0."""
    made = ObjectStore(load_eds(FINGERTIP_EDS, node_id))
    made.values.update({(0x1018, 1 + part): number for part, number in enumerate(IDENTITY)})
    made.values.update({(int(name[1:], 16), 0): value for name, value in values.items()})
    return made


class LssTable:
    """The slave of CiA 305 by its tables: which requests are answered, and what the answer is."""

    def __init__(self, node_id: int) -> None:
        self.node_id = self.pending = node_id
        self.configuring = False
        self.selected: list[int] = []
        self.identified: list[int] = []

    def answer(self, command: int, number: int) -> tuple[int, int] | None:
        first = number & 0xFF
        if command == 0x04:
            if first < 2:
                self.configuring, self.selected = first == 1, []
            return None
        if 0x46 <= command <= 0x4B:
            step = command - 0x46
            fits = (
                *(number == IDENTITY[0], number == IDENTITY[1], number <= IDENTITY[2], number >= IDENTITY[2]),
                *(number <= IDENTITY[3], number >= IDENTITY[3]),
            )[step]
            in_order = step == 0 or self.identified == list(range(step))
            self.identified = list(range(step + 1)) if fits and in_order else []
            if len(self.identified) < 6:
                return None
            self.identified = []
            return 0x4F, 0
        if command == 0x4C:
            return (0x50, 0) if self.pending == self.node_id == 255 else None
        return self.configured(command, number) if self.configuring else self.waiting(command, number)

    def waiting(self, command: int, number: int) -> tuple[int, int] | None:
        if not 0x40 <= command <= 0x43:
            return None
        part = command - 0x40
        in_order = part == 0 or self.selected == list(range(part))
        self.selected = list(range(part + 1)) if number == IDENTITY[part] and in_order else []
        if len(self.selected) < 4:
            return None
        self.selected, self.configuring = [], True
        return 0x44, 0

    def configured(self, command: int, number: int) -> tuple[int, int] | None:
        if 0x5A <= command <= 0x5D:
            return command, IDENTITY[command - 0x5A]
        if command == 0x5E:
            return command, self.node_id
        if command == 0x13:
            return command, 1
        if command == 0x11:
            node_id = number & 0xFF
            is_allowed = 1 <= node_id <= 127 or node_id == 255
            self.pending = node_id if is_allowed else self.pending
            return command, int(not is_allowed)
        return (command, 0) if command == 0x17 else None


@pytest.mark.parametrize("node_id", [0x10, 255])
@pytest.mark.parametrize("seed", range(3))
def test_lss_answers_as_the_tables_of_cia_305(node_id: int, seed: int) -> None:
    """300 requests of all kinds, half of them with the numbers of this node."""
    chance, table = random.Random(seed), LssTable(node_id)
    slave = LssSlave(store(node_id), lambda _node_id: True, lambda: True)
    commands = (0x04, *range(0x40, 0x44), *range(0x46, 0x4D), 0x11, 0x13, 0x17, *range(0x5A, 0x5F), 0x60)
    for _ in range(300):
        if chance.random() < 0.3:  # a whole selection or identification in order
            first, numbers = chance.choice(
                [
                    (0x40, IDENTITY),
                    (0x46, (*IDENTITY[:2], IDENTITY[2], IDENTITY[2], IDENTITY[3], IDENTITY[3])),
                ]
            )
            requests = [(first + step, number) for step, number in enumerate(numbers)]
            if chance.random() < 0.3:
                requests.pop(chance.randrange(len(requests)))
        else:
            requests = [(chance.choice(commands), chance.choice((0, 1, 127, 128, 255, *IDENTITY)))]
        for command, number in requests:
            expected = table.answer(command, number)
            frame = slave.receive(struct.pack("<BI3x", command, number))
            assert (frame is None) is (expected is None), (hex(command), number)
            if frame is not None and expected is not None:
                assert frame.can_id == 0x7E4 and len(frame.data) == 8
                assert struct.unpack_from("<BI", frame.data) == expected
            assert (slave.configuring, slave.pending_node_id) == (table.configuring, table.pending)
    assert slave.receive(bytes(7)) is None
    slave.restart()
    assert not slave.configuring


@pytest.mark.parametrize(
    ("is_stored", "stores", "data"), [(True, 1, "17 00"), (False, 1, "17 02"), (False, 0, "17 01")]
)
def test_the_answer_to_a_store_request_comes_with_its_result(is_stored: bool, stores: int, data: str) -> None:
    objects = store()
    objects.values[0x1010, 1] = stores
    slave = LssSlave(objects, lambda _node_id: None, lambda: True)
    slave.receive(bytes.fromhex("04 01 00 00 00 00 00 00"))
    assert slave.receive(bytes.fromhex("17 00 00 00 00 00 00 00")) is None
    (frame,) = slave.confirm_store(is_stored)
    assert frame.data.hex(" ") == f"{data} 00 00 00 00 00 00"


def test_a_state_that_forbids_changes_is_a_specific_error() -> None:
    slave = LssSlave(store(), lambda _node_id: True, lambda: False)
    slave.receive(bytes.fromhex("04 01 00 00 00 00 00 00"))
    for command in (0x11, 0x17):
        frame = slave.receive(bytes([command, 0x20, 0, 0, 0, 0, 0, 0]))
        assert frame is not None and frame.data.hex(" ") == f"{command:02x} ff 01 00 00 00 00 00"
    assert slave.pending_node_id == 0x10


def test_errors_that_flicker_are_paced_after_a_burst_of_32() -> None:
    """One message every 10 ms; each 10 ms of silence earns one of the burst back, up to 32."""
    emcy = EmergencyProducer(store())
    sent = []
    for tick in range(100):
        now_us = 1000 * tick
        for _ in range(2):
            emcy.report(0xFF01, ErrorRegister.MANUFACTURER)
            emcy.clear(0xFF01)
        sent.append(len(emcy.poll(now_us, UP)))
    assert sum(sent[:10]) == 32
    assert [tick for tick, count in enumerate(sent) if count and tick >= 10] == list(range(10, 100, 10))
    assert sum(sent) == 32 + 9
    while emcy.due_us() is not None:
        now_us = emcy.due_us()
        emcy.poll(now_us, UP)
    for _ in range(20):
        emcy.report(0xFF01, ErrorRegister.MANUFACTURER)
        emcy.clear(0xFF01)
    assert len(emcy.poll(now_us + 55_000, UP)) == 5


def test_the_next_message_is_due_when_its_inhibit_time_has_passed() -> None:
    emcy = EmergencyProducer(store(x1015=250))
    for code in (0xFF01, 0xFF02):
        emcy.report(code, ErrorRegister.MANUFACTURER)
    assert emcy.due_us() is None
    assert len(emcy.poll(1_000, UP)) == 1 and emcy.due_us() == 26_000
    assert emcy.poll(25_999, UP) == []
    (last,) = emcy.poll(26_000, UP)
    assert last.data[:3] == b"\x02\xff\x81" and emcy.due_us() is None


def test_the_register_is_that_of_all_active_errors() -> None:
    objects = store()
    emcy = EmergencyProducer(objects)
    emcy.report(0x4200, ErrorRegister.TEMPERATURE)
    emcy.report(0x8130, ErrorRegister.COMMUNICATION, b"\x7f")
    assert objects.number(0x1001) == 0x19
    emcy.clear(0x4200)
    assert objects.number(0x1001) == 0x11
    emcy.clear(0x8130)  # another info: no such error
    assert objects.number(0x1001) == 0x11
    emcy.reset()
    assert objects.number(0x1001) == 0 and emcy.poll(0, UP) == []


def test_emergencies_wait_while_the_node_may_not_send() -> None:
    objects = store()
    emcy = EmergencyProducer(objects)
    emcy.report(0x4200, ErrorRegister.TEMPERATURE)
    assert emcy.poll(0, NmtState.STOPPED) == emcy.poll(0, NmtState.INITIALISING) == []
    objects.values[0x1014, 0] = 0x8000_0090
    assert emcy.can_id() is None and emcy.poll(0, UP) == []
    objects.values[0x1014, 0] = 0x0000_00A0
    assert [frame.can_id for frame in emcy.poll(0, NmtState.PRE_OPERATIONAL)] == [0x0A0]


def test_a_late_heartbeat_skips_what_it_has_missed() -> None:
    heartbeat = HeartbeatProducer(store(x1017=100))
    heartbeat.start(0)
    assert heartbeat.due_us() == 100_000 and heartbeat.poll(99_999, UP) is None
    frame = heartbeat.poll(100_000, UP)
    assert frame is not None and (frame.can_id, frame.data) == (0x710, b"\x05")
    assert heartbeat.poll(250_000, UP) is not None and heartbeat.due_us() == 300_000
    assert heartbeat.poll(400_000, UP) is not None and heartbeat.due_us() == 500_000
    heartbeat.reconfigure(410_000)
    assert heartbeat.due_us() == 410_000
    silent = HeartbeatProducer(store(x1017=0))
    silent.start(0)
    assert silent.due_us() is None and silent.poll(10**9, UP) is None


def watching(**times_ms: int) -> tuple[HeartbeatConsumer, ObjectStore, EmergencyProducer]:
    """A consumer of nodes "n20" with their times."""
    objects = store()
    for sub, (name, time_ms) in enumerate(times_ms.items(), start=1):
        objects.values[0x1016, sub] = int(name[1:], 16) << 16 | time_ms
    emcy = EmergencyProducer(objects)
    return HeartbeatConsumer(objects, emcy), objects, emcy


def test_each_node_has_a_deadline_of_its_own_and_the_first_is_due() -> None:
    consumer, _, emcy = watching(n20=100, n21=50)
    assert consumer.can_ids() == {0x720, 0x721} and consumer.due_us() is None
    consumer.receive(0, 0x720)
    consumer.receive(10_000, 0x721)
    assert consumer.due_us() == 60_000
    assert consumer.poll(59_999) == [] and consumer.poll(60_000) == [0x21] and consumer.poll(70_000) == []
    assert consumer.due_us() == 100_000
    (frame,) = emcy.poll(70_000, UP)
    assert frame.data == bytes.fromhex("30 81 11 21 00 00 00 00")
    consumer.receive(80_000, 0x721)
    assert emcy.poll(80_000, UP)[0].data[:3] == b"\x00\x00\x00"


def test_a_node_is_watched_by_one_sub_index_only() -> None:
    consumer, objects, _ = watching(n20=100, n21=50)
    entry = {sub: objects.od.entry(0x1016, sub) for sub in (1, 2)}
    consumer.check_write(entry[1], 0x20 << 16 | 200)
    consumer.check_write(entry[2], 0x20 << 16)  # a time of 0 watches nothing
    with pytest.raises(SdoAbortError) as clash:
        consumer.check_write(entry[2], 0x20 << 16 | 200)
    assert clash.value.code is AbortCode.PARAMETER_CLASH
    with pytest.raises(SdoAbortError) as reserved:
        consumer.check_write(entry[1], 1 << 24 | 0x20 << 16 | 200)
    assert reserved.value.code is AbortCode.VALUE_INVALID


def test_a_change_keeps_the_deadlines_of_the_other_nodes() -> None:
    consumer, objects, emcy = watching(n20=100, n21=50)
    consumer.receive(0, 0x720)
    consumer.receive(0, 0x721)
    consumer.poll(50_000)
    objects.values[0x1016, 2] = 0
    consumer.reconfigure()
    assert consumer.can_ids() == {0x720} and consumer.due_us() == 100_000
    assert [frame.data[:2] for frame in emcy.poll(50_000, UP)] == [b"\x30\x81", b"\x00\x00"]
    objects.values[0x1016, 1] = 0x20 << 16 | 90
    consumer.reconfigure()
    assert consumer.due_us() is None  # another time: from the next heartbeat on


@pytest.mark.parametrize(
    ("value", "entry"),
    [(0x7F << 16 | 3, (127, 3000)), (0x80 << 16 | 3, (128, 0)), (3, (0, 0)), (1 << 16, (1, 0))],
)
def test_the_entries_of_1016h(value: int, entry: tuple[int, int]) -> None:
    assert consumer_entry(value) == entry


def test_the_window_of_a_sync_and_its_length() -> None:
    objects = store(x1007=500)
    emcy = EmergencyProducer(objects)
    sync = SyncConsumer(objects, emcy)
    assert (sync.can_id, sync.counter_overflow) == (0x080, 0) and sync.in_window(10**9)
    assert sync.accept(1_000, b"")
    assert sync.in_window(1_500) and not sync.in_window(1_501)
    assert not sync.accept(2_000, b"\x01")
    assert [frame.data[:2] for frame in emcy.poll(2_000, UP)] == [b"\x40\x82"]
    objects.values[0x1007, 0] = 0
    sync.start()
    assert sync.accept(3_000, b"") and sync.in_window(10**9)
    objects.values[0x1019, 0] = 10
    sync.start()
    assert sync.accept(4_000, b"\x01") and not sync.accept(5_000, b"")
    for value, is_allowed in ((0, True), (1, False), (2, True), (240, True)):
        if is_allowed:
            sync.check_write(objects.od.entry(0x1019), value)
        else:
            with pytest.raises(SdoAbortError):
                sync.check_write(objects.od.entry(0x1019), value)


def test_the_time_of_day_is_in_the_lower_28_bits() -> None:
    time = TimeConsumer(store(x1012=0x8000_0100))
    assert time.can_id == 0x100
    event = time.receive(5, struct.pack("<IH", 0xF000_0000 | 43_200_000, 15_000))
    assert event is not None and (event.days, event.milliseconds) == (15_000, 43_200_000)
    assert time.receive(5, bytes(5)) is None and time.receive(5, bytes(7)) is None
    assert TimeConsumer(store(x1012=0x100)).can_id is None
    entry = store().od.entry(0x1012)
    time.check_write(entry, 0x0000_0123 & 0x100)
    time.check_write(entry, 0x8000_0100)
    for value in (0x8000_0090, 0x4000_0100, 0x8000_0701):  # another id, a producer, a restricted id
        with pytest.raises(SdoAbortError):
            time.check_write(entry, value)


def test_a_conflict_is_silent_for_0_7_s_and_over_after_10_s() -> None:
    conflict = IdConflict()
    assert conflict.due_us is None
    conflict.seen(1_000, 0x190)
    conflict.seen(2_000, 0x710)
    assert (conflict.frames, conflict.can_id, conflict.due_us) == (2, 0x710, 702_000)
    conflict.poll(701_999)
    assert conflict.is_silent and conflict.is_active
    conflict.poll(702_000)
    assert (conflict.is_silent, conflict.is_active, conflict.due_us) == (False, True, 10_002_000)
    conflict.poll(10_001_999)
    assert conflict.is_active
    conflict.poll(10_002_000)
    assert (conflict.is_active, conflict.due_us) == (False, None)
    conflict.seen(11_000_000, 0x190)
    conflict.end()
    assert not conflict.is_active and not conflict.is_silent


def fastscan(slave: LssSlave, number: int, bit: int, part: int, following: int) -> bool:
    """One fastscan request (CiA 305); return whether the slave answers, always with "identified"."""
    frame = slave.receive(struct.pack("<BIBBB", 0x51, number, bit, part, following))
    assert frame is None or frame.data == b"\x4f" + bytes(7)
    return frame is not None


def test_fastscan_compares_the_upper_bits_of_one_part_after_another() -> None:
    slave = LssSlave(store(255), lambda _node_id: True, lambda: True)
    assert fastscan(slave, 0, 0x80, 0, 0)
    for part, number in enumerate(IDENTITY):
        assert not fastscan(slave, number, 0, (part + 1) % 4, 0)  # another part's turn
        for bit in (31, 16, 8, 0):
            assert fastscan(slave, number >> bit << bit, bit, part, part)
            assert not fastscan(slave, number ^ 1 << bit, bit, part, part)
        assert not slave.configuring
        assert fastscan(slave, number, 0, part, (part + 1) % 4)
    assert slave.configuring


def test_a_restart_and_a_reset_begin_the_fastscan_anew() -> None:
    slave = LssSlave(store(255), lambda _node_id: True, lambda: True)
    for begin_anew in (slave.restart, lambda: fastscan(slave, 0, 0x80, 0, 0)):
        assert fastscan(slave, IDENTITY[0], 0, 0, 1)
        assert not fastscan(slave, IDENTITY[0], 0, 0, 0)
        begin_anew()
        assert fastscan(slave, IDENTITY[0], 0, 0, 0)
    for wrong in ((0, 32, 0, 0), (0, 31, 4, 0), (0, 31, 0, 4)):
        assert not fastscan(slave, *wrong)
    assert not fastscan(LssSlave(store(0x10), lambda _node_id: True, lambda: True), 0, 0x80, 0, 0)
