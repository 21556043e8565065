"""What was true of each picture of a fingertip, as a file: a row a frame."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from palpate_edge.common.errors import ConfigError
from palpate_twin.camera.live import COLUMNS
from palpate_twin.closed_loop.fingertip_feel import Picture


class PictureFile:
    """A CSV with the columns of `simulate camera --truth`; a line is written at once."""

    def __init__(self, path: Path) -> None:
        """Raises ConfigError where `path` cannot be written."""
        try:
            self._file = path.open("w", newline="", encoding="utf-8", buffering=1)
        except OSError as error:
            raise ConfigError(f"{path} cannot be written: {error.strerror}: give another --truth") from None
        self._write: Callable[[list[str]], object] = csv.writer(self._file, lineterminator="\n").writerow
        self._write(list(COLUMNS))

    def __enter__(self) -> PictureFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def note(self, picture: Picture) -> None:
        """Where it was pressed, empty without touch, and how hard."""
        place = ["", "", ""] if picture.point_mm is None else [f"{v:.4f}" for v in picture.point_mm]
        forces = [f"{value:.5f}" for value in picture.force_N]
        self._write([str(picture.sequence), str(picture.exposed_at_us), *place, *forces])
