"""SDO block transfers byte by byte, as CiA 301 (7.2.4.3.8 to 7.2.4.3.16) writes them."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.sdo_block import crc16
from palpate_edge.node.slave import Slave

NAME = b"palpate fingertip"  # 1008h: 17 bytes, segments of 7, 7 and 3
LONG_TEXT = b"left index finger, outer phalanx"  # 32 bytes: five segments
INITIATE_LONG = "c6 03 20 00 20 00 00 00"


@pytest.fixture
def slave(fingertip: FingertipNode) -> Slave:
    fingertip.process(0, ())
    return fingertip.slave


def ask(slave: Slave, *requests: str | bytes, at_us: int = 1) -> list[str]:
    """What the server says to the requests, each as hexadecimal text."""
    frames = [CanFrame(0x610, bytes.fromhex(one) if isinstance(one, str) else one) for one in requests]
    answers = slave.process(at_us, frames).frames_out
    return [frame.data.hex(" ") for frame in answers if frame.can_id == 0x590]


def segments(data: bytes, numbers: Sequence[int] = (), last: bool = True) -> list[bytes]:
    """`data` as segments numbered from 1; only those of `numbers` if any are named."""
    parts = [data[start : start + 7].ljust(7, b"\x00") for start in range(0, len(data), 7)]
    frames = [
        bytes([number | (0x80 if last and number == len(parts) else 0)]) + part
        for number, part in enumerate(parts, 1)
    ]
    return [frame for number, frame in enumerate(frames, 1) if not numbers or number in numbers]


def end(data: bytes, crc: int | None = None) -> bytes:
    unused = -len(data) % 7
    return (
        bytes([0xC1 | unused << 2]) + (crc16(data) if crc is None else crc).to_bytes(2, "little") + bytes(5)
    )


def test_the_crc_is_that_of_the_standard() -> None:
    """CRC-16/XMODEM in the catalogues of CRCs: check value of "123456789"."""
    assert crc16(b"123456789") == 0x31C3


def test_upload_in_one_block(slave: Slave) -> None:
    assert ask(slave, "a4 08 10 00 7f 00 00 00") == ["c6 08 10 00 11 00 00 00"]
    assert ask(slave, "a3 00 00 00 00 00 00 00") == [
        "01 " + b"palpate".hex(" "),
        "02 " + b" finger".hex(" "),
        "83 " + b"tip".hex(" ") + " 00 00 00 00",
    ]
    crc = crc16(NAME).to_bytes(2, "little").hex(" ")
    assert ask(slave, "a2 03 7f 00 00 00 00 00") == [f"d1 {crc} 00 00 00 00 00"]  # 4 bytes unused
    assert ask(slave, "a1 00 00 00 00 00 00 00") == []
    assert ask(slave, "40 00 10 00 00 00 00 00") == ["43 00 10 00 94 01 02 00"]


def test_upload_in_blocks_of_two(slave: Slave) -> None:
    ask(slave, "a4 08 10 00 02 00 00 00")
    assert [one[:2] for one in ask(slave, "a3 00 00 00 00 00 00 00")] == ["01", "02"]
    assert ask(slave, "a2 02 02 00 00 00 00 00") == ["81 " + b"tip".hex(" ") + " 00 00 00 00"]
    assert ask(slave, "a2 01 02 00 00 00 00 00")[0][:2] == "d1"


def test_upload_sends_again_what_was_lost(slave: Slave) -> None:
    ask(slave, "a4 08 10 00 7f 00 00 00", "a3 00 00 00 00 00 00 00")
    again = ask(slave, "a2 01 7f 00 00 00 00 00")  # only the first came
    assert again == ["01 " + b" finger".hex(" "), "82 " + b"tip".hex(" ") + " 00 00 00 00"]
    assert ask(slave, "a2 00 7f 00 00 00 00 00") == again
    assert ask(slave, "a2 02 7f 00 00 00 00 00")[0][:2] == "d1"


def test_upload_of_nothing(fingertip: FingertipNode, slave: Slave) -> None:
    fingertip.slave.write(0x2001, 0, "")
    assert ask(slave, "a4 01 20 00 7f 00 00 00") == ["c6 01 20 00 00 00 00 00"]
    assert ask(slave, "a3 00 00 00 00 00 00 00") == ["81 00 00 00 00 00 00 00"]
    assert ask(slave, "a2 01 7f 00 00 00 00 00") == ["dd 00 00 00 00 00 00 00"]  # 7 bytes unused


@pytest.mark.parametrize(
    ("threshold", "answer"),
    [("11", "41 08 10 00 11 00 00 00"), ("10", "c6 08 10 00 11 00 00 00"), ("00", "c6 08 10 00 11 00 00 00")],
)
def test_upload_switches_to_segments_below_the_threshold(slave: Slave, threshold: str, answer: str) -> None:
    assert ask(slave, f"a4 08 10 00 7f {threshold} 00 00") == [answer]


def test_download(slave: Slave) -> None:
    assert ask(slave, INITIATE_LONG) == ["a4 03 20 00 7f 00 00 00"]
    assert ask(slave, *segments(LONG_TEXT)) == ["a2 05 7f 00 00 00 00 00"]
    assert ask(slave, end(LONG_TEXT)) == ["a1 00 00 00 00 00 00 00"]
    assert slave.read(0x2003) == LONG_TEXT.decode()


def test_download_of_more_than_one_block(slave: Slave) -> None:
    """1008 bytes are 144 segments: a block of 127, then one of 17; 2003h refuses the long text at the end."""
    data = b"x" * 1008
    assert ask(slave, "c4 03 20 00 00 00 00 00") == ["a4 03 20 00 7f 00 00 00"]
    assert ask(slave, *segments(data[: 127 * 7], last=False)) == ["a2 7f 7f 00 00 00 00 00"]
    assert ask(slave, *segments(data[127 * 7 :])) == ["a2 11 7f 00 00 00 00 00"]
    assert ask(slave, end(data)) == ["80 03 20 00 12 00 07 06"]


def test_download_asks_again_for_what_was_lost(slave: Slave) -> None:
    ask(slave, INITIATE_LONG)
    assert ask(slave, *segments(LONG_TEXT, (1, 2, 4, 5))) == ["a2 02 7f 00 00 00 00 00"]
    assert ask(slave, *segments(LONG_TEXT[14:])) == ["a2 03 7f 00 00 00 00 00"]
    assert ask(slave, end(LONG_TEXT)) == ["a1 00 00 00 00 00 00 00"]
    assert slave.read(0x2003) == LONG_TEXT.decode()


def test_download_without_a_crc(slave: Slave) -> None:
    ask(slave, "c2 03 20 00 20 00 00 00", *segments(LONG_TEXT))
    assert ask(slave, end(LONG_TEXT, crc=0)) == ["a1 00 00 00 00 00 00 00"]


@pytest.mark.parametrize(
    ("requests", "code"),
    [
        ([INITIATE_LONG, *segments(LONG_TEXT), end(LONG_TEXT, crc=1)], "04 00 04 05"),
        (["c6 03 20 00 1f 00 00 00", *segments(LONG_TEXT), end(LONG_TEXT)], "10 00 07 06"),
        ([INITIATE_LONG, "00 00 00 00 00 00 00 00"], "03 00 04 05"),  # segments count from 1
        ([INITIATE_LONG, *segments(LONG_TEXT), "c0 03 20 00 00 00 00 00", "a3 00 00 00 00 00 00 00"], None),
        (["c6 03 20 00 01 04 00 00"], "05 00 04 05"),  # 1025 bytes
        (
            ["c4 03 20 00 00 00 00 00", *segments(b"x" * 889, last=False), *segments(b"x" * 889)],
            "05 00 04 05",
        ),
        (["a4 03 20 00 00 00 00 00"], "02 00 04 05"),
        (["a4 03 20 00 80 00 00 00"], "02 00 04 05"),
    ],
    ids=[
        "CRC",
        "shorter than said",
        "segment 0",
        "new transfer",
        "too long",
        "more than said",
        "block 0",
        "block 128",
    ],
)
def test_download_and_upload_are_refused(slave: Slave, requests: list[str | bytes], code: str | None) -> None:
    answers = ask(slave, *requests)
    if code is not None:
        assert answers[-1] == f"80 03 20 00 {code}"
    assert slave.read(0x2003) == ""


@pytest.mark.parametrize(
    ("initiate", "code"),
    [
        ("c6 00 10 00 04 00 00 00", "02 00 01 06"),  # const
        ("c6 17 10 00 04 00 00 00", "12 00 07 06"),  # 4 bytes into 2
        ("c6 99 99 00 04 00 00 00", "00 00 02 06"),
        ("a4 99 99 00 7f 00 00 00", "00 00 02 06"),
        ("a4 25 61 01 7f 00 00 00", "01 00 01 06"),  # write-only
    ],
)
def test_initiate_is_refused(slave: Slave, initiate: str, code: str) -> None:
    assert ask(slave, initiate) == [f"80 {initiate[3:11]} {code}"]


def test_an_acknowledge_beyond_what_was_sent(slave: Slave) -> None:
    ask(slave, "a4 08 10 00 7f 00 00 00", "a3 00 00 00 00 00 00 00")
    assert ask(slave, "a2 04 7f 00 00 00 00 00") == ["80 08 10 00 03 00 04 05"]


def test_a_block_that_stops_times_out(slave: Slave) -> None:
    ask(slave, INITIATE_LONG, *segments(LONG_TEXT, (1, 2)))
    assert ask(slave, at_us=1_000_000) == []
    assert ask(slave, at_us=1_000_001) == ["80 03 20 00 00 00 04 05"]


def test_an_abort_within_a_block_is_no_segment(slave: Slave) -> None:
    ask(slave, INITIATE_LONG, *segments(LONG_TEXT, (1, 2)))
    assert ask(slave, "80 03 20 00 00 00 04 05") == []
    assert ask(slave, "40 00 10 00 00 00 00 00") == ["43 00 10 00 94 01 02 00"]


def test_a_number_goes_as_a_block_too(slave: Slave) -> None:
    ask(slave, "c6 17 10 00 02 00 00 00", *segments(b"\xfa\x00"))
    assert ask(slave, end(b"\xfa\x00")) == ["a1 00 00 00 00 00 00 00"]
    assert slave.read(0x1017) == 250


@pytest.mark.parametrize(("initiate", "crc"), [("a4", crc16(NAME)), ("a0", 0)])
def test_the_crc_of_an_upload_is_for_clients_that_ask_for_it(slave: Slave, initiate: str, crc: int) -> None:
    assert ask(slave, f"{initiate} 08 10 00 7f 00 00 00") == ["c6 08 10 00 11 00 00 00"]
    ask(slave, "a3 00 00 00 00 00 00 00")
    assert ask(slave, "a2 03 7f 00 00 00 00 00") == [
        (b"\xd1" + crc.to_bytes(2, "little") + bytes(5)).hex(" ")
    ]
