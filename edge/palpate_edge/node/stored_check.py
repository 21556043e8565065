"""The check of stored parameters: a node uses only values that a master could have written by SDO.

The checksum of the parameter file finds a torn file, not one that was edited, or made by another program.
"""

from __future__ import annotations

from collections.abc import Mapping

from palpate_edge.common.errors import BusError, ConfigError
from palpate_edge.node.cob_ids import NOT_VALID
from palpate_edge.node.eds_history import EARLIER
from palpate_edge.node.emcy import COB_ID as EMCY_COB_ID
from palpate_edge.node.object_dictionary import (
    UNCONFIGURED_NODE_ID,
    DataType,
    Entry,
    ObjectDictionary,
    ObjectKey,
    Value,
)
from palpate_edge.node.object_store import ObjectStore, check_limits
from palpate_edge.node.pdo_codec import PdoDirection
from palpate_edge.node.pdo_parameters import COB_ID_SUB, MAX_PDOS
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError
from palpate_edge.node.services import Services
from palpate_edge.node.stored_parameters import StoredParameters, is_parameter


class StoredParametersError(ConfigError):
    """Stored parameters that the node does not use: of another EDS, or not allowed by it."""


def check_stored(od: ObjectDictionary, kept: StoredParameters) -> None:
    """Raise StoredParametersError for parameters that the node must not use, with the first wrong one."""
    node_id = kept.node_id
    if node_id is not None and usable_node_id(kept) is None:
        raise StoredParametersError(f"the stored node id is {node_id}: 1 to 127 or 255 is allowed")
    if kept.objects and kept.eds_checksum not in (od.checksum, *(eds.checksum for eds in EARLIER)):
        raise StoredParametersError(
            f"the stored parameters belong to another EDS ({kept.eds_checksum}): save them again"
        )
    od = od if node_id is None else od.for_node(node_id)
    for key, value in kept.objects.items():
        _check_value(od, key, value)
    _check_as_writes(od, kept.objects)


def usable_node_id(kept: StoredParameters) -> int | None:
    """Return the stored node id; None when there is none, or one that is not allowed."""
    node_id = kept.node_id
    is_usable = node_id is not None and (1 <= node_id <= 127 or node_id == UNCONFIGURED_NODE_ID)
    return node_id if is_usable else None


def _check_value(od: ObjectDictionary, key: ObjectKey, value: Value) -> None:
    """Check one value by the entry of the EDS: it exists, is a parameter, and takes the value."""
    entry = od.entries.get(key)
    if entry is None or not is_parameter(entry):
        raise StoredParametersError(f"stored object {key[0]:04X}h:{key[1]:02X} is no parameter of this node")
    is_text = entry.data_type is DataType.VISIBLE_STRING
    try:
        if isinstance(value, str) is not is_text:
            raise SdoAbortError(AbortCode.LENGTH_MISMATCH)
        entry.check(value)
        check_limits(entry, value)
    except BusError:
        raise _refused(entry, value) from None


def _check_as_writes(od: ObjectDictionary, objects: Mapping[ObjectKey, Value]) -> None:
    """Write the objects as a master does: disable the PDOs, write their mappings, write COB-IDs last."""
    store = ObjectStore(od)
    services = Services(store, lambda _entry, _value: True)
    wanted = dict(objects)
    for key in objects:
        communication, mapping = _pdo_indices(key[0])
        cob_id = (EMCY_COB_ID, 0) if key == (EMCY_COB_ID, 0) else (communication, COB_ID_SUB)
        if cob_id in store.values:
            store.values[cob_id] = store.number(*cob_id) | NOT_VALID
            wanted.setdefault(cob_id, od.entries[cob_id].default)
        if (mapping, 0) in store.values:
            store.values[mapping, 0] = 0
            wanted.setdefault((mapping, 0), od.entries[mapping, 0].default)
    for key in sorted(wanted, key=_order):
        entry, value = od.entries[key], wanted[key]
        try:
            services.check_write(entry, value)
        except SdoAbortError:
            raise _refused(entry, value) from None
        store.values[key] = value
        services.written(0, entry)


def _pdo_indices(index: int) -> tuple[int, int]:
    """Return the indices of communication and mapping of the PDO that an object belongs to; 0 for none."""
    for direction in PdoDirection:
        for first in (direction.communication_index, direction.mapping_index):
            if 0 <= index - first < MAX_PDOS:
                number = index - first
                return direction.communication_index + number, direction.mapping_index + number
    return 0, 0


def _order(key: ObjectKey) -> tuple[int, ObjectKey]:
    """Sort mapping entries before their number, and COB-IDs after all else."""
    communication, mapping = _pdo_indices(key[0])
    if key in ((communication, COB_ID_SUB), (EMCY_COB_ID, 0)):
        return 2, key
    return int(key == (mapping, 0)), key


def _refused(entry: Entry, value: Value) -> StoredParametersError:
    return StoredParametersError(f"stored value {value!r} is not allowed in object {entry}")
