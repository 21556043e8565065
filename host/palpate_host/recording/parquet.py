"""The rows of table.py as a Parquet file, in the types of LeRobot's datasets.

``observation.state`` and ``action`` are vectors of float32, one a row, and ``timestamp`` is float32. The
schema's metadata ``names`` is JSON with the names of each vector's elements. An unknown value is NaN.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from palpate_edge.common.atomic_write import atomic_file
from palpate_edge.common.errors import ConfigError
from palpate_host.common.status import HostStatus
from palpate_host.recording.table import Cell, rows

ROWS_A_GROUP = 10_000
Row = dict[str, Cell | list[float]]


def write_parquet(path: Path, statuses: Iterable[HostStatus]) -> int:
    """Write one row per status; return their number. Raises ConfigError when the file system refuses."""
    table = rows(statuses)
    first = next(table, None)
    if first is None:
        raise ConfigError(f"{path}: nothing to write: the source has no tick: record while a host runs")
    vectors = vector_names(first)
    fields = [(name, _type(name)) for name in _packed(first, vectors)]
    fields = [
        (name, pa.list_(pa.float32(), len(vectors[name])) if name in vectors else kind)
        for name, kind in fields
    ]
    schema = pa.schema(fields, metadata={"names": msgspec.json.encode(vectors)})
    count = 0
    with atomic_file(path, ConfigError) as file, pq.ParquetWriter(file, schema) as writer:
        for group in _groups(itertools.chain([first], table)):
            writer.write_table(pa.Table.from_pylist([_packed(row, vectors) for row in group], schema))
            count += len(group)
    return count


def vector_names(row: dict[str, Cell]) -> dict[str, list[str]]:
    """Return the elements of each vector column: the numbers of `row` whose name is VECTOR.ELEMENT."""
    found: dict[str, list[str]] = {}
    for name, value in row.items():
        vector, _, element = name.rpartition(".")
        if vector.startswith(("observation.", "action")) and not isinstance(value, bool):
            found.setdefault(vector, []).append(element)
    return found


def _packed(row: dict[str, Cell], vectors: dict[str, list[str]]) -> Row:
    packed: Row = {}
    for name, value in row.items():
        vector, _, element = name.rpartition(".")
        if element not in vectors.get(vector, ()):
            packed[name] = math.nan if value is None and _type(name) == pa.float32() else value
        elif vector not in packed:
            cells = [row[f"{vector}.{one}"] for one in vectors[vector]]
            packed[vector] = [math.nan if cell is None else float(cell) for cell in cells]
    return packed


def _groups(table: Iterator[dict[str, Cell]]) -> Iterator[list[dict[str, Cell]]]:
    while group := list(itertools.islice(table, ROWS_A_GROUP)):
        yield group


def _type(name: str) -> pa.DataType:
    if name == "mode":
        return pa.string()
    if name.endswith("index"):
        return pa.int64()
    return pa.bool_() if name.endswith(("in_contact", "slip")) else pa.float32()
