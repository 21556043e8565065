"""Files that decide what a process does must not be writable by everybody."""

from __future__ import annotations

import stat
from pathlib import Path

from palpate_edge.common.errors import ConfigError


def refuse_unsafe(path: Path) -> None:
    """ConfigError when anybody may write this file. OSError as `Path.stat`."""
    mode = path.stat().st_mode
    if mode & stat.S_IWOTH:
        raise ConfigError(
            f"{path} may be written by everybody (mode {stat.S_IMODE(mode):o}): chmod o-w {path}"
        )
