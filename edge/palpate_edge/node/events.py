"""What a slave tells its application about what came over the bus, in the order it came."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from palpate_edge.node.nmt import NmtCommand, NmtState
from palpate_edge.node.object_dictionary import ObjectKey, Value


@dataclass(frozen=True, slots=True)
class NmtStateChanged:
    """The node is in `state` now; `command` is what brought it there, None for the boot-up."""

    state: NmtState
    command: NmtCommand | None


@dataclass(frozen=True, slots=True)
class NodeIdConflict:
    """A frame came with an identifier that only this node may send: another node has the same id."""

    can_id: int


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


Event = NmtStateChanged | NodeIdConflict | ObjectWritten | RpdoReceived | RpdoTimedOut
