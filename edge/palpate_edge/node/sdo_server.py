"""The SDO server (CiA 301, 7.2.4): expedited and segmented transfers in both directions, one at a time.

Block transfer is refused with 0504 0001h, which tells a client to use segments.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from palpate_edge.can_frame import CanFrame
from palpate_edge.node.object_dictionary import Entry, Value
from palpate_edge.node.object_store import ObjectStore, check_length, sdo_value
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

TIMEOUT_US = 1_000_000
MAX_DOWNLOAD_BYTES = 1024
SEGMENT_BYTES = 7
SDO_FRAME_BYTES = 8

EXPEDITED = 0x02
SIZE_INDICATED = 0x01
TOGGLE = 0x10
LAST_SEGMENT = 0x01


class ClientCommand(IntEnum):
    """Client command specifier, bits 7-5 of the first byte."""

    DOWNLOAD_SEGMENT = 0
    INITIATE_DOWNLOAD = 1
    INITIATE_UPLOAD = 2
    UPLOAD_SEGMENT = 3
    ABORT = 4


@dataclass(slots=True)
class Download:
    """A segmented write under way. size_bytes: what the client announced, if it did."""

    entry: Entry
    size_bytes: int | None
    toggle: int
    data: bytearray


@dataclass(slots=True)
class Upload:
    """A segmented read under way."""

    index: int
    subindex: int
    toggle: int
    rest: bytes


class SdoServer:
    """Answers one client. `commit` takes an admitted value, or raises SdoAbortError to refuse it."""

    def __init__(self, store: ObjectStore, commit: Callable[[Entry, Value], None]) -> None:
        self._store = store
        self._commit = commit
        self.request_id = store.number(0x1200, 1) & 0x7FF
        self.response_id = store.number(0x1200, 2) & 0x7FF
        self._transfer: Download | Upload | None = None
        self._deadline_us: int | None = None

    def cancel(self) -> None:
        """Forget a transfer under way (reset, STOPPED)."""
        self._transfer = None
        self._deadline_us = None

    def due_us(self) -> int | None:
        return self._deadline_us

    def poll(self, now_us: int) -> CanFrame | None:
        """The abort of a transfer that the client left unfinished for :data:`TIMEOUT_US`."""
        if self._deadline_us is None or now_us < self._deadline_us:
            return None
        return self._abort(*self._transfer_key(), AbortCode.TIMED_OUT)

    def receive(self, now_us: int, data: bytes) -> CanFrame | None:
        """The answer to one request; None for an abort or a frame that is not 8 bytes long."""
        if len(data) != SDO_FRAME_BYTES:
            return None
        command = data[0] >> 5
        if command == ClientCommand.ABORT:
            self.cancel()
            return None
        index, subindex = self._transfer_key()
        if command not in (ClientCommand.DOWNLOAD_SEGMENT, ClientCommand.UPLOAD_SEGMENT):
            index, subindex = struct.unpack_from("<HB", data, 1)
        try:
            answer = self._serve(command, index, subindex, data)
        except SdoAbortError as refusal:
            return self._abort(index, subindex, refusal.code)
        self._deadline_us = None if self._transfer is None else now_us + TIMEOUT_US
        return CanFrame(self.response_id, answer)

    def _serve(self, command: int, index: int, subindex: int, data: bytes) -> bytes:
        match command:
            case ClientCommand.INITIATE_DOWNLOAD:
                return self._initiate_download(index, subindex, data)
            case ClientCommand.DOWNLOAD_SEGMENT:
                return self._download_segment(data)
            case ClientCommand.INITIATE_UPLOAD:
                return self._initiate_upload(index, subindex)
            case ClientCommand.UPLOAD_SEGMENT:
                return self._upload_segment(data)
            case _:
                raise SdoAbortError(AbortCode.COMMAND_UNKNOWN)

    def _initiate_download(self, index: int, subindex: int, data: bytes) -> bytes:
        self.cancel()
        entry = self._store.sdo_writable_entry(index, subindex)
        has_size = bool(data[0] & SIZE_INDICATED)
        if data[0] & EXPEDITED:
            length_bytes = 4 - (data[0] >> 2 & 3) if has_size else min(4, entry.size_bytes or 4)
            self._commit(entry, sdo_value(entry, data[4 : 4 + length_bytes]))
        else:
            size_bytes = struct.unpack_from("<I", data, 4)[0] if has_size else None
            if size_bytes is not None:
                check_length(entry, size_bytes)
                if size_bytes > MAX_DOWNLOAD_BYTES:
                    raise SdoAbortError(AbortCode.OUT_OF_MEMORY)
            self._transfer = Download(entry, size_bytes, 0, bytearray())
        return struct.pack("<BHB4x", 0x60, index, subindex)

    def _download_segment(self, data: bytes) -> bytes:
        transfer = self._transfer
        if not isinstance(transfer, Download):
            raise SdoAbortError(AbortCode.COMMAND_UNKNOWN)
        toggle = data[0] & TOGGLE
        if toggle != transfer.toggle:
            raise SdoAbortError(AbortCode.TOGGLE_BIT)
        transfer.toggle ^= TOGGLE
        transfer.data += data[1 : 8 - (data[0] >> 1 & 7)]
        if len(transfer.data) > MAX_DOWNLOAD_BYTES:
            raise SdoAbortError(AbortCode.OUT_OF_MEMORY)
        if data[0] & LAST_SEGMENT:
            if transfer.size_bytes not in (None, len(transfer.data)):
                raise SdoAbortError(AbortCode.LENGTH_MISMATCH)
            self._commit(transfer.entry, sdo_value(transfer.entry, bytes(transfer.data)))
            self.cancel()
        return struct.pack("<B7x", 0x20 | toggle)

    def _initiate_upload(self, index: int, subindex: int) -> bytes:
        self.cancel()
        data = self._store.sdo_upload(index, subindex)
        if 1 <= len(data) <= 4:
            command = 0x40 | (4 - len(data)) << 2 | EXPEDITED | SIZE_INDICATED
            return struct.pack("<BHB4s", command, index, subindex, data)
        self._transfer = Upload(index, subindex, 0, data)
        return struct.pack("<BHBI", 0x40 | SIZE_INDICATED, index, subindex, len(data))

    def _upload_segment(self, data: bytes) -> bytes:
        transfer = self._transfer
        if not isinstance(transfer, Upload):
            raise SdoAbortError(AbortCode.COMMAND_UNKNOWN)
        toggle = data[0] & TOGGLE
        if toggle != transfer.toggle:
            raise SdoAbortError(AbortCode.TOGGLE_BIT)
        transfer.toggle ^= TOGGLE
        segment, transfer.rest = transfer.rest[:SEGMENT_BYTES], transfer.rest[SEGMENT_BYTES:]
        command = toggle | (SEGMENT_BYTES - len(segment)) << 1
        if not transfer.rest:
            command |= LAST_SEGMENT
            self.cancel()
        return struct.pack("<B7s", command, segment)

    def _transfer_key(self) -> tuple[int, int]:
        match self._transfer:
            case Download(entry=entry):
                return entry.key
            case Upload(index=index, subindex=subindex):
                return index, subindex
            case _:
                return 0, 0

    def _abort(self, index: int, subindex: int, code: AbortCode) -> CanFrame:
        self.cancel()
        return CanFrame(self.response_id, struct.pack("<BHBI", 0x80, index, subindex, code))
