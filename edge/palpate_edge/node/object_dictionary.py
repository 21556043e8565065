"""Object dictionary: the description of each object in an electronic data sheet, typed and immutable.

``eds.py`` makes it; an :class:`Entry` converts values to bytes and back. The values of a running node are in
``object_store.py``.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from enum import Enum, IntEnum

import msgspec

from palpate_edge.common.errors import BusError

Value = int | str
ObjectKey = tuple[int, int]
"""Index and sub-index."""

UNCONFIGURED_NODE_ID = 255
"""The node id of a node without one (LSS, CiA 305)."""


class DataType(IntEnum):
    """Data types of CiA 301 (table of object 0001h ff.) that these nodes use."""

    INTEGER8 = 0x02
    INTEGER16 = 0x03
    INTEGER32 = 0x04
    UNSIGNED8 = 0x05
    UNSIGNED16 = 0x06
    UNSIGNED32 = 0x07
    VISIBLE_STRING = 0x09


STRUCT_CODES = {
    DataType.INTEGER8: "b",
    DataType.INTEGER16: "h",
    DataType.INTEGER32: "i",
    DataType.UNSIGNED8: "B",
    DataType.UNSIGNED16: "H",
    DataType.UNSIGNED32: "I",
}
STRUCTS = {data_type: struct.Struct("<" + code) for data_type, code in STRUCT_CODES.items()}
RANGES = {
    data_type: range(-(1 << 8 * packer.size - 1), 1 << 8 * packer.size - 1)
    if packer.format.islower()
    else range(1 << 8 * packer.size)
    for data_type, packer in STRUCTS.items()
}
"""The range of each integer data type."""


class Access(Enum):
    """CiA 306 access types; ``rwr`` and ``rww`` are ``rw`` for SDO."""

    READ_ONLY = "ro"
    WRITE_ONLY = "wo"
    READ_WRITE = "rw"
    READ_WRITE_ON_PROCESS_INPUT = "rwr"
    READ_WRITE_ON_PROCESS_OUTPUT = "rww"
    CONSTANT = "const"

    @property
    def readable(self) -> bool:
        """Return whether SDO may read the object."""
        return self is not Access.WRITE_ONLY

    @property
    def writable(self) -> bool:
        """Return whether SDO may write the object."""
        return self not in (Access.READ_ONLY, Access.CONSTANT)


class Entry(msgspec.Struct, frozen=True):
    """One sub-index of one object.

    low, high: limits of values written by SDO; None for the range of the data type. follows_node_id: the
    default is a ``$NODEID`` formula.
    """

    index: int
    subindex: int
    name: str
    data_type: DataType
    access: Access
    default: Value
    low: int | None
    high: int | None
    pdo_mappable: bool
    follows_node_id: bool

    @property
    def key(self) -> ObjectKey:
        """Index and sub-index."""
        return self.index, self.subindex

    @property
    def size_bytes(self) -> int | None:
        """The length on the bus in bytes; None when it varies (strings)."""
        packer = STRUCTS.get(self.data_type)
        return None if packer is None else packer.size

    def check(self, value: Value) -> None:
        """Raise BusError when the value is not of the entry's data type."""
        if not isinstance(value, int) or value not in RANGES.get(self.data_type, ()):
            self.encode(value)

    def encode(self, value: Value) -> bytes:
        """Return the value's bytes, little endian.

        Raises BusError when the value is not of the entry's data type or outside its range.
        """
        try:
            if self.data_type is DataType.VISIBLE_STRING:
                return str(value).encode("ascii")
            return STRUCTS[self.data_type].pack(value)
        except (struct.error, UnicodeEncodeError):
            raise BusError(
                f"object {self}: {value!r} does not fit {self.data_type.name}: give a value in its range"
            ) from None

    def decode(self, data: bytes) -> Value:
        """Return the value in `data`. Raises BusError when the length is not that of the data type."""
        if self.data_type is DataType.VISIBLE_STRING:
            return data.decode("latin-1")
        if len(data) != self.size_bytes:
            raise BusError(
                f"object {self}: {len(data)} bytes, but {self.data_type.name} has {self.size_bytes}: "
                "use the same EDS on both sides"
            )
        value: int = STRUCTS[self.data_type].unpack(data)[0]
        return value

    def __str__(self) -> str:
        return f"{self.index:04X}h:{self.subindex:02X} ({self.name})"


class ObjectDictionary(msgspec.Struct, frozen=True):
    """Every entry of one device, with ``$NODEID`` formulas evaluated for `node_id`.

    checksum: 16 hexadecimal digits of the file's hash. bit_rates_kbit_s: those of [DeviceInfo].
    has_fd: the bus carries CAN FD frames, so that the device may send its CAN FD PDOs.
    """

    node_id: int
    source: str
    checksum: str
    entries: Mapping[ObjectKey, Entry]
    indices: frozenset[int]
    bit_rates_kbit_s: frozenset[int]
    has_fd: bool = False

    def for_node(self, node_id: int) -> ObjectDictionary:
        """Return the dictionary of the same device with another node id."""
        if node_id == self.node_id:
            return self
        shift = node_id - self.node_id
        entries = {
            key: msgspec.structs.replace(entry, default=entry.default + shift)
            if entry.follows_node_id and isinstance(entry.default, int)
            else entry
            for key, entry in self.entries.items()
        }
        return msgspec.structs.replace(self, node_id=node_id, entries=entries)

    def with_defaults(self, defaults: Mapping[ObjectKey, Value]) -> ObjectDictionary:
        """Return the dictionary with other defaults of these objects. Raises BusError when one is missing."""
        changed = {
            key: msgspec.structs.replace(self.entry(*key), default=value) for key, value in defaults.items()
        }
        return msgspec.structs.replace(self, entries={**self.entries, **changed})

    def entry(self, index: int, subindex: int = 0) -> Entry:
        """Return an entry. Raises BusError with the file's name when there is none."""
        found = self.entries.get((index, subindex))
        if found is None:
            raise BusError(
                f"object {index:04X}h:{subindex:02X} is not in {self.source}: use one that it describes"
            )
        return found

    def default_number(self, index: int, subindex: int = 0) -> int:
        """Return the default of a numeric entry (COB-ID, mapping word). Raises BusError for a text."""
        value = self.entry(index, subindex).default
        if not isinstance(value, int):
            raise BusError(
                f"object {index:04X}h:{subindex:02X} of {self.source} is a text: give it an integer DataType"
            )
        return value
