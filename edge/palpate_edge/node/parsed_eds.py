"""What is kept of a parsed EDS beside the file, so that a fingertip starts without a parser."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from palpate_edge.node.object_dictionary import Entry

FINGERTIP_EDS = Path(__file__).with_name("fingertip.eds")


@dataclass(frozen=True, slots=True)
class ParsedEds:
    """What an EDS says, its ``$NODEID`` formulas worked out for node 1.

    checksum: 16 hexadecimal digits that name the file's content. bit_rates_kbit_s: of [DeviceInfo].
    """

    checksum: str
    entries: tuple[Entry, ...]
    bit_rates_kbit_s: frozenset[int]


def checksum_of(path: Path) -> str:
    """What `ParsedEds.checksum` is of this file. Raises OSError."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def parsed_path(eds: Path) -> Path:
    """Where what was parsed of `eds` lies, if anywhere."""
    return eds.with_suffix(".parsed.json")
