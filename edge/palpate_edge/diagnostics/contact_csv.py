"""The CSV of ``palpate-edge estimate``: one row a frame, a contract that stays as it is."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

from palpate_edge.common.atomic_write import whole_file
from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import DatasetError

COLUMNS = (
    "frame",
    "contact",
    "x_mm",
    "y_mm",
    "z_mm",
    "fn_N",
    "fx_N",
    "fy_N",
    "fz_N",
    "quality",
    "ms",
    "reason",
    "radius95_mm",
)


def write_contacts(path: Path, rows: Iterable[tuple[str, Contact, float]]) -> None:
    """Write (frame name, contact, milliseconds) rows; the file appears whole, at the end, or not at all."""
    with (
        whole_file(path, DatasetError) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(_row(*row) for row in rows)


def _row(name: str, contact: Contact, milliseconds: float) -> list[str]:
    position = contact.position_mm or (None, None, None)
    force = contact.force_N or (None, None, None)
    return [
        name,
        str(int(contact.in_contact)),
        *(_number(value, 4) for value in position),
        _number(contact.normal_force_N, 5),
        *(_number(value, 5) for value in force),
        _number(contact.quality, 3),
        _number(milliseconds, 3),
        contact.reason,
        _number(contact.radius95_mm, 3),
    ]


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
