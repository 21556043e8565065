"""Disk of a machine as the end of its power leaves it, from a log of its writes (write_log.c)."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

HEAD = struct.Struct("<QQQ")


@dataclass(frozen=True)
class Record:
    """A write to the disk at `offset`. data_at: place of its bytes in the log."""

    offset: int
    length: int
    time_ns: int
    data_at: int


def read_log(log: Path) -> list[Record]:
    """Return the writes in the order in which they were made; one that was cut off is left out."""
    records, size, at = [], log.stat().st_size, 0
    with log.open("rb") as file:
        while at + HEAD.size <= size:
            file.seek(at)
            offset, length, time_ns = HEAD.unpack(file.read(HEAD.size))
            at += HEAD.size + length
            if at <= size:
                records.append(Record(offset, length, time_ns, at - length))
    return records


class CutDisk:
    """A copy of the disk from before the first write, on which the writes are made again."""

    def __init__(self, disk: Path, log: Path, records: Sequence[Record]) -> None:
        self._disk, self._log, self._records = disk, log, records
        self._made = 0  # writes before this one are on the disk

    def cut(self, before: int) -> Path:
        """Return the disk with all writes before this one; the cuts are in the order of the log."""
        assert before >= self._made, "cuts are not in the order of the log"
        with self._disk.open("r+b", buffering=0) as disk, self._log.open("rb") as log:
            for record in self._records[self._made : before]:
                log.seek(record.data_at)
                disk.seek(record.offset)
                disk.write(log.read(record.length))
        self._made = before
        return self._disk
