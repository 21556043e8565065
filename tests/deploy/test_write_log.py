"""A disk after a power cut has what was flushed, and of later writes any part."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest

from deploy_rig.write_log import BLOCK, HEAD, CutDisk, read_log

# One letter a block: a write to block 0, a flush, a write to blocks 1 and 2, one to block 0, a flush.
RECORDS = ((0, b"a"), (0, b""), (1, b"bb"), (0, b"c"), (0, b""))


class Always(random.Random):
    """Draws one number: 0 writes every block, 1 none."""

    def __init__(self, number: float) -> None:
        super().__init__()
        self.random: Callable[[], float] = lambda: number


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


def test_what_was_flushed_is_there_and_the_rest_may_be(disk: CutDisk) -> None:
    for before, number, blocks in (
        *((0, 0, b"..."), (1, 1, b"..."), (1, 0, b"a.."), (2, 1, b"a..")),
        *((4, 1, b"a.."), (4, 0, b"cbb"), (4, 1, b"a.."), (5, 1, b"cbb")),
    ):
        with disk.cut(before, Always(number)) as path:
            assert path.read_bytes()[::BLOCK] == blocks, f"before record {before}"


def test_blocks_are_lost_one_by_one(disk: CutDisk) -> None:
    seen = set()
    for seed in range(50):
        with disk.cut(4, random.Random(seed)) as path:
            seen.add(path.read_bytes()[::BLOCK])
    assert {b"a.b", b"ab.", b"c.."} <= seen
    assert all(blocks[:1] in (b"a", b"c") for blocks in seen)


def test_cuts_are_made_in_the_order_of_the_log(disk: CutDisk) -> None:
    with disk.cut(5, Always(0)), pytest.raises(AssertionError, match="order"), disk.cut(1, Always(0)):
        pass
