"""The values behind the object dictionary of a running node, and the rules for access by SDO (CiA 301)."""

from __future__ import annotations

from collections.abc import Container

from palpate_edge.errors import BusError
from palpate_edge.node.object_dictionary import DataType, Entry, ObjectDictionary, ObjectKey, Value
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError


class ObjectStore:
    """One value for each entry of `od`, the defaults at first."""

    def __init__(self, od: ObjectDictionary) -> None:
        self.od = od
        self.values: dict[ObjectKey, Value] = {key: entry.default for key, entry in od.entries.items()}

    def number(self, index: int, subindex: int = 0) -> int:
        """The value of a numeric entry. Raises BusError when there is none."""
        value = self.values.get((index, subindex))
        if not isinstance(value, int):
            raise BusError(f"{self.od.source} has no number {index:04X}h:{subindex:02X}; correct the EDS")
        return value

    def write(self, index: int, subindex: int, value: Value) -> None:
        """The application's write: any access type, but only what fits the data type (else BusError)."""
        entry = self.od.entry(index, subindex)
        entry.encode(value)
        self.values[entry.key] = value

    def restore_defaults(self, indices: Container[int]) -> None:
        """Undo what a master wrote to objects in `indices`; what only the application writes stays."""
        for key, entry in self.od.entries.items():
            if entry.access.writable and entry.index in indices:
                self.values[key] = entry.default

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
