"""PDO communication and mapping parameters (CiA 301, objects 1400h ff., 1600h ff., 1800h ff., 1A00h ff.).

Reads them from the object store and rejects writes that CiA 301 forbids, so that the store always contains
valid PDOs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from palpate_edge.common.errors import ConfigError
from palpate_edge.node.cob_ids import CAN_ID_MASK, NOT_VALID, check_cob_id
from palpate_edge.node.object_dictionary import Entry, ObjectDictionary, ObjectKey
from palpate_edge.node.object_store import ObjectStore
from palpate_edge.node.pdo_codec import (
    MappingFault,
    PdoDirection,
    PdoLayout,
    is_fd_pdo,
    layout_of,
)
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

MAX_PDOS = 512
COB_ID_NO_RTR = 1 << 30
HIGHEST_SYNC_TYPE = 240
EVENT_DRIVEN = (254, 255)

COB_ID_SUB, TYPE_SUB, INHIBIT_SUB, EVENT_TIMER_SUB, SYNC_START_SUB = 1, 2, 3, 5, 6

ABORT_OF_FAULT = {
    MappingFault.NOT_MAPPABLE: AbortCode.NOT_MAPPABLE,
    MappingFault.TOO_LONG: AbortCode.PDO_TOO_LONG,
}


class PdoParameters(msgspec.Struct, frozen=True):
    """Present configuration of one PDO.

    event_us: event timer (TPDO) or deadline (RPDO), 0 for none. sync_start: SYNC counter at which a
    synchronous TPDO begins to count, 0 for any.
    """

    number: int
    can_id: int
    valid: bool
    transmission_type: int
    inhibit_us: int
    event_us: int
    sync_start: int
    layout: PdoLayout

    @property
    def is_sent(self) -> bool:
        """Return whether the PDO is valid and maps at least one object."""
        return self.valid and bool(self.layout.keys)

    @property
    def event_driven(self) -> bool:
        """Return whether the transmission type is 254 or 255."""
        return self.transmission_type in EVENT_DRIVEN


def pdo_numbers(od: ObjectDictionary, direction: PdoDirection) -> tuple[int, ...]:
    """Return the numbers, from 1 on, of the PDOs in `od`."""
    base = direction.communication_index
    return tuple(number for number in range(1, MAX_PDOS + 1) if base + number - 1 in od.indices)


def with_tpdos_enabled(od: ObjectDictionary, numbers: Sequence[int]) -> ObjectDictionary:
    """Return the dictionary with these TPDOs valid by default, whose identifiers it has but disables."""
    return od.with_defaults({key: cob_id & ~NOT_VALID for key, cob_id in _tpdo_cob_ids(od, numbers)})


def with_tpdos_disabled(od: ObjectDictionary, numbers: Sequence[int]) -> ObjectDictionary:
    """Return the dictionary with these TPDOs not valid by default."""
    return od.with_defaults({key: cob_id | NOT_VALID for key, cob_id in _tpdo_cob_ids(od, numbers)})


def _tpdo_cob_ids(od: ObjectDictionary, numbers: Sequence[int]) -> Iterator[tuple[ObjectKey, int]]:
    for number in numbers:
        key = (PdoDirection.TRANSMIT.communication_index + number - 1, COB_ID_SUB)
        yield key, od.default_number(*key)


def read_parameters(store: ObjectStore, direction: PdoDirection, number: int) -> PdoParameters:
    """Read the parameters of one PDO from the store. Raises ConfigError when the EDS's mapping is invalid."""
    index = direction.communication_index + number - 1
    mapping_index = direction.mapping_index + number - 1
    words = _mapping_words(store, mapping_index)
    layout = layout_of(store.od, words, direction, fd=is_fd_pdo(store.od, direction, number))
    if isinstance(layout, MappingFault):
        raise ConfigError(f"{store.od.source}: {mapping_index:04X}h maps {layout.value}: correct the EDS")
    cob_id = store.number(index, COB_ID_SUB)
    return PdoParameters(
        number=number,
        can_id=cob_id & CAN_ID_MASK,
        valid=not cob_id & NOT_VALID,
        transmission_type=store.number(index, TYPE_SUB),
        inhibit_us=100 * store.optional_number(index, INHIBIT_SUB),
        event_us=1000 * store.optional_number(index, EVENT_TIMER_SUB),
        sync_start=store.optional_number(index, SYNC_START_SUB),
        layout=layout,
    )


def valid_can_ids(store: ObjectStore, direction: PdoDirection, numbers: Sequence[int]) -> set[int]:
    """Return the identifiers of those of the PDOs that are valid now."""
    base = direction.communication_index - 1
    cob_ids = (store.number(base + number, COB_ID_SUB) for number in numbers)
    return {cob_id & CAN_ID_MASK for cob_id in cob_ids if not cob_id & NOT_VALID}


def check_pdo_write(store: ObjectStore, entry: Entry, value: int) -> None:
    """Raise SdoAbortError for an invalid write to a PDO parameter; other objects are not checked."""
    for direction in PdoDirection:
        number = 1 + entry.index - direction.communication_index
        if 0 < number <= MAX_PDOS:
            _check_communication(store, direction, number, entry, value)
        offset = entry.index - direction.mapping_index
        if 0 <= offset < MAX_PDOS:
            _check_mapping(store, direction, offset, entry, value)


def _check_communication(
    store: ObjectStore, direction: PdoDirection, number: int, entry: Entry, value: int
) -> None:
    cob_id = store.number(entry.index, COB_ID_SUB)
    if entry.subindex == COB_ID_SUB:
        _check_pdo_cob_id(cob_id, value)
        if not value & NOT_VALID and not store.od.has_fd and is_fd_pdo(store.od, direction, number):
            raise SdoAbortError(AbortCode.DEVICE_STATE)  # a classic bus carries no CAN FD frame
    elif entry.subindex == TYPE_SUB:
        # 252 and 253 are sent on a remote request only, which this node does not support (no RTR).
        if value > HIGHEST_SYNC_TYPE and value not in EVENT_DRIVEN:
            raise SdoAbortError(AbortCode.VALUE_INVALID)
    elif entry.subindex in (INHIBIT_SUB, SYNC_START_SUB) and not cob_id & NOT_VALID:
        raise SdoAbortError(AbortCode.DEVICE_STATE)


def _check_pdo_cob_id(old: int, new: int) -> None:
    """Raise SdoAbortError for an invalid COB-ID. Bit 30 (no RTR) is free: no remote frame is answered."""
    check_cob_id(new, flags=NOT_VALID | COB_ID_NO_RTR)
    moves_while_valid = not (old | new) & NOT_VALID and (old ^ new) & CAN_ID_MASK
    if moves_while_valid:
        raise SdoAbortError(AbortCode.VALUE_INVALID)


def _check_mapping(
    store: ObjectStore, direction: PdoDirection, offset: int, entry: Entry, value: int
) -> None:
    cob_id = store.number(direction.communication_index + offset, COB_ID_SUB)
    if not cob_id & NOT_VALID:
        raise SdoAbortError(AbortCode.DEVICE_STATE)
    if entry.subindex == 0:
        words = [store.number(entry.index, 1 + slot) for slot in range(value)]
    elif store.number(entry.index, 0):
        raise SdoAbortError(AbortCode.DEVICE_STATE)
    else:
        words = [value] if value else []
    layout = layout_of(store.od, words, direction, fd=is_fd_pdo(store.od, direction, offset + 1))
    if isinstance(layout, MappingFault):
        raise SdoAbortError(ABORT_OF_FAULT[layout])


def _mapping_words(store: ObjectStore, mapping_index: int) -> list[int]:
    return [store.number(mapping_index, 1 + slot) for slot in range(store.number(mapping_index, 0))]
