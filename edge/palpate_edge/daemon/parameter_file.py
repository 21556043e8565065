"""The file behind 1010h, 1011h and LSS's store: the only part of the node that uses a disk.

A save is written to a new file, flushed, read back and then renamed; the last save stays as
``NAME.previous``. Whenever the power fails, one of the two files is intact; a checksum detects a torn one.
The file is text: a line with the checksum, then JSON. `common.atomic_write` is not enough here: it keeps no
previous file and does not read back.
"""

from __future__ import annotations

import os
import zlib
from pathlib import Path
from typing import Protocol

import msgspec

from palpate_edge.common.errors import ConfigError
from palpate_edge.node.object_dictionary import Value
from palpate_edge.node.stored_parameters import NOTHING_STORED, StoredParameters

TITLE = b"palpate parameters 1 crc32 "


class Files(Protocol):
    """The file operations that a store needs; each raises OSError."""

    def read(self, path: Path) -> bytes:
        """Return the content of a file."""

    def write(self, path: Path, content: bytes) -> None:
        """Write a file; its content is not yet safe from a power failure."""

    def flush(self, path: Path) -> None:
        """Return when a file, or the names in a folder, are on the disk."""

    def replace(self, path: Path, target: Path) -> None:
        """Rename a file; an existing target is replaced."""


class Disk:
    """The real file system."""

    def read(self, path: Path) -> bytes:
        return path.read_bytes()

    def write(self, path: Path, content: bytes) -> None:
        path.write_bytes(content)

    def flush(self, path: Path) -> None:
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)

    def replace(self, path: Path, target: Path) -> None:
        path.replace(target)


class _Content(msgspec.Struct, forbid_unknown_fields=True):
    """The JSON; the keys of objects are index and sub-index as in ``1017:00``.

    eds: checksum of the EDS that the objects belong to and, after a blank, the digest of the device.
    """

    eds: str
    node_id: int | None
    bit_rate_kbit_s: int | None
    objects: dict[str, int | str]


class ParameterFile:
    """The stored parameters of one node at `path`."""

    def __init__(self, path: Path, files: Files | None = None) -> None:
        self._path = path
        self._previous = path.with_name(path.name + ".previous")
        self._new = path.with_name(path.name + ".new")
        self._files = files or Disk()

    def load(self) -> StoredParameters:
        """Return the last save, or the one before if the last is torn; NOTHING_STORED if there never was one.

        Raises ConfigError when files exist and none is intact: nothing is overwritten silently.
        """
        found = False
        for path in (self._path, self._previous):
            try:
                return decode(self._files.read(path))
            except FileNotFoundError:
                continue
            except (OSError, ValueError):
                found = True
        if found:
            raise ConfigError(
                f"stored parameters {self._path} are damaged, and so is {self._previous.name}: "
                "remove both to start with the defaults of the EDS"
            )
        return NOTHING_STORED

    def save(self, parameters: StoredParameters) -> None:
        """Save `parameters` and return when they are on the disk. Raises ConfigError; the old ones then
        stay."""
        content = encode(parameters)
        try:
            self._files.write(self._new, content)
            self._files.flush(self._new)
            if self._files.read(self._new) != content:
                raise OSError("the file reads back differently")
            if self._is_whole(self._path):
                self._files.replace(self._path, self._previous)
            self._files.replace(self._new, self._path)
            self._files.flush(self._path.parent)
        except OSError as error:
            raise ConfigError(
                f"parameters cannot be stored in {self._path}: {error.strerror or error}: check the disk"
            ) from error

    def _is_whole(self, path: Path) -> bool:
        """Return whether a file is intact: a torn file must not replace the previous one."""
        try:
            decode(self._files.read(path))
        except (OSError, ValueError):
            return False
        return True


def encode(parameters: StoredParameters) -> bytes:
    """Return the content of the file."""
    objects: dict[str, Value] = {
        f"{index:04X}:{subindex:02X}": value for (index, subindex), value in parameters.objects.items()
    }
    owner = f"{parameters.eds_checksum} {parameters.device}".rstrip()
    content = _Content(owner, parameters.node_id, parameters.bit_rate_kbit_s, objects)
    body = msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n"
    return TITLE + b"%08x\n" % zlib.crc32(body) + body


def decode(content: bytes) -> StoredParameters:
    """Parse the content of a file. Raises ValueError when it is not intact."""
    title, _, body = content.partition(b"\n")
    if title != TITLE + b"%08x" % zlib.crc32(body):
        raise ValueError("not an intact parameter file")
    try:
        kept = msgspec.json.decode(body, type=_Content)
    except msgspec.DecodeError:
        raise ValueError("not a parameter file of this version") from None
    objects = {(int(key[:4], 16), int(key[5:], 16)): value for key, value in kept.objects.items()}
    eds_checksum, _, device = kept.eds.partition(" ")
    return StoredParameters(eds_checksum, kept.node_id, kept.bit_rate_kbit_s, objects, device)
