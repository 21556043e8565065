"""SDO server (CiA 301, 7.2.4): expedited, segmented and block transfers in both directions, one at a time.

A new request ends an unfinished transfer without a response. A transfer that the client does not continue for
1 s is aborted.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import IntEnum

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.object_dictionary import Entry, Value
from palpate_edge.node.object_store import ObjectStore, check_length, sdo_value
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError
from palpate_edge.node.sdo_block import KNOWS_CRC, MAX_BLOCK_SEGMENTS, BlockDownload, BlockUpload
from palpate_edge.node.sdo_segmented import SegmentedDownload, SegmentedUpload, check_room

TIMEOUT_US = 1_000_000
SDO_FRAME_BYTES = 8

EXPEDITED = 0x02
SIZE_INDICATED = 0x01
BLOCK_SIZE_INDICATED = 0x02
BLOCK_SUBCOMMANDS = 0x03
ABORT = 0x80

Transfer = SegmentedDownload | SegmentedUpload | BlockDownload | BlockUpload


class Initiate(IntEnum):
    """Client command specifiers (bits 7-5) that begin a transfer; block transfers have sub-command 0."""

    DOWNLOAD = 1
    UPLOAD = 2
    BLOCK_UPLOAD = 5
    BLOCK_DOWNLOAD = 6


class SdoServer:
    """SDO server for one client.

    commit: called with a valid value; it applies the value, or raises SdoAbortError. If it returns False, the
    response waits for :meth:`confirm`.
    """

    def __init__(self, store: ObjectStore, commit: Callable[[Entry, Value], bool]) -> None:
        self._store = store
        self._commit = commit
        self._transfer: Transfer | None = None
        self._deadline_us: int | None = None
        self._held: tuple[int, int, bytes] | None = None
        self.request_id = self.response_id = 0
        self.start()

    def start(self) -> None:
        """Start after a reset: read the identifiers from 1200h and cancel a transfer."""
        self.request_id = self._store.number(0x1200, 1) & 0x7FF
        self.response_id = self._store.number(0x1200, 2) & 0x7FF
        self.cancel()

    def cancel(self) -> None:
        """Discard the transfer in progress (reset, STOPPED)."""
        self._transfer = None
        self._deadline_us = None
        self._held = None

    def confirm(self, stored: bool) -> list[CanFrame]:
        """Return the response that waited for the application's storage."""
        if self._held is None:
            return []
        index, subindex, answer = self._held
        self._held = None
        return [self._frame(answer)] if stored else [self._abort(index, subindex, AbortCode.HARDWARE)]

    def due_us(self) -> int | None:
        """Return when the running transfer times out; None without one."""
        return self._deadline_us

    def poll(self, now_us: int) -> list[CanFrame]:
        """Return the abort of a transfer that has timed out."""
        if self._transfer is None or self._deadline_us is None or now_us < self._deadline_us:
            return []
        return [self._abort(*self._transfer.key, AbortCode.TIMED_OUT)]

    def receive(self, now_us: int, data: bytes) -> list[CanFrame]:
        """Return the responses to one request; none for an abort or a frame that is not 8 bytes long."""
        if len(data) != SDO_FRAME_BYTES:
            return []
        command = data[0]
        transfer = self._transfer
        if command == ABORT:
            self.cancel()
            return []
        if transfer is not None and transfer.expects(command):
            index, subindex = transfer.key
        elif begins_transfer(command):
            index, subindex = struct.unpack_from("<HB", data, 1)
        else:
            index, subindex = (0, 0) if transfer is None else transfer.key
            return [self._abort(index, subindex, AbortCode.COMMAND_UNKNOWN)]
        try:
            if transfer is not None and transfer.expects(command):
                answers = self._go_on(transfer, data)
            else:
                answers = [self._initiate(command, index, subindex, data)]
        except SdoAbortError as error:
            return [self._abort(index, subindex, error.code)]
        self._deadline_us = None if self._transfer is None else now_us + TIMEOUT_US
        if self._held is not None:
            return []
        return [self._frame(answer) for answer in answers]

    def _go_on(self, transfer: Transfer, data: bytes) -> list[bytes]:
        answers = transfer.receive(data)
        if transfer.finished:
            self._transfer = None
            if transfer.held:
                self._held = (*transfer.key, answers[0])
        return answers

    def _initiate(self, command: int, index: int, subindex: int, data: bytes) -> bytes:
        if self._held is not None:
            raise SdoAbortError(AbortCode.DEVICE_STATE)
        self._transfer = None
        match command >> 5:
            case Initiate.DOWNLOAD:
                return self._initiate_download(index, subindex, data)
            case Initiate.UPLOAD:
                return self._initiate_upload(index, subindex, self._store.sdo_upload(index, subindex))
            case Initiate.BLOCK_DOWNLOAD:
                return self._initiate_block_download(index, subindex, data)
            case _:
                return self._initiate_block_upload(index, subindex, data)

    def _initiate_download(self, index: int, subindex: int, data: bytes) -> bytes:
        entry = self._store.sdo_writable_entry(index, subindex)
        has_size = bool(data[0] & SIZE_INDICATED)
        answer = struct.pack("<BHB4x", 0x60, index, subindex)
        if data[0] & EXPEDITED:
            length_bytes = 4 - (data[0] >> 2 & 3) if has_size else min(4, entry.size_bytes or 4)
            if not self._complete(entry, data[4 : 4 + length_bytes]):
                self._held = (index, subindex, answer)
        else:
            size_bytes = announced_size(entry, data) if has_size else None
            self._transfer = SegmentedDownload(entry, size_bytes, self._complete)
        return answer

    def _initiate_upload(self, index: int, subindex: int, content: bytes) -> bytes:
        if 1 <= len(content) <= 4:
            command = 0x40 | (4 - len(content)) << 2 | EXPEDITED | SIZE_INDICATED
            return struct.pack("<BHB4s", command, index, subindex, content)
        self._transfer = SegmentedUpload((index, subindex), content)
        return struct.pack("<BHBI", 0x40 | SIZE_INDICATED, index, subindex, len(content))

    def _initiate_block_download(self, index: int, subindex: int, data: bytes) -> bytes:
        entry = self._store.sdo_writable_entry(index, subindex)
        size_bytes = announced_size(entry, data) if data[0] & BLOCK_SIZE_INDICATED else None
        self._transfer = BlockDownload(entry, size_bytes, bool(data[0] & KNOWS_CRC), self._complete)
        return struct.pack("<BHBB3x", 0xA0 | KNOWS_CRC, index, subindex, MAX_BLOCK_SEGMENTS)

    def _initiate_block_upload(self, index: int, subindex: int, data: bytes) -> bytes:
        content = self._store.sdo_upload(index, subindex)
        block_segments, switch_threshold_bytes = data[4], data[5]
        with_crc = bool(data[0] & KNOWS_CRC)
        transfer = BlockUpload((index, subindex), content, block_segments, with_crc=with_crc)
        if switch_threshold_bytes and len(content) <= switch_threshold_bytes:
            # The client prefers a segmented transfer for short data (protocol switch threshold).
            return self._initiate_upload(index, subindex, content)
        self._transfer = transfer
        return struct.pack("<BHBI", 0xC0 | KNOWS_CRC | BLOCK_SIZE_INDICATED, index, subindex, len(content))

    def _complete(self, entry: Entry, data: bytes) -> bool:
        return self._commit(entry, sdo_value(entry, data))

    def _frame(self, answer: bytes) -> CanFrame:
        return CanFrame(self.response_id, answer)

    def _abort(self, index: int, subindex: int, code: AbortCode) -> CanFrame:
        self._transfer = None
        self._deadline_us = None
        return self._frame(struct.pack("<BHBI", 0x80, index, subindex, code))


def begins_transfer(command: int) -> bool:
    """Return whether a request's first byte begins a new transfer."""
    match command >> 5:
        case Initiate.DOWNLOAD | Initiate.UPLOAD:
            return True
        case Initiate.BLOCK_UPLOAD:
            return command & BLOCK_SUBCOMMANDS == 0
        case Initiate.BLOCK_DOWNLOAD:
            return command & 1 == 0
        case _:
            return False


def announced_size(entry: Entry, data: bytes) -> int:
    """Return the length that a client announces. Raises SdoAbortError when it does not fit the entry."""
    size_bytes: int = struct.unpack_from("<I", data, 4)[0]
    check_length(entry, size_bytes)
    check_room(size_bytes)
    return size_bytes
