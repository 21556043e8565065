"""Disk of a machine as a power cut leaves it, from a log of its writes (write_log.c)."""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

HEAD = struct.Struct("<QQQ")
BLOCK = 4096  # bytes that a card writes as one


@dataclass(frozen=True)
class Record:
    """A write to the disk at `offset`, or a flush (length 0). data_at: place of its bytes in the log."""

    offset: int
    length: int
    time_ns: int
    data_at: int


def read_log(log: Path) -> list[Record]:
    """Return the records in the order in which they were made; a record that was cut off is left out."""
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
    """A copy of the disk from before the first record, on which cuts are made in the order of the log."""

    def __init__(self, disk: Path, log: Path, records: Sequence[Record]) -> None:
        self._disk, self._log, self._records = disk, log, records
        self._durable = 0  # records before this one are on the disk

    @contextmanager
    def cut(self, before: int, draw: random.Random) -> Iterator[Path]:
        """Yield the disk after a cut before this record: all writes up to the last flush, and some others.

        A disk with a write cache may write what was not flushed in any order, so each block of it is there or
        is not.
        """
        flushed = next((at for at in range(before - 1, -1, -1) if self._records[at].length == 0), 0)
        assert flushed >= self._durable, "cuts are not in the order of the log"
        with self._disk.open("r+b", buffering=0) as disk, self._log.open("rb") as log:
            for record in self._records[self._durable : flushed]:
                _write(disk, record.offset, _read(log, record.data_at, record.length))
            self._durable = flushed
            undo = []
            for record in self._records[flushed:before]:
                for at in range(0, record.length, BLOCK):
                    length = min(BLOCK, record.length - at)
                    if draw.random() < 0.5:
                        undo.append((record.offset + at, _read(disk, record.offset + at, length)))
                        _write(disk, record.offset + at, _read(log, record.data_at + at, length))
        try:
            yield self._disk
        finally:
            with self._disk.open("r+b", buffering=0) as disk:
                for offset, former in reversed(undo):
                    _write(disk, offset, former)


def _read(file, offset: int, length: int) -> bytes:
    file.seek(offset)
    return bytes(file.read(length))


def _write(file, offset: int, data: bytes) -> None:
    file.seek(offset)
    file.write(data)
