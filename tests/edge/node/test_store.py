"""Store and restore of parameters (CiA 301, 1010h and 1011h) with a real file."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.parameter_file import ParameterFile
from palpate_edge.daemon.parameter_store import save
from palpate_edge.node.eds import load_eds
from palpate_edge.node.eds_history import EARLIER, EarlierEds
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.object_dictionary import ObjectDictionary
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.slave import Slave, SlaveOutput
from palpate_edge.node.stored_check import StoredParametersError
from palpate_edge.node.stored_parameters import StoredParameters

SAVE, LOAD = 0x65766173, 0x64616F6C
NO_TPDO_5 = 0xC000_0310
RESET_NODE, RESET_COMMUNICATION = CanFrame(0x000, b"\x81\x00"), CanFrame(0x000, b"\x82\x00")


def write(index: int, subindex: int, value: int, code: str = "<I") -> CanFrame:
    data = struct.pack(code, value)
    head = struct.pack("<BHB", 0x23 | (4 - len(data)) << 2, index, subindex)
    return CanFrame(0x610, head + data.ljust(4, b"\x00"))


HEARTBEAT_250 = write(0x1017, 0, 250, "<H")
LED_40 = write(0x2030, 0, 40, "<B")


class Board:
    """A fingertip with its parameter file, switched on and off."""

    def __init__(self, path: Path) -> None:
        self.file = ParameterFile(path)
        self.switch_on()

    def switch_on(self, node_id: int = 0x10) -> None:
        self.node = FingertipNode(node_id, MethodCode.PAPER, "", kept=self.file.load(), has_led=True)
        self.node.process(0, ())

    @property
    def slave(self) -> Slave:
        return self.node.slave

    def store(self, output: SlaveOutput) -> list[str]:
        """Save what is requested, and answer; what failed."""
        results = [save(self.file, e.parameters) for e in output.events if isinstance(e, StoreRequested)]
        for result in results:
            self.slave.store_finished(result.stored, result.parameters)
        return [result.failure for result in results if result.failure]

    def send(self, *frames: CanFrame) -> list[str]:
        """SDO answers, those included that come once the file is written."""
        output = self.node.process(1, frames)
        self.store(output)
        frames_out = output.frames_out + self.node.process(2, ()).frames_out
        return [frame.data.hex(" ") for frame in frames_out if frame.can_id == 0x590]


@pytest.fixture
def board(tmp_path: Path) -> Board:
    return Board(tmp_path / "finger-1.parameters")


def test_save_survives_the_power(board: Board) -> None:
    board.send(HEARTBEAT_250, LED_40)
    assert board.send(write(0x1010, 1, SAVE)) == ["60 10 10 01 00 00 00 00"]
    board.switch_on()
    assert (board.slave.read(0x1017), board.slave.read(0x2030)) == (250, 40)


def test_without_save_nothing_survives(board: Board) -> None:
    board.send(HEARTBEAT_250)
    board.switch_on()
    assert board.slave.read(0x1017) == 100


@pytest.mark.parametrize(("subindex", "heartbeat_ms", "led"), [(2, 250, 255), (3, 100, 255), (4, 100, 40)])
def test_groups_are_saved_apart(board: Board, subindex: int, heartbeat_ms: int, led: int) -> None:
    board.send(HEARTBEAT_250, LED_40, write(0x1010, subindex, SAVE))
    board.switch_on()
    assert (board.slave.read(0x1017), board.slave.read(0x2030)) == (heartbeat_ms, led)


def test_a_reset_gives_what_was_saved(board: Board) -> None:
    board.send(HEARTBEAT_250, write(0x1010, 1, SAVE), write(0x1017, 0, 999, "<H"))
    board.node.process(3, (RESET_COMMUNICATION,))
    assert board.slave.read(0x1017) == 250


def test_load_gives_the_defaults_after_the_next_reset(board: Board) -> None:
    board.send(HEARTBEAT_250, LED_40, write(0x1010, 1, SAVE))
    assert board.send(write(0x1011, 1, LOAD)) == ["60 11 10 01 00 00 00 00"]
    assert board.slave.read(0x1017) == 250
    board.node.process(3, (RESET_NODE,))
    assert (board.slave.read(0x1017), board.slave.read(0x2030)) == (100, 255)
    board.switch_on()
    assert board.slave.read(0x1017) == 100


def test_load_of_one_group_leaves_the_other(board: Board) -> None:
    board.send(HEARTBEAT_250, LED_40, write(0x1010, 1, SAVE))
    board.send(write(0x1011, 2, LOAD))
    board.switch_on()
    assert (board.slave.read(0x1017), board.slave.read(0x2030)) == (100, 40)


@pytest.mark.parametrize("index", [0x1010, 0x1011])
@pytest.mark.parametrize("value", [0, SAVE + 1, 0x73617665])
def test_another_signature_is_refused(board: Board, index: int, value: int) -> None:
    assert board.send(write(index, 1, value)) == [f"80 {index & 0xFF:02x} 10 01 20 00 00 08"]


@pytest.mark.parametrize("index", [0x1010, 0x1011])
def test_what_is_read_says_that_it_works_on_command(board: Board, index: int) -> None:
    request = CanFrame(0x610, struct.pack("<BHB4x", 0x40, index, 1))
    assert board.send(request) == [f"43 {index & 0xFF:02x} 10 01 01 00 00 00"]


def test_a_node_without_a_file_shows_that_it_stores_nothing() -> None:
    """CiA 301, 7.5.2.13: bit 0 is 0, "the device does not save parameters on command"."""
    node = FingertipNode(0x10, MethodCode.PAPER, "", stores=False)
    for request in ((), (CanFrame(0x000, b"\x81\x00"),)):
        node.process(0, request)
        assert {node.slave.read(index, group) for index in (0x1010, 0x1011) for group in (1, 2, 3, 4)} == {0}


def test_the_answer_waits_for_the_disk(board: Board) -> None:
    waiting = board.node.process(
        1, (write(0x1010, 1, SAVE), CanFrame(0x610, b"\x40\x00\x10\x00\x00\x00\x00\x00"))
    )
    assert [frame.data.hex(" ") for frame in waiting.frames_out] == ["80 00 10 00 22 00 00 08"]
    board.slave.store_finished(False)
    assert [frame.data.hex(" ") for frame in board.node.process(2, ()).frames_out] == [
        "80 10 10 01 00 00 06 06"
    ]


def test_a_disk_that_never_answers_is_a_failure(board: Board) -> None:
    board.node.process(1, (write(0x1010, 1, SAVE),))
    frames_out = board.node.process(5_000_001, ()).frames_out
    assert CanFrame(0x590, bytes.fromhex("80 10 10 01 00 00 06 06")) in frames_out


def test_a_name_by_segments(board: Board) -> None:
    board.send(
        CanFrame(0x610, bytes.fromhex("21 03 20 00 05 00 00 00")),
        CanFrame(0x610, bytes.fromhex("05") + b"thumb\x00\x00"),
        write(0x1010, 4, SAVE),
    )
    board.switch_on()
    assert board.slave.read(0x2003) == "thumb"


def test_cob_ids_follow_a_new_node_id(board: Board) -> None:
    """Saved is what differs from the EDS: TPDO 2 was moved, TPDO 1 was not."""
    board.send(write(0x1801, 1, 0xC000_0290), write(0x1801, 1, 0x4000_0123 + 0x80), write(0x1010, 2, SAVE))
    board.switch_on(node_id=0x20)
    assert board.slave.read(0x1800, 1) == 0x4000_01A0
    assert board.slave.read(0x1801, 1) == 0x4000_01A3


def test_clocks_and_histories_are_not_saved(board: Board) -> None:
    board.slave.write(0x1013, 0, 77)
    board.slave.emcy.report(0xFF01, 0x80)
    board.send(HEARTBEAT_250, write(0x1010, 1, SAVE))
    assert dict(board.file.load().objects) == {(0x1017, 0): 250}


def test_parameters_of_another_eds_are_not_used(board: Board) -> None:
    board.file.save(StoredParameters("0123456789abcdef", 0x20, None, {(0x1017, 0): 250}))
    board.node = FingertipNode(0x10, MethodCode.PAPER, "", kept=board.file.load())
    frames_out = board.node.process(0, ()).frames_out
    assert board.slave.read(0x1017) == 100
    assert (
        CanFrame(0x0A0, bytes.fromhex("00 63 01 00 00 00 00 00")) in frames_out
    )  # of node 0x20, as LSS stored


@pytest.mark.parametrize("earlier", EARLIER)
def test_parameters_of_an_earlier_eds_are_kept(board: Board, earlier: EarlierEds) -> None:
    """An update that only adds objects drops nothing that a user saved."""
    saved = {(0x1017, 0): 250, (0x1804, 1): NO_TPDO_5}
    board.file.save(StoredParameters(earlier.checksum, None, None, saved))
    board.switch_on()
    assert board.slave.stored_fault is None
    assert (board.slave.read(0x1017), board.slave.read(0x1804, 1)) == (250, NO_TPDO_5)
    board.send(LED_40, write(0x1010, 4, SAVE))
    assert board.file.load().eds_checksum == load_eds(FINGERTIP_EDS, 0x10).checksum
    assert dict(board.file.load().objects) == saved | {(0x2030, 0): 40}


def test_a_save_does_not_take_over_what_another_eds_kept(board: Board) -> None:
    board.file.save(StoredParameters("0123456789abcdef", None, None, {(0x1017, 0): 250, (0x5FFF, 0): 1}))
    board.switch_on()
    board.send(LED_40, write(0x1010, 4, SAVE))
    assert dict(board.file.load().objects) == {(0x2030, 0): 40}


def test_a_torn_file_gives_the_one_before(board: Board, tmp_path: Path) -> None:
    board.send(HEARTBEAT_250, write(0x1010, 1, SAVE))
    board.send(write(0x1017, 0, 500, "<H"), write(0x1010, 1, SAVE))
    path = tmp_path / "finger-1.parameters"
    path.write_bytes(path.read_bytes()[:-3])
    board.switch_on()
    assert board.slave.read(0x1017) == 250


def test_two_damaged_files_are_refused_with_the_way_out(board: Board, tmp_path: Path) -> None:
    board.send(HEARTBEAT_250, write(0x1010, 1, SAVE))
    (tmp_path / "finger-1.parameters").write_text("x")
    with pytest.raises(ConfigError, match=r"finger-1.parameters are damaged.*remove both"):
        board.file.load()


def test_a_full_disk_is_an_abort_and_the_old_parameters_stay(board: Board, tmp_path: Path) -> None:
    board.send(HEARTBEAT_250, write(0x1010, 1, SAVE))
    (tmp_path / "finger-1.parameters.new").mkdir()  # cannot be written
    output = board.node.process(3, (write(0x1017, 0, 500, "<H"), write(0x1010, 1, SAVE)))
    (failure,) = board.store(output)
    assert "finger-1.parameters" in failure
    assert [frame.data.hex(" ") for frame in board.node.process(4, ()).frames_out] == [
        "80 10 10 01 00 00 06 06"
    ]
    board.node.process(5, (RESET_NODE,))
    assert board.slave.read(0x1017) == 250


def test_a_drive_without_these_objects_stores_nothing(drive_od: ObjectDictionary) -> None:
    slave = Slave(drive_od)
    slave.process(0, ())
    answer = slave.process(1, (write(0x1010, 1, SAVE),)).frames_out
    assert answer == (CanFrame(0x590, bytes.fromhex("80 10 10 01 00 00 02 06")),)


@pytest.mark.parametrize("index", [0x1010, 0x1011])
def test_nothing_is_stored_while_operational(board: Board, index: int) -> None:
    """A foreign master must stop the contacts before it changes what the node keeps."""
    signature = SAVE if index == 0x1010 else LOAD
    board.send(HEARTBEAT_250, CanFrame(0x000, b"\x01\x00"))
    assert board.send(write(index, 1, signature)) == [f"80 {index & 0xFF:02x} 10 01 22 00 00 08"]
    assert board.file.load().objects == {}
    board.node.process(3, (CanFrame(0x000, b"\x80\x00"),))
    assert board.send(write(index, 1, signature)) == [f"60 {index & 0xFF:02x} 10 01 00 00 00 00"]


def test_unchanged_parameters_are_not_written_again(board: Board, tmp_path: Path) -> None:
    board.send(HEARTBEAT_250, write(0x1010, 1, SAVE))
    path = tmp_path / "finger-1.parameters"
    before = path.stat().st_ino
    assert board.send(write(0x1010, 1, SAVE)) == ["60 10 10 01 00 00 00 00"]
    assert board.send(write(0x1010, 2, SAVE)) == ["60 10 10 02 00 00 00 00"]
    assert path.stat().st_ino == before
    board.send(LED_40)
    assert board.send(write(0x1010, 1, SAVE)) == ["60 10 10 01 00 00 00 00"]
    assert path.stat().st_ino != before


def test_a_save_that_ends_after_its_time_out_counts_and_answers_nobody(board: Board) -> None:
    board.send(HEARTBEAT_250)
    output = board.node.process(1, (write(0x1010, 1, SAVE),))
    (late,) = (event for event in output.events if isinstance(event, StoreRequested))
    board.node.process(5_000_001, ())
    board.node.process(5_000_002, (LED_40,))
    output = board.node.process(5_000_003, (write(0x1010, 1, SAVE),))
    (second,) = (event for event in output.events if isinstance(event, StoreRequested))
    board.slave.store_finished(True, late.parameters)
    assert board.node.process(5_000_004, ()).frames_out == ()
    board.slave.store_finished(True, second.parameters)
    assert board.node.process(5_000_005, ()).frames_out == (
        CanFrame(0x590, bytes.fromhex("60 10 10 01 00 00 00 00")),
    )


TPDO_1, TPDO_2, RPDO_1 = 0x1800, 0x1801, 0x1400
XY = {(0x1A00, 1): 0x7130_0210, (0x1A00, 2): 0x7130_0110}  # x and y exchanged


@pytest.mark.parametrize(
    "objects",
    [
        {(0x1017, 0): "fast"},
        {(0x1017, 0): 70_000},
        {(0x1017, 0): -1},
        {(0x2003, 0): 7},
        {(0x2003, 0): "d\u00f4me"},
        {(0x1000, 0): 5},  # a constant
        {(0x7130, 1): 5},  # not a parameter
        {(0x1010, 1): SAVE},
        {(0x5FFF, 0): 1},
        {(0x1029, 1): 3},  # above HighLimit
        {(TPDO_1, 1): 0x4000_0000},  # NMT
        {(TPDO_1, 1): 0x4000_0601},
        {(TPDO_1, 1): 0x6000_0190},  # 29 bits
        {(TPDO_1, 1): 0x4000_0290},  # of TPDO 2
        {(TPDO_1, 1): 0x4000_0123 + 0x80, (TPDO_2, 1): 0x4000_0123 + 0x80},
        {(TPDO_1, 2): 241},
        {(RPDO_1, 1): 0x190},
        {(0x1005, 0): 0x1FF},
        {(0x1014, 0): 0x190},
        {(0x1016, 1): 0x0080_0000 + 100, (0x1016, 2): 0x0180_0000},
        {(0x1A00, 1): 0x7130_0120},  # 32 of 16 bits
        {(0x1A00, 0): 5},  # the fifth entry is empty
        {(0x1A00, 1): 0x1008_0008},  # a text
        {(0x1019, 0): 1},
    ],
)
def test_parameters_that_no_master_could_write_are_not_used(
    board: Board, objects: dict[tuple[int, int], int | str]
) -> None:
    """The checksum of the file is right: someone else made it."""
    checksum = board.slave._store.od.checksum
    board.file.save(StoredParameters(checksum, None, None, {(0x2030, 0): 40} | objects))
    board.switch_on()
    fault = board.slave.stored_fault
    assert isinstance(fault, StoredParametersError)
    assert any(f"{index:04X}h" in str(fault) for index, _ in objects)
    assert (board.slave.node_id, board.slave.read(0x2030)) == (0x10, 255)
    assert board.slave.emcy._active == {(0x6300, b""): 0x01}


@pytest.mark.parametrize("node_id", [0, 128, 254, 300, -1])
def test_a_stored_node_id_out_of_range_is_not_used(board: Board, node_id: int) -> None:
    board.file.save(StoredParameters("", node_id, None, {}))
    board.switch_on()
    assert board.slave.node_id == 0x10
    assert str(board.slave.stored_fault) == f"the stored node id is {node_id}: 1 to 127 or 255 is allowed"


@pytest.mark.parametrize(
    "objects",
    [
        XY,
        {(TPDO_1, 3): 100},  # the inhibit time of a valid TPDO: a master disables it first
        {(TPDO_1, 1): 0x290, (TPDO_2, 1): 0x190},  # exchanged, without bit 30
        {(TPDO_1, 1): 0xC000_0190, (0x1A00, 0): 0},
        {(TPDO_1, 1): 0x4000_01B0, (0x1A00, 0): 1, (0x1A00, 1): 0x2013_0010},
        {(0x1014, 0): 0x0F0},
        {(0x1005, 0): 0x0F1},
        {(0x1016, 1): 0x007F_0064, (0x1017, 0): 250, (0x2003, 0): "thumb"},
    ],
)
def test_what_a_master_can_store_is_used(board: Board, objects: dict[tuple[int, int], int | str]) -> None:
    board.file.save(StoredParameters(board.slave._store.od.checksum, None, None, objects))
    board.switch_on()
    assert board.slave.stored_fault is None
    assert {key: board.slave.read(*key) for key in objects} == objects
