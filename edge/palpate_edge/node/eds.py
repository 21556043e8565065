"""Loading of an electronic data sheet (EDS, CiA 306) as the object dictionary of one node.

Importing the parser and parsing the file takes a tenth of a fingertip's start. The output of
``eds_parser.py`` may therefore be stored next to the file (``fingertip.parsed.json``). It is used only if its
checksum is that of the file.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import msgspec

from palpate_edge.common.errors import BusError, ConfigError
from palpate_edge.node.object_dictionary import UNCONFIGURED_NODE_ID, ObjectDictionary
from palpate_edge.node.parsed_eds import ParsedEds, checksum_of, parsed_path


def load_eds(path: Path, node_id: int) -> ObjectDictionary:
    """Read an EDS for the node `node_id`: 1 to 127, or 255 for a node that gets its id by LSS.

    Raises ConfigError with file and object when the file cannot be read or describes an object that these
    nodes do not support.
    """
    if not 1 <= node_id <= 127 and node_id != UNCONFIGURED_NODE_ID:
        raise ConfigError(f"node id {node_id} is not in 1..127: set `node_id` to a free id on the bus")
    try:
        od = _dictionary(path, checksum_of(path)).for_node(node_id)
        for entry in od.entries.values():
            if entry.follows_node_id:
                entry.check(entry.default)
    except OSError as error:
        raise ConfigError(f"EDS {path} cannot be read ({error.strerror}): check the path") from error
    except BusError as error:
        raise ConfigError(f"EDS {path}: {error}") from error
    return od


@cache
def _dictionary(path: Path, checksum: str) -> ObjectDictionary:
    """Return the dictionary of the file with this checksum, for node 1.

    Cached, since a hand has a dozen nodes with two EDS files.
    """
    parsed = _parsed_before(path, checksum)
    if parsed is None:
        from palpate_edge.node.eds_parser import parse  # noqa: PLC0415 - not needed by a fingertip

        parsed = parse(path, checksum)
    return ObjectDictionary(
        node_id=1,
        source=path.name,
        checksum=checksum,
        entries={entry.key: entry for entry in parsed.entries},
        indices=frozenset(entry.index for entry in parsed.entries),
        bit_rates_kbit_s=parsed.bit_rates_kbit_s,
    )


def _parsed_before(path: Path, checksum: str) -> ParsedEds | None:
    try:
        parsed = msgspec.json.decode(parsed_path(path).read_bytes(), type=ParsedEds)
    except (OSError, msgspec.DecodeError):
        return None
    return parsed if parsed.checksum == checksum else None
