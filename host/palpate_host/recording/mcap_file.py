"""The file behind an MCAP writer; the MCAP library only logs what the disk refuses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from palpate_edge.common.atomic_write import refused_as
from palpate_edge.common.errors import ConfigError


class McapFile:
    """A file that keeps its first failure and then takes everything; `check` raises it."""

    def __init__(self, path: Path) -> None:
        self._path, self._place, self._size = path, 0, 0
        self._failure: OSError | None = None
        with refused_as(path, ConfigError):
            self._file = path.open("wb")

    def write(self, data: bytes) -> int:
        self._try(lambda: self._file.write(data))
        self._place += len(data)
        self._size = max(self._size, self._place)
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        """Move to a place from the start, from here or from the end, as io.IOBase.seek."""
        self._place = offset + (0, self._place, self._size)[whence]
        self._try(lambda: self._file.seek(self._place))
        return self._place

    def flush(self) -> None:
        self._try(self._file.flush)

    def close(self) -> None:
        try:
            self._file.close()
        except OSError as failure:
            self._failure = self._failure or failure

    def check(self) -> None:
        """Raise ConfigError when anything could not be written."""
        with refused_as(self._path, ConfigError):
            if self._failure is not None:
                raise self._failure

    def _try(self, action: Callable[[], object]) -> None:
        if self._failure is None:
            try:
                action()
            except OSError as failure:
                self._failure = failure
