"""Data types of CiA 301 (objects 0001h to 001Bh) and the notation of their values in CiA 306."""

from __future__ import annotations

import re
from dataclasses import dataclass

Value = int | float | str


@dataclass(frozen=True, slots=True)
class DataTypeInfo:
    """One data type.

    bits: length, 0 when it varies. low, high: range of an integer type, None for other types.
    """

    name: str
    bits: int
    low: int | None = None
    high: int | None = None

    @property
    def is_integer(self) -> bool:
        return self.low is not None

    @property
    def is_text(self) -> bool:
        return self.bits == 0


def _signed(bits: int) -> DataTypeInfo:
    return DataTypeInfo(f"INTEGER{bits}", bits, -(1 << (bits - 1)), (1 << (bits - 1)) - 1)


def _unsigned(bits: int) -> DataTypeInfo:
    return DataTypeInfo(f"UNSIGNED{bits}", bits, 0, (1 << bits) - 1)


DATA_TYPES: dict[int, DataTypeInfo] = {
    0x01: DataTypeInfo("BOOLEAN", 1, 0, 1),
    0x02: _signed(8),
    0x03: _signed(16),
    0x04: _signed(32),
    0x05: _unsigned(8),
    0x06: _unsigned(16),
    0x07: _unsigned(32),
    0x08: DataTypeInfo("REAL32", 32),
    0x09: DataTypeInfo("VISIBLE_STRING", 0),
    0x0A: DataTypeInfo("OCTET_STRING", 0),
    0x0B: DataTypeInfo("UNICODE_STRING", 0),
    0x0C: DataTypeInfo("TIME_OF_DAY", 48),
    0x0D: DataTypeInfo("TIME_DIFFERENCE", 48),
    0x0F: DataTypeInfo("DOMAIN", 0),
    0x10: _signed(24),
    0x11: DataTypeInfo("REAL64", 64),
    0x12: _signed(40),
    0x13: _signed(48),
    0x14: _signed(56),
    0x15: _signed(64),
    0x16: _unsigned(24),
    0x18: _unsigned(40),
    0x19: _unsigned(48),
    0x1A: _unsigned(56),
    0x1B: _unsigned(64),
}
BOOLEAN, UNSIGNED8, UNSIGNED16, UNSIGNED32, VISIBLE_STRING, DOMAIN = 0x01, 0x05, 0x06, 0x07, 0x09, 0x0F
FIRST_COMPLEX_TYPE, LAST_COMPLEX_TYPE = 0x20, 0x25F  # records, manufacturer's and profiles' own types

_NODE_ID = re.compile(r"\+?\s*\$NODEID\s*\+?", re.IGNORECASE)
_OCTAL = re.compile(r"0[0-7]+")


def parse_integer(text: str, node_id: int | None = None) -> int:
    """Parse a number in the notation of CiA 306: decimal, 0x hexadecimal, 0 octal.

    With a node id, ``$NODEID+0x180`` is accepted as well. Raises ValueError with the reason.
    """
    written = text
    offset = 0
    if node_id is not None and "$NODEID" in text.upper():
        text, count = _NODE_ID.subn(" ", text)
        if count != 1:
            raise ValueError(f"{written!r} contains $NODEID {count} times")
        text, offset = text.strip() or "0", node_id
    try:
        return (int(text, 8) if _OCTAL.fullmatch(text) else int(text, 0)) + offset
    except ValueError:
        raise ValueError(f"{written[:40]!r} is not a number") from None


def parse_value(info: DataTypeInfo, text: str, node_id: int) -> Value:
    """Parse a value of the data type. A negative value may be given as its bits in hexadecimal.

    Raises ValueError with the reason.
    """
    if info.is_text or info.name.startswith("TIME"):
        return text
    if not info.is_integer:
        try:
            return float(text)
        except ValueError:
            return float(parse_integer(text, node_id))
    number = parse_integer(text, node_id)
    assert info.low is not None and info.high is not None
    if info.low < 0 and text.lower().startswith("0x") and info.high < number < 1 << info.bits:
        number -= 1 << info.bits
    if not info.low <= number <= info.high:
        raise ValueError(f"{text[:40]} is outside the range of {info.name}, {info.low} to {info.high}")
    return number
