"""jig.csv: the holes of the jig of a sensor, beside its sensor.toml (docs/jig.md)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.truth_table import check_length, read_rows
from palpate_edge.datasets.weights_table import direction_deg
from palpate_edge.jig.jig_plan import Hole

JIG = "jig.csv"
COLUMNS = ["hole", "theta_deg", "phi_deg"]


def jig_table_text(holes: Sequence[Hole]) -> str:
    """Return the content of a jig.csv."""
    rows = (f"{hole.number},{hole.theta_deg:g},{hole.phi_deg:g}" for hole in holes)
    return "\n".join([",".join(COLUMNS), *rows]) + "\n"


def read_jig_table(path: Path) -> tuple[Hole, ...]:
    """Read the holes in the order of the file. Raises DatasetError with the line and the column."""
    rows = read_rows(path, "docs/jig.md")
    if not rows or rows[0] != COLUMNS:
        raise DatasetError(f"{path}: the first line must be {','.join(COLUMNS)}")
    holes = tuple(_hole(f"{path}, line {number}", row) for number, row in enumerate(rows[1:], 2) if row)
    if not holes:
        raise DatasetError(f"{path} has no hole: write it with palpate-edge jig")
    return holes


def _hole(where: str, row: list[str]) -> Hole:
    check_length(where, row, COLUMNS)
    number, theta, phi = row
    if not number.isascii() or not number.isdigit():
        raise DatasetError(f"{where}: hole = {number} is not a number")
    return Hole(int(number), *direction_deg(where, theta, phi))
