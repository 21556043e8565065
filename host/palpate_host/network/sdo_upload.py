"""Upload of one object over a node's default SDO channel, client side (CiA 301, 7.2.4.3). Pure.

Expedited and segmented transfers. The caller sends `request`, passes each response to `receive`, and calls
`restart` when no response has come in time.
"""

from __future__ import annotations

import struct

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_host.drives.identify import SDO_REQUEST_ID

LARGEST_BYTES = 256  # of the objects that the host reads, the longest is a text of 64 characters

_INITIATE, _SEGMENT = 0x40, 0x60
_ABORT = 4
_INITIATED, _SEGMENT_SENT = 2, 0
_TOGGLE = 0x10
_TOO_LONG = 0x0607_0010  # data type does not match, length of service parameter does not match


class SdoUpload:
    """One upload. data: the object's bytes, None until the transfer is complete. abort: the node's code."""

    def __init__(self, node_id: int, key: tuple[int, int]) -> None:
        self.key = key
        self._node_id = node_id
        self.restart()

    def restart(self) -> None:
        """Begin the transfer again; the server then drops the former one."""
        self.data: bytes | None = None
        self.abort: int | None = None
        self._toggle: int | None = None  # of the segment that is requested, None before the first one
        self._received = b""

    @property
    def finished(self) -> bool:
        """Return whether the object was read or the node aborted."""
        return self.data is not None or self.abort is not None

    def request(self) -> CanFrame:
        """Return the request that the transfer needs next."""
        if self._toggle is None:
            data = struct.pack("<BHB4x", _INITIATE, *self.key)
        else:
            data = bytes((_SEGMENT | self._toggle, *(0,) * 7))
        return CanFrame(SDO_REQUEST_ID + self._node_id, data)

    def receive(self, data: bytes) -> bool:
        """Take a response of 8 bytes; return whether it continues this transfer.

        A response to another client's request, with another object or toggle bit, is ignored.
        """
        if len(data) != 8 or self.finished:
            return False
        specifier = data[0] >> 5
        if specifier == _ABORT and struct.unpack_from("<HB", data, 1) == self.key:
            (self.abort,) = struct.unpack_from("<I", data, 4)
            return True
        if self._toggle is None:
            return specifier == _INITIATED and self._take_initiated(data)
        if specifier != _SEGMENT_SENT or data[0] & _TOGGLE != self._toggle:
            return False
        self._received += data[1 : 8 - (data[0] >> 1 & 7)]
        self._toggle ^= _TOGGLE
        if len(self._received) > LARGEST_BYTES:
            self.abort = _TOO_LONG
        elif data[0] & 1:
            self.data = self._received
        return True

    def _take_initiated(self, data: bytes) -> bool:
        if struct.unpack_from("<HB", data, 1) != self.key:
            return False
        is_expedited, has_size = data[0] & 2, data[0] & 1
        if is_expedited:
            self.data = data[4 : 8 - (data[0] >> 2 & 3 if has_size else 0)]
        else:
            self._toggle = 0
        return True
