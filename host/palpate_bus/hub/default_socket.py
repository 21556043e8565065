"""Default path of the hub's socket, for hub and clients."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from palpate_edge.common.errors import BusError

SOCKET_NAME = "palpate-hub.sock"


def default_socket() -> Path:
    """Return $PALPATE_HUB, else palpate-hub.sock in $XDG_RUNTIME_DIR or in a folder of this user.

    The folder for temporary files belongs to everybody: a socket there could be another user's. The folder
    palpate-UID in it is made with mode 0700. Raises BusError when it is not this user's alone.
    """
    named = os.environ.get("PALPATE_HUB")
    if named:
        return Path(named)
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return (Path(runtime) if runtime else _own_folder()) / SOCKET_NAME


def _own_folder() -> Path:
    folder = Path(tempfile.gettempdir()) / f"palpate-{os.geteuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError as error:
        raise BusError(
            f"folder {folder} of the hub's socket cannot be made: {error.strerror}: set PALPATE_HUB"
        ) from error
    is_own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid()
    if not is_own or status.st_mode & 0o077:
        raise BusError(
            f"folder {folder} of the hub's socket is open to other users, or theirs: remove it, or set "
            "PALPATE_HUB"
        )
    return folder
