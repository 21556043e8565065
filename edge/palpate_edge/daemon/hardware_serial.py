"""A serial number for 1018h:04 from the board, so that LSS distinguishes fingertips without configuration."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

SOURCES = (
    Path("/proc/device-tree/serial-number"),
    Path("/sys/firmware/devicetree/base/serial-number"),
    Path("/etc/machine-id"),
)
"""Files with an identifier of the machine, the best first: of the board, then of the installation."""


def hardware_serial(name: str, sources: Sequence[Path] = SOURCES) -> int:
    """Return 32 bits that differ between machines and between the fingertips of one machine.

    name: of the fingertip. 0 when no source can be read. The identifier itself is not published: machine-id
    is confidential (machine-id(5)).
    """
    for source in sources:
        try:
            identifier = source.read_bytes().strip(b"\0\n ")
        except OSError:
            continue
        if identifier.strip(b"0"):
            digest = hashlib.sha256(b"palpate\0" + identifier + b"\0" + name.encode()).digest()
            return int.from_bytes(digest[:4], "little")
    return 0
