"""Default path of the hub's socket, for hub and clients."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def default_socket() -> Path:
    """Return $PALPATE_HUB, else palpate-hub.sock in $XDG_RUNTIME_DIR or the directory for temporary files."""
    named = os.environ.get("PALPATE_HUB")
    if named:
        return Path(named)
    return Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()) / "palpate-hub.sock"
