"""weights.csv: which frame shows the apex of the dome under how many grams (docs/press-dataset.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.truth_table import (
    check_frame_and_split,
    check_length,
    finite_number,
    read_rows,
)

WEIGHTS = "weights.csv"
COLUMNS = ["frame", "mass_g", "split"]
NEWTONS_PER_GRAM = 9.80665e-3  # standard gravity; it differs by up to 0.3 % over the Earth
LARGEST_G = 1e5


@dataclass(frozen=True, slots=True)
class WeightRow:
    """A frame, the mass in grams on the apex or on the scale's display (0: untouched), and the split."""

    frame: str
    mass_g: float
    split: str = "train"


def read_weight_rows(path: Path) -> list[WeightRow]:
    """Read all rows; the column split may be absent. Raises DatasetError with the line and the column."""
    rows = read_rows(path, "docs/press-dataset.md")
    columns = rows[0] if rows else []
    if columns not in (COLUMNS, COLUMNS[:2]):
        raise DatasetError(f"{path}: the first line must be {','.join(COLUMNS)}, or that without split")
    return [_row(f"{path}, line {number}", row, columns) for number, row in enumerate(rows[1:], 2) if row]


def _row(where: str, row: list[str], columns: Sequence[str]) -> WeightRow:
    check_length(where, row, columns)
    frame, mass, split = (*row, "train")[:3]
    check_frame_and_split(where, frame, split)
    mass_g = finite_number(where, "mass_g", mass)
    if not 0 <= mass_g <= LARGEST_G:
        raise DatasetError(f"{where}: mass_g = {mass} is out of range: it must be 0 to {LARGEST_G:g}")
    return WeightRow(frame, mass_g, split)


def weights_text(rows: Sequence[WeightRow]) -> str:
    """Return the content of a weights.csv."""
    lines = [",".join(COLUMNS), *(f"{row.frame},{row.mass_g:g},{row.split}" for row in rows)]
    return "\n".join(lines) + "\n"
