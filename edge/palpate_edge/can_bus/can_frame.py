"""One classic CAN frame: the input and output of every pure bus core.

The cores (``node/``, the host's master) take and return :class:`CanFrame`; the I/O boundary (``bus.py``)
converts from and to python-can. CANopen uses 11-bit identifiers and at most 8 data bytes (CiA 301, 7.2).
"""

from __future__ import annotations

from dataclasses import dataclass

MAX_STANDARD_ID = 0x7FF
MAX_DATA_BYTES = 8


@dataclass(frozen=True, slots=True)
class CanFrame:
    """A classic CAN data or remote frame with an 11-bit identifier."""

    can_id: int
    data: bytes = b""
    remote: bool = False
