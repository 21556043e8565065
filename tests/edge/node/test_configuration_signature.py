"""The configuration signature, 1020h: "if any other command changes boot-up configuration values, the device
shall reset the object verify configuration to 0" (CiA 301, 7.5.2.16)."""

from __future__ import annotations

import struct
from pathlib import Path

import msgspec
import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.daemon.parameter_file import ParameterFile
from palpate_edge.daemon.parameter_store import save
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode

SAVE, LOAD = 0x65766173, 0x64616F6C
RESET_NODE, RESET_COMMUNICATION = CanFrame(0x000, b"\x81\x00"), CanFrame(0x000, b"\x82\x00")
DATE, TIME = 15_000, 43_200_000
OK = 0x60


def lss(*data: int) -> CanFrame:
    return CanFrame(0x7E5, bytes(data).ljust(8, b"\0"))


class Board:
    """A fingertip with its parameter file."""

    def __init__(self, path: Path) -> None:
        self.file = ParameterFile(path)
        self.switch_on()

    def switch_on(self, calibration: str = "0123456789abcdef", serial: int = 42) -> None:
        self.node = FingertipNode(
            0x10, MethodCode.PAPER, calibration, kept=self.file.load(), serial_number=serial, has_led=True
        )
        self.node.process(0, ())

    def send(self, *frames: CanFrame) -> list[int]:
        """The first bytes of the SDO responses, those included that come once the file is written."""
        output = self.node.process(1, frames)
        for event in output.events:
            if isinstance(event, StoreRequested):
                result = save(self.file, event.parameters)
                self.node.slave.store_finished(result.stored, result.parameters)
        answers = output.frames_out + self.node.process(2, ()).frames_out
        return [frame.data[0] for frame in answers if frame.can_id == 0x590]

    def write(self, index: int, subindex: int, value: int, size: int = 4) -> None:
        head = struct.pack("<BHB", 0x23 | (4 - size) << 2, index, subindex)
        answers = self.send(CanFrame(0x610, head + value.to_bytes(size, "little").ljust(4, b"\0")))
        assert answers == [OK]

    def sign(self) -> None:
        self.write(0x1020, 1, DATE)
        self.write(0x1020, 2, TIME)

    @property
    def signature(self) -> tuple[object, object]:
        return self.node.slave.read(0x1020, 1), self.node.slave.read(0x1020, 2)


@pytest.fixture
def board(tmp_path: Path) -> Board:
    """A fingertip that was configured, verified, signed and saved."""
    board = Board(tmp_path / "finger-1.parameters")
    board.write(0x1017, 0, 250, size=2)
    board.sign()
    board.write(0x1010, 1, SAVE)
    return board


def test_the_signature_is_saved_with_the_configuration(board: Board) -> None:
    assert board.signature == (DATE, TIME)
    for reset in (RESET_COMMUNICATION, RESET_NODE):
        board.send(reset)
        assert board.signature == (DATE, TIME)
    board.switch_on()
    assert board.signature == (DATE, TIME)


@pytest.mark.parametrize(
    ("index", "subindex", "value", "size"),
    [
        (0x1017, 0, 100, 2),
        (0x1800, 1, 0xC000_0190, 4),
        (0x1800, 5, 20, 2),
        (0x1016, 1, 0x007F_0064, 4),
        (0x2030, 0, 40, 1),
    ],
)
def test_a_change_of_a_parameter_clears_it(
    board: Board, index: int, subindex: int, value: int, size: int
) -> None:
    board.write(index, subindex, value, size)
    assert board.signature == (0, 0)


def test_a_write_of_the_same_value_changes_nothing(board: Board) -> None:
    board.write(0x1017, 0, 250, size=2)
    assert board.signature == (DATE, TIME)


def test_an_unsaved_change_is_gone_after_a_reset_and_the_signature_returns(board: Board) -> None:
    board.write(0x1017, 0, 100, size=2)
    board.send(RESET_COMMUNICATION)
    assert (board.node.slave.read(0x1017), *board.signature) == (250, DATE, TIME)


@pytest.mark.parametrize("group", [1, 2])
def test_a_saved_change_has_no_signature(board: Board, group: int) -> None:
    board.write(0x1017, 0, 100, size=2)
    board.write(0x1010, group, SAVE)
    board.switch_on()
    assert (board.node.slave.read(0x1017), *board.signature) == (100, 0, 0)


def test_a_saved_change_of_another_group_has_none_either(board: Board) -> None:
    board.write(0x2030, 0, 40, size=1)
    board.write(0x1010, 4, SAVE)
    board.switch_on()
    assert (board.node.slave.read(0x2030), *board.signature) == (40, 0, 0)


def test_a_changed_configuration_that_is_signed_again_is_saved_with_it(board: Board) -> None:
    board.write(0x1017, 0, 100, size=2)
    board.sign()
    board.write(0x1010, 2, SAVE)
    board.switch_on()
    assert (board.node.slave.read(0x1017), *board.signature) == (100, DATE, TIME)


@pytest.mark.parametrize("group", [1, 2, 3, 4])
def test_restored_defaults_have_no_signature(board: Board, group: int) -> None:
    board.write(0x2030, 0, 40, size=1)
    board.sign()
    board.write(0x1010, 1, SAVE)
    board.write(0x1011, group, LOAD)
    assert board.signature == (0, 0)
    board.switch_on()
    changes = group != 3  # nothing of the application's profile was stored
    assert board.signature == ((0, 0) if changes else (DATE, TIME))


def test_another_stored_node_id_has_none(board: Board) -> None:
    board.send(lss(0x04, 1), lss(0x11, 0x21), lss(0x17))
    assert board.file.load().node_id == 0x21
    board.switch_on()
    assert board.signature == (0, 0)


@pytest.mark.parametrize(
    "constants", [{"calibration": "fedcba9876543210"}, {"serial": 43}], ids=["calibration", "board"]
)
def test_another_device_with_the_same_parameters_has_none(board: Board, constants: dict) -> None:
    """The verified values include constants of the device: after a new calibration the master reads again."""
    board.switch_on(**constants)
    assert (board.node.slave.read(0x1017), *board.signature) == (250, 0, 0)
    board.switch_on()
    assert board.signature == (DATE, TIME)


def test_a_file_that_names_no_device_is_read_without_signature(board: Board) -> None:
    """As versions before the signature wrote it: `eds` ends with the checksum."""
    kept = board.file.load()
    board.file.save(msgspec.structs.replace(kept, device=""))
    board.switch_on()
    assert (board.node.slave.read(0x1017), *board.signature) == (250, 0, 0)
