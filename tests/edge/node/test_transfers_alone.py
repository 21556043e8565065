"""The SDO server and the PDO services on their own objects, frame by frame as CiA 301 has them."""

from __future__ import annotations

import binascii
import struct

import msgspec
import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_edge.node.change_policy import SAVES, TARES, WriteRates
from palpate_edge.node.eds import load_eds
from palpate_edge.node.emcy import EmergencyProducer
from palpate_edge.node.nmt import NmtState
from palpate_edge.node.object_dictionary import Entry, Value
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.parameter_keeper import ParameterKeeper
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.rpdo import RpdoService
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError
from palpate_edge.node.sdo_server import SdoServer
from palpate_edge.node.stored_parameters import StoredParameters
from palpate_edge.node.sync import SyncConsumer
from palpate_edge.node.tpdo import TpdoService

OD = load_eds(FINGERTIP_EDS, 0x10)
TEXT = "03 20 00"  # 2003h:00, a text that may be written
LONG = "a fingertip of the left hand, index"
UP = NmtState.OPERATIONAL


class Server:
    """A server and the values that it was given. holds: the response waits for the application."""

    def __init__(self, holds: bool = False) -> None:
        self.store, self.written, self._holds = ObjectStore(OD), [], holds
        self.server = SdoServer(self.store, self._commit)

    def _commit(self, entry: Entry, value: Value) -> bool:
        self.written.append((entry.key, value))
        return not self._holds

    def ask(self, request: str | bytes, now_us: int = 0) -> list[str]:
        data = bytes.fromhex(request) if isinstance(request, str) else request
        frames = self.server.receive(now_us, data.ljust(8, b"\x00"))
        assert all(frame.can_id == 0x590 and len(frame.data) == 8 for frame in frames)
        return [frame.data.hex(" ") for frame in frames]


def aborted(index: str, code: int) -> list[str]:
    return [f"80 {index} {struct.pack('<I', code).hex(' ')}"]


@pytest.mark.parametrize(
    ("key", "value", "answer"),
    [
        ((0x2011, 0), 0xAB, "4f 11 20 00 ab 00 00 00"),
        ((0x1017, 0), 0x1234, "4b 17 10 00 34 12 00 00"),
        ((0x1018, 4), 0x12345678, "43 18 10 04 78 56 34 12"),
        ((0x2003, 0), "abc", "47 03 20 00 61 62 63 00"),
    ],
)
def test_up_to_four_bytes_are_read_in_one_frame(key, value, answer) -> None:
    server = Server()
    server.store.values[key] = value
    assert server.ask(struct.pack("<BHB", 0x40, *key)) == [answer]


def test_a_long_text_is_read_in_segments_of_seven_bytes_with_a_toggle() -> None:
    server = Server()
    server.store.values[0x2003, 0] = LONG
    assert server.ask(f"40 {TEXT}") == [f"41 {TEXT} {len(LONG):02x} 00 00 00"]
    text, toggle = b"", 0
    for number in range(5):
        (answer,) = (bytes.fromhex(one) for one in server.ask(bytes([0x60 | toggle])))
        assert answer[0] & 0xF0 == toggle and bool(answer[0] & 1) is (number == 4)
        text += answer[1 : 8 - (answer[0] >> 1 & 7)]
        toggle ^= 0x10
    assert text.decode() == LONG
    assert server.ask("60") == aborted("00 00 00", 0x0504_0001)


@pytest.mark.parametrize(
    ("request_", "written", "code"),
    [
        ("2b 17 10 00 64 00", 100, None),
        ("22 17 10 00 64 00", 100, None),  # without a size: that of the object
        ("2f 17 10 00 64", None, 0x0607_0013),
        ("23 17 10 00 64 00 00 00", None, 0x0607_0012),
        ("2f 17 20 00 64", None, 0x0602_0000),
        ("2f 17 10 05 64", None, 0x0609_0011),
        ("2f 11 20 00 64", None, 0x0601_0002),
    ],
)
def test_a_value_is_written_in_one_frame(request_, written, code) -> None:
    server = Server()
    index = request_[3:11]
    expected = [f"60 {index} 00 00 00 00"] if code is None else aborted(index, code)
    assert server.ask(request_) == expected
    assert server.written == ([] if written is None else [((0x1017, 0), written)])


def segments(text: bytes) -> list[bytes]:
    parts = [text[at : at + 7] for at in range(0, len(text), 7)]
    return [
        bytes([(number % 2) << 4 | (7 - len(part)) << 1 | (number == len(parts) - 1)]) + part
        for number, part in enumerate(parts)
    ]


@pytest.mark.parametrize("announced", [len(LONG), None, len(LONG) + 1])
def test_a_text_is_written_in_segments(announced) -> None:
    server = Server()
    head = (
        b"\x20\x03\x20\x00" if announced is None else struct.pack("<B3sI", 0x21, b"\x03\x20\x00", announced)
    )
    assert server.ask(head) == [f"60 {TEXT} 00 00 00 00"]
    *first, last = segments(LONG.encode())
    for number, segment in enumerate(first):
        assert server.ask(segment) == [f"{0x20 | number % 2 << 4:02x} 00 00 00 00 00 00 00"]
    if announced == len(LONG) + 1:
        assert server.ask(last) == aborted(TEXT, 0x0607_0010) and server.written == []
    else:
        assert server.ask(last)[0].startswith("20") and server.written == [((0x2003, 0), LONG)]


def test_a_toggle_that_does_not_change_ends_a_transfer() -> None:
    server = Server()
    server.ask(f"20 {TEXT}")
    server.ask("00 61 62 63 64 65 66 67")
    assert server.ask("00 61 62 63 64 65 66 67") == aborted(TEXT, 0x0503_0000)
    server.store.values[0x2003, 0] = LONG
    server.ask(f"40 {TEXT}")
    assert server.ask("70") == aborted(TEXT, 0x0503_0000)


def test_more_than_a_kibibyte_is_out_of_memory() -> None:
    server = Server()
    assert server.ask(struct.pack("<B3sI", 0x21, b"\x03\x20\x00", 1025)) == aborted(TEXT, 0x0504_0005)
    assert server.ask(struct.pack("<B3sI", 0x21, b"\x03\x20\x00", 1024))[0].startswith("60")
    server.ask(f"20 {TEXT}")
    answers = [server.ask(bytes([number % 2 << 4]) + b"abcdefg")[0] for number in range(147)]
    assert all(answer.startswith(("20", "30")) for answer in answers[:146])
    assert answers[146:] == aborted(TEXT, 0x0504_0005)


def block_write(server: Server, text: bytes, lost: int | None, crc: int | None = None) -> list[str]:
    """Write a text by a block download with a CRC; segment `lost` is missing at first."""
    assert server.ask(struct.pack("<B3sI", 0xC6, b"\x03\x20\x00", len(text))) == [f"a4 {TEXT} 7f 00 00 00"]
    parts = [text[at : at + 7] for at in range(0, len(text), 7)]
    for sequence, part in enumerate(parts, start=1):
        is_last = sequence == len(parts)
        if sequence != lost:
            answers = server.ask(bytes([sequence | 0x80 * is_last]) + part)
            assert bool(answers) is is_last
    in_order = len(parts) if lost is None else lost - 1
    assert answers == [f"a2 {in_order:02x} 7f 00 00 00 00 00"]
    for sequence, part in enumerate(parts[in_order:], start=1):
        answers = server.ask(bytes([sequence | 0x80 * (in_order + sequence == len(parts))]) + part)
    if lost is not None:
        assert answers == [f"a2 {len(parts) - in_order:02x} 7f 00 00 00 00 00"]
    crc = binascii.crc_hqx(text, 0) if crc is None else crc
    return server.ask(struct.pack("<BH", 0xC1 | -len(text) % 7 << 2, crc))


@pytest.mark.parametrize("lost", [None, 1, 3, 4])
def test_a_text_is_written_in_a_block_whose_lost_segments_are_sent_again(lost) -> None:
    server = Server()
    assert block_write(server, LONG[:33].encode(), lost) == ["a1 00 00 00 00 00 00 00"]
    assert server.written == [((0x2003, 0), LONG[:33])]


def test_a_block_with_another_checksum_or_sequence_is_aborted() -> None:
    server = Server()
    assert block_write(server, LONG.encode(), None, crc=1) == aborted(TEXT, 0x0504_0004)
    assert server.written == []
    server.ask(f"c4 {TEXT}")
    assert server.ask("00") == aborted(TEXT, 0x0504_0003)


@pytest.mark.parametrize(("block", "first"), [(127, 5), (2, 2)])
def test_a_text_is_read_in_blocks(block, first) -> None:
    server, data = Server(), LONG[:33].encode()
    server.store.values[0x2003, 0] = LONG[:33]
    assert server.ask(f"a4 {TEXT} {block:02x} 00") == [f"c6 {TEXT} 21 00 00 00"]
    frames, text, got = server.ask("a3"), b"", 0
    assert len(frames) == first
    while frames[0][:2] != "c9":
        for sequence, frame in enumerate(map(bytes.fromhex, frames), start=1):
            assert frame[0] & 0x7F == sequence
            text += frame[1:]
        got = len(frames)
        frames = server.ask(f"a2 {got:02x} {block:02x}")
    assert text[:33] == data and text[33:] == b"\x00\x00"
    assert bytes.fromhex(frames[0]) == struct.pack("<BH5x", 0xC1 | 2 << 2, binascii.crc_hqx(data, 0))
    assert server.ask("a1") == []


def test_a_block_of_which_nothing_arrived_is_sent_again_and_too_much_is_an_error() -> None:
    server = Server()
    server.store.values[0x2003, 0] = LONG
    server.ask(f"a0 {TEXT} 02 00")
    first = server.ask("a3")
    assert server.ask("a2 00 02") == first
    assert server.ask("a2 03 02") == aborted(TEXT, 0x0504_0003)
    assert server.ask(f"a0 {TEXT} 80 00") == server.ask(f"a0 {TEXT} 00 00") == aborted(TEXT, 0x0504_0002)


def test_short_data_is_read_in_segments_if_the_client_prefers_that() -> None:
    server = Server()
    server.store.values[0x2003, 0] = LONG
    assert server.ask(f"a4 {TEXT} 7f {len(LONG):02x}") == [f"41 {TEXT} {len(LONG):02x} 00 00 00"]
    assert server.ask(f"a4 {TEXT} 7f {len(LONG) - 1:02x}")[0].startswith("c6")


def test_a_transfer_that_rests_for_a_second_is_aborted() -> None:
    server = Server()
    server.store.values[0x2003, 0] = LONG
    assert server.server.due_us() is None
    server.ask(f"40 {TEXT}", now_us=500)
    assert server.server.due_us() == 1_000_500 and server.server.poll(1_000_499) == []
    (frame,) = server.server.poll(1_000_500)
    assert [frame.data.hex(" ")] == aborted(TEXT, 0x0504_0000)
    assert server.server.due_us() is None and server.server.poll(10**9) == []


def test_the_clients_abort_and_short_frames_have_no_response() -> None:
    server = Server()
    server.store.values[0x2003, 0] = LONG
    server.ask(f"40 {TEXT}")
    assert server.ask(f"80 {TEXT}") == [] and server.server.due_us() is None
    assert server.server.receive(0, bytes(7)) == []
    assert server.ask("e0") == aborted("00 00 00", 0x0504_0001)


@pytest.mark.parametrize(("stored", "answer"), [(True, "60 17 10 00"), (False, "80 17 10 00 00 00 06 06")])
def test_a_response_waits_for_the_applications_storage(stored, answer) -> None:
    server = Server(holds=True)
    assert server.server.confirm(True) == []
    assert server.ask("2b 17 10 00 64 00") == []
    assert server.ask("40 17 10 00") == aborted("17 10 00", 0x0800_0022)
    (frame,) = server.server.confirm(stored)
    assert frame.data.hex(" ").startswith(answer)


def pdo_store(**values: int) -> ObjectStore:
    """Objects of a fingertip whose TPDOs are not valid but the first; "x1800_2": value of 1800h:02."""
    store = ObjectStore(OD)
    for index in range(0x1801, 0x1810):
        if (index, 1) in store.values:
            store.values[index, 1] = store.number(index, 1) | 1 << 31
    for name, value in values.items():
        index, _, sub = name[1:].partition("_")
        store.values[int(index, 16), int(sub or "0")] = value
    return store


def tpdos(**values: int) -> TpdoService:
    service = TpdoService(pdo_store(**values))
    service.start(0)
    return service


def test_an_event_driven_tpdo_is_sent_on_request_and_by_its_timer() -> None:
    service = tpdos(x1800_2=255, x1800_3=50, x1800_5=20)  # 5 ms of inhibit time, a timer of 20 ms
    assert service.due_us() == 20_000
    service.trigger([1])
    assert service.due_us() == 0
    (frame,) = service.poll(1_000)
    assert (frame.can_id, len(frame.data)) == (0x190, 8)
    assert service.due_us() == 21_000
    service.trigger([1])
    assert service.due_us() == 6_000 and service.poll(5_999) == []
    assert len(service.poll(2_000, last=True)) == 1  # the node stops: no inhibit time
    assert service.poll(21_999) == [] and len(service.poll(22_000)) == 1
    with pytest.raises(BusError, match="has no TPDO 99"):
        service.trigger([99])
    service.stop()
    assert service.due_us() is None and service.poll(10**9) == []


def test_without_timer_or_request_nothing_is_due() -> None:
    service = tpdos(x1800_2=254, x1800_5=0)
    assert service.due_us() is None and service.poll(10**9) == []
    assert service.can_ids() == {0x190}


@pytest.mark.parametrize(("kind", "sent"), [(1, [1, 2, 3, 4, 5, 6]), (2, [2, 4, 6]), (4, [4]), (240, [])])
def test_a_synchronous_tpdo_is_sent_with_every_nth_sync(kind, sent) -> None:
    service = tpdos(x1800_2=kind)
    assert service.due_us() is None and service.poll(10**9) == []
    assert [number for number in range(1, 7) if service.sync(1000 * number, None)] == sent


def test_type_0_is_sent_with_the_sync_after_a_request() -> None:
    service = tpdos(x1800_2=0)
    assert service.sync(1, None) == []
    service.trigger([1])
    assert service.poll(2) == []
    assert len(service.sync(3, None)) == 1 and service.sync(4, None) == []


def test_counting_begins_at_the_start_value() -> None:
    service = tpdos(x1800_2=2, x1800_6=3, x1019=10)
    assert [counter for counter in range(1, 9) if service.sync(counter, counter)] == [4, 6, 8]
    uncounted = tpdos(x1800_2=2, x1800_6=3)
    assert [number for number in range(1, 5) if uncounted.sync(number, None)] == [2, 4]


def rpdos(**values: int) -> tuple[RpdoService, EmergencyProducer, SyncConsumer, ObjectStore]:
    store = pdo_store(**values)
    emcy = EmergencyProducer(store)
    sync = SyncConsumer(store, emcy)
    service = RpdoService(store, emcy, sync)
    service.start()
    return service, emcy, sync, store


def emergencies(emcy: EmergencyProducer) -> list[int]:
    return [struct.unpack_from("<H", frame.data)[0] for frame in emcy.poll(0, UP)]


RPDO_ID = OD.default_number(0x1400, 1) & 0x7FF
TIME = struct.pack("<I", 1_234_567)


def test_an_rpdo_has_a_deadline_from_its_first_reception_on() -> None:
    service, emcy, _, store = rpdos(x1400_2=255, x1400_5=30)
    assert RPDO_ID in service.can_ids() and service.due_us() is None and service.poll(10**9) == []
    events = service.receive(1_000, 900, CanFrame(RPDO_ID, TIME))
    assert events and store.number(0x1013) == 1_234_567
    assert service.due_us() == 31_000 and service.poll(30_999) == []
    assert [event.number for event in service.poll(31_000)] == [1]
    assert service.due_us() is None and emergencies(emcy) == [0x8250]
    service.receive(40_000, 40_000, CanFrame(RPDO_ID, TIME))
    assert emergencies(emcy) == [0x0000]


def test_the_length_of_an_rpdo() -> None:
    service, emcy, _, store = rpdos(x1400_2=255)
    assert service.receive(0, 0, CanFrame(RPDO_ID, TIME[:3])) == []
    assert emergencies(emcy) == [0x8210] and store.number(0x1013) == OD.default_number(0x1013)
    assert service.receive(0, 0, CanFrame(RPDO_ID, TIME + b"\x00"))
    assert emergencies(emcy) == [0x8220, 0x0000] and store.number(0x1013) == 1_234_567
    service.receive(0, 0, CanFrame(RPDO_ID, TIME))
    assert emergencies(emcy) == [0x0000]
    assert service.receive(0, 0, CanFrame(RPDO_ID + 1, TIME)) == []


def test_a_synchronous_rpdo_takes_effect_at_the_next_sync_within_the_window() -> None:
    service, _, sync, store = rpdos(x1400_2=1, x1007=500)
    before = store.number(0x1013)
    sync.accept(1_000, b"")
    assert service.receive(1_400, 1_400, CanFrame(RPDO_ID, TIME)) == []
    assert store.number(0x1013) == before
    assert service.sync() and store.number(0x1013) == 1_234_567
    assert service.sync() == []
    assert service.receive(1_501, 1_501, CanFrame(RPDO_ID, bytes(4))) == [] and service.sync() == []
    service.stop()
    assert service.receive(0, 0, CanFrame(RPDO_ID, TIME)) == []


@pytest.mark.parametrize(("index", "rate"), [(0x1010, SAVES), (0x6125, TARES)])
def test_a_rate_allows_a_burst_and_then_one_a_period(index, rate) -> None:
    rates = WriteRates()
    for _ in range(rate.burst):
        rates.take(0, index)
    for too_soon_us in (0, rate.period_us - 1):
        with pytest.raises(SdoAbortError) as refused:
            rates.take(too_soon_us, index)
        assert refused.value.code is AbortCode.LOCAL_CONTROL
    rates.take(rate.period_us, index)
    with pytest.raises(SdoAbortError):
        rates.take(rate.period_us, index)
    rates.take(2 * rate.period_us, index)
    for _ in range(200):
        rates.take(0, 0x1017)  # as often as a master likes


def keeper() -> tuple[ParameterKeeper, ObjectStore, list[bool]]:
    store, confirmed = ObjectStore(OD), []
    return ParameterKeeper(store, StoredParameters(), WriteRates()), store, confirmed


def test_a_store_request_ends_with_its_result_or_after_5_s() -> None:
    made, store, confirmed = keeper()
    store.values[0x1017, 0] = 77
    entry, confirm = OD.entry(0x1010, 1), lambda done: confirmed.append(done) or []
    request = made.write(1_000, entry, int.from_bytes(b"save", "little"), confirm)
    assert request is not None and dict(request.parameters.objects) == {(0x1017, 0): 77}
    assert made.is_storing
    with pytest.raises(SdoAbortError) as busy:
        made.keep_lss(1_000, 0x20, confirm)
    assert busy.value.code is AbortCode.DEVICE_STATE
    made.poll(5_000_999)
    assert made.is_storing and confirmed == []
    made.poll(5_001_000)
    assert not made.is_storing and confirmed == [False] and made.kept == StoredParameters()
    made.finished(True, request.parameters)  # late, but it is on the disk
    assert made.kept == request.parameters and store.saved == {(0x1017, 0): 77} and confirmed == [False]
    assert made.write(0, entry, int.from_bytes(b"save", "little"), confirm) is None  # nothing has changed
    with pytest.raises(SdoAbortError) as other:
        made.write(0, entry, int.from_bytes(b"load", "little"), confirm)
    assert other.value.code is AbortCode.NOT_STORED


def test_lss_stores_a_new_node_id_once() -> None:
    made, _, confirmed = keeper()
    request = made.keep_lss(0, 0x20, lambda done: confirmed.append(done) or [])
    assert request is not None and request.parameters == msgspec.structs.replace(
        StoredParameters(), node_id=0x20
    )
    made.finished(True)
    assert confirmed == [True] and made.kept.node_id == 0x20
    assert made.keep_lss(0, 0x20, lambda _done: []) is None
