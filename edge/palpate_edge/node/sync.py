"""SYNC consumer (CiA 301, 7.2.5): COB-ID 1005h, window 1007h, counter 1019h.

A SYNC whose length does not fit 1019h is ignored and reported by EMCY 0x8240; the next valid one clears the
error.
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
    """Consumer of SYNC. counter_overflow: value of 1019h; with 0, SYNC has no counter."""

    def __init__(self, store: ObjectStore, emcy: EmergencyProducer) -> None:
        self._store = store
        self._emcy = emcy
        self._last_us: int | None = None
        self._window_us = 0
        self.can_id = 0
        self.counter_overflow = 0
        self.start()

    def start(self) -> None:
        """Read the objects again, after a reset or a write to one of them."""
        self.can_id = self._store.number(COB_ID) & CAN_ID_MASK
        self._window_us = self._store.optional_number(WINDOW)
        self.counter_overflow = self._store.optional_number(COUNTER_OVERFLOW)
        self._last_us = None

    def check_write(self, entry: Entry, value: int) -> None:
        """Raise SdoAbortError for a producer, a restricted identifier, or counter overflow 1."""
        if entry.index == COB_ID:
            check_cob_id(value, flags=0)
        elif entry.index == COUNTER_OVERFLOW and value == RESERVED_OVERFLOW:
            raise SdoAbortError(AbortCode.VALUE_INVALID)

    def accept(self, arrived_us: int, data: bytes) -> bool:
        """Return whether a SYNC is valid; report or clear EMCY 0x8240."""
        if len(data) != (1 if self.counter_overflow else 0):
            self._emcy.report(EmcyCode.SYNC_LENGTH, ErrorRegister.COMMUNICATION)
            return False
        self._emcy.clear(EmcyCode.SYNC_LENGTH)
        self._last_us = arrived_us
        return True

    def in_window(self, at_us: int) -> bool:
        """Return whether synchronous PDOs may still be sent and received at `at_us`."""
        if not self._window_us or self._last_us is None:
            return True
        return at_us - self._last_us <= self._window_us
