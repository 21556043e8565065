"""Layout and codec of a PDO from the mapping in the object dictionary (CiA 301, 1600h ff. and 1A00h ff.).

The slave uses its present mapping, the host the default mapping of the EDS. Only whole bytes are mapped
(granularity 8). A PDO whose default mapping is longer than a classic frame is a CAN FD PDO: it is always sent
as a CAN FD frame of up to 64 bytes, with zeros up to a length that CAN FD has. Other PDOs are classic.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from enum import Enum
from functools import lru_cache

import msgspec

from palpate_edge.can_bus.can_frame import MAX_DATA_BYTES, MAX_FD_DATA_BYTES, CanFrame, padded
from palpate_edge.common.errors import BusError
from palpate_edge.node.cob_ids import CAN_ID_MASK
from palpate_edge.node.object_dictionary import STRUCT_CODES, Entry, ObjectDictionary, ObjectKey, Value


class PdoDirection(Enum):
    """Direction as seen from the device: it sends TPDOs and receives RPDOs.

    The values are the first indices of communication and mapping parameters.
    """

    TRANSMIT = (0x1800, 0x1A00)
    RECEIVE = (0x1400, 0x1600)

    @property
    def communication_index(self) -> int:
        return self.value[0]

    @property
    def mapping_index(self) -> int:
        return self.value[1]

    @property
    def label(self) -> str:
        return "TPDO" if self is PdoDirection.TRANSMIT else "RPDO"


class MappingFault(Enum):
    """Reasons why a mapping is invalid; the SDO server has an abort code for each."""

    NOT_MAPPABLE = "an object that this PDO must not contain"
    TOO_LONG = "more bytes than its frame has"


class PdoLayout(msgspec.Struct, frozen=True):
    """The entries of one PDO in order, their keys, and their packer. fd: a CAN FD PDO."""

    entries: tuple[Entry, ...]
    keys: tuple[ObjectKey, ...]
    packer: struct.Struct
    fd: bool = False

    @property
    def length_bytes(self) -> int:
        """Length of the payload, with the zeros of a CAN FD frame."""
        return len(padded(bytes(self.packer.size))) if self.fd else self.packer.size

    def pack(self, values: Mapping[ObjectKey, Value]) -> bytes:
        """Return the payload."""
        data = self.packer.pack(*[values[key] for key in self.keys])
        return padded(data) if self.fd else data

    def frame(self, can_id: int, values: Mapping[ObjectKey, Value]) -> CanFrame:
        """Return the frame of the PDO."""
        return CanFrame(can_id, self.pack(values), fd=self.fd)

    def unpack(self, data: bytes) -> dict[ObjectKey, int]:
        """Return the raw integers of a payload of the right length."""
        return dict(zip(self.keys, self.packer.unpack_from(data), strict=True))


def is_fd_pdo(od: ObjectDictionary, direction: PdoDirection, number: int) -> bool:
    """Return whether PDO `number` is a CAN FD PDO: its default mapping exceeds a classic frame."""
    index = direction.mapping_index + number - 1
    bits = sum(od.default_number(index, 1 + slot) & 0xFF for slot in range(od.default_number(index, 0)))
    return bits > 8 * MAX_DATA_BYTES


def layout_of(
    od: ObjectDictionary, words: Sequence[int], direction: PdoDirection, *, fd: bool = False
) -> PdoLayout | MappingFault:
    """Return the layout of mapping words (index << 16 | sub-index << 8 | bits), or why they are invalid.

    fd: of a CAN FD PDO.
    """
    entries = []
    for word in words:
        entry = od.entries.get((word >> 16, word >> 8 & 0xFF))
        if entry is None or not _carries(entry, direction) or (word & 0xFF) != 8 * (entry.size_bytes or 0):
            return MappingFault.NOT_MAPPABLE
        entries.append(entry)
    packer = _packer("<" + "".join(STRUCT_CODES[entry.data_type] for entry in entries))
    if packer.size > (MAX_FD_DATA_BYTES if fd else MAX_DATA_BYTES):
        return MappingFault.TOO_LONG
    return PdoLayout(tuple(entries), tuple(entry.key for entry in entries), packer, fd)


@lru_cache(maxsize=64)
def _packer(words: str) -> struct.Struct:
    """Return the one packer of these words, so that layouts with the same entries are equal."""
    return struct.Struct(words)


def _carries(entry: Entry, direction: PdoDirection) -> bool:
    allowed = entry.access.readable if direction is PdoDirection.TRANSMIT else entry.access.writable
    return entry.pdo_mappable and allowed


class PdoCodec(msgspec.Struct, frozen=True):
    """Codec of one PDO of one node, with the mapping of its EDS, for the side that does not run the slave."""

    node_id: int
    direction: PdoDirection
    number: int
    cob_id: int
    layout: PdoLayout

    @property
    def length_bytes(self) -> int:
        """Length of the payload."""
        return self.layout.length_bytes

    def decode(self, data: bytes) -> dict[ObjectKey, int]:
        """Return raw integers by (index, sub-index). Raises BusError when the length is not the mapping's."""
        self.check_length(data)
        return self.layout.unpack(data)

    def check_length(self, data: bytes) -> None:
        """Raise BusError when the length is not the mapping's."""
        if len(data) != self.length_bytes:
            raise BusError(
                f"{self}: {len(data)} bytes, expected {self.length_bytes}: use the same EDS on both sides"
                " or restore the node's default mapping"
            )

    def encode(self, values: Mapping[ObjectKey, int]) -> bytes:
        """Return the payload for raw integers by (index, sub-index).

        Raises BusError when a mapped object has no value or one that does not fit its data type.
        """
        for entry in self.layout.entries:
            if entry.key not in values:
                raise BusError(f"{self}: no value for {entry}: give a value for every mapped object")
        try:
            return self.layout.pack(values)
        except struct.error as error:
            raise BusError(f"{self}: {error}: give values in their data type's range") from None

    @property
    def label(self) -> str:
        """Direction and number, such as ``TPDO 1``."""
        return f"{self.direction.label} {self.number}"

    def __str__(self) -> str:
        return f"node {self.node_id} {self.label}"


def pdo_codec(od: ObjectDictionary, direction: PdoDirection, number: int) -> PdoCodec:
    """Return the codec of PDO `number` (from 1 on) with the defaults of the EDS, for the node id of `od`.

    Raises BusError when the EDS has no such PDO or its mapping is invalid.
    """
    offset = number - 1
    mapping_index = direction.mapping_index + offset
    cob_id = od.default_number(direction.communication_index + offset, 1)
    count = od.default_number(mapping_index, 0)
    words = [od.default_number(mapping_index, 1 + slot) for slot in range(count)]
    layout = layout_of(od, words, direction, fd=is_fd_pdo(od, direction, number))
    if isinstance(layout, MappingFault):
        raise BusError(
            f"{od.source}: {direction.label} {number} maps {layout.value}: correct {mapping_index:04X}h"
        )
    return PdoCodec(od.node_id, direction, number, cob_id & CAN_ID_MASK, layout)
