"""The LSS slave byte by byte (CiA 305)."""

from __future__ import annotations

import struct

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.events import NmtStateChanged, StoreRequested
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.nmt import NmtCommand, NmtState
from palpate_edge.node.slave import Slave
from palpate_edge.node.stored_parameters import StoredParameters

VENDOR, PRODUCT, REVISION, SERIAL = 0, 0x404, 0x10000, 0xDEADBEEF
CONFIGURATION, WAITING = "04 01", "04 00"
RESET_COMMUNICATION, RESET_NODE = CanFrame(0x000, b"\x82\x00"), CanFrame(0x000, b"\x81\x00")


def fingertip(node_id: int, kept: StoredParameters | None = None) -> Slave:
    kept = kept or StoredParameters()
    node = FingertipNode(node_id, MethodCode.PAPER, "", serial_number=SERIAL, kept=kept)
    node.process(0, ())
    return node.slave


@pytest.fixture
def slave() -> Slave:
    return fingertip(0x10)


@pytest.fixture
def unconfigured() -> Slave:
    return fingertip(255)


def ask(slave: Slave, *requests: str) -> list[str]:
    """Answers to LSS requests, both without the zeros at their end."""
    frames = [CanFrame(0x7E5, bytes.fromhex(request).ljust(8, b"\x00")) for request in requests]
    output = slave.process(1, frames)
    answers = [frame.data for frame in output.frames_out if frame.can_id == 0x7E4]
    assert all(len(data) == 8 for data in answers)
    return [data[: 2 if data[0] < 0x5A or data[0] == 0x5E else 5].hex(" ") for data in answers]


def number(command: int, value: int) -> str:
    return struct.pack("<BI", command, value).hex(" ")


def select(serial: int = SERIAL) -> list[str]:
    return [number(0x40 + part, value) for part, value in enumerate((VENDOR, PRODUCT, REVISION, serial))]


def test_waiting_answers_no_inquiry(slave: Slave) -> None:
    assert ask(slave, "5a", "5e", "11 20") == []


def test_inquiries(slave: Slave) -> None:
    answers = ask(slave, CONFIGURATION, "5a", "5b", "5c", "5d", "5e")
    assert answers == [
        number(0x5A, VENDOR),
        number(0x5B, PRODUCT),
        number(0x5C, REVISION),
        number(0x5D, SERIAL),
        "5e 10",
    ]


def test_selected_by_all_four_numbers(slave: Slave) -> None:
    assert ask(slave, *select()) == ["44 00"]
    assert ask(slave, "5e") == ["5e 10"]
    assert ask(slave, WAITING, "5e") == []


@pytest.mark.parametrize(
    "requests",
    [
        select(SERIAL + 1),
        select()[1:],
        [*select()[:2], *select()[3:]],
        [*select()[:3], select()[2], select()[3]][::-1],
    ],
    ids=["another serial number", "no vendor", "no revision", "backwards"],
)
def test_not_selected(slave: Slave, requests: list[str]) -> None:
    assert ask(slave, *requests, "5e") == []


@pytest.mark.parametrize(
    ("ranges", "answers"),
    [
        ((VENDOR, PRODUCT, REVISION, REVISION, SERIAL, SERIAL), ["4f 00"]),
        ((VENDOR, PRODUCT, 0, 0xFFFFFFFF, 0, 0xFFFFFFFF), ["4f 00"]),
        ((VENDOR, PRODUCT, 0, 0xFFFFFFFF, SERIAL + 1, 0xFFFFFFFF), []),
        ((VENDOR, PRODUCT, 0, 0xFFFFFFFF, 0, SERIAL - 1), []),
        ((VENDOR, PRODUCT, REVISION + 1, 0xFFFFFFFF, 0, 0xFFFFFFFF), []),
        ((VENDOR, PRODUCT, 0, REVISION - 1, 0, 0xFFFFFFFF), []),
        ((VENDOR + 1, PRODUCT, 0, 0xFFFFFFFF, 0, 0xFFFFFFFF), []),
        ((VENDOR, PRODUCT + 1, 0, 0xFFFFFFFF, 0, 0xFFFFFFFF), []),
    ],
)
def test_identified_within_ranges(slave: Slave, ranges: tuple[int, ...], answers: list[str]) -> None:
    assert ask(slave, *(number(0x46 + step, value) for step, value in enumerate(ranges))) == answers


def test_identify_non_configured(slave: Slave, unconfigured: Slave) -> None:
    assert ask(slave, "4c") == []
    assert ask(unconfigured, "4c") == ["50 00"]


@pytest.mark.parametrize(("node_id", "error"), [(1, 0), (127, 0), (255, 0), (0, 1), (128, 1), (254, 1)])
def test_which_node_ids_are_taken(slave: Slave, node_id: int, error: int) -> None:
    assert ask(slave, CONFIGURATION, f"11 {node_id:02x}") == [f"11 {error:02x}"]


def test_a_node_id_counts_after_the_reset_communication(slave: Slave) -> None:
    ask(slave, CONFIGURATION, "11 20", WAITING)
    assert slave.node_id == 0x10
    assert slave.process(2, (RESET_COMMUNICATION,)).frames_out == (CanFrame(0x720, b"\x00"),)
    assert slave.node_id == 0x20
    answer = slave.process(3, (CanFrame(0x620, bytes.fromhex("40 00 18 01 00 00 00 00")),)).frames_out
    assert answer == (CanFrame(0x5A0, bytes.fromhex("43 00 18 01 a0 01 00 40")),)
    assert {0x000, 0x620, 0x7E5} <= set(slave.accept_ids())
    assert 0x610 not in slave.accept_ids()


def test_a_node_id_that_was_not_stored_is_gone_after_the_reset_node(slave: Slave) -> None:
    ask(slave, CONFIGURATION, "11 20", WAITING)
    slave.process(2, (RESET_COMMUNICATION,))
    assert slave.process(3, (RESET_NODE,)).frames_out == (CanFrame(0x710, b"\x00"),)


def test_a_stored_node_id_stays(slave: Slave) -> None:
    assert ask(slave, CONFIGURATION, "11 20") == ["11 00"]
    output = slave.process(2, (CanFrame(0x7E5, bytes.fromhex("17 00 00 00 00 00 00 00")),))
    (request,) = (event for event in output.events if isinstance(event, StoreRequested))
    assert request.parameters.node_id == 0x20
    assert output.frames_out == ()  # the answer waits for the disk
    slave.store_finished(True)
    assert CanFrame(0x7E4, bytes.fromhex("17 00 00 00 00 00 00 00")) in slave.process(3, ()).frames_out
    assert slave.process(4, (RESET_NODE,)).frames_out == (CanFrame(0x720, b"\x00"),)
    assert fingertip(0x10, request.parameters).node_id == 0x20


def test_a_disk_that_fails_is_told(slave: Slave) -> None:
    ask(slave, CONFIGURATION, "11 20", "17")
    slave.store_finished(False)
    assert CanFrame(0x7E4, bytes.fromhex("17 02 00 00 00 00 00 00")) in slave.process(2, ()).frames_out
    assert slave.process(3, (RESET_NODE,)).frames_out == (CanFrame(0x710, b"\x00"),)


def test_what_is_stored_already_is_answered_at_once(slave: Slave) -> None:
    output = slave.process(
        1, [CanFrame(0x7E5, bytes.fromhex(one).ljust(8, b"\0")) for one in (CONFIGURATION, "11 20", "17")]
    )
    (request,) = (event for event in output.events if isinstance(event, StoreRequested))
    slave.store_finished(True, request.parameters)
    slave.process(2, ())
    assert ask(slave, "17") == ["17 00"]


@pytest.mark.parametrize(("stores", "error"), [(False, 1), (True, 2)])
def test_the_error_tells_a_node_without_storage_from_a_disk_that_fails(stores: bool, error: int) -> None:
    """CiA 305, store configuration: 1 is "not supported", 2 is "storage media access error"."""
    slave = FingertipNode(0x10, MethodCode.PAPER, "", stores=stores).slave
    ask(slave, CONFIGURATION, "11 20", "17")
    slave.store_finished(False)
    assert slave.process(2, ()).frames_out[0] == CanFrame(0x7E4, bytes([0x17, error, 0, 0, 0, 0, 0, 0]))


def test_one_storing_at_a_time(slave: Slave) -> None:
    assert ask(slave, CONFIGURATION, "17", "17") == ["17 02"]


def test_a_node_without_an_id_says_nothing_until_it_has_one(unconfigured: Slave) -> None:
    assert unconfigured.state is NmtState.INITIALISING
    assert unconfigured.accept_ids() == (0x7E5,)
    assert unconfigured.process(5_000_000, (CanFrame(0x000, b"\x01\x00"),)).frames_out == ()
    assert ask(unconfigured, CONFIGURATION, "5e", "11 21") == ["5e ff", "11 00"]
    output = unconfigured.process(5_000_001, (CanFrame(0x7E5, bytes.fromhex("04 00 00 00 00 00 00 00")),))
    assert output.frames_out == (CanFrame(0x721, b"\x00"),)
    assert NmtStateChanged(NmtState.PRE_OPERATIONAL, None) in output.events
    assert unconfigured.node_id == 0x21


def test_a_node_id_can_be_taken_away(slave: Slave) -> None:
    ask(slave, CONFIGURATION, "11 ff", WAITING)
    output = slave.process(2, (RESET_COMMUNICATION,))
    assert output.frames_out == ()
    assert NmtStateChanged(NmtState.INITIALISING, NmtCommand.RESET_COMMUNICATION) in output.events
    assert slave.process(3_000_000, ()).frames_out == ()


@pytest.mark.parametrize(("table", "index"), [(0, 0), (0, 4), (0, 5), (0, 9), (1, 0)])
def test_a_bit_timing_is_refused_and_its_activation_changes_nothing(
    slave: Slave, table: int, index: int
) -> None:
    """CiA 305: error code 1, bit timing not supported. The link sets the bit rate, the node cannot."""
    assert ask(slave, CONFIGURATION, f"13 {table:02x} {index:02x}") == ["13 01"]
    output = slave.process(2, (CanFrame(0x7E5, bytes.fromhex("15 ff ff 00 00 00 00 00")),))
    assert output.events == ()
    assert slave.process(100_000, ()).frames_out == (CanFrame(0x710, b"\x7f"),)  # the delay is 131 s
    assert ask(slave, "5e") == ["5e 10"]


@pytest.mark.parametrize("reset", [RESET_COMMUNICATION, RESET_NODE])
def test_a_reset_ends_the_configuration_state(slave: Slave, reset: CanFrame) -> None:
    ask(slave, CONFIGURATION)
    slave.process(2, (reset,))
    assert ask(slave, "5e") == []


def test_half_a_selection_is_forgotten_by_a_reset(slave: Slave) -> None:
    requests = select()
    ask(slave, *requests[:3])
    slave.process(2, (RESET_COMMUNICATION,))
    assert ask(slave, requests[3]) == []
    assert ask(slave, *requests) == ["44 00"]


def fastscan(value: int, bit: int, part: int, next_part: int) -> str:
    return struct.pack("<BIBBB", 0x51, value, bit, part, next_part).hex(" ")


def test_fastscan_finds_the_whole_identity(unconfigured: Slave) -> None:
    assert ask(unconfigured, fastscan(0, 0x80, 0, 0)) == ["4f 00"]
    found = []
    for part in range(4):
        value = 0
        for bit in range(31, -1, -1):
            if not ask(unconfigured, fastscan(value, bit, part, part)):
                value |= 1 << bit
        assert ask(unconfigured, fastscan(value, 0, part, (part + 1) % 4)) == ["4f 00"]
        found.append(value)
    assert found == [VENDOR, PRODUCT, REVISION, SERIAL]
    assert ask(unconfigured, "5e") == ["5e ff"]  # it is in configuration now


@pytest.mark.parametrize(
    "request_",
    [fastscan(0, 32, 0, 0), fastscan(0, 31, 4, 0), fastscan(0, 31, 0, 4), fastscan(0, 31, 1, 1)],
    ids=["bit 32", "part 4", "next part 4", "another part"],
)
def test_fastscan_leaves_wrong_questions(unconfigured: Slave, request_: str) -> None:
    ask(unconfigured, fastscan(0, 0x80, 0, 0))
    assert ask(unconfigured, request_) == []


def test_fastscan_is_for_nodes_without_an_id(slave: Slave) -> None:
    assert ask(slave, fastscan(0, 0x80, 0, 0)) == []


def test_short_frames_are_left(slave: Slave) -> None:
    assert slave.process(1, (CanFrame(0x7E5, b"\x04\x01"),)).frames_out == ()
    assert ask(slave, "5e") == []
