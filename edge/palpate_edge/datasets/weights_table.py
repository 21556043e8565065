"""weights.csv: which frame shows the dome under how many grams, at the apex or where a jig's rod pressed
(docs/press-dataset.md)."""

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
PLACE = ["theta_deg", "phi_deg"]
"""Optional columns after those: where the rod of a jig pressed; blank for the apex."""

MOST_THETA_DEG = 90.0
NEWTONS_PER_GRAM = 9.80665e-3  # standard gravity; it differs by up to 0.3 % over the Earth
LARGEST_G = 1e5


@dataclass(frozen=True, slots=True)
class WeightRow:
    """A frame, the mass in grams on the dome or on the scale's display (0: untouched), and the split.

    theta_deg, phi_deg: polar angle and azimuth of the press; None: near the apex, the place is not known.
    """

    frame: str
    mass_g: float
    split: str = "train"
    theta_deg: float | None = None
    phi_deg: float | None = None


def read_weight_rows(path: Path) -> list[WeightRow]:
    """Read all rows; the column split may be absent. Raises DatasetError with the line and the column."""
    rows = read_rows(path, "docs/press-dataset.md")
    columns = rows[0] if rows else []
    if columns not in (COLUMNS, COLUMNS[:2], [*COLUMNS, *PLACE]):
        raise DatasetError(
            f"{path}: the first line must be {','.join(COLUMNS)}, or that without split, or with "
            f"{','.join(PLACE)} after it"
        )
    return [_row(f"{path}, line {number}", row, columns) for number, row in enumerate(rows[1:], 2) if row]


def _row(where: str, row: list[str], columns: Sequence[str]) -> WeightRow:
    check_length(where, row, columns)
    frame, mass, split = (*row, "train")[:3]
    place = row[3:]
    check_frame_and_split(where, frame, split)
    mass_g = finite_number(where, "mass_g", mass)
    if not 0 <= mass_g <= LARGEST_G:
        raise DatasetError(f"{where}: mass_g = {mass} is out of range: it must be 0 to {LARGEST_G:g}")
    if not any(place):
        return WeightRow(frame, mass_g, split)
    return WeightRow(frame, mass_g, split, *direction_deg(where, *place))


def direction_deg(where: str, theta: str, phi: str) -> tuple[float, float]:
    """Return polar angle and azimuth of two cells. Raises DatasetError."""
    theta_deg, phi_deg = finite_number(where, "theta_deg", theta), finite_number(where, "phi_deg", phi)
    if not 0 <= theta_deg <= MOST_THETA_DEG:
        raise DatasetError(
            f"{where}: theta_deg = {theta} is out of range: it must be 0 to {MOST_THETA_DEG:g}"
        )
    if not -360 <= phi_deg <= 360:
        raise DatasetError(f"{where}: phi_deg = {phi} is out of range: it must be -360 to 360")
    return theta_deg, phi_deg


def weights_text(rows: Sequence[WeightRow]) -> str:
    """Return the content of a weights.csv."""
    columns = COLUMNS if all(row.theta_deg is None for row in rows) else [*COLUMNS, *PLACE]
    return "\n".join([",".join(columns), *(",".join(_cells(row)[: len(columns)]) for row in rows)]) + "\n"


def _cells(row: WeightRow) -> list[str]:
    place = ["" if angle is None else f"{angle:g}" for angle in (row.theta_deg, row.phi_deg)]
    return [row.frame, f"{row.mass_g:g}", row.split, *place]
