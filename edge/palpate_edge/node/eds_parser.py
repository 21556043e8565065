"""Parser of electronic data sheets, by the ``canopen`` package.

python -m palpate_edge.node.eds_parser   # after a change of fingertip.eds: write fingertip.parsed.json
"""

from __future__ import annotations

import configparser
from collections.abc import Iterator
from pathlib import Path

import canopen
import msgspec
from canopen.objectdictionary import ODArray, ODRecord, ODVariable

from palpate_edge.common.errors import BusError, ConfigError
from palpate_edge.node.object_dictionary import Access, DataType, Entry, Value
from palpate_edge.node.parsed_eds import FINGERTIP_EDS, ParsedEds, checksum_of, parsed_path


def parse(path: Path, checksum: str) -> ParsedEds:
    """Parse the file with this checksum. Raises ConfigError with file and object, or OSError."""
    try:
        parsed = canopen.import_od(str(path), node_id=1)
    except (configparser.Error, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())
        raise ConfigError(f"EDS {path} is not a CiA 306 file ({reason}): restore it") from error
    entries = tuple(_entry(path, variable) for variable in _variables(parsed))
    if not entries:
        raise ConfigError(f"EDS {path} describes no object: give a CiA 306 file")
    return ParsedEds(
        checksum=checksum,
        entries=entries,
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
        raise ConfigError(
            f"{where}: {error}: use a data type and an access type that this node supports"
        ) from error
    default: Value | None = variable.default
    if default is None:
        # The parser drops a default that it cannot read; CiA 306 allows an empty one.
        written = getattr(variable, "default_raw", "")
        if written.strip():
            raise ConfigError(f"{where}: DefaultValue {written!r} is not a number: correct it")
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


def main() -> None:
    """Write the parsed form of fingertip.eds beside the file."""
    parsed = parse(FINGERTIP_EDS, checksum_of(FINGERTIP_EDS))
    parsed_path(FINGERTIP_EDS).write_bytes(msgspec.json.encode(parsed, order="deterministic"))


if __name__ == "__main__":
    main()
