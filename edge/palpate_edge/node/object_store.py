"""Values of the object dictionary of a running node, and the rules of SDO access (CiA 301)."""

from __future__ import annotations

from collections.abc import Container, Mapping

from palpate_edge.common.errors import BusError
from palpate_edge.node.object_dictionary import RANGES, DataType, Entry, ObjectDictionary, ObjectKey, Value
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

ERROR_HISTORY = 0x1003
CONFIGURATION_SIGNATURE = 0x1020
SIGNATURE_KEYS = ((CONFIGURATION_SIGNATURE, 1), (CONFIGURATION_SIGNATURE, 2))


class ObjectStore:
    """One value for each entry of `od`, initially its default.

    saved: stored values (1010h), which a reset restores instead of the defaults.
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
        """Set another node id; defaults that depend on it change, and values equal to their old default."""
        if node_id == self.od.node_id:
            return
        old, self.od = self.od, self.od.for_node(node_id)
        for key, entry in old.entries.items():
            if self.values[key] == entry.default:
                self.values[key] = self.od.entries[key].default

    def number(self, index: int, subindex: int = 0) -> int:
        """Return the value of a numeric entry. Raises BusError when there is none."""
        value = self.values.get((index, subindex))
        if not isinstance(value, int):
            raise BusError(
                f"{self.od.source} has no numeric object {index:04X}h:{subindex:02X}: correct the EDS"
            )
        return value

    def optional_number(self, index: int, subindex: int = 0) -> int:
        """Return the value of a numeric entry, 0 when the EDS does not contain it."""
        value = self.values.get((index, subindex), 0)
        return value if isinstance(value, int) else 0

    def has(self, index: int) -> bool:
        """Return whether the EDS has an object with this index."""
        return index in self.od.indices

    def write(self, index: int, subindex: int, value: Value) -> None:
        """Write for the application, with any access type.

        Raises BusError when the data type does not fit.
        """
        self.od.entry(index, subindex).check(value)
        self.values[index, subindex] = value

    def write_all(self, objects: Mapping[ObjectKey, Value]) -> None:
        """Write like :meth:`write`, either all objects or none."""
        ranges = self._ranges
        for key, value in objects.items():
            if value not in ranges.get(key, ()):
                self.od.entry(*key).check(value)
        self.values.update(objects)

    @property
    def is_signed(self) -> bool:
        """Return whether 1020h has a signature: the configuration is as a master verified it."""
        return any(self.values.get(key) for key in SIGNATURE_KEYS)

    def clear_signature(self) -> None:
        """Set 1020h to 0: the configuration has changed."""
        self.values.update({key: 0 for key in SIGNATURE_KEYS if key in self.values})

    def restore(self, indices: Container[int]) -> None:
        """Reset objects in `indices` to their saved or default values, as at power-on.

        Objects that only the application writes keep their values.
        """
        entries, saved = self.od.entries, self.saved
        for key in self._writable:
            if key[0] in indices:
                self.values[key] = saved[key] if key in saved else entries[key].default

    def sdo_entry(self, index: int, subindex: int) -> Entry:
        """Return the entry of an SDO request. Raises SdoAbortError when there is none."""
        entry = self.od.entries.get((index, subindex))
        if entry is None:
            known = index in self.od.indices
            raise SdoAbortError(AbortCode.NO_SUBINDEX if known else AbortCode.NO_OBJECT)
        return entry

    def sdo_upload(self, index: int, subindex: int) -> bytes:
        """Return the bytes that a master reads. Raises SdoAbortError when the object is not readable."""
        entry = self.sdo_entry(index, subindex)
        if not entry.access.readable:
            raise SdoAbortError(AbortCode.WRITE_ONLY)
        if index == ERROR_HISTORY and subindex > self.number(ERROR_HISTORY):
            raise SdoAbortError(AbortCode.NO_DATA)
        return entry.encode(self.values[entry.key])

    def sdo_writable_entry(self, index: int, subindex: int) -> Entry:
        """Return the entry that a master is about to write. Raises SdoAbortError when it is not writable."""
        entry = self.sdo_entry(index, subindex)
        if not entry.access.writable:
            raise SdoAbortError(AbortCode.READ_ONLY)
        return entry


def sdo_value(entry: Entry, data: bytes) -> Value:
    """Decode bytes written by a master. Raises SdoAbortError when their length or value is not allowed."""
    if entry.data_type is DataType.VISIBLE_STRING:
        if not data.isascii():
            raise SdoAbortError(AbortCode.VALUE_INVALID)
        return data.decode("ascii")
    check_length(entry, len(data))
    value = entry.decode(data)
    check_limits(entry, value)
    return value


def check_limits(entry: Entry, value: Value) -> None:
    """Raise SdoAbortError when a number is beyond the limits of the EDS."""
    if isinstance(value, int):
        if entry.high is not None and value > entry.high:
            raise SdoAbortError(AbortCode.VALUE_TOO_HIGH)
        if entry.low is not None and value < entry.low:
            raise SdoAbortError(AbortCode.VALUE_TOO_LOW)


def check_length(entry: Entry, length_bytes: int) -> None:
    """Raise SdoAbortError when `length_bytes` is not the entry's size."""
    size_bytes = entry.size_bytes
    if size_bytes is None or length_bytes == size_bytes:
        return
    raise SdoAbortError(AbortCode.TOO_LONG if length_bytes > size_bytes else AbortCode.TOO_SHORT)
