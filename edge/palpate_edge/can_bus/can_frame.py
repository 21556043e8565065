"""One CAN frame: the input and output of every pure bus core.

The cores (``node/``, the host's master) take and return :class:`CanFrame`; the I/O boundary (``bus.py``)
converts from and to the interface's frames. CANopen uses 11-bit identifiers and at most 8 data bytes
(CiA 301, 7.2); one PDO of a fingertip may be a CAN FD frame of up to 64 bytes (ISO 11898-1).
"""

from __future__ import annotations

import msgspec

from palpate_edge.common.errors import BusError

MAX_STANDARD_ID = 0x7FF
MAX_DATA_BYTES = 8
MAX_FD_DATA_BYTES = 64
FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)  # ISO 11898-1:2015, table of the DLC


class CanFrame(msgspec.Struct, frozen=True):
    """A data or remote frame with an 11-bit identifier.

    fd: a CAN FD frame with a faster data phase (bits FDF and BRS set); its length is one of `FD_LENGTHS`, and
    it is never remote. Else a classic frame of at most 8 bytes.
    """

    can_id: int
    data: bytes = b""
    remote: bool = False
    fd: bool = False


def padded(data: bytes) -> bytes:
    """Return `data` with zeros up to the next of `FD_LENGTHS`. Raises ValueError beyond the longest one."""
    for length in FD_LENGTHS:
        if length >= len(data):
            return data.ljust(length, b"\0")
    raise ValueError(f"{len(data)} bytes do not fit a CAN FD frame of {MAX_FD_DATA_BYTES}")


def check_frame(frame: CanFrame, *, fd: bool) -> None:
    """Raise BusError for a frame that cannot exist, or for a CAN FD frame on a classic bus (`fd` false)."""
    length = len(frame.data)
    if not 0 <= frame.can_id <= MAX_STANDARD_ID or (length > MAX_DATA_BYTES and not frame.fd):
        raise BusError(
            f"no CAN frame: identifier {frame.can_id:#x}, {length} data bytes: the maximum is "
            f"{MAX_STANDARD_ID:#x} and {MAX_DATA_BYTES} bytes"
        )
    if not frame.fd:
        return
    if not fd:
        raise BusError(f"CAN FD frame {frame.can_id:03X} on a bus of classic CAN: set bus.data_bitrate")
    if frame.remote or length not in FD_LENGTHS:
        raise BusError(
            f"no CAN FD frame: {frame.can_id:03X} with {length} data bytes{', remote' * frame.remote}: give "
            f"a data frame of {', '.join(map(str, FD_LENGTHS))} bytes"
        )
