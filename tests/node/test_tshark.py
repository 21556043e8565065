"""A second opinion on every frame of a session: tshark's CANopen dissector finds nothing malformed."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from palpate_edge.can_frame import CanFrame
from palpate_edge.contact_type import Contact
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.object_dictionary import ObjectDictionary
from palpate_edge.node.slave import Slave
from palpate_host.bus.candump import LogRecord
from palpate_host.bus.pcap import write_pcap

TOUCH = Contact(1, 0, True, True, (0.0, 9.0, 12.0), 2.0, None, None, 1.0, "", 31, 31)


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
