"""A disk after a power cut has the writes before it, and no later one."""

from __future__ import annotations

from pathlib import Path

import pytest

from deploy_rig.write_log import HEAD, CutDisk, read_log

BLOCK = 4096
# One letter a block: a write to block 0, one to blocks 1 and 2, another one to block 0.
RECORDS = ((0, b"a"), (1, b"bb"), (0, b"c"))


@pytest.fixture
def disk(tmp_path: Path) -> CutDisk:
    path, log = tmp_path / "disk", tmp_path / "log"
    path.write_bytes(b"." * 3 * BLOCK)
    parts = []
    for time_ns, (block, letters) in enumerate(RECORDS):
        data = b"".join(bytes([letter]) * BLOCK for letter in letters)
        parts.append(HEAD.pack(block * BLOCK, len(data), time_ns) + data)
    log.write_bytes(b"".join(parts) + parts[0][:-1])  # a record that the end of the machine cut off
    records = read_log(log)
    assert len(records) == len(RECORDS)
    return CutDisk(path, log, records)


def test_a_disk_has_the_writes_before_the_cut(disk: CutDisk) -> None:
    blocks = [disk.cut(before).read_bytes()[::BLOCK] for before in (0, 1, 1, 2, 3)]
    assert blocks == [b"...", b"a..", b"a..", b"abb", b"cbb"]


def test_cuts_are_made_in_the_order_of_the_log(disk: CutDisk) -> None:
    disk.cut(2)
    with pytest.raises(AssertionError, match="order"):
        disk.cut(1)
