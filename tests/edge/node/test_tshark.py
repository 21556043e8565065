"""A second opinion on every frame of a session: tshark's CANopen dissector finds nothing malformed."""

from __future__ import annotations

import random
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from palpate_bus.logs.candump import LogRecord
from palpate_bus.logs.pcap import write_pcap
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact
from palpate_edge.node.eds import load_eds
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.object_dictionary import ObjectDictionary
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.sdo_block import crc16
from palpate_edge.node.slave import Slave

TOUCH = Contact(1, 0, True, True, (0.0, 9.0, 12.0), 2.0, None, 1.0, "", 31, 31)


def sdo(data: str) -> CanFrame:
    return CanFrame(0x610, bytes.fromhex(data))


SESSION = (
    (10, sdo("40 00 10 00 00 00 00 00")),
    (20, sdo("2b 17 10 00 0a 00 00 00")),
    (30, sdo("40 08 10 00 00 00 00 00")),
    (40, sdo("60 00 00 00 00 00 00 00")),
    (50, sdo("70 00 00 00 00 00 00 00")),
    (60, sdo("60 00 00 00 00 00 00 00")),
    (70, sdo("2f 00 20 00 01 00 00 00")),
    (80, CanFrame(0x000, b"\x01\x10")),
    (90, CanFrame(0x080)),
    (10_100, CanFrame(0x000, b"\x80\x10")),
    (20_200, CanFrame(0x000, b"\x82\x10")),
)


def decode(tmp_path: Path, records: list[LogRecord], *fields: str) -> list[list[str]]:
    if shutil.which("tshark") is None:
        pytest.skip("tshark is missing: install it for a second opinion on every frame")
    path = tmp_path / "session.pcap"
    write_pcap(path, records)
    command = [
        "tshark",
        "-r",
        str(path),
        "-d",
        "can.subdissector,canopen",
        "-T",
        "fields",
        "-E",
        "separator=;",
    ]
    for field in fields:
        command += ["-e", field]
    run = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
    return [line.split(";") for line in run.stdout.splitlines()]


def test_every_frame_of_a_session_is_canopen(tmp_path: Path, fingertip: FingertipNode) -> None:
    records = [LogRecord(0, frame) for frame in fingertip.process(0, ()).frames_out]
    for at_us, request in SESSION:
        fingertip.publish(TOUCH, 0)
        answers = fingertip.process(at_us, (request,)).frames_out
        records += [LogRecord(at_us, frame) for frame in (request, *answers)]
    rows = decode(tmp_path, records, "_ws.malformed", "_ws.col.Info", "canopen.sdo.abort_code")
    assert len(rows) == len(records)
    assert [row for row in rows if row[0]] == []
    names = " ".join(row[1] for row in rows)
    for name in ("Boot-up", "SDO", "PDO", "NMT", "Sync"):
        assert name.lower() in names.lower()
    assert int(next(row[2] for row in rows if row[2]), 0) == 0x0601_0002


def test_an_emergency_is_read_with_its_code(tmp_path: Path, drive_od: ObjectDictionary) -> None:
    slave = Slave(drive_od)
    sent = slave.process(0, (CanFrame(0x000, b"\x01\x10"), CanFrame(0x210, b"\x00"))).frames_out
    rows = decode(tmp_path, [LogRecord(0, frame) for frame in sent], "_ws.malformed", "canopen.em.err_code")
    assert [row[0] for row in rows] == ["", ""]
    assert [int(row[1], 0) for row in rows if row[1]] == [0x8210]


def served(slave: Slave, requests: Sequence[CanFrame]) -> list[LogRecord]:
    """The requests, a millisecond apart, each with what the slave says to it; storing always works."""
    records = []
    for at_us, request in enumerate(requests):
        output = slave.process(1_000 * at_us, (request,))
        if any(isinstance(event, StoreRequested) for event in output.events):
            slave.store_finished(True)
        answers = output.frames_out + slave.process(1_000 * at_us, ()).frames_out
        records += [LogRecord(1_000 * at_us, frame) for frame in (request, *answers)]
    return records


def lss(data: str) -> CanFrame:
    return CanFrame(0x7E5, bytes.fromhex(data).ljust(8, b"\x00"))


EVERY_SERVICE = (
    sdo("a4 08 10 00 02 00 00 00"),  # block upload of 17 bytes in blocks of two
    sdo("a3 00 00 00 00 00 00 00"),
    sdo("a2 02 7f 00 00 00 00 00"),
    sdo("a2 01 7f 00 00 00 00 00"),
    sdo("a1 00 00 00 00 00 00 00"),
    sdo("c6 03 20 00 09 00 00 00"),  # block download of 9 bytes
    sdo("01 " + b"indexfi".hex()),
    sdo("82 " + b"ng".hex() + "00 00 00 00 00"),
    sdo("d5 " + crc16(b"indexfing").to_bytes(2, "little").hex() + "00 00 00 00 00"),
    sdo("21 03 20 00 05 00 00 00"),  # segmented download
    sdo("05 " + b"thumb".hex() + "00 00"),
    sdo("23 10 10 01 73 61 76 65"),  # store
    sdo("23 11 10 01 6c 6f 61 64"),  # restore
    sdo("23 16 10 01 64 00 7f 00"),  # heartbeat consumer: node 127, 100 ms
    CanFrame(0x77F, b"\x05"),
    CanFrame(0x000, b"\x01\x10"),
    CanFrame(0x080),
    CanFrame(0x1FF, b"\x01\x02\x03\x04"),
    CanFrame(0x100, bytes(6)),
    CanFrame(0x080, b"\x01"),  # of the wrong length: an emergency
    CanFrame(0x000, b"\x80\x10"),  # no other node id while OPERATIONAL
    lss("04 01"),
    lss("5a"),
    lss("5d"),
    lss("5e"),
    lss("11 20"),
    lss("13 00 02"),
    lss("17"),
    lss("04 00"),
    CanFrame(0x000, b"\x82\x10"),
)


def test_every_service_is_known_to_tshark(tmp_path: Path, fingertip: FingertipNode) -> None:
    records = served(fingertip.slave, EVERY_SERVICE)
    rows = decode(tmp_path, records, "_ws.malformed", "_ws.col.Info")
    assert len(rows) == len(records)
    assert [row for row in rows if row[0]] == []
    names = " ".join(row[1] for row in rows).lower()
    for name in ("boot-up", "sdo", "nmt", "sync", "time stamp", "emcy", "lss", "pdo"):
        assert name in names, name
    assert fingertip.slave.node_id == 0x20


def test_what_a_fuzzed_slave_says_is_canopen(tmp_path: Path, fingertip: FingertipNode) -> None:
    """Twenty thousand requests by chance: no answer that the dissector calls malformed."""
    rng = random.Random(7)
    first_bytes = (0x40, 0x23, 0x2B, 0x2F, 0x21, 0x60, 0x70, 0x00, 0x11, 0xA4, 0xA3, 0xA2, 0xC6, 0x81, 0xC1)
    indices = sorted(load_eds(FINGERTIP_EDS, 0x10).indices)
    said: list[LogRecord] = []
    for number in range(20_000):
        key = rng.choice(indices).to_bytes(2, "little") + bytes([rng.randrange(4)])
        request = bytes([rng.choice(first_bytes)]) + key + rng.randbytes(4)
        frames: list[CanFrame] = [CanFrame(0x610, request)]
        if number % 500 == 0:
            frames.append(CanFrame(0x000, bytes([rng.choice((0x01, 0x80, 0x82)), 0])))
        output = fingertip.process(100 * number, frames)
        said += [LogRecord(100 * number, frame) for frame in output.frames_out]
    rows = decode(tmp_path, said, "_ws.malformed")
    assert len(rows) == len(said)
    assert [row for row in rows if row[0]] == []
