"""The CSV of ``palpate-edge estimate``: one row a frame; its columns are a contract, new ones go last."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

from palpate_edge.common.atomic_write import atomic_text
from palpate_edge.common.contact import Contact
from palpate_edge.common.contact_quantities import QUANTITIES
from palpate_edge.common.errors import DatasetError

MEASURED = tuple(
    (quantity, quantity.csv_digits) for quantity in QUANTITIES if quantity.csv_digits is not None
)
FORCE = ("fx_N", "fy_N", "fz_N")
FIRST_COLUMNS = (
    "frame", "contact", "x_mm", "y_mm", "z_mm", "fn_N", *FORCE, "quality", "ms", "reason"
)  # fmt: skip
LATER_COLUMNS = ("torsion95_Nmm", "force95_N")
"""Columns that came after the pose labels, before which they stand on the bus."""
_FIRST_MEASURED = (quantity.column for quantity, _ in MEASURED if quantity.column not in LATER_COLUMNS)
COLUMNS = (*dict.fromkeys([*FIRST_COLUMNS, *_FIRST_MEASURED]), *LATER_COLUMNS)


def write_contacts(path: Path, rows: Iterable[tuple[str, Contact, float]]) -> None:
    """Write (frame name, contact, milliseconds) rows; the file appears complete or not at all."""
    with atomic_text(path, DatasetError) as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(_row(*row) for row in rows)


def _row(name: str, contact: Contact, milliseconds: float) -> dict[str, str]:
    force = dict(zip(FORCE, contact.force_N or (None, None, None), strict=True))
    return {
        "frame": name,
        "contact": str(int(contact.in_contact)),
        **{quantity.column: _number(quantity.of(contact), digits) for quantity, digits in MEASURED},
        **{column: _number(value, 5) for column, value in force.items()},
        "quality": _number(contact.quality, 3),
        "ms": _number(milliseconds, 3),
        "reason": contact.reason,
    }


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
