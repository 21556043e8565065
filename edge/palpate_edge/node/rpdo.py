"""Receive PDOs (CiA 301, 7.2.2): types 0 to 240 take effect at the next SYNC, 254 and 255 at once.

A synchronous RPDO received after the SYNC window (1007h) is ignored. An RPDO with 1013h contains the bus
time.

A PDO that is too short is ignored (EMCY 0x8210); of one that is too long the mapped bytes are used (EMCY
0x8220), except for the zeros that fill a CAN FD frame. The event timer of an RPDO is a deadline from the
first reception on (EMCY 0x8250). The next valid PDO clears each error.
"""

from __future__ import annotations

import msgspec

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.emcy import EmcyCode, EmergencyProducer, ErrorRegister
from palpate_edge.node.events import RpdoReceived, RpdoTimedOut, TimeStampReceived
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.pdo_codec import PdoDirection
from palpate_edge.node.pdo_parameters import PdoParameters, pdo_numbers, read_parameters, valid_can_ids
from palpate_edge.node.sync import SyncConsumer

TIME_STAMP = (0x1013, 0)


class Rpdo(msgspec.Struct):
    """One RPDO in OPERATIONAL. waiting: reception time and data of a synchronous RPDO until the next SYNC."""

    parameters: PdoParameters
    waiting: tuple[int, bytes] | None = None
    deadline_us: int | None = None


class RpdoService:
    """All RPDOs of a node; they are active from :meth:`start` to :meth:`stop`, that is in OPERATIONAL."""

    def __init__(self, store: ObjectStore, emcy: EmergencyProducer, sync: SyncConsumer) -> None:
        self._store = store
        self._emcy = emcy
        self._sync = sync
        self._numbers = pdo_numbers(store.od, PdoDirection.RECEIVE)
        self._rpdos: tuple[Rpdo, ...] = ()
        for number in self._numbers:
            read_parameters(store, PdoDirection.RECEIVE, number)

    def start(self) -> None:
        """Read the parameters and begin to receive."""
        parameters = (read_parameters(self._store, PdoDirection.RECEIVE, number) for number in self._numbers)
        self._rpdos = tuple(Rpdo(one) for one in parameters if one.valid)

    def stop(self) -> None:
        """Stop receiving."""
        self._rpdos = ()

    def can_ids(self) -> set[int]:
        """Return the identifiers of the valid RPDOs."""
        return valid_can_ids(self._store, PdoDirection.RECEIVE, self._numbers)

    def due_us(self) -> int | None:
        """Return the earliest deadline; None if there is none."""
        return min((rpdo.deadline_us for rpdo in self._rpdos if rpdo.deadline_us is not None), default=None)

    def receive(
        self, now_us: int, arrived_us: int, frame: CanFrame
    ) -> list[RpdoReceived | TimeStampReceived]:
        """Process one frame, if it is an RPDO of this node."""
        return [
            event
            for rpdo in self._rpdos
            if rpdo.parameters.can_id == frame.can_id
            for event in self._accept(now_us, arrived_us, rpdo, frame.data)
        ]

    def sync(self) -> list[RpdoReceived | TimeStampReceived]:
        """Apply the synchronous RPDOs received since the last SYNC."""
        events = []
        for rpdo in self._rpdos:
            if rpdo.waiting is not None:
                events += self._apply(rpdo, *rpdo.waiting)
                rpdo.waiting = None
        return events

    def poll(self, now_us: int) -> list[RpdoTimedOut]:
        """Return the RPDOs whose deadline has passed; each is reported once."""
        events = []
        for rpdo in self._rpdos:
            if rpdo.deadline_us is not None and rpdo.deadline_us <= now_us:
                rpdo.deadline_us = None
                self._emcy.report(EmcyCode.RPDO_TIMEOUT, ErrorRegister.COMMUNICATION)
                events.append(RpdoTimedOut(rpdo.parameters.number))
        return events

    def _accept(
        self, now_us: int, arrived_us: int, rpdo: Rpdo, data: bytes
    ) -> list[RpdoReceived | TimeStampReceived]:
        parameters = rpdo.parameters
        length_bytes = parameters.layout.packer.size
        if len(data) < length_bytes:
            self._emcy.report(EmcyCode.PDO_LENGTH, ErrorRegister.COMMUNICATION)
            return []
        if len(data) > length_bytes and len(data) > parameters.layout.length_bytes:
            self._emcy.report(EmcyCode.PDO_LENGTH_EXCEEDED, ErrorRegister.COMMUNICATION)
        else:
            self._emcy.clear(EmcyCode.PDO_LENGTH_EXCEEDED)
        self._emcy.clear(EmcyCode.PDO_LENGTH)
        self._emcy.clear(EmcyCode.RPDO_TIMEOUT)
        rpdo.deadline_us = now_us + parameters.event_us if parameters.event_us else None
        if parameters.event_driven:
            return self._apply(rpdo, arrived_us, data[:length_bytes])
        if self._sync.in_window(arrived_us):
            rpdo.waiting = arrived_us, data[:length_bytes]
        return []

    def _apply(self, rpdo: Rpdo, arrived_us: int, data: bytes) -> list[RpdoReceived | TimeStampReceived]:
        values = rpdo.parameters.layout.unpack(data)
        self._store.values.update(values)
        received = RpdoReceived(rpdo.parameters.number, values)
        if TIME_STAMP not in values:
            return [received]
        return [received, TimeStampReceived(arrived_us, values[TIME_STAMP])]
