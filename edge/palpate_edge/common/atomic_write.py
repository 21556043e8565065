"""Files that appear whole or not at all: written beside, flushed to the disk, renamed into place."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate_edge.common.errors import PalpateError


@contextmanager
def whole_file(path: Path, error: type[PalpateError]) -> Iterator[Path]:
    """A path to write to; what is there at the end of the block takes `path`'s place, unless it raises.

    Raises `error` when the file system refuses.
    """
    temporary = path.parent / f".{path.name}.{os.getpid()}.tmp"
    try:
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as refusal:
        raise error(f"{path} cannot be written: {refusal.strerror}") from None
    finally:
        temporary.unlink(missing_ok=True)
