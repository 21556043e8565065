"""Transmit PDOs (CiA 301, 7.2.2): types 254 and 255 with inhibit time and event timer, SYNC types 0 to 240.

With a SYNC start value, counting begins at the SYNC with that counter.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.pdo_codec import PdoDirection
from palpate_edge.node.pdo_parameters import PdoParameters, pdo_numbers, read_parameters, valid_can_ids
from palpate_edge.node.sync import COUNTER_OVERFLOW


class Tpdo(msgspec.Struct):
    """One TPDO in OPERATIONAL.

    self_triggered: valid and event-driven. requested: triggered by the application since it was last sent.
    awaits_start: the SYNC with its start value has not been received yet.
    """

    parameters: PdoParameters
    self_triggered: bool
    awaits_start: bool = False
    requested: bool = False
    syncs: int = 0
    inhibited_until_us: int = 0
    event_due_us: int | None = None

    def due_us(self) -> int | None:
        """Return the time at which a valid event-driven TPDO has to be sent, None for any other."""
        if not self.self_triggered:
            return None
        if self.requested:
            return self.inhibited_until_us
        if self.event_due_us is None:
            return None
        return max(self.event_due_us, self.inhibited_until_us)

    def count_sync(self, counter: int | None) -> bool:
        """Count a SYNC; return True when the TPDO has to be sent for it."""
        kind = self.parameters.transmission_type
        if self.parameters.event_driven or not self.parameters.is_sent:
            return False
        if kind == 0:
            return self.requested
        if self.awaits_start and counter != self.parameters.sync_start:
            return False
        self.awaits_start = False
        self.syncs += 1
        return self.syncs >= kind

    def sent(self, now_us: int) -> None:
        """Restart inhibit time and event timer after a transmission."""
        self.requested = False
        self.syncs = 0
        self.inhibited_until_us = now_us + self.parameters.inhibit_us
        self.start_event_timer(now_us)

    def start_event_timer(self, now_us: int) -> None:
        """Restart the event timer, if the TPDO has one."""
        event_us = self.parameters.event_us
        self.event_due_us = now_us + event_us if event_us else None


class TpdoService:
    """All TPDOs of a node; they are active from :meth:`start` to :meth:`stop`, that is in OPERATIONAL."""

    def __init__(self, store: ObjectStore) -> None:
        self._store = store
        self.numbers = pdo_numbers(store.od, PdoDirection.TRANSMIT)
        self._tpdos: dict[int, Tpdo] = {}
        for number in self.numbers:
            read_parameters(store, PdoDirection.TRANSMIT, number)

    def start(self, now_us: int) -> None:
        """Read the parameters and begin to transmit."""
        counted = bool(self._store.optional_number(COUNTER_OVERFLOW))
        all_parameters = (
            read_parameters(self._store, PdoDirection.TRANSMIT, number) for number in self.numbers
        )
        self._tpdos = {
            parameters.number: Tpdo(
                parameters,
                self_triggered=parameters.is_sent and parameters.event_driven,
                awaits_start=counted and parameters.sync_start != 0,
            )
            for parameters in sorted(all_parameters, key=lambda one: one.can_id)
        }
        for tpdo in self._tpdos.values():
            tpdo.start_event_timer(now_us)

    def stop(self) -> None:
        """Stop transmitting."""
        self._tpdos.clear()

    def can_ids(self) -> set[int]:
        """Return the identifiers of the valid TPDOs."""
        return valid_can_ids(self._store, PdoDirection.TRANSMIT, self.numbers)

    def trigger(self, numbers: Iterable[int]) -> None:
        """Request these TPDOs; no effect outside OPERATIONAL. Raises BusError for an unknown number."""
        for number in numbers:
            if number not in self.numbers:
                raise BusError(f"{self._store.od.source} has no TPDO {number}: trigger one of {self.numbers}")
            if number in self._tpdos:
                self._tpdos[number].requested = True

    def due_us(self) -> int | None:
        """Return when the next TPDO is due; None if none is."""
        due = [tpdo.due_us() for tpdo in self._tpdos.values()]
        return min((at_us for at_us in due if at_us is not None), default=None)

    def sync(self, now_us: int, counter: int | None) -> list[CanFrame]:
        """Return the TPDOs that one SYNC requests, lowest identifier first.

        counter: of the SYNC; None for a SYNC without one.
        """
        return [self._send(tpdo, now_us) for tpdo in self._tpdos.values() if tpdo.count_sync(counter)]

    def poll(self, now_us: int, *, last: bool = False) -> list[CanFrame]:
        """Return the event-driven TPDOs that are due, lowest identifier first.

        last: the node stops transmitting, so requested ones do not wait for their inhibit time.

        A controller with several transmit buffers sends in this order too, so it holds on every board.
        """
        frames = []
        for tpdo in self._tpdos.values():
            due_us = tpdo.due_us()
            if due_us is not None and (due_us <= now_us or (last and tpdo.requested)):
                frames.append(self._send(tpdo, now_us))
        return frames

    def _send(self, tpdo: Tpdo, now_us: int) -> CanFrame:
        tpdo.sent(now_us)
        return tpdo.parameters.layout.frame(tpdo.parameters.can_id, self._store.values)
