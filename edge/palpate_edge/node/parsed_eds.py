"""Contents of a parsed EDS, stored next to the file so that a fingertip starts without a parser."""

from __future__ import annotations

import hashlib
from pathlib import Path

import msgspec

from palpate_edge.node.object_dictionary import Entry

FINGERTIP_EDS = Path(__file__).with_name("fingertip.eds")


class ParsedEds(msgspec.Struct, frozen=True):
    """Contents of an EDS, with ``$NODEID`` formulas evaluated for node 1.

    checksum: 16 hexadecimal digits of the file's hash. bit_rates_kbit_s: those of [DeviceInfo].
    """

    checksum: str
    entries: tuple[Entry, ...]
    bit_rates_kbit_s: frozenset[int]


def checksum_of(path: Path) -> str:
    """Return the value of `ParsedEds.checksum` for this file. Raises OSError."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def parsed_path(eds: Path) -> Path:
    """Return the path of the parsed contents of `eds`, which may not exist."""
    return eds.with_suffix(".parsed.json")
