"""Store and restore of parameters (CiA 301, 1010h and 1011h): which objects, and what is kept of them.

Pure: a write of "save" or "load" makes the :class:`StoredParameters` that the rim then writes to its file
(``parameter_file.py``). Kept is what differs from the default of the EDS, so that a COB-ID that follows the
node id still does so after LSS gave another one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from palpate_edge.node.object_dictionary import Entry, ObjectKey, Value
from palpate_edge.node.object_store import ERROR_HISTORY, ObjectStore
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

STORE, RESTORE = 0x1010, 0x1011
SIGNATURES = {STORE: int.from_bytes(b"save", "little"), RESTORE: int.from_bytes(b"load", "little")}

COMMUNICATION = range(0x1000, 0x2000)
MANUFACTURER = range(0x2000, 0x6000)
APPLICATION = range(0x6000, 0xA000)
GROUPS = {1: range(0x1000, 0xA000), 2: COMMUNICATION, 3: APPLICATION, 4: MANUFACTURER}
"""Sub-indices of 1010h and 1011h."""

NEVER_STORED = frozenset({ERROR_HISTORY, STORE, RESTORE, 0x1013})
"""Commands, a history and a clock: writable, but no parameters."""


@dataclass(frozen=True, slots=True)
class StoredParameters:
    """What a node keeps without power.

    eds_checksum: of the EDS that `objects` belong to. node_id, bit_rate_kbit_s: what LSS stored, None before.
    """

    eds_checksum: str = ""
    node_id: int | None = None
    bit_rate_kbit_s: int | None = None
    objects: Mapping[ObjectKey, Value] = field(default_factory=dict)


NOTHING_STORED = StoredParameters()


def after_write(store: ObjectStore, kept: StoredParameters, entry: Entry, value: Value) -> StoredParameters:
    """What is to be kept after a master wrote `value` to 1010h or 1011h.

    Raises SdoAbortError when the value is not the signature.
    """
    if value != SIGNATURES[entry.index]:
        raise SdoAbortError(AbortCode.NOT_STORED)
    group = GROUPS[entry.subindex]
    objects = {key: kept_value for key, kept_value in kept.objects.items() if key[0] not in group}
    if entry.index == STORE:
        objects |= changed_parameters(store, group)
    return replace(kept, eds_checksum=store.od.checksum, objects=objects)


def changed_parameters(store: ObjectStore, group: range) -> dict[ObjectKey, Value]:
    """The parameters of `group` that are not as the EDS has them."""
    return {
        key: store.values[key]
        for key, entry in store.od.entries.items()
        if key[0] in group and is_parameter(entry) and store.values[key] != entry.default
    }


def is_parameter(entry: Entry) -> bool:
    return entry.access.readable and entry.access.writable and entry.index not in NEVER_STORED


def fits(store: ObjectStore, kept: StoredParameters) -> bool:
    """Whether the kept objects are of this EDS; those of another one are not used."""
    return not kept.objects or kept.eds_checksum == store.od.checksum
