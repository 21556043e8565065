"""Reader of bus logs in the common formats: candump -L (also gzipped), Vector ASC, Vector BLF.

ASC and BLF are read by python-can, which stops without an error at some kinds of damage. The file's length
and the order of time stamps are therefore checked here. 29-bit and error frames, and CAN FD frames without a
fast data phase, are omitted.
"""

from __future__ import annotations

import gzip
import struct
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import can
from can.io.blf import BLFParseError

from palpate_bus.logs.candump import BusLog, LogError, LogHeader, LogRecord, parse_log
from palpate_edge.can_bus.can_frame import CanFrame, check_frame
from palpate_edge.common.errors import BusError

MAX_LOG_BYTES = 1 << 30
MAX_GZIP_RATIO = 100  # logs of a bus have 5 to 20
SMALL_LOG_BYTES = 16 << 20  # a gzipped log of any ratio may have as much
_RELATIVE_LIMIT_S = 1e6  # time stamps of ASC without a date begin at 0
EPOCH_OF_RELATIVE_US = 1_700_000_000_000_000
"""Begin of logs whose time stamps begin at 0, so that they have absolute times like other logs."""

_READ_ERRORS = (ValueError, IndexError, KeyError, TypeError, OverflowError, struct.error, zlib.error, OSError)


def read_any_log(path: Path) -> BusLog:
    """Read a log in the format given by its name: .asc, .blf, .gz, otherwise candump.

    Raises LogError with file and line or byte when it cannot be read, is damaged or contains no frame.
    """
    try:
        if path.stat().st_size > MAX_LOG_BYTES:
            raise LogError(f"bus log {path}: larger than {MAX_LOG_BYTES >> 30} GiB: split it")
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"bus log {path}: {error.strerror}: check the path") from error
    suffix = path.suffix.lower()
    if suffix == ".asc":
        log = BusLog(LogHeader(), _read_asc(path))
    elif suffix == ".blf":
        log = BusLog(LogHeader(), _read_blf(path))
    else:
        log = parse_log(path, _unzipped(path, data) if suffix == ".gz" else data, skip_foreign=True)
    if not log.records:
        raise LogError(f"bus log {path}: contains no CANopen frame: give another log or record it again")
    return log


def _unzipped(path: Path, data: bytes) -> bytes:
    """Return the plain bytes of a gzipped log; a small file must not fill the memory."""
    limit = min(MAX_LOG_BYTES, max(SMALL_LOG_BYTES, MAX_GZIP_RATIO * len(data)))
    try:
        opened = zlib.decompressobj(wbits=31)
        plain = opened.decompress(data, limit + 1)
    except (gzip.BadGzipFile, zlib.error) as error:
        raise LogError(f"bus log {path}: not a gzip file, or damaged ({error}): compress it again") from error
    if len(plain) > limit:
        raise LogError(
            f"bus log {path}: {len(data)} bytes unpack to more than {limit >> 20} MiB: unpack it with gzip, "
            "and read the file"
        )
    if not opened.eof:
        raise LogError(f"bus log {path}: truncated at byte {len(data)}: copy it again")
    return plain


class _AscLines:
    """Lines of an ASC file for python-can's reader, with the current line's number.

    That reader treats the first line after the header as a header line, and so loses a frame in files without
    "internal events logged". This class inserts that line.
    """

    def __init__(self, file: TextIO) -> None:
        self.number = 0
        self._file = file
        self._first_event: str | None = None
        self._in_header = True

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        line, self._first_event = self._first_event or self._file.readline(), None
        if not line:
            raise StopIteration
        if self._in_header and line.lstrip()[:1].isdigit():
            self._in_header, self._first_event = False, line
            return "internal events logged\n"
        self.number += 1
        return line

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def _read_asc(path: Path) -> tuple[LogRecord, ...]:
    with path.open(encoding="latin-1") as file:
        lines = _AscLines(file)
        try:
            reader = can.ASCReader(lines)
            return tuple(_records(path, reader, lambda: f"line {lines.number}"))
        except _READ_ERRORS as error:
            raise _damaged(path, f"line {lines.number}", error) from error


def _read_blf(path: Path) -> tuple[LogRecord, ...]:
    with path.open("rb") as file:
        try:
            reader = can.BLFReader(file)
            _check_length(path, reader.file_size)
            return tuple(_records(path, reader, lambda: _byte(file)))
        except (*_READ_ERRORS, BLFParseError) as error:
            raise _damaged(path, _byte(file), error) from error


def _byte(file: BinaryIO) -> str:
    return "the end" if file.closed else f"byte {file.tell()}"


def _check_length(path: Path, expected: int) -> None:
    length = path.stat().st_size
    if length < expected:
        raise LogError(
            f"bus log {path}, byte {length}: truncated, its header gives {expected} bytes: copy it again"
        )


def _damaged(path: Path, place: str, error: Exception) -> LogError:
    if isinstance(error, LogError):
        return error
    reason = " ".join(str(error).split()) or type(error).__name__
    return LogError(
        f"bus log {path}, {place}: damaged, or of another format ({reason[:80]}): record it again"
    )


def _records(path: Path, messages: Iterable[can.Message], place: Any) -> Iterator[LogRecord]:
    """Yield the 11-bit data and remote frames; raise LogError when a time stamp decreases."""
    last_us: int | None = None
    for message in messages:
        if message.is_error_frame or message.is_extended_id or (message.is_fd and not message.bitrate_switch):
            continue
        data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
        frame = CanFrame(message.arbitration_id, data, message.is_remote_frame, message.is_fd)
        try:
            check_frame(frame, fd=True)
        except BusError as error:
            raise LogError(f"bus log {path}, {place()}: {error}: record the log again") from error
        stamp_us = round(message.timestamp * 1e6)
        if message.timestamp < _RELATIVE_LIMIT_S:
            stamp_us += EPOCH_OF_RELATIVE_US
        if stamp_us < 0 or (last_us is not None and stamp_us < last_us):
            raise LogError(
                f"bus log {path}, {place()}: time stamp decreases: sort the log or record it again"
            )
        last_us = stamp_us
        yield LogRecord(stamp_us, frame)
