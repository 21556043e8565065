"""The rows of table.py as a Parquet file."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from palpate_edge.errors import ConfigError
from palpate_host.recording.table import Cell, rows
from palpate_host.status import HostStatus

ROWS_A_GROUP = 10_000


def write_parquet(path: Path, statuses: Iterable[HostStatus]) -> int:
    """The number of rows written; ConfigError when the file cannot be."""
    table = rows(statuses)
    first = next(table, None)
    if first is None:
        raise ConfigError(f"{path}: nothing to write: the log holds no tick of the host")
    schema = pa.schema([(name, _type(name)) for name in first])
    count = 0
    try:
        with pq.ParquetWriter(path, schema) as writer:
            for group in _groups(itertools.chain([first], table)):
                writer.write_table(pa.Table.from_pylist(group, schema))
                count += len(group)
    except OSError as exc:
        raise ConfigError(f"{path}: cannot be written ({exc.strerror}): give another -o") from exc
    return count


def _groups(table: Iterator[dict[str, Cell]]) -> Iterator[list[dict[str, Cell]]]:
    while group := list(itertools.islice(table, ROWS_A_GROUP)):
        yield group


def _type(name: str) -> pa.DataType:
    if name == "mode":
        return pa.string()
    if name.endswith("index"):
        return pa.int64()
    return pa.bool_() if name.endswith(("in_contact", "slip")) else pa.float64()
