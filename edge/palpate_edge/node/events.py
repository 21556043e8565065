"""What a slave tells its application about what came over the bus, in the order it came.

Times of arrival (`arrived_us`) are those given to :meth:`Slave.process` with the frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from palpate_edge.node.nmt import NmtCommand, NmtState
from palpate_edge.node.object_dictionary import ObjectKey, Value
from palpate_edge.node.stored_parameters import StoredParameters


@dataclass(frozen=True, slots=True)
class NmtStateChanged:
    """The node is in `state` now; `command` is what brought it there, None for the boot-up or an error."""

    state: NmtState
    command: NmtCommand | None


@dataclass(frozen=True, slots=True)
class NodeIdConflict:
    """A frame came with an identifier that only this node may send: another node has the same id."""

    can_id: int


@dataclass(frozen=True, slots=True)
class AcceptIdsChanged:
    """A receive filter must let these identifiers through from now on (see :meth:`Slave.accept_ids`)."""

    can_ids: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ObjectWritten:
    """A master wrote an object by SDO."""

    index: int
    subindex: int
    value: Value


@dataclass(frozen=True, slots=True)
class RpdoReceived:
    """RPDO `number` was taken over into its objects: raw integers by (index, sub-index)."""

    number: int
    values: Mapping[ObjectKey, int]


@dataclass(frozen=True, slots=True)
class RpdoTimedOut:
    """The event timer of RPDO `number` passed without a new one (EMCY 0x8250)."""

    number: int


@dataclass(frozen=True, slots=True)
class SyncReceived:
    """counter: what SYNC carries while 1019h is not 0, else None."""

    arrived_us: int
    counter: int | None


@dataclass(frozen=True, slots=True)
class TimeStampReceived:
    """An RPDO brought 1013h: the bus's time in us, modulo 2^32."""

    arrived_us: int
    stamp_us: int


@dataclass(frozen=True, slots=True)
class TimeOfDayReceived:
    """TIME (1012h): days since 1984-01-01 and milliseconds since midnight."""

    arrived_us: int
    days: int
    milliseconds: int


@dataclass(frozen=True, slots=True)
class HeartbeatLost:
    """A node that 1016h watches was silent for too long (EMCY 0x8130)."""

    node_id: int


@dataclass(frozen=True, slots=True)
class StoreRequested:
    """A master wants these parameters kept (1010h, 1011h, LSS): write them, then call `store_finished`."""

    parameters: StoredParameters


@dataclass(frozen=True, slots=True)
class BitRateActivated:
    """LSS: wait `delay_us`, switch the bus, wait as long again; the node sends nothing meanwhile."""

    bit_rate_kbit_s: int
    delay_us: int


Event = (
    NmtStateChanged
    | NodeIdConflict
    | AcceptIdsChanged
    | ObjectWritten
    | RpdoReceived
    | RpdoTimedOut
    | SyncReceived
    | TimeStampReceived
    | TimeOfDayReceived
    | HeartbeatLost
    | StoreRequested
    | BitRateActivated
)
