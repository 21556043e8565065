"""A ring of frames in a shared file: one process writes, any number read, and none waits for another.

The file (little endian) may have any path; use one in memory (/dev/shm, /run):

    0   8 bytes  magic
    8   u32      version
    12  u32      slots
    16  u32 x 3  width, height, channels (1 grey, 3 BGR)
    32  16 bytes fingerprint of the sensor's description (Sensor.fingerprint), or zeros
    48  u64      count: frames written so far; the newest is number count - 1, in slot (count - 1) % slots
    64  slots, each a multiple of 4096 bytes:
        0   u64  stamp: 2 n + 1 while frame number n is being written, 2 n + 2 when it is complete
        8   u64  sequence: counts exposures; a gap means that the writer skipped frames
        16  i64  time of exposure, microseconds of CLOCK_MONOTONIC, which all processes share
        64  pixels, row by row

A reader copies a slot and uses the copy only if the stamp was that of a complete frame before and after: it
never returns a torn frame. The reader's mapping is read-only, so that it cannot block the writer. When the
writer dies, the count stops. A new writer replaces the file at the path; a reader has to open the path again.
"""

from __future__ import annotations

import mmap
import os
import struct
import threading
from pathlib import Path

import msgspec
import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.atomic_write import atomic_path
from palpate_edge.common.errors import CaptureError, reason_of

MAGIC = b"PALPRING"
VERSION = 1
HEADER = struct.Struct("<8sIIIII4x16s")
COUNT_AT = 48
HEADER_BYTES = SLOT_HEADER_BYTES = 64
SLOT = struct.Struct("<QQq")
WORD = struct.Struct("<Q")
PAGE = 4096
SLOTS = 4
MOST_PIXELS = 8192 * 8192
TRIES = 8  # copies in a row that the writer may overwrite before `newest` returns None


class RingFormat(msgspec.Struct, frozen=True):
    """The format of all frames of a ring. fingerprint: of the sensor, empty when unknown."""

    width: int
    height: int
    channels: int
    slots: int = SLOTS
    fingerprint: str = ""

    @property
    def frame_bytes(self) -> int:
        """Bytes of the pixels of a frame."""
        return self.width * self.height * self.channels

    @property
    def slot_bytes(self) -> int:
        """Bytes of a slot, whole pages."""
        return -(-(SLOT_HEADER_BYTES + self.frame_bytes) // PAGE) * PAGE

    @property
    def file_bytes(self) -> int:
        """Bytes of the file."""
        return HEADER_BYTES + self.slots * self.slot_bytes

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of an image: (height, width), or (height, width, channels)."""
        return (self.height, self.width) if self.channels == 1 else (self.height, self.width, self.channels)


class RingFrame(msgspec.Struct, frozen=True):
    """A complete frame; image is the reader's own copy. exposed_at_us: on CLOCK_MONOTONIC."""

    image: Image
    sequence: int
    exposed_at_us: int


class RingWriter:
    """Makes and fills the file. The file gets its name when it is ready; `close` removes it."""

    def __init__(self, path: Path, form: RingFormat, *, mode: int | None = None) -> None:
        """mode: of the file, by default that of the process's umask. Raises CaptureError when the file cannot
        be written."""
        self._path, self._form = path, form
        with atomic_path(path, CaptureError, sync_folder=False) as fresh, fresh.open("wb+") as file:
            if mode is not None:
                os.fchmod(file.fileno(), mode)
            os.posix_fallocate(file.fileno(), 0, form.file_bytes)  # else a full disk is a SIGBUS later
            self._map = mmap.mmap(file.fileno(), form.file_bytes)
            self._inode = os.fstat(file.fileno()).st_ino
            fingerprint = form.fingerprint.encode("ascii")
            HEADER.pack_into(
                self._map, 0, MAGIC, VERSION, form.slots, form.width, form.height, form.channels, fingerprint
            )
        self._slots = [_pixels(self._map, form, slot) for slot in range(form.slots)]
        self._count = 0

    def write(self, image: Image, sequence: int, exposed_at_us: int) -> None:
        """Write the next frame. image: of the ring's shape, uint8; exposed_at_us: on CLOCK_MONOTONIC."""
        number = self._count % self._form.slots
        at = HEADER_BYTES + number * self._form.slot_bytes
        SLOT.pack_into(self._map, at, 2 * self._count + 1, sequence, exposed_at_us)
        _barrier()
        self._slots[number][...] = image
        _barrier()
        WORD.pack_into(self._map, at, 2 * self._count + 2)
        _barrier()
        self._count += 1
        WORD.pack_into(self._map, COUNT_AT, self._count)

    def close(self) -> None:
        """Remove the file, unless another writer has replaced it, and unmap it."""
        try:
            if self._path.stat().st_ino == self._inode:
                self._path.unlink()
        except FileNotFoundError:
            pass
        self._slots = []
        self._map.close()


class RingReader:
    """Reads the newest frame of a ring; by default none that was written before it was opened."""

    def __init__(self, path: Path, *, newest_unread: bool = False) -> None:
        """newest_unread: the newest frame before now is returned too. Raises FileNotFoundError, or
        CaptureError for a file that is not a ring."""
        try:
            with path.open("rb") as file:
                size = os.fstat(file.fileno()).st_size
                if size < HEADER_BYTES:
                    raise CaptureError(f"{path} is not a ring of frames: give a running writer's file")
                self._map = mmap.mmap(file.fileno(), size, access=mmap.ACCESS_READ)
        except FileNotFoundError:
            raise
        except OSError as error:
            raise CaptureError(
                f"{path} cannot be read: {reason_of(error)}; "
                "give the file of a running writer, readable by this user"
            ) from None
        try:
            self.format = _read_format(self._map, path)
        except CaptureError:
            self._map.close()
            raise
        self._slots = [_pixels(self._map, self.format, slot) for slot in range(self.format.slots)]
        self._seen = 0 if newest_unread else self._count()

    def newest(self) -> RingFrame | None:
        """Return the newest frame; None when it was returned before, or overwritten during `TRIES` copies."""
        for _ in range(TRIES):
            count = self._count()
            if count <= self._seen:
                return None
            frame = self._copy(count - 1)
            if frame is not None:
                self._seen = count
                return frame
        return None

    def close(self) -> None:
        """Unmap the file."""
        self._slots = []
        self._map.close()

    def _count(self) -> int:
        return int(WORD.unpack_from(self._map, COUNT_AT)[0])

    def _copy(self, frame_number: int) -> RingFrame | None:
        """Copy a frame; return None when the writer overwrote it meanwhile."""
        slot = frame_number % self.format.slots
        at = HEADER_BYTES + slot * self.format.slot_bytes
        stamp, sequence, exposed_at_us = SLOT.unpack_from(self._map, at)
        if stamp != 2 * frame_number + 2:
            return None
        _barrier()
        image = self._slots[slot].copy()
        _barrier()
        if WORD.unpack_from(self._map, at)[0] != stamp:
            return None
        return RingFrame(image, sequence, exposed_at_us)


def _read_format(mapped: mmap.mmap, path: Path) -> RingFormat:
    """Read the header. Raises CaptureError for another kind of file, another version, or inconsistent
    sizes."""
    magic, version, slots, width, height, channels, fingerprint = HEADER.unpack_from(mapped, 0)
    if magic != MAGIC:
        raise CaptureError(f"{path} is not a ring of frames: give a running writer's file")
    if version != VERSION:
        raise CaptureError(f"{path} is a ring of version {version}, not {VERSION}: update the older program")
    fits = channels in {1, 3} and 2 <= slots <= 64 and 0 < width * height <= MOST_PIXELS
    name = fingerprint.rstrip(b"\0").decode("ascii", "replace")
    form = RingFormat(width, height, channels, slots, name)
    if not fits or form.file_bytes > len(mapped):
        raise CaptureError(f"{path}: header and file size are inconsistent: restart its writer")
    return form


def _pixels(mapped: mmap.mmap, form: RingFormat, slot: int) -> Image:
    """Return a view of a slot's pixels."""
    at = HEADER_BYTES + slot * form.slot_bytes + SLOT_HEADER_BYTES
    flat = np.frombuffer(mapped, dtype=np.uint8, count=form.frame_bytes, offset=at)
    return flat.reshape(form.shape)


_order = threading.Lock()


def _barrier() -> None:
    """Order memory accesses on processors that reorder them (aarch64): a store-release followed by a
    load-acquire of the same lock is a full barrier."""
    for _ in range(2):
        with _order:
            pass
