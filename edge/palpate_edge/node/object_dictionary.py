"""The object dictionary: what a CiA 306 electronic data sheet (EDS) says of each object, typed and immutable.

The ``canopen`` package parses the file; what it parses becomes :class:`Entry` values that know how to turn
themselves into bytes. Values that change while a node runs live in ``object_store.py``.
"""

from __future__ import annotations

import configparser
import hashlib
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from functools import cache
from pathlib import Path

import canopen
from canopen.objectdictionary import ODArray, ODRecord, ODVariable

from palpate_edge.errors import BusError, ConfigError

Value = int | str
ObjectKey = tuple[int, int]
"""Index and sub-index."""

UNCONFIGURED_NODE_ID = 255
"""What LSS (CiA 305) calls the node id of a node that has none yet."""

FINGERTIP_EDS = Path(__file__).with_name("fingertip.eds")


class DataType(IntEnum):
    """The data types of CiA 301 (table of object 0001h ff.) that these nodes use."""

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
"""The integers of each data type."""


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
        return self is not Access.WRITE_ONLY

    @property
    def writable(self) -> bool:
        return self not in (Access.READ_ONLY, Access.CONSTANT)


@dataclass(frozen=True, slots=True)
class Entry:
    """One sub-index of one object.

    low, high: bounds of what SDO may write; None: the type's own range. follows_node_id: the default is a
    ``$NODEID`` formula.
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
        return self.index, self.subindex

    @property
    def size_bytes(self) -> int | None:
        """Bytes on the bus; None where the length varies (strings)."""
        packer = STRUCTS.get(self.data_type)
        return None if packer is None else packer.size

    def check(self, value: Value) -> None:
        """Raises BusError when the value is not of the entry's data type."""
        if not isinstance(value, int) or value not in RANGES.get(self.data_type, ()):
            self.encode(value)

    def encode(self, value: Value) -> bytes:
        """The value's bytes, little endian.

        Raises BusError when the value is not of the entry's data type or outside its range.
        """
        try:
            if self.data_type is DataType.VISIBLE_STRING:
                return str(value).encode("ascii")
            return STRUCTS[self.data_type].pack(value)
        except (struct.error, UnicodeEncodeError):
            raise BusError(
                f"object {self}: {value!r} does not fit {self.data_type.name}; give a value in its range"
            ) from None

    def decode(self, data: bytes) -> Value:
        """The value in `data`. Raises BusError when the length is not that of the data type."""
        if self.data_type is DataType.VISIBLE_STRING:
            return data.decode("latin-1")
        if len(data) != self.size_bytes:
            raise BusError(
                f"object {self}: {len(data)} bytes, but {self.data_type.name} has {self.size_bytes}; "
                "check that both sides use the same EDS"
            )
        value: int = STRUCTS[self.data_type].unpack(data)[0]
        return value

    def __str__(self) -> str:
        return f"{self.index:04X}h:{self.subindex:02X} ({self.name})"


@dataclass(frozen=True, slots=True)
class ObjectDictionary:
    """Every entry of one device, with ``$NODEID`` formulas worked out for `node_id`.

    checksum: 16 hexadecimal digits that name the file's content. bit_rates_kbit_s: of [DeviceInfo].
    """

    node_id: int
    source: str
    checksum: str
    entries: Mapping[ObjectKey, Entry]
    indices: frozenset[int]
    bit_rates_kbit_s: frozenset[int]

    def for_node(self, node_id: int) -> ObjectDictionary:
        """The same device with another node id."""
        if node_id == self.node_id:
            return self
        shift = node_id - self.node_id
        entries = {
            key: replace(entry, default=entry.default + shift)
            if entry.follows_node_id and isinstance(entry.default, int)
            else entry
            for key, entry in self.entries.items()
        }
        return replace(self, node_id=node_id, entries=entries)

    def entry(self, index: int, subindex: int = 0) -> Entry:
        """The entry. Raises BusError naming the file when there is none."""
        found = self.entries.get((index, subindex))
        if found is None:
            raise BusError(
                f"object {index:04X}h:{subindex:02X} is not in {self.source}; use one that it lists"
            )
        return found

    def default_number(self, index: int, subindex: int = 0) -> int:
        """The default of a numeric entry (COB-IDs, mapping words)."""
        value = self.entry(index, subindex).default
        if not isinstance(value, int):
            raise BusError(f"object {index:04X}h:{subindex:02X} of {self.source} is text; name a number")
        return value


def load_eds(path: Path, node_id: int) -> ObjectDictionary:
    """Read an EDS for the node `node_id`: 1-127, or 255 for a node that LSS has yet to name.

    Raises ConfigError, naming the file and the object, when it cannot be read or describes what these
    nodes cannot serve.
    """
    if not 1 <= node_id <= 127 and node_id != UNCONFIGURED_NODE_ID:
        raise ConfigError(f"node id {node_id} is not in 1..127; set `node_id` to a free number of the bus")
    try:
        checksum = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
        od = _parsed(path, checksum).for_node(node_id)
        for entry in od.entries.values():
            if entry.follows_node_id:
                entry.check(entry.default)
    except OSError as error:
        raise ConfigError(f"EDS {path} cannot be read: {error.strerror}; check the path") from error
    except BusError as error:
        raise ConfigError(f"EDS {path}: {error}") from error
    return od


@cache
def _parsed(path: Path, checksum: str) -> ObjectDictionary:
    """The file with this content, for node 1. A hand has a dozen nodes of two files: each is parsed once."""
    try:
        parsed = canopen.import_od(str(path), node_id=1)
    except (configparser.Error, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())
        raise ConfigError(f"EDS {path} is not a CiA 306 file: {reason}; restore it") from error
    entries = {}
    for variable in _variables(parsed):
        entry = _entry(path, variable)
        entries[entry.key] = entry
    if not entries:
        raise ConfigError(f"EDS {path} describes no object; give a CiA 306 file")
    return ObjectDictionary(
        node_id=1,
        source=path.name,
        checksum=checksum,
        entries=entries,
        indices=frozenset(index for index, _ in entries),
        bit_rates_kbit_s=frozenset(rate // 1000 for rate in parsed.device_information.allowed_baudrates),
    )


def _variables(parsed: canopen.ObjectDictionary) -> Iterator[ODVariable]:
    for item in parsed.values():
        if isinstance(item, (ODRecord, ODArray)):
            yield from item.subindices.values()
        else:
            yield item


def _entry(path: Path, variable: ODVariable) -> Entry:
    where = f"EDS {path}, object {variable.index:04X}h:{variable.subindex:02X}"
    try:
        data_type = DataType(variable.data_type or 0)
        access = Access(variable.access_type)
    except ValueError as error:
        raise ConfigError(f"{where}: {error}; use a type and access that this node serves") from error
    default: Value | None = variable.default
    if default is None:
        # The parser drops a default that it cannot read; an empty one is allowed by CiA 306.
        written = getattr(variable, "default_raw", "")
        if written.strip():
            raise ConfigError(f"{where}: DefaultValue {written!r} is not a number; correct it")
        default = "" if data_type is DataType.VISIBLE_STRING else 0
    entry = Entry(
        index=variable.index,
        subindex=variable.subindex,
        name=variable.name,
        data_type=data_type,
        access=access,
        default=default,
        low=variable.min,
        high=variable.max,
        pdo_mappable=bool(variable.pdo_mappable),
        follows_node_id=variable.relative,
    )
    try:
        entry.encode(default)
    except BusError as error:
        raise ConfigError(f"EDS {path}: {error}") from error
    return entry
