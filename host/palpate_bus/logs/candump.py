"""Bus logs in the format of ``candump -L``, with exact microseconds and a header of comment lines.

::

    # palpate-log: 1
    # eds.fingertip: 3f0c...
    # node.0x10: fingertip finger-1
    (1700000000.123456) can0 190#0011223344556677
    (1700000000.123587) can0 701#R

A remote frame is ``R`` and, unless zero, its DLC. Time is Unix time in integer microseconds, written and
read without floating point and without a time zone. Source of the line format: can-utils, lib.h and
candump(1).
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TextIO

from palpate_edge.can_bus.can_frame import MAX_STANDARD_ID, CanFrame
from palpate_edge.common.errors import BusError

FORMAT_KEY = "palpate-log"
FORMAT_VERSION = "1"

_LINE = re.compile(
    r"\((?P<seconds>[0-9]{1,12})\.(?P<micros>[0-9]{6})\) (?P<channel>[^\s#]+) "
    r"(?P<id>[0-9A-Fa-f]{3})#(?:(?P<remote>R)(?P<dlc>[0-8]?)|(?P<data>(?:[0-9A-Fa-f]{2}){0,8}))(?: [RT])?"
)
_FOREIGN_LINE = re.compile(r"\([0-9]{1,12}\.[0-9]{6}\) [^\s#]+ (?:[0-9A-Fa-f]{8}#|[0-9A-Fa-f]{3,8}##).*")
"""29-bit, error and FD frames: the log is sound, CANopen has none of them."""
_HEADER_LINE = re.compile(r"# (?P<key>[!-9;-~]+): (?P<value>.*)")


class LogError(BusError):
    """A bus log cannot be read: garbled, cut off, or of another format."""


@dataclass(frozen=True, slots=True)
class LogRecord:
    """One frame of a log. stamp_us: when it won the wire, Unix time in us."""

    stamp_us: int
    frame: CanFrame
    channel: str = "can0"


@dataclass(frozen=True, slots=True)
class LogHeader:
    """The ``# key: value`` lines at the top, in order."""

    entries: Mapping[str, str] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """The header's lines without line ends; raises LogError for what does not fit on one ASCII line."""
        lines = [f"# {key}: {value}" for key, value in {FORMAT_KEY: FORMAT_VERSION, **self.entries}.items()]
        for line in lines:
            if _HEADER_LINE.fullmatch(line) is None or not (line.isascii() and line.isprintable()):
                raise LogError(f"log header line {line!r}: key without space or colon, value on one line")
        return lines


@dataclass(frozen=True, slots=True)
class BusLog:
    """A whole log."""

    header: LogHeader
    records: tuple[LogRecord, ...]


def format_record(record: LogRecord) -> str:
    """The record's line without line end."""
    seconds, micros = divmod(record.stamp_us, 1_000_000)
    frame = record.frame
    content = f"R{len(frame.data) or ''}" if frame.remote else frame.data.hex().upper()
    return f"({seconds:010d}.{micros:06d}) {record.channel} {frame.can_id:03X}#{content}"


def parse_record(line: str) -> LogRecord:
    """The record of one line (without line end).

    Raises ValueError with the reason; 29-bit, FD and error frames are refused, CANopen has none.
    """
    match = _LINE.fullmatch(line)
    if match is None:
        raise ValueError(f"{line[:60]!r} is no line of candump -L with a classic 11-bit frame")
    can_id = int(match["id"], 16)
    if can_id > MAX_STANDARD_ID:
        raise ValueError(f"identifier {can_id:#x} has more than 11 bits")
    if match["remote"]:
        frame = CanFrame(can_id, bytes(int(match["dlc"] or 0)), remote=True)
    else:
        frame = CanFrame(can_id, bytes.fromhex(match["data"]))
    return LogRecord(int(match["seconds"]) * 1_000_000 + int(match["micros"]), frame, match["channel"])


def read_log(path: Path, skip_foreign: bool = False) -> BusLog:
    """Reads a whole log. A log of plain candump, without a header, is read as well.

    skip_foreign: leave 29-bit, error and FD frames out instead of refusing them.
    Raises LogError naming file and line for a garbled line, a last line without its line end, time that
    runs backwards, or a header of another version.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"bus log {path}: {error.strerror}: check the path") from error
    return parse_log(path, data, skip_foreign)


def parse_log(path: Path, data: bytes, skip_foreign: bool = False) -> BusLog:
    """The log in the bytes of a file; `path` is for messages. As `read_log`."""
    try:
        text = data.decode("ascii")
    except UnicodeDecodeError as error:
        raise LogError(
            f"bus log {path}: byte {error.start} is not ASCII: no candump log, or damaged"
        ) from error
    lines = text.split("\n")
    if lines.pop() != "":
        raise LogError(f"bus log {path}, line {len(lines) + 1}: cut off: remove the line or record again")
    header, first = _read_header(path, lines)
    records: list[LogRecord] = []
    for number, line in enumerate(lines[first:], start=first + 1):
        if skip_foreign and _FOREIGN_LINE.fullmatch(line):
            continue
        try:
            records.append(parse_record(line))
        except ValueError as error:
            raise LogError(
                f"bus log {path}, line {number}: {error}: remove the line or record again"
            ) from error
        if len(records) > 1 and records[-1].stamp_us < records[-2].stamp_us:
            raise LogError(
                f"bus log {path}, line {number}: time runs backwards: sort the log or record again"
            )
    return BusLog(header, tuple(records))


def _read_header(path: Path, lines: list[str]) -> tuple[LogHeader, int]:
    """The header and the number of lines it has."""
    entries: dict[str, str] = {}
    for number, line in enumerate(itertools.takewhile(_is_comment, lines), start=1):
        match = _HEADER_LINE.fullmatch(line)
        if match is None or match["key"] in entries:
            raise LogError(
                f"bus log {path}, line {number}: header line {line[:60]!r} is not a new '# key: value'"
            )
        entries[match["key"]] = match["value"]
    entry_count = len(entries)
    version = entries.pop(FORMAT_KEY, FORMAT_VERSION)
    if version != FORMAT_VERSION:
        raise LogError(
            f"bus log {path}: format {version}, this palpate reads {FORMAT_VERSION}: update palpate"
        )
    return LogHeader(entries), entry_count


def _is_comment(line: str) -> bool:
    return line.startswith("#")


class LogWriter:
    """Writes a log line by line. Raises LogError when the file cannot be made or written."""

    def __init__(self, path: Path, header: LogHeader | None = None) -> None:
        lines = (header or LogHeader()).lines()
        self._path = path
        try:
            self._file: TextIO = path.open("w", encoding="ascii", newline="\n")
        except OSError as error:
            raise LogError(f"bus log {path}: {error.strerror}: check the path") from error
        self._write("".join(f"{line}\n" for line in lines))

    def write(self, record: LogRecord) -> None:
        """Appends one record (buffered)."""
        self._write(format_record(record) + "\n")

    def flush(self) -> None:
        """Hands all that was written to the operating system, whole lines only."""
        try:
            self._file.flush()
        except OSError as error:
            raise LogError(f"bus log {self._path}: {error.strerror}: free some space") from error

    def close(self) -> None:
        """Flushes and closes; a second call does nothing."""
        if not self._file.closed:
            self.flush()
            self._file.close()

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write(self, text: str) -> None:
        try:
            self._file.write(text)
        except OSError as error:
            raise LogError(f"bus log {self._path}: {error.strerror}: free some space") from error


def write_log(path: Path, header: LogHeader, records: Iterable[LogRecord]) -> None:
    """Writes a whole log."""
    with LogWriter(path, header) as writer:
        for record in records:
            writer.write(record)
