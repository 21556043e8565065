"""SDO block transfers, server side (CiA 301, 7.2.4.3.8 to 7.2.4.3.15).

Up to 127 segments of seven bytes are sent without a response. The receiver then acknowledges the last segment
received in order, and the missing ones are sent again. A CRC over all data ends the transfer if both sides
support it.
"""

from __future__ import annotations

import binascii
import struct
from enum import Enum, auto

from palpate_edge.node.object_dictionary import Entry, ObjectKey
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError
from palpate_edge.node.sdo_segmented import (
    MAX_DOWNLOAD_BYTES,
    SEGMENT_BYTES,
    Complete,
    check_room,
    check_size,
)

MAX_BLOCK_SEGMENTS = 127
LAST_SEGMENT = 0x80
SEQUENCE_NUMBER = 0x7F
KNOWS_CRC = 0x04
ABORT = 0x80

# Command bytes: specifier of the client (ccs) or server (scs) in bits 7-5, sub-command below.
DOWNLOAD_BLOCK_ACK, DOWNLOAD_END, DOWNLOAD_END_ACK = 0xA2, 0xC1, 0xA1
UPLOAD_START, UPLOAD_BLOCK_ACK, UPLOAD_END, UPLOAD_END_ACK = 0xA3, 0xA2, 0xC1, 0xA1


def crc16(data: bytes) -> int:
    """Return the CRC of block transfers: polynomial x^16 + x^12 + x^5 + 1, start 0 (CiA 301, 7.2.4.3.16)."""
    return binascii.crc_hqx(data, 0)


class BlockDownload:
    """A write in progress. size_bytes: announced by the client; with_crc: the client sends a CRC."""

    def __init__(self, entry: Entry, size_bytes: int | None, with_crc: bool, complete: Complete) -> None:
        self.key: ObjectKey = entry.key
        self.finished = False
        self.held = False
        self._entry = entry
        self._size_bytes = size_bytes
        self._with_crc = with_crc
        self._complete = complete
        self._data = bytearray()
        self._in_order = 0
        self._all_here = False

    def expects(self, command: int) -> bool:
        """Return whether a frame with this command byte belongs to the transfer.

        Within a block every command byte except an abort's is the sequence number of a segment.
        """
        return command & 0xE1 == DOWNLOAD_END if self._all_here else command != ABORT

    def receive(self, data: bytes) -> list[bytes]:
        """Take a request that continues the transfer; return the responses."""
        return self._end(data) if self._all_here else self._segment(data)

    def _segment(self, data: bytes) -> list[bytes]:
        sequence, last = data[0] & SEQUENCE_NUMBER, bool(data[0] & LAST_SEGMENT)
        if sequence == 0:
            raise SdoAbortError(AbortCode.SEQUENCE_NUMBER)
        if sequence == self._in_order + 1:
            self._in_order = sequence
            self._all_here = last
            if len(self._data) <= MAX_DOWNLOAD_BYTES + SEGMENT_BYTES:
                self._data += data[1:]
        if not last and sequence != MAX_BLOCK_SEGMENTS:
            return []
        # After an abort within the block, segments still in transit would be taken for requests.
        check_room(len(self._data) - SEGMENT_BYTES)
        answer = struct.pack("<BBB5x", DOWNLOAD_BLOCK_ACK, self._in_order, MAX_BLOCK_SEGMENTS)
        self._in_order = 0
        return [answer]

    def _end(self, data: bytes) -> list[bytes]:
        unused_bytes = data[0] >> 2 & 7
        content = bytes(self._data[: len(self._data) - unused_bytes])
        if self._with_crc and crc16(content) != struct.unpack_from("<H", data, 1)[0]:
            raise SdoAbortError(AbortCode.CRC)
        check_room(len(content))
        check_size(self._size_bytes, len(content))
        self.held = not self._complete(self._entry, content)
        self.finished = True
        return [struct.pack("<B7x", DOWNLOAD_END_ACK)]


class Phase(Enum):
    """The message that a block upload waits for."""

    START = auto()
    BLOCK_ACK = auto()
    END_ACK = auto()


COMMAND_OF_PHASE = {
    Phase.START: UPLOAD_START,
    Phase.BLOCK_ACK: UPLOAD_BLOCK_ACK,
    Phase.END_ACK: UPLOAD_END_ACK,
}


class BlockUpload:
    """A read in progress. block_segments: number of frames that the client accepts without a response.

    with_crc: the client checks a CRC; 0 is sent to another one.
    """

    def __init__(self, key: ObjectKey, data: bytes, block_segments: int, *, with_crc: bool) -> None:
        self.key = key
        self.finished = False
        self.held = False
        self._data = data
        self._crc = crc16(data) if with_crc else 0
        self._block_segments = admitted_block(block_segments)
        self._sent = 0
        self._start = 0  # offset of the present block, in bytes
        self._phase = Phase.START

    def expects(self, command: int) -> bool:
        """Return whether the first byte continues the transfer."""
        return command == COMMAND_OF_PHASE[self._phase]

    def receive(self, data: bytes) -> list[bytes]:
        """Take a request that continues the transfer; return the responses."""
        match self._phase:
            case Phase.START:
                self._phase = Phase.BLOCK_ACK
                return self._block()
            case Phase.BLOCK_ACK:
                return self._acknowledged(data[1], data[2])
            case Phase.END_ACK:
                self.finished = True
                return []

    def _acknowledged(self, in_order: int, block_segments: int) -> list[bytes]:
        if in_order > self._sent:
            raise SdoAbortError(AbortCode.SEQUENCE_NUMBER)
        self._block_segments = admitted_block(block_segments)
        self._start += in_order * SEGMENT_BYTES
        if in_order == 0 or self._start < len(self._data):
            return self._block()
        self._phase = Phase.END_ACK
        unused_bytes = -len(self._data) % SEGMENT_BYTES if self._data else SEGMENT_BYTES
        return [struct.pack("<BH5x", UPLOAD_END | unused_bytes << 2, self._crc)]

    def _block(self) -> list[bytes]:
        """Return the next segments; an empty object has one segment without valid bytes."""
        size_bytes = max(1, len(self._data))
        starts = range(self._start, size_bytes, SEGMENT_BYTES)[: self._block_segments]
        self._sent = len(starts)
        frames = []
        for sequence, start in enumerate(starts, 1):
            end = start + SEGMENT_BYTES
            last = LAST_SEGMENT if end >= size_bytes else 0
            frames.append(struct.pack("<B7s", sequence | last, self._data[start:end]))
        return frames


def admitted_block(segments: int) -> int:
    """Return the block size that a client requests. Raises SdoAbortError when it is not 1 to 127."""
    if not 1 <= segments <= MAX_BLOCK_SEGMENTS:
        raise SdoAbortError(AbortCode.BLOCK_SIZE)
    return segments
