"""The SYNC consumer (CiA 301, 7.2.5): COB-ID 1005h, window 1007h, counter 1019h.

A SYNC whose length does not fit 1019h is not taken: EMCY 0x8240, which goes with the next good one.
"""

from __future__ import annotations

from palpate_edge.node.cob_ids import CAN_ID_MASK, check_cob_id
from palpate_edge.node.emcy import EmcyCode, EmergencyProducer, ErrorRegister
from palpate_edge.node.object_dictionary import Entry
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

COB_ID, WINDOW, COUNTER_OVERFLOW = 0x1005, 0x1007, 0x1019
RESERVED_OVERFLOW = 1


class SyncConsumer:
    """counter_overflow: 1019h; 0 means that SYNC carries no counter."""

    def __init__(self, store: ObjectStore, emcy: EmergencyProducer) -> None:
        self._store = store
        self._emcy = emcy
        self._last_us: int | None = None
        self._window_us = 0
        self.can_id = 0
        self.counter_overflow = 0
        self.start()

    def start(self) -> None:
        """After a reset or a write to one of the objects."""
        self.can_id = self._store.number(COB_ID) & CAN_ID_MASK
        self._window_us = self._store.optional_number(WINDOW)
        self.counter_overflow = self._store.optional_number(COUNTER_OVERFLOW)
        self._last_us = None

    def check_write(self, entry: Entry, value: int) -> None:
        """Raises SdoAbortError for what these objects cannot be: a producer, a restricted id, overflow 1."""
        if entry.index == COB_ID:
            check_cob_id(value, flags=0)
        elif entry.index == COUNTER_OVERFLOW and value == RESERVED_OVERFLOW:
            raise SdoAbortError(AbortCode.VALUE_INVALID)

    def accept(self, arrived_us: int, data: bytes) -> bool:
        """Whether a SYNC is one to act on."""
        if len(data) != (1 if self.counter_overflow else 0):
            self._emcy.report(EmcyCode.SYNC_LENGTH, ErrorRegister.COMMUNICATION)
            return False
        self._emcy.clear(EmcyCode.SYNC_LENGTH)
        self._last_us = arrived_us
        return True

    def in_window(self, at_us: int) -> bool:
        """Whether synchronous PDOs may still be sent and taken at `at_us`."""
        if not self._window_us or self._last_us is None:
            return True
        return at_us - self._last_us <= self._window_us
