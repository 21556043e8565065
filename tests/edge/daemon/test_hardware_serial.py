"""A serial number from the board: another for each board, and for each fingertip of one."""

from __future__ import annotations

from palpate_edge.daemon.hardware_serial import hardware_serial


def test_boards_and_fingertips_differ_and_each_keeps_its_own(tmp_path):
    board, machine = tmp_path / "serial-number", tmp_path / "machine-id"
    board.write_bytes(b"10000000abcdef01\0")
    machine.write_bytes(b"0123456789abcdef0123456789abcdef\n")
    sources = (board, machine)
    first = hardware_serial("finger-1", sources)
    assert 0 < first <= 0xFFFF_FFFF
    assert hardware_serial("finger-1", sources) == first
    assert hardware_serial("finger-2", sources) != first
    board.write_bytes(b"10000000abcdef02\0")
    assert hardware_serial("finger-1", sources) != first


def test_a_board_without_a_number_has_that_of_its_installation(tmp_path):
    board, machine = tmp_path / "serial-number", tmp_path / "machine-id"
    machine.write_bytes(b"0123456789abcdef0123456789abcdef\n")
    without = hardware_serial("finger-1", (board, machine))
    board.write_bytes(b"0000000000000000\0")
    assert hardware_serial("finger-1", (board, machine)) == without != 0
    assert hardware_serial("finger-1", (board,)) == 0
