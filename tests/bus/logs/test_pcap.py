"""The pcap file, read by tshark."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from palpate_bus.logs.candump import LogRecord
from palpate_bus.logs.pcap import write_pcap
from palpate_edge.can_bus.can_frame import CanFrame

FRAMES = [
    (CanFrame(0x710, b"\x00"), "Boot-up"),
    (CanFrame(0x000, b"\x01\x10"), "NMT"),
    (CanFrame(0x080), "Sync"),
    (CanFrame(0x190, bytes(8)), "PDO"),
    (CanFrame(0x610, bytes.fromhex("4017100000000000")), "SDO"),
    (CanFrame(0x090, bytes.fromhex("3081010000000000")), "EMCY"),
]


@pytest.fixture
def tshark() -> str:
    path = shutil.which("tshark")
    if path is None:
        pytest.skip("tshark is missing: install the package tshark")
    return path


def fields(tshark, path, *names):
    options = [option for name in names for option in ("-e", name)]
    command = [tshark, "-r", str(path), "-d", "can.subdissector,canopen", "-T", "fields", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    return [line.split("\t") for line in done.stdout.splitlines()]


def test_tshark_names_every_canopen_service(tmp_path, tshark):
    path = tmp_path / "bus.pcap"
    start_us = 1_700_000_000_000_001
    write_pcap(path, [LogRecord(start_us + n, frame) for n, (frame, _) in enumerate(FRAMES)])
    rows = fields(tshark, path, "frame.time_epoch", "can.id", "can.len", "_ws.col.Info", "_ws.malformed")
    for number, (row, (frame, service)) in enumerate(zip(rows, FRAMES, strict=True)):
        stamp, can_id, length, info, malformed = row
        assert stamp.startswith(f"1700000000.{number + 1:06d}")
        assert (int(can_id), int(length)) == (frame.can_id, len(frame.data))
        assert service.lower() in info.lower()
        assert malformed == ""


def test_tshark_sees_a_remote_frame(tmp_path, tshark):
    path = tmp_path / "bus.pcap"
    write_pcap(path, [LogRecord(0, CanFrame(0x701, bytes(2), remote=True))])
    ((can_id, remote, length),) = fields(tshark, path, "can.id", "can.flags.rtr", "can.len")
    assert (can_id, length) == ("1793", "2")
    assert remote in ("1", "True")  # as tshark 4.0 and later versions write it


def test_tshark_sees_a_can_fd_frame(tmp_path, tshark):
    path = tmp_path / "bus.pcap"
    write_pcap(path, [LogRecord(0, CanFrame(0x190, bytes(range(64)), fd=True))])
    names = ("can.id", "can.len", "canfd.flags.brs", "canfd.flags.esi", "_ws.malformed", "frame.protocols")
    ((can_id, length, switches, passive, malformed, protocols),) = fields(tshark, path, *names)
    assert (can_id, length, malformed) == ("400", "64", "")
    assert switches in ("1", "True") and passive in ("0", "False")
    assert "canfd" in protocols or "can" in protocols
