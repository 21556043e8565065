"""Marlin's serial dialogue. Lines, checksums and replies are those of the RepRap wiki and of Marlin 2."""

from __future__ import annotations

import pytest

from palpate_edge.common.errors import RigError
from palpate_edge.press_rig.marlin import MarlinLink, numbered, position_of

S = 1_000_000


def _opened(silence_s: float = 10.0) -> MarlinLink:
    link = MarlinLink(silence_s)
    assert link.open(0) == b"N0 M110 N0*125\n"
    assert link.receive(1, b"start\necho:Marlin 2.1.2\nok\n") == b""
    assert link.is_ready
    return link


@pytest.mark.parametrize(
    ("number", "command", "line"),
    [  # octoprint's and the RepRap wiki's examples: N3 T0*57, N4 G92 E0*67
        (3, "T0", b"N3 T0*57\n"),
        (4, "G92 E0", b"N4 G92 E0*67\n"),
    ],
)
def test_a_line_has_number_and_checksum(number: int, command: str, line: bytes) -> None:
    assert numbered(number, command) == line


def test_a_command_is_done_at_its_ok_and_not_before() -> None:
    link = _opened()
    link.send(10, "M114")
    link.receive(11, b"X:1.50 Y:-2.00 Z:3.25 E:0.00 Count X:150 Y:-200 Z:")
    assert not link.is_ready
    link.receive(12, b"1300\nok P15 B3\n")
    assert link.is_ready
    assert position_of(link.take_replies()) == (1.5, -2.0, 3.25)


def test_a_damaged_line_is_sent_again_and_the_ok_of_the_resend_does_not_count() -> None:
    link = _opened()
    line = link.send(10, "G1 X1")
    again = link.receive(11, b"Error:checksum mismatch, Last Line: 0\nResend: 1\nok\n")
    assert again == line
    assert not link.is_ready
    link.receive(12, b"ok\n")
    assert link.is_ready


def test_a_busy_printer_is_not_silent() -> None:
    link = _opened(silence_s=5.0)
    link.send(0, "M400")
    for second in range(2, 60, 2):
        link.receive(second * S, b"echo:busy: processing\n")
        link.check((second + 1) * S)
    with pytest.raises(RigError, match="silent for 5 s after M400"):
        link.check(64 * S)


@pytest.mark.parametrize(
    ("reply", "message"),
    [
        (b"Error:Printer halted. kill() called!\n", "refuses G28: Error:Printer halted"),
        (b"!! Must home axis first: 0.000 0.000 5.000 [0.000]\nok\n", "refuses G28: !! Must home"),
        (b"echo:Home XYZ First\nok\n", "not homed"),
        (b"start\n", "restarted"),
        (b"Resend: 7\nok\n", "asks for line 7 again, line 1 is under way"),
    ],
)
def test_a_printer_that_stopped_ends_the_run(reply: bytes, message: str) -> None:
    link = _opened()
    link.send(10, "G28")
    with pytest.raises(RigError, match=message):
        link.receive(11, reply)


def test_a_line_that_is_damaged_again_and_again_ends_the_run() -> None:
    link = _opened()
    link.send(10, "G28")
    with pytest.raises(RigError, match="check the cable"):
        for _ in range(20):
            link.receive(11, b"Resend: 1\nok\n")


def test_a_board_that_restarts_when_its_port_opens_has_time_for_it() -> None:
    link = MarlinLink(silence_s=3.0)
    link.open(0)
    link.check(10 * S)
    with pytest.raises(RigError, match="silent"):
        link.check(16 * S)


def test_another_device_has_no_position() -> None:
    with pytest.raises(RigError, match="M114"):
        position_of(["hello"])
