"""SDO transfers byte by byte, as CiA 301 (7.2.4.3) writes them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.slave import Slave

Ask = Callable[[Slave, str], str | None]


@pytest.fixture
def slave(fingertip: FingertipNode) -> Slave:
    fingertip.process(0, ())
    return fingertip.slave


@pytest.fixture
def with_text(tmp_path: Path) -> Iterator[Slave]:
    """A fingertip whose calibration hash a master may write: the fingertip itself has no writable text."""
    text = FINGERTIP_EDS.read_text()
    head, tail = text.split("[2001]", 1)
    path = tmp_path / "writable_text.eds"
    path.write_text(head + "[2001]" + tail.replace("AccessType=ro", "AccessType=rw", 1))
    slave = Slave(load_eds(path, 0x10))
    slave.process(0, ())
    yield slave


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("40 00 10 00 00 00 00 00", "43 00 10 00 94 01 02 00"),  # 4 bytes, expedited
        ("40 17 10 00 00 00 00 00", "4b 17 10 00 64 00 00 00"),  # 2 bytes
        ("40 01 10 00 00 00 00 00", "4f 01 10 00 00 00 00 00"),  # 1 byte
        ("40 14 10 00 00 00 00 00", "43 14 10 00 90 00 00 00"),  # $NODEID+0x80
        ("40 25 61 01 00 00 00 00", "80 25 61 01 01 00 01 06"),  # read of a write-only object
        ("40 34 12 00 00 00 00 00", "80 34 12 00 00 00 02 06"),  # no object
        ("40 18 10 05 00 00 00 00", "80 18 10 05 11 00 09 06"),  # no sub-index
        ("40 00 18 04 00 00 00 00", "80 00 18 04 11 00 09 06"),  # reserved sub-index of a TPDO
    ],
)
def test_upload(slave: Slave, sdo: Ask, request_: str, answer: str) -> None:
    assert sdo(slave, request_) == answer


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("2b 17 10 00 2c 01 00 00", "60 17 10 00 00 00 00 00"),
        ("22 17 10 00 2c 01 00 00", "60 17 10 00 00 00 00 00"),  # size not indicated
        ("23 17 10 00 2c 01 00 00", "80 17 10 00 12 00 07 06"),  # 4 bytes into 2
        ("2f 17 10 00 2c 01 00 00", "80 17 10 00 13 00 07 06"),  # 1 byte into 2
        ("23 00 10 00 00 00 00 00", "80 00 10 00 02 00 01 06"),  # const
        ("2b 30 71 01 00 00 00 00", "80 30 71 01 02 00 01 06"),  # ro
        ("2f 00 1a 00 09 00 00 00", "80 00 1a 00 31 00 09 06"),  # above HighLimit (8 entries)
        ("23 25 61 01 7a 65 72 6f", "60 25 61 01 00 00 00 00"),  # autozero: "zero"
        ("23 25 61 01 6f 72 65 7a", "80 25 61 01 20 00 00 08"),  # autozero: bytes reversed
        ("2f 00 18 02 f1 00 00 00", "80 00 18 02 30 00 09 06"),  # reserved transmission type 241
        ("23 00 18 01 90 01 00 00", "60 00 18 01 00 00 00 00"),  # RTR allowed: never answered
        ("23 00 18 01 90 01 00 80", "60 00 18 01 00 00 00 00"),  # not valid, RTR allowed
        ("23 00 18 01 90 01 00 20", "80 00 18 01 30 00 09 06"),  # a 29-bit identifier
        ("23 05 10 00 ff 01 00 00", "80 05 10 00 30 00 09 06"),  # SYNC with the id of RPDO 1
        ("23 12 10 00 ff 01 00 80", "80 12 10 00 30 00 09 06"),  # TIME with the id of RPDO 1
        ("23 05 10 00 80 00 00 20", "80 05 10 00 30 00 09 06"),  # SYNC with 29 bits
        ("23 05 10 00 05 06 00 00", "80 05 10 00 30 00 09 06"),  # SYNC with a restricted id
        ("23 05 10 00 81 00 00 00", "60 05 10 00 00 00 00 00"),  # SYNC with another id
        ("23 00 18 01 91 01 00 40", "80 00 18 01 30 00 09 06"),  # another id while the PDO is valid
        ("23 00 18 01 01 06 00 c0", "80 00 18 01 30 00 09 06"),  # restricted id 601h
        ("23 00 18 01 90 00 00 c0", "80 00 18 01 30 00 09 06"),  # the id of our EMCY
        ("23 00 18 01 80 00 00 c0", "80 00 18 01 30 00 09 06"),  # the id of SYNC
        ("23 00 18 01 90 02 00 c0", "80 00 18 01 30 00 09 06"),  # the id of TPDO 2
        ("23 14 10 00 90 01 00 80", "80 14 10 00 30 00 09 06"),  # the id of TPDO 1
        ("23 00 14 01 90 01 00 80", "80 00 14 01 30 00 09 06"),  # an RPDO with the id of TPDO 1
        ("2b 00 18 03 0a 00 00 00", "80 00 18 03 22 00 00 08"),  # inhibit time while valid
        ("2f 00 1a 00 00 00 00 00", "80 00 1a 00 22 00 00 08"),  # mapping while valid
    ],
)
def test_download(slave: Slave, sdo: Ask, request_: str, answer: str) -> None:
    assert sdo(slave, request_) == answer


def test_a_refused_write_changes_nothing(slave: Slave, sdo: Ask) -> None:
    sdo(slave, "23 17 10 00 2c 01 00 00")
    assert slave.read(0x1017) == 100


def test_mapping_is_checked_entry_by_entry_and_as_a_whole(slave: Slave, sdo: Ask) -> None:
    assert sdo(slave, "23 00 18 01 90 01 00 c0") == "60 00 18 01 00 00 00 00"
    assert sdo(slave, "23 00 1a 01 20 00 12 20") == "80 00 1a 01 22 00 00 08"  # sub 0 is not 0 yet
    assert sdo(slave, "2f 00 1a 00 00 00 00 00") == "60 00 1a 00 00 00 00 00"
    assert sdo(slave, "23 00 1a 01 10 00 17 10") == "80 00 1a 01 41 00 04 06"  # 1017h is not mappable
    assert sdo(slave, "23 00 1a 01 10 00 12 20") == "80 00 1a 01 41 00 04 06"  # wrong number of bits
    for slot in ("01", "02", "03"):
        assert sdo(slave, f"23 00 1a {slot} 20 00 12 20") == f"60 00 1a {slot} 00 00 00 00"
    assert sdo(slave, "2f 00 1a 00 03 00 00 00") == "80 00 1a 00 42 00 04 06"  # 12 bytes
    assert sdo(slave, "2f 00 1a 00 02 00 00 00") == "60 00 1a 00 00 00 00 00"


def test_segmented_upload(slave: Slave, sdo: Ask) -> None:
    """ "palpate fingertip": 17 bytes in segments of 7, 7 and 3."""
    assert sdo(slave, "40 08 10 00 00 00 00 00") == "41 08 10 00 11 00 00 00"
    assert sdo(slave, "60 00 00 00 00 00 00 00") == "00 " + b"palpate".hex(" ")
    assert sdo(slave, "70 00 00 00 00 00 00 00") == "10 " + b" finger".hex(" ")
    assert sdo(slave, "60 00 00 00 00 00 00 00") == "09 " + b"tip".hex(" ") + " 00 00 00 00"
    assert sdo(slave, "70 00 00 00 00 00 00 00") == "80 00 00 00 01 00 04 05"  # nothing is left to ask for


def test_segmented_download(with_text: Slave, sdo: Ask) -> None:
    assert sdo(with_text, "21 01 20 00 09 00 00 00") == "60 01 20 00 00 00 00 00"
    assert sdo(with_text, "00 " + b"abcdefg".hex(" ")) == "20 00 00 00 00 00 00 00"
    assert sdo(with_text, "1b " + b"hi".hex(" ") + " 00 00 00 00 00") == "30 00 00 00 00 00 00 00"
    assert with_text.read(0x2001) == "abcdefghi"


def test_segmented_download_shorter_than_announced(with_text: Slave, sdo: Ask) -> None:
    sdo(with_text, "21 01 20 00 09 00 00 00")
    assert sdo(with_text, "01 " + b"abcdefg".hex(" ")) == "80 01 20 00 10 00 07 06"
    assert with_text.read(0x2001) == ""


def test_text_too_large_for_the_buffer(with_text: Slave, sdo: Ask) -> None:
    assert sdo(with_text, "21 01 20 00 01 04 00 00") == "80 01 20 00 05 00 04 05"


@pytest.mark.parametrize(
    ("initiate", "segment", "key"),
    [
        ("40 08 10 00 00 00 00 00", "70 00 00 00 00 00 00 00", "08 10 00"),
        ("21 17 10 00 02 00 00 00", "1b 00 00 00 00 00 00 00", "17 10 00"),
    ],
    ids=["upload", "download"],
)
def test_a_toggle_bit_that_does_not_alternate(
    slave: Slave, sdo: Ask, initiate: str, segment: str, key: str
) -> None:
    sdo(slave, initiate)
    assert sdo(slave, segment) == f"80 {key} 00 00 03 05"


def test_an_abandoned_transfer_times_out(slave: Slave, sdo: Ask) -> None:
    sdo(slave, "40 08 10 00 00 00 00 00")
    timeout = CanFrame(0x590, bytes.fromhex("80 08 10 00 00 00 04 05"))
    before = slave.process(1_000_000, ()).frames_out
    after = slave.process(1_000_001, ()).frames_out
    assert timeout not in before
    assert timeout in after
    assert timeout not in slave.process(3_000_000, ()).frames_out


def test_an_abort_of_the_client_is_not_answered(slave: Slave, sdo: Ask) -> None:
    sdo(slave, "40 08 10 00 00 00 00 00")
    assert sdo(slave, "80 08 10 00 00 00 04 05") is None
    assert sdo(slave, "60 00 00 00 00 00 00 00") == "80 00 00 00 01 00 04 05"


def test_no_sdo_in_stopped(slave: Slave, sdo: Ask) -> None:
    slave.process(1, (CanFrame(0x000, b"\x02\x10"),))
    assert sdo(slave, "40 00 10 00 00 00 00 00") is None


def test_a_remap_as_dcfgen_writes_it_is_taken_and_no_remote_frame_answered(slave: Slave, sdo: Ask) -> None:
    """dcfgen of ros2_canopen: 0x80000190, the mapping, 0x190; bit 30 (no RTR) is never set."""
    writes = (
        "23 00 18 01 90 01 00 80",
        "2f 00 1a 00 00 00 00 00",
        "23 00 1a 01 10 02 30 71",
        "2f 00 1a 00 01 00 00 00",
        "23 00 18 01 90 01 00 00",
    )
    for request in writes:
        answer = sdo(slave, request)
        assert answer is not None and answer.startswith("60")
    slave.process(2, (CanFrame(0x000, b"\x01\x10"),))
    slave.trigger((1,))
    (tpdo,) = (frame for frame in slave.process(3, ()).frames_out if frame.can_id == 0x190)
    assert len(tpdo.data) == 2
    output = slave.process(4, (CanFrame(0x190, b"", True),))
    assert (output.frames_out, output.events) == ((), ())
