"""Bus logs in the format of ``candump -L``, with exact microseconds and a header of comment lines.

::

    # palpate-log: 2
    # eds.fingertip: 3f0c...
    # node.0x10: fingertip finger-1
    (1700000000.123456) can0 190#0011223344556677
    (1700000000.123587) can0 701#R
    #! (1700000000.124000) tick {"mode":"grasp", ...
    #+ ... }

A remote frame is written as ``R``, followed by its DLC unless that is 0, a CAN FD frame as ``190##1`` and its
data, where 1 is the flag of a fast data phase (BRS). candump of today adds 4 (FDF). Time is Unix time in
integer microseconds, converted without floating point and without a time zone. Source of the line format:
can-utils, lib.h and candump(1).

A line that begins with ``#!`` is a note: time, kind and text of something that is not on the bus (a host's
tick, an operator's command). ``#+`` continues the note before it. can-utils skip every line that does not
begin with ``(``, but stop at a line of 400 bytes, so a note is split into lines of at most LONGEST_LINE
bytes.
"""

from __future__ import annotations

import itertools
import re
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TextIO

from palpate_edge.can_bus.can_frame import FD_LENGTHS, MAX_STANDARD_ID, CanFrame
from palpate_edge.common.atomic_write import atomic_text
from palpate_edge.common.errors import BusError

FORMAT_KEY = "palpate-log"
FORMAT_VERSION = "2"
READABLE_VERSIONS = ("1", FORMAT_VERSION)
"""Version 1 has no notes."""
NOTE, CONTINUED = "#! ", "#+ "
LONGEST_LINE = 380

_LINE = re.compile(
    r"\((?P<seconds>[0-9]{1,12})\.(?P<micros>[0-9]{6})\) (?P<channel>[^\s#]+) "
    r"(?P<id>[0-9A-Fa-f]{3})#(?:(?P<remote>R)(?P<dlc>[0-8]?)|(?P<data>(?:[0-9A-Fa-f]{2}){0,8})"
    r"|#[1357](?P<fd>(?:[0-9A-Fa-f]{2}){0,64}))(?: [RT])?"
)
_FOREIGN_LINE = re.compile(
    r"\([0-9]{1,12}\.[0-9]{6}\) [^\s#]+ (?:[0-9A-Fa-f]{8}#|[0-9A-Fa-f]{3}##[02468ACEace]).*"
)
"""Valid lines of 29-bit and error frames, and of CAN FD frames without a fast data phase."""
_NOTE = re.compile(
    r"\((?P<seconds>[0-9]{1,12})\.(?P<micros>[0-9]{6})\) (?P<kind>[a-z][a-z-]*) (?P<text>[ -~]*)"
)
_HEADER_LINE = re.compile(r"# (?P<key>[!-9;-~]+): (?P<value>.*)")


class LogError(BusError):
    """A bus log cannot be read or written: damaged, truncated, or of another format."""


@dataclass(frozen=True, slots=True)
class LogRecord:
    """One frame of a log. stamp_us: start of frame, Unix time in us."""

    stamp_us: int
    frame: CanFrame
    channel: str = "can0"


@dataclass(frozen=True, slots=True)
class LogHeader:
    """The ``# key: value`` lines at the beginning of a log, in order."""

    entries: Mapping[str, str] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """Return the header's lines without line ends.

        Raises LogError for a key or value that cannot be written on one ASCII line.
        """
        lines = [f"# {key}: {value}" for key, value in {FORMAT_KEY: FORMAT_VERSION, **self.entries}.items()]
        for line in lines:
            if _HEADER_LINE.fullmatch(line) is None or not (line.isascii() and line.isprintable()):
                raise LogError(
                    f"log header line {line!r}: write a key without space or colon, and a printable ASCII"
                    " value on one line"
                )
        return lines


@dataclass(frozen=True, slots=True)
class LogNote:
    """A note in a log, for what is not on the bus. kind: lower-case word; text: printable ASCII."""

    stamp_us: int
    kind: str
    text: str

    def lines(self) -> list[str]:
        """Return the note's lines without line ends. Raises LogError for a text that is not ASCII."""
        seconds, micros = divmod(self.stamp_us, 1_000_000)
        whole = f"({seconds:010d}.{micros:06d}) {self.kind} {self.text}"
        if _NOTE.fullmatch(whole) is None:
            raise LogError(f"log note {whole[:60]!r}: write a lower-case kind and printable ASCII text")
        size = LONGEST_LINE - len(NOTE)
        first, *more = (whole[place : place + size] for place in range(0, len(whole), size))
        return [NOTE + first, *(CONTINUED + part for part in more)]


@dataclass(frozen=True, slots=True)
class BusLog:
    """Header, records and notes of a log, each in the order of the file."""

    header: LogHeader
    records: tuple[LogRecord, ...]
    notes: tuple[LogNote, ...] = ()


def format_record(record: LogRecord) -> str:
    """Return the record's line without line end."""
    seconds, micros = divmod(record.stamp_us, 1_000_000)
    frame = record.frame
    content = f"R{len(frame.data) or ''}" if frame.remote else frame.data.hex().upper()
    if frame.fd:
        content = f"#1{content}"
    return f"({seconds:010d}.{micros:06d}) {record.channel} {frame.can_id:03X}#{content}"


def parse_record(line: str) -> LogRecord:
    """Parse one line (without line end).

    Raises ValueError with the reason, also for 29-bit and error frames, and for CAN FD frames without a fast
    data phase.
    """
    match = _LINE.fullmatch(line)
    if match is None:
        raise ValueError(f"{line[:60]!r} is not a line of candump -L with an 11-bit frame")
    can_id = int(match["id"], 16)
    if can_id > MAX_STANDARD_ID:
        raise ValueError(f"identifier {can_id:#x} has more than 11 bits")
    if match["remote"]:
        frame = CanFrame(can_id, bytes(int(match["dlc"] or 0)), remote=True)
    elif match["fd"] is not None:
        frame = CanFrame(can_id, bytes.fromhex(match["fd"]), fd=True)
        if len(frame.data) not in FD_LENGTHS:
            raise ValueError(f"{len(frame.data)} bytes are not a length of CAN FD")
    else:
        frame = CanFrame(can_id, bytes.fromhex(match["data"]))
    return LogRecord(int(match["seconds"]) * 1_000_000 + int(match["micros"]), frame, match["channel"])


def read_log(path: Path, skip_foreign: bool = False) -> BusLog:
    """Read a whole log, with or without a header.

    skip_foreign: omit 29-bit and error frames, and CAN FD frames without a fast data phase, instead of
    raising LogError for them.
    Raises LogError with file and line for an invalid line, a last line without line end, a decreasing time
    stamp, or a header of another version.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"bus log {path}: {error.strerror}: check the path") from error
    return parse_log(path, data, skip_foreign)


def parse_log(path: Path, data: bytes, skip_foreign: bool = False) -> BusLog:
    """Parse the bytes of a log file like `read_log`; `path` is used in messages only."""
    try:
        text = data.decode("ascii")
    except UnicodeDecodeError as error:
        raise LogError(
            f"bus log {path}: byte {error.start} is not ASCII, so the file is damaged or not a candump log:"
            " give another file"
        ) from error
    lines = text.split("\n")
    if lines.pop() != "":
        raise LogError(
            f"bus log {path}, line {len(lines) + 1}: truncated: remove the line or record the log again"
        )
    header, first = _read_header(path, lines)
    records: list[LogRecord] = []
    notes: list[tuple[int, str]] = []  # line number, text
    for number, line in enumerate(lines[first:], start=first + 1):
        if line.startswith(NOTE):
            notes.append((number, line[len(NOTE) :]))
            continue
        if line.startswith(CONTINUED) and notes:
            notes[-1] = (notes[-1][0], notes[-1][1] + line[len(CONTINUED) :])
            continue
        if skip_foreign and _FOREIGN_LINE.fullmatch(line):
            continue
        try:
            records.append(parse_record(line))
        except ValueError as error:
            raise LogError(
                f"bus log {path}, line {number}: {error}: remove the line or record the log again"
            ) from error
        if len(records) > 1 and records[-1].stamp_us < records[-2].stamp_us:
            raise LogError(
                f"bus log {path}, line {number}: time stamp decreases: sort the log or record it again"
            )
    return BusLog(header, tuple(records), tuple(_parse_note(path, *note) for note in notes))


def _parse_note(path: Path, number: int, text: str) -> LogNote:
    match = _NOTE.fullmatch(text)
    if match is None:
        raise LogError(
            f"bus log {path}, line {number}: {text[:60]!r} is not a note '(time) kind text':"
            " remove the line or record the log again"
        )
    return LogNote(int(match["seconds"]) * 1_000_000 + int(match["micros"]), match["kind"], match["text"])


def _read_header(path: Path, lines: list[str]) -> tuple[LogHeader, int]:
    """Return the header and its number of lines."""
    entries: dict[str, str] = {}
    for number, line in enumerate(itertools.takewhile(_is_comment, lines), start=1):
        match = _HEADER_LINE.fullmatch(line)
        if match is None or match["key"] in entries:
            raise LogError(
                f"bus log {path}, line {number}: header line {line[:60]!r} is not '# key: value' with a new"
                " key: correct or remove it"
            )
        entries[match["key"]] = match["value"]
    entry_count = len(entries)
    version = entries.pop(FORMAT_KEY, FORMAT_VERSION)
    if version not in READABLE_VERSIONS:
        raise LogError(
            f"bus log {path}: format version {version}, this palpate reads {' and '.join(READABLE_VERSIONS)}:"
            " update palpate"
        )
    return LogHeader(entries), entry_count


def _is_comment(line: str) -> bool:
    return line.startswith("#") and not line.startswith((NOTE, CONTINUED))


class LogWriter:
    """Writer of a log, line by line. Raises LogError when the file cannot be created or written."""

    def __init__(self, path: Path, header: LogHeader | None = None) -> None:
        lines = (header or LogHeader()).lines()
        self._path = path
        try:
            self._file: TextIO = path.open("w", encoding="ascii", newline="\n")
        except OSError as error:
            raise LogError(f"bus log {path}: {error.strerror}: check the path") from error
        self._write("".join(f"{line}\n" for line in lines))

    def write(self, record: LogRecord) -> None:
        """Append one record (buffered)."""
        self._write(format_record(record) + "\n")

    def note(self, note: LogNote) -> None:
        """Append a note (buffered)."""
        self._write("".join(f"{line}\n" for line in note.lines()))

    def flush(self) -> None:
        """Flush the buffer to the operating system, in whole lines."""
        try:
            self._file.flush()
        except OSError as error:
            raise LogError(f"bus log {self._path}: {error.strerror}: free some space") from error

    def close(self) -> None:
        """Flush and close; a second call has no effect."""
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


def write_log(
    path: Path, header: LogHeader, records: Iterable[LogRecord], notes: Iterable[LogNote] = ()
) -> None:
    """Write a whole log, complete or not at all; ``-`` is standard output. Raises LogError.

    notes: in the order of time; each is written before the first record that is later.
    """
    waiting = deque(notes)
    with atomic_text(path, LogError) as file:
        file.writelines(f"{line}\n" for line in header.lines())
        for record in records:
            while waiting and waiting[0].stamp_us < record.stamp_us:
                file.writelines(f"{line}\n" for line in waiting.popleft().lines())
            file.write(f"{format_record(record)}\n")
        for note in waiting:
            file.writelines(f"{line}\n" for line in note.lines())
