"""Text of LSS frames (CiA 305): command specifier and argument."""

from __future__ import annotations

import struct

_PARTS = ("vendor", "product", "revision", "serial")
_WITH_NUMBER = {
    **{0x40 + i: f"switch selective, {part}" for i, part in enumerate(_PARTS)},
    0x46: "identify, vendor",
    0x47: "identify, product",
    0x48: "identify, revision from",
    0x49: "identify, revision to",
    0x4A: "identify, serial from",
    0x4B: "identify, serial to",
    **{0x5A + i: f"inquire {part}" for i, part in enumerate(_PARTS)},
}
_WITH_BYTE = {
    0x04: "switch all, mode",
    0x11: "configure node id or its result",
    0x13: "configure bit timing",
    0x15: "activate bit timing",
    0x17: "store configuration or its result",
    0x5E: "inquire node id",
}
_ALONE = {
    0x44: "switched to configuration state",
    0x4C: "identify unconfigured nodes",
    0x4F: "identified",
    0x50: "an unconfigured node responds",
}
FAST_SCAN = 0x51


def lss_text(data: bytes) -> str:
    """Return the text of an LSS frame; ``malformed`` when its length is not 8 bytes."""
    if len(data) != 8:
        return f"malformed: {len(data)} bytes, LSS has 8"
    command = data[0]
    number: int = struct.unpack_from("<I", data, 1)[0]
    if command == FAST_SCAN:
        if data[5] == 0x80:
            return "fastscan of all unconfigured nodes"
        return f"fastscan {_PARTS[data[6] & 3]} 0x{number:08X}, bit {data[5]} on, then {_PARTS[data[7] & 3]}"
    if command in _WITH_NUMBER:
        return f"{_WITH_NUMBER[command]} 0x{number:08X}"
    if command in _WITH_BYTE:
        return f"{_WITH_BYTE[command]} {data[1]}"
    return _ALONE.get(command, f"unknown command {command:02X}h")
