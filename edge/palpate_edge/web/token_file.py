"""The token that permits commands: a file that its user alone may read."""

from __future__ import annotations

import os
import re
import secrets
import stat
from pathlib import Path

from palpate_edge.common.errors import ConfigError, reason_of

TOKEN_BYTES = 32
TOKEN = re.compile(rb"[A-Za-z0-9_-]{43}\n?")
LONGEST = 256


def read_or_make_token(path: Path) -> str:
    """Return the token of the file at `path`, which is made with mode 0600 when it does not exist.

    Raises ConfigError for a file of another user, one that others may read, or one without a token: another
    user might command with it.
    """
    try:
        try:
            return _make(path)
        except FileExistsError:
            return _read(path)
    except OSError as error:
        raise ConfigError(
            f"token file {path}: {reason_of(error)}: set XDG_RUNTIME_DIR to a folder of this user"
        ) from None


def _make(path: Path) -> str:
    token = secrets.token_urlsafe(TOKEN_BYTES)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    with os.fdopen(os.open(path, flags, 0o600), "w") as file:
        file.write(token + "\n")
    return token


def _read(path: Path) -> str:
    flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    with os.fdopen(os.open(path, flags), "rb") as file:
        state = os.fstat(file.fileno())
        data = file.read(LONGEST)
    if state.st_uid != os.geteuid() or not stat.S_ISREG(state.st_mode) or state.st_mode & 0o077:
        raise ConfigError(f"token file {path}: must be this user's and of mode 0600: remove it")
    if not TOKEN.fullmatch(data):
        raise ConfigError(f"token file {path}: contains no token: remove it, a new one is made")
    return data.decode("ascii").strip()
