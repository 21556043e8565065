"""TIME consumer (CiA 301, 7.2.6; object 1012h): the time of day that a producer sends occasionally.

The bus clock in microseconds is a separate object: 1013h, received in an RPDO.
"""

from __future__ import annotations

import struct

from palpate_edge.node.cob_ids import CAN_ID_MASK, check_cob_id
from palpate_edge.node.events import TimeOfDayReceived
from palpate_edge.node.object_dictionary import Entry
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

COB_ID = 0x1012
CONSUMES = 1 << 31
LENGTH_BYTES = 6
MILLISECONDS_MASK = (1 << 28) - 1


class TimeConsumer:
    """Consumer of TIME. can_id: its identifier, None while 1012h disables it."""

    def __init__(self, store: ObjectStore) -> None:
        self._store = store
        self.can_id: int | None = None
        self.start()

    def start(self) -> None:
        """Read 1012h again, after a reset or a write to it."""
        cob_id = self._store.optional_number(COB_ID)
        self.can_id = cob_id & CAN_ID_MASK if cob_id & CONSUMES else None

    def check_write(self, _entry: Entry, value: int) -> None:
        """Raise SdoAbortError for a producer, and for another identifier while TIME is consumed."""
        # 0x100, the default identifier, is not restricted.
        check_cob_id(value, flags=CONSUMES)
        old = self._store.number(COB_ID)
        if old & value & CONSUMES and (old ^ value) & CAN_ID_MASK:
            raise SdoAbortError(AbortCode.VALUE_INVALID)

    def receive(self, arrived_us: int, data: bytes) -> TimeOfDayReceived | None:
        """Return the time of day of a TIME message, None when its length is not that of TIME_OF_DAY."""
        if len(data) != LENGTH_BYTES:
            return None
        milliseconds, days = struct.unpack("<IH", data)
        return TimeOfDayReceived(arrived_us, days, milliseconds & MILLISECONDS_MASK)
