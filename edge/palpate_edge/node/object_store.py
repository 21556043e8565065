"""The values behind the object dictionary of a running node, and the rules for access by SDO (CiA 301)."""

from __future__ import annotations

from collections.abc import Container, Mapping

from palpate_edge.common.errors import BusError
from palpate_edge.node.object_dictionary import RANGES, DataType, Entry, ObjectDictionary, ObjectKey, Value
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

ERROR_HISTORY = 0x1003


class ObjectStore:
    """One value for each entry of `od`, the defaults at first.

    saved: what a reset gives in place of a default (1010h).
    """

    def __init__(self, od: ObjectDictionary) -> None:
        self.od = od
        self.values: dict[ObjectKey, Value] = {key: entry.default for key, entry in od.entries.items()}
        self.saved: Mapping[ObjectKey, Value] = {}
        self._ranges = {
            key: RANGES[entry.data_type] for key, entry in od.entries.items() if entry.data_type in RANGES
        }
        self._writable = [key for key, entry in od.entries.items() if entry.access.writable]

    def set_node_id(self, node_id: int) -> None:
        """Take over another node id: defaults that follow it move, and values that still are defaults."""
        if node_id == self.od.node_id:
            return
        old, self.od = self.od, self.od.for_node(node_id)
        for key, entry in old.entries.items():
            if self.values[key] == entry.default:
                self.values[key] = self.od.entries[key].default

    def number(self, index: int, subindex: int = 0) -> int:
        """The value of a numeric entry. Raises BusError when there is none."""
        value = self.values.get((index, subindex))
        if not isinstance(value, int):
            raise BusError(f"{self.od.source} has no number {index:04X}h:{subindex:02X}; correct the EDS")
        return value

    def optional_number(self, index: int, subindex: int = 0) -> int:
        """The value of a numeric entry that an EDS may leave out: 0 then."""
        value = self.values.get((index, subindex), 0)
        return value if isinstance(value, int) else 0

    def has(self, index: int) -> bool:
        return index in self.od.indices

    def write(self, index: int, subindex: int, value: Value) -> None:
        """The application's write: any access type, but only what fits the data type (else BusError)."""
        self.od.entry(index, subindex).check(value)
        self.values[index, subindex] = value

    def write_all(self, objects: Mapping[ObjectKey, Value]) -> None:
        """As :meth:`write`, all of them or none."""
        ranges = self._ranges
        for key, value in objects.items():
            if value not in ranges.get(key, ()):
                self.od.entry(*key).check(value)
        self.values.update(objects)

    def restore(self, indices: Container[int]) -> None:
        """Objects in `indices` as at power-on: saved or default; what only the application writes stays."""
        entries, saved = self.od.entries, self.saved
        for key in self._writable:
            if key[0] in indices:
                self.values[key] = saved[key] if key in saved else entries[key].default

    def sdo_entry(self, index: int, subindex: int) -> Entry:
        """The entry that an SDO names. Raises SdoAbortError when there is none."""
        entry = self.od.entries.get((index, subindex))
        if entry is None:
            known = index in self.od.indices
            raise SdoAbortError(AbortCode.NO_SUBINDEX if known else AbortCode.NO_OBJECT)
        return entry

    def sdo_upload(self, index: int, subindex: int) -> bytes:
        """The bytes a master reads. Raises SdoAbortError."""
        entry = self.sdo_entry(index, subindex)
        if not entry.access.readable:
            raise SdoAbortError(AbortCode.WRITE_ONLY)
        if index == ERROR_HISTORY and subindex > self.number(ERROR_HISTORY):
            raise SdoAbortError(AbortCode.NO_DATA)
        return entry.encode(self.values[entry.key])

    def sdo_writable_entry(self, index: int, subindex: int) -> Entry:
        """The entry that a master is about to write. Raises SdoAbortError."""
        entry = self.sdo_entry(index, subindex)
        if not entry.access.writable:
            raise SdoAbortError(AbortCode.READ_ONLY)
        return entry


def sdo_value(entry: Entry, data: bytes) -> Value:
    """What a master's bytes mean. Raises SdoAbortError when their length or value is not allowed."""
    if entry.data_type is DataType.VISIBLE_STRING:
        if not data.isascii():
            raise SdoAbortError(AbortCode.VALUE_INVALID)
        return data.decode("ascii")
    check_length(entry, len(data))
    value = entry.decode(data)
    if isinstance(value, int):
        if entry.high is not None and value > entry.high:
            raise SdoAbortError(AbortCode.VALUE_TOO_HIGH)
        if entry.low is not None and value < entry.low:
            raise SdoAbortError(AbortCode.VALUE_TOO_LOW)
    return value


def check_length(entry: Entry, length_bytes: int) -> None:
    """Raises SdoAbortError when `length_bytes` is not the entry's size."""
    size_bytes = entry.size_bytes
    if size_bytes is None or length_bytes == size_bytes:
        return
    raise SdoAbortError(AbortCode.TOO_LONG if length_bytes > size_bytes else AbortCode.TOO_SHORT)
