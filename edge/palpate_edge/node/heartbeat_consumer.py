"""Heartbeat consumer (CiA 301, 7.2.8.3.2; object 1016h): supervised nodes and their consumer times.

Supervision of a node begins with its first message. A timeout is reported by EMCY 0x8130 with the node id in
the first manufacturer byte, and 1029h is applied. The node's next message clears the error.
"""

from __future__ import annotations

from palpate_edge.node.emcy import EmcyCode, EmergencyProducer, ErrorRegister
from palpate_edge.node.nmt import ERROR_CONTROL_ID
from palpate_edge.node.object_dictionary import Entry
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

CONSUMER_TIMES = 0x1016
HIGHEST_NODE_ID = 127


class HeartbeatConsumer:
    """Consumer of the heartbeats of the nodes in 1016h, with the deadline of each."""

    def __init__(self, store: ObjectStore, emcy: EmergencyProducer) -> None:
        self._store = store
        self._emcy = emcy
        self._times_us: dict[int, int] = {}
        self._deadlines_us: dict[int, int] = {}
        self.start()

    def start(self) -> None:
        """Start after a reset; supervision of each node begins with its first message."""
        entries = [self._entry(sub) for sub in range(1, 1 + self._store.optional_number(CONSUMER_TIMES))]
        self._times_us = {node_id: time_us for node_id, time_us in entries if time_us}
        self._deadlines_us.clear()

    def reconfigure(self) -> None:
        """Apply a write to 1016h: clear the errors of removed nodes, keep the deadlines of unchanged ones."""
        times_us, deadlines_us = self._times_us, dict(self._deadlines_us)
        self.start()
        for node_id, time_us in times_us.items():
            if node_id not in self._times_us:
                self._emcy.clear(EmcyCode.HEARTBEAT, bytes([node_id]))
            elif self._times_us[node_id] == time_us and node_id in deadlines_us:
                self._deadlines_us[node_id] = deadlines_us[node_id]

    def check_write(self, entry: Entry, value: int) -> None:
        """Raise SdoAbortError for reserved bits, and for a node that another sub-index supervises."""
        if value >> 24:
            raise SdoAbortError(AbortCode.VALUE_INVALID)
        node_id, time_us = consumer_entry(value)
        others = (
            self._entry(sub)
            for sub in range(1, 1 + self._store.number(CONSUMER_TIMES))
            if sub != entry.subindex
        )
        if time_us and any(time and node == node_id for node, time in others):
            raise SdoAbortError(AbortCode.PARAMETER_CLASH)

    def can_ids(self) -> set[int]:
        """Return the identifiers of the monitored heartbeats."""
        return {ERROR_CONTROL_ID + node_id for node_id in self._times_us}

    def due_us(self) -> int | None:
        """Return the earliest deadline; None while no node is monitored."""
        return min(self._deadlines_us.values()) if self._deadlines_us else None

    def receive(self, now_us: int, can_id: int) -> None:
        """Restart the deadline of a supervised node; a message with any state counts."""
        node_id = can_id - ERROR_CONTROL_ID
        self._deadlines_us[node_id] = now_us + self._times_us[node_id]
        self._emcy.clear(EmcyCode.HEARTBEAT, bytes([node_id]))

    def poll(self, now_us: int) -> list[int]:
        """Return the nodes whose heartbeat has timed out; each is reported once."""
        if not self._deadlines_us:
            return []
        lost = [node_id for node_id, deadline_us in self._deadlines_us.items() if deadline_us <= now_us]
        for node_id in lost:
            del self._deadlines_us[node_id]
            self._emcy.report(EmcyCode.HEARTBEAT, ErrorRegister.COMMUNICATION, bytes([node_id]))
        return lost

    def _entry(self, subindex: int) -> tuple[int, int]:
        return consumer_entry(self._store.number(CONSUMER_TIMES, subindex))


def consumer_entry(value: int) -> tuple[int, int]:
    """Return node id and time in us of one sub-index of 1016h; the time is 0 for an unused one."""
    node_id, time_ms = value >> 16 & 0xFF, value & 0xFFFF
    return node_id, time_ms * 1000 if 1 <= node_id <= HIGHEST_NODE_ID else 0
