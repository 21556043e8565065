"""Store and restore of parameters (CiA 301, 1010h and 1011h): the objects and their stored values.

Pure: a write of "save" or "load" makes the :class:`StoredParameters` that the application then writes to its
file (``parameter_file.py``). Only values that differ from the default of the EDS are stored, so that a COB-ID
that depends on the node id still does so after LSS assigns another one.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from palpate_edge.node.object_dictionary import Entry, ObjectDictionary, ObjectKey, Value
from palpate_edge.node.object_store import ERROR_HISTORY, SIGNATURE_KEYS, ObjectStore
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

STORE, RESTORE = 0x1010, 0x1011
SIGNATURES = {STORE: int.from_bytes(b"save", "little"), RESTORE: int.from_bytes(b"load", "little")}

COMMUNICATION = range(0x1000, 0x2000)
MANUFACTURER = range(0x2000, 0x6000)
APPLICATION = range(0x6000, 0xA000)
GROUPS = {1: range(0x1000, 0xA000), 2: COMMUNICATION, 3: APPLICATION, 4: MANUFACTURER}
"""Sub-index of 1010h and 1011h -> indices of the objects."""

NEVER_STORED = frozenset({ERROR_HISTORY, STORE, RESTORE, 0x1013})
"""Commands, a history and a clock, which are writable but not parameters."""


class StoredParameters(msgspec.Struct, frozen=True):
    """Values that a node keeps without power.

    eds_checksum: of the EDS that `objects` belong to. node_id: stored by LSS, None if not. bit_rate_kbit_s:
    of a file of an earlier version; not used. device: digest of the device to which the signature in 1020h
    belongs.
    """

    eds_checksum: str = ""
    node_id: int | None = None
    bit_rate_kbit_s: int | None = None
    objects: Mapping[ObjectKey, Value] = msgspec.field(default_factory=dict)
    device: str = ""

    def without_signature(self) -> StoredParameters:
        """Return the parameters with 1020h at 0, after a change of the others."""
        return msgspec.structs.replace(self, objects=_without_signature(self.objects))

    def on_device(self, device: str) -> StoredParameters:
        """Return the parameters as `device` starts with them.

        A master also verified constants of the device, such as its calibration: a device with others has no
        signature.
        """
        kept = self if device == self.device else self.without_signature()
        return msgspec.structs.replace(kept, device=device)


NOTHING_STORED = StoredParameters()


def without_storage(od: ObjectDictionary) -> ObjectDictionary:
    """Return the dictionary of a device that cannot store: 1010h and 1011h read 0 (CiA 301, 7.5.2.13)."""
    return od.with_defaults({(index, group): 0 for index in SIGNATURES for group in GROUPS})


def after_write(store: ObjectStore, kept: StoredParameters, entry: Entry, value: Value) -> StoredParameters:
    """Return the parameters to store after a master wrote `value` to 1010h or 1011h.

    A change of the stored values deletes the configuration signature (1020h) unless it is stored with them.
    Raises SdoAbortError when the value is not that of "save" or "load".
    """
    if value != SIGNATURES[entry.index]:
        raise SdoAbortError(AbortCode.NOT_STORED)
    group = GROUPS[entry.subindex]
    objects = {key: kept_value for key, kept_value in kept.objects.items() if key[0] not in group}
    if entry.index == STORE:
        objects |= changed_parameters(store, group)
    parameters = msgspec.structs.replace(kept, eds_checksum=store.od.checksum, objects=objects)
    is_changed = _without_signature(objects) != _without_signature(kept.objects)
    is_signed = entry.index == STORE and store.is_signed
    return parameters.without_signature() if is_changed and not is_signed else parameters


def changed_parameters(store: ObjectStore, group: range) -> dict[ObjectKey, Value]:
    """Return the parameters of `group` whose values differ from the defaults of the EDS."""
    return {
        key: store.values[key]
        for key, entry in store.od.entries.items()
        if key[0] in group and is_parameter(entry) and store.values[key] != entry.default
    }


def _without_signature(objects: Mapping[ObjectKey, Value]) -> dict[ObjectKey, Value]:
    return {key: value for key, value in objects.items() if key not in SIGNATURE_KEYS}


def is_parameter(entry: Entry) -> bool:
    """Return whether 1010h stores the object."""
    return entry.access.readable and entry.access.writable and entry.index not in NEVER_STORED
