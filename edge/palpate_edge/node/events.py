"""Events that a slave reports to its application, in the order of the received frames.

Reception times (`arrived_us`) are those given to :meth:`Slave.process` with the frames.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from palpate_edge.node.nmt import NmtCommand, NmtState
from palpate_edge.node.object_dictionary import ObjectKey, Value
from palpate_edge.node.stored_parameters import StoredParameters


class NmtStateChanged(msgspec.Struct, frozen=True):
    """The node has entered `state`, by `command`; None after the first boot-up, LSS or an error."""

    state: NmtState
    command: NmtCommand | None


class NodeIdConflict(msgspec.Struct, frozen=True):
    """Another node has the same id: it sent a frame with an identifier of this node.

    The application decides what follows: `Slave.hold`, `Slave.release`.
    """

    can_id: int


class AcceptIdsChanged(msgspec.Struct, frozen=True):
    """The identifiers that a receive filter has to accept have changed (see :meth:`Slave.accept_ids`)."""

    can_ids: tuple[int, ...]


class ObjectWritten(msgspec.Struct, frozen=True):
    """A master wrote an object by SDO."""

    index: int
    subindex: int
    value: Value


class RpdoReceived(msgspec.Struct, frozen=True):
    """RPDO `number` has updated its mapped objects; `values` are raw integers by (index, sub-index)."""

    number: int
    values: Mapping[ObjectKey, int]


class RpdoTimedOut(msgspec.Struct, frozen=True):
    """The event timer of RPDO `number` elapsed without a new RPDO (EMCY 0x8250)."""

    number: int


class SyncReceived(msgspec.Struct, frozen=True):
    """A SYNC was received. counter: its counter when 1019h is not 0, otherwise None."""

    arrived_us: int
    counter: int | None


class TimeStampReceived(msgspec.Struct, frozen=True):
    """An RPDO with 1013h was received; `stamp_us` is the bus time in us, modulo 2^32."""

    arrived_us: int
    stamp_us: int


class TimeOfDayReceived(msgspec.Struct, frozen=True):
    """TIME (1012h) was received: days since 1984-01-01 and milliseconds since midnight."""

    arrived_us: int
    days: int
    milliseconds: int


class HeartbeatLost(msgspec.Struct, frozen=True):
    """The heartbeat of a node in 1016h has timed out (EMCY 0x8130)."""

    node_id: int


class StoreRequested(msgspec.Struct, frozen=True):
    """A master requests storage of these parameters (1010h, 1011h, LSS).

    The application writes them, then calls `Slave.store_finished`.
    """

    parameters: StoredParameters


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
)
