"""A disk after a power cut has the writes before it and no later one, but for what was in its cache."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from deploy_rig.write_log import DISCARD, FLUSH, FUA, CutDisk, cached, read_log, stored

BLOCK, SECTOR = 4096, 512
# One letter a block of 4096 bytes: the first block, the letters, the flags. The disk has three blocks.
ENTRIES = (
    (0, b"a", 0),
    (0, b"", FLUSH),
    (1, b"bb", 0),
    (0, b"c", FUA),
    (0, b"d", 0),
    (2, b"", FLUSH),
    (1, b"\0", DISCARD),
    (2, b"e", 0),
)


def log_of(entries: tuple[tuple[int, bytes, int], ...], counted: int) -> bytes:
    """Return a log as Documentation/admin-guide/device-mapper/log-writes.rst of Linux describes it."""
    log = struct.pack("<QQQI", 0x6A736677736872, 1, counted, SECTOR).ljust(SECTOR, b"\0")
    for block, letters, flags in entries:
        sectors = len(letters) * BLOCK // SECTOR
        log += struct.pack("<QQQQ", block * BLOCK // SECTOR, sectors, flags, 0).ljust(SECTOR, b"\0")
        if not flags & DISCARD:
            log += b"".join(bytes([letter]) * BLOCK for letter in letters)
    return log


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log"
    path.write_bytes(log_of((*ENTRIES, (0, b"z", 0)), len(ENTRIES)))  # the last one was not finished
    return path


@pytest.fixture
def disk(tmp_path: Path, log: Path) -> CutDisk:
    path = tmp_path / "disk"
    path.write_bytes(b"." * 3 * BLOCK)
    return CutDisk(path, log, read_log(log))


def blocks(path: Path) -> bytes:
    content = path.read_bytes()
    assert all(len(set(content[at : at + BLOCK])) == 1 for at in range(0, len(content), BLOCK))
    return content[::BLOCK]


def test_a_disk_has_the_writes_before_the_cut(disk: CutDisk) -> None:
    cuts = [blocks(disk.cut(before)) for before in (0, 1, 1, 2, 3, 4, 5, 6, 7, 8)]
    assert cuts == [b"...", b"a..", b"a..", b"a..", b"abb", b"cbb", b"dbb", b"dbb", b"d\0b", b"d\0e"]


def test_what_was_in_the_cache_can_be_lost_and_the_next_cut_has_it(disk: CutDisk) -> None:
    assert blocks(disk.cut(5, lost=[(2, 0), (4, 0)])) == b"c.b"
    assert blocks(disk.cut(5, lost=[(2, 1)])) == b"db."
    assert blocks(disk.cut(5)) == b"dbb"
    assert blocks(disk.cut(8, lost=[(6, 0)])) == b"dbe"


def test_a_cache_holds_what_was_written_since_the_flush(log: Path) -> None:
    """A write with FUA goes past the cache."""
    entries = read_log(log)
    assert [stored(entries, before) for before in range(9)] == [0, 0, 1, 1, 1, 1, 5, 5, 5]
    assert cached(entries, 1) == [(0, 0)]
    assert cached(entries, 2) == []
    assert cached(entries, 5) == [(2, 0), (2, 1), (4, 0)]
    assert cached(entries, 8) == [(6, 0), (7, 0)]


def test_cuts_are_made_in_the_order_of_the_log(disk: CutDisk) -> None:
    disk.cut(6)
    with pytest.raises(AssertionError, match="order"):
        disk.cut(4)


def test_another_file_is_no_log(tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(b"\0" * SECTOR)
    with pytest.raises(AssertionError, match="dm-log-writes"):
        read_log(tmp_path / "log")
