"""Segmented SDO transfers as a server sees them (CiA 301, 7.2.4.3.3 to 7.2.4.3.6): seven bytes a frame."""

from __future__ import annotations

import struct
from collections.abc import Callable

from palpate_edge.node.object_dictionary import Entry, ObjectKey
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

MAX_DOWNLOAD_BYTES = 1024
SEGMENT_BYTES = 7
TOGGLE = 0x10
LAST_SEGMENT = 0x01

Complete = Callable[[Entry, bytes], bool]
"""Takes over what was written; False: the answer waits until the application has stored it."""


def check_size(size_bytes: int | None, received_bytes: int) -> None:
    """Raises SdoAbortError when a finished transfer has not the length that its client announced."""
    if size_bytes not in (None, received_bytes):
        raise SdoAbortError(AbortCode.LENGTH_MISMATCH)


def check_room(received_bytes: int) -> None:
    """Raises SdoAbortError when a transfer becomes longer than any object."""
    if received_bytes > MAX_DOWNLOAD_BYTES:
        raise SdoAbortError(AbortCode.OUT_OF_MEMORY)


class SegmentedDownload:
    """A write under way. size_bytes: what the client announced, if it did."""

    def __init__(self, entry: Entry, size_bytes: int | None, complete: Complete) -> None:
        self.key: ObjectKey = entry.key
        self.finished = False
        self.held = False
        self._entry = entry
        self._size_bytes = size_bytes
        self._complete = complete
        self._toggle = 0
        self._data = bytearray()

    def expects(self, command: int) -> bool:
        return command >> 5 == 0

    def receive(self, data: bytes) -> list[bytes]:
        toggle = data[0] & TOGGLE
        if toggle != self._toggle:
            raise SdoAbortError(AbortCode.TOGGLE_BIT)
        self._toggle ^= TOGGLE
        self._data += data[1 : 8 - (data[0] >> 1 & 7)]
        check_room(len(self._data))
        if data[0] & LAST_SEGMENT:
            check_size(self._size_bytes, len(self._data))
            self.held = not self._complete(self._entry, bytes(self._data))
            self.finished = True
        return [struct.pack("<B7x", 0x20 | toggle)]


class SegmentedUpload:
    """A read under way."""

    def __init__(self, key: ObjectKey, data: bytes) -> None:
        self.key = key
        self.finished = False
        self.held = False
        self._toggle = 0
        self._rest = data

    def expects(self, command: int) -> bool:
        return command >> 5 == 3

    def receive(self, data: bytes) -> list[bytes]:
        toggle = data[0] & TOGGLE
        if toggle != self._toggle:
            raise SdoAbortError(AbortCode.TOGGLE_BIT)
        self._toggle ^= TOGGLE
        segment, self._rest = self._rest[:SEGMENT_BYTES], self._rest[SEGMENT_BYTES:]
        self.finished = not self._rest
        command = toggle | (SEGMENT_BYTES - len(segment)) << 1 | (LAST_SEGMENT if self.finished else 0)
        return [struct.pack("<B7s", command, segment)]
