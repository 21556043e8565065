"""Write a file so that it appears complete or not at all, even when the power fails.

A regular file is written beside its place, flushed to the disk, and renamed; the folder is flushed after it.
A symbolic link keeps pointing to its target, which is replaced. A device, a pipe and ``-`` (standard output)
are written directly: there is nothing to replace.
"""

from __future__ import annotations

import errno
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TextIO, cast

from palpate_edge.common.errors import DISK_ERRORS, PalpateError, reason_of

STANDARD_OUTPUT = Path("-")


@contextmanager
def atomic_path(
    path: Path, error: type[PalpateError], *, sync_folder: bool = True, sync_file: bool = True
) -> Iterator[Path]:
    """Yield the path to write to; at the end of the block its content is at `path`, unless the block raises.

    sync_folder: False saves a flush for each of many files whose names may be lost with the power. sync_file:
    False for a content that may be lost with the power too; no flush can then delay the caller. Raises
    `error` when the file system refuses.
    """
    if _is_direct(path):
        with refused_as(path, error):
            yield path
        return
    target = path.resolve()
    temporary = target.parent / f".{target.name}.{os.getpid()}.tmp"
    try:
        with refused_as(path, error):
            temporary.touch()  # refused now, not after the work
            yield temporary
            if sync_file:
                _sync(temporary)
            temporary.replace(target)
            if sync_folder:
                _sync(target.parent)
    finally:
        with suppress(OSError):  # renamed, or never made
            temporary.unlink()


@contextmanager
def atomic_file(
    path: Path, error: type[PalpateError], *, sync_folder: bool = True, sync_file: bool = True
) -> Iterator[BinaryIO]:
    """Yield an open binary file, as `atomic_path`; ``-`` is standard output."""
    if path == STANDARD_OUTPUT:
        yield cast(BinaryIO, sys.stdout.buffer)
        sys.stdout.buffer.flush()
        return
    with (
        atomic_path(path, error, sync_folder=sync_folder, sync_file=sync_file) as temporary,
        refused_as(path, error),
        temporary.open("wb") as file,
    ):
        yield file


@contextmanager
def atomic_text(path: Path, error: type[PalpateError]) -> Iterator[TextIO]:
    """Yield an open UTF-8 text file, line ends as written, as `atomic_path`; ``-`` is standard output."""
    if path == STANDARD_OUTPUT:
        yield sys.stdout
        sys.stdout.flush()
        return
    with (
        atomic_path(path, error) as temporary,
        refused_as(path, error),
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        yield file


def write_atomically(
    path: Path,
    data: bytes,
    error: type[PalpateError],
    *,
    sync_folder: bool = True,
    sync_file: bool = True,
) -> None:
    """Write `data` as the whole content of `path`, as `atomic_file`."""
    with atomic_file(path, error, sync_folder=sync_folder, sync_file=sync_file) as file:
        file.write(data)


def make_folder(path: Path, error: type[PalpateError]) -> None:
    """Make a folder and those above it where they are missing. Raises `error` when the system refuses."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as refusal:
        reason = "is a file" if path.is_file() else reason_of(refusal)
        raise error(f"folder {path} cannot be made: {reason}; give another path") from None


@contextmanager
def refused_as(path: Path, error: type[PalpateError]) -> Iterator[None]:
    """Turn an OSError of the block into `error`, with `path` and the reason."""
    try:
        yield
    except OSError as refusal:
        reason = reason_of(refusal)
        if refusal.errno == errno.ENOENT:
            reason = "its folder does not exist"
        raise error(f"{path} cannot be written: {reason}; give another path") from None


@contextmanager
def disk_refusal_as(folder: Path, error: type[PalpateError]) -> Iterator[None]:
    """Turn a full, read-only or failing disk into `error`, for a block that writes many files to `folder`."""
    try:
        yield
    except OSError as refusal:
        if refusal.errno not in DISK_ERRORS:
            raise
        raise error(f"{folder} cannot be written: {reason_of(refusal)}; give another path") from None


def _is_direct(path: Path) -> bool:
    """Return whether a path is no regular file, or a name of a file that is already open (/dev/stdout)."""
    try:
        if path.is_symlink() and path.readlink().is_relative_to("/proc"):
            return True
        return path.resolve().is_relative_to("/proc") or not stat.S_ISREG(path.stat().st_mode)
    except OSError:  # absent, or not readable: the error follows when it is written
        return False


def _sync(path: Path) -> None:
    """Flush a file or a folder to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
