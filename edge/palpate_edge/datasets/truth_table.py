"""Rows of a truth.csv, and the checks that press datasets and pose datasets share."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from palpate_edge.common.errors import DatasetError, reason_of
from palpate_edge.common.type_text import value_text

SPLITS = frozenset({"train", "test"})


def read_rows(path: Path, guide: str) -> list[list[str]]:
    """Return all lines of a CSV file as cells. Raises DatasetError; guide: page that describes the file."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return list(csv.reader(file))
    except OSError as error:
        raise DatasetError(f"{path}: {reason_of(error)}") from None
    except (UnicodeDecodeError, csv.Error):
        raise DatasetError(f"{path} is not a CSV file in UTF-8: write it as in {guide}") from None


def check_length(where: str, row: Sequence[str], columns: Sequence[str]) -> None:
    """Refuse a row that has not one field a column. Raises DatasetError."""
    if len(row) != len(columns):
        raise DatasetError(f"{where} has {len(row)} fields, not {len(columns)}: the file may be cut short")


def check_frame_and_split(where: str, frame: str, split: str) -> None:
    """Refuse a frame that is no plain file name, and an unknown split. Raises DatasetError."""
    if Path(frame).name != frame or frame in {"", ".."} or "\0" in frame:
        raise DatasetError(f"{where}: frame = {value_text(frame)} is not a file name")
    if split not in SPLITS:
        raise DatasetError(f"{where}: split = {value_text(split)} is not one of train, test")


def finite_number(where: str, column: str, text: str, way_out: str = "") -> float:
    """Return a cell as a number. Raises DatasetError, which ends in `way_out`, where it is none."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DatasetError(f"{where}: {column} = {value_text(text)} is not a finite number{way_out}")
    return value


def check_split_has_rows(folder: Path, split: str, rows: Sequence[object]) -> None:
    """Refuse to evaluate a split without rows. Raises DatasetError."""
    if not rows:
        raise DatasetError(
            f"{folder / 'truth.csv'} has no row of the split {split!r}: give another --split (train or test)"
        )
