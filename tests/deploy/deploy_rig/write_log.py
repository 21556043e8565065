"""Disk of a machine as the end of its power leaves it, from a log of its writes.

The log is the one of Linux' dm-log-writes: a superblock, then each write with its data, in an order in which
the disk may have stored them. A flush tells the disk to store what it has in its cache.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

SUPERBLOCK, ENTRY = struct.Struct("<QQQI"), struct.Struct("<QQQQ")
MAGIC, VERSION = 0x6A736677736872, 1
FLUSH, FUA, DISCARD = 1, 2, 4  # flags of an entry; FUA: this write goes past the cache
BLOCK = 4096  # bytes, the size of ext4's blocks: the part of a write that is stored whole or not at all


@dataclass(frozen=True)
class Entry:
    """A write of `length` bytes to the disk at `offset`. data_at: place of its bytes in the log."""

    offset: int
    length: int
    flags: int
    data_at: int


Block = tuple[int, int]
"""A block of a write: number of the entry, and of the block in it."""


def read_log(log: Path) -> list[Entry]:
    """Return the entries up to the last one that the superblock counts."""
    entries = []
    with log.open("rb") as file:
        magic, version, count, sector = SUPERBLOCK.unpack(file.read(SUPERBLOCK.size))
        assert (magic, version) == (MAGIC, VERSION), f"{log} is no log of dm-log-writes"
        at = sector
        for _ in range(count):
            file.seek(at)
            first, sectors, flags, _ = ENTRY.unpack(file.read(ENTRY.size))
            entries.append(Entry(first * sector, sectors * sector, flags, at + sector))
            at += sector * (1 if flags & DISCARD else 1 + sectors)
    return entries


def stored(entries: Sequence[Entry], before: int) -> int:
    """Return the number of entries that a flush before this one has stored."""
    flushes = (number for number in range(before - 1, -1, -1) if entries[number].flags & FLUSH)
    return next(flushes, 0)


def cached(entries: Sequence[Entry], before: int) -> list[Block]:
    """Return the blocks, written before this entry, that the disk may still have in its cache."""
    return [
        (number, block)
        for number in range(stored(entries, before), before)
        if not entries[number].flags & FUA
        for block in range(-(-entries[number].length // BLOCK))
    ]


class CutDisk:
    """A copy of the disk from before the first write, on which the writes are made again."""

    def __init__(self, disk: Path, log: Path, entries: Sequence[Entry]) -> None:
        self._disk, self._log, self._entries = disk, log, entries
        self._made = 0  # entries before this one are on the disk
        self._undo: list[tuple[int, bytes]] = []  # content of the disk before the later ones

    def cut(self, before: int, lost: Collection[Block] = ()) -> Path:
        """Return the disk with the writes before this entry, but for the lost blocks.

        The cuts are in the order of the log. lost: of `cached`.
        """
        safe = stored(self._entries, before)
        assert safe >= self._made, "cuts are not in the order of the log"
        with self._disk.open("r+b", buffering=0) as disk, self._log.open("rb") as log:
            for offset, content in reversed(self._undo):
                os.pwrite(disk.fileno(), content, offset)
            self._undo.clear()
            for entry in self._entries[self._made : safe]:
                self._write(disk, entry.offset, _data(log, entry))
            for number in range(safe, before):
                entry = self._entries[number]
                data = _data(log, entry)
                for block, at in enumerate(range(0, entry.length, BLOCK)):
                    if (number, block) not in lost:
                        part = data[at : at + BLOCK]
                        old = os.pread(disk.fileno(), len(part), entry.offset + at)
                        self._undo.append((entry.offset + at, old))
                        self._write(disk, entry.offset + at, part)
        self._made = safe
        return self._disk

    @staticmethod
    def _write(disk: BinaryIO, offset: int, data: bytes) -> None:
        assert os.pwrite(disk.fileno(), data, offset) == len(data)


def _data(log: BinaryIO, entry: Entry) -> bytes:
    """Return the bytes of a write; a discarded part is read as zeros."""
    if entry.flags & DISCARD:
        return bytes(entry.length)
    log.seek(entry.data_at)
    return log.read(entry.length)
