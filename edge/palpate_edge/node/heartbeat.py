"""Heartbeat producer (CiA 301, 7.2.8.3.2; object 1017h, in ms)."""

from __future__ import annotations

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.nmt import ERROR_CONTROL_ID, NmtState
from palpate_edge.node.object_store import ObjectStore

PRODUCER_TIME = 0x1017


class HeartbeatProducer:
    """Producer that sends the NMT state every 1017h milliseconds; disabled while 1017h is 0."""

    def __init__(self, store: ObjectStore) -> None:
        self._store = store
        self._due_us: int | None = None

    def start(self, now_us: int) -> None:
        """Start after the boot-up, which is the first message; the next one follows after one period."""
        period_us = self._period_us()
        self._due_us = now_us + period_us if period_us else None

    def reconfigure(self, now_us: int) -> None:
        """Apply a write to 1017h; the first message of the new period is sent at once."""
        self._due_us = now_us if self._period_us() else None

    def due_us(self) -> int | None:
        """Return when the next heartbeat is due; None while 1017h is 0."""
        return self._due_us

    def poll(self, now_us: int, state: NmtState) -> CanFrame | None:
        """Return the heartbeat if it is due."""
        if self._due_us is None or now_us < self._due_us:
            return None
        self._due_us += self._period_us()
        if self._due_us <= now_us:
            # After a late call the missed messages are skipped, not sent as a burst.
            self._due_us = now_us + self._period_us()
        return CanFrame(ERROR_CONTROL_ID + self._store.od.node_id, bytes([state]))

    def _period_us(self) -> int:
        return self._store.number(PRODUCER_TIME) * 1000
