"""Segmented SDO transfers, server side (CiA 301, 7.2.4.3.3 to 7.2.4.3.6): seven bytes a frame."""

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
"""Function that applies written data; returns False when the response has to wait for the application."""


def check_size(size_bytes: int | None, received_bytes: int) -> None:
    """Raise SdoAbortError when a finished transfer does not have the length announced by the client."""
    if size_bytes not in (None, received_bytes):
        raise SdoAbortError(AbortCode.LENGTH_MISMATCH)


def check_room(received_bytes: int) -> None:
    """Raise SdoAbortError when a transfer exceeds MAX_DOWNLOAD_BYTES."""
    if received_bytes > MAX_DOWNLOAD_BYTES:
        raise SdoAbortError(AbortCode.OUT_OF_MEMORY)


class SegmentedDownload:
    """A write in progress. size_bytes: announced by the client, None if it was not."""

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
        """Return whether the first byte continues the transfer."""
        return command >> 5 == 0

    def receive(self, data: bytes) -> list[bytes]:
        """Take a segment or its request; return the responses."""
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
    """A read in progress."""

    def __init__(self, key: ObjectKey, data: bytes) -> None:
        self.key = key
        self.finished = False
        self.held = False
        self._toggle = 0
        self._remaining = data

    def expects(self, command: int) -> bool:
        """Return whether the first byte continues the transfer."""
        return command >> 5 == 3

    def receive(self, data: bytes) -> list[bytes]:
        """Take a segment or its request; return the responses."""
        toggle = data[0] & TOGGLE
        if toggle != self._toggle:
            raise SdoAbortError(AbortCode.TOGGLE_BIT)
        self._toggle ^= TOGGLE
        segment, self._remaining = self._remaining[:SEGMENT_BYTES], self._remaining[SEGMENT_BYTES:]
        self.finished = not self._remaining
        command = toggle | (SEGMENT_BYTES - len(segment)) << 1 | (LAST_SEGMENT if self.finished else 0)
        return [struct.pack("<B7s", command, segment)]
