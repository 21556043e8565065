"""True contacts of rendered frames, and their CSV file with one row per frame."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError

COLUMNS = ("sequence", "exposed_at_us", "x_mm", "y_mm", "z_mm", "fx_N", "fy_N", "fz_N")


@dataclass(frozen=True, slots=True)
class FrameTruth:
    """True contact of one rendered frame, in frame F.

    point_mm: (3,) position on the dome, None without contact; force_N: (3,) force on the dome.
    """

    sequence: int
    exposed_at_us: int
    point_mm: Array | None
    force_N: Array


class FrameTruthFile:
    """CSV writer of true contacts; each line is flushed."""

    def __init__(self, path: Path) -> None:
        """Open the file and write the header. Raises ConfigError if `path` cannot be written."""
        try:
            self._file = path.open("w", newline="", encoding="utf-8", buffering=1)
        except OSError as error:
            raise ConfigError(f"{path} cannot be written: {error.strerror}: give another --truth") from None
        self._write_row: Callable[[list[str]], object] = csv.writer(self._file, lineterminator="\n").writerow
        self._write_row(list(COLUMNS))

    def __enter__(self) -> FrameTruthFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def write(self, truth: FrameTruth) -> None:
        """Write one row; the position is empty without contact."""
        point = ["", "", ""] if truth.point_mm is None else [f"{value:.4f}" for value in truth.point_mm]
        force = [f"{value:.5f}" for value in truth.force_N]
        self._write_row([str(truth.sequence), str(truth.exposed_at_us), *point, *force])
