"""Logs of the services: standard `logging`, with journal priorities when systemd collects standard error.

Each part logs to ``palpate.<part>`` (``palpate.camera``, ``palpate.bus`` ...). ERROR: a device or the bus is
lost, or a request failed. WARNING: the service works with less than it was configured for. INFO: started,
recovered, recording. CRITICAL: an error that the program does not handle ends it; its traceback is written.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import TextIO

import msgspec

ROOT = "palpate"
JOURNAL_STREAM = "JOURNAL_STREAM"
PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6), (0, 7))
"""Least level of `logging` and its priority in the journal (sd-daemon(3), syslog(3))."""


def priority(level: int) -> int:
    """Return the journal's priority of a logging level: 2 critical, 3 error, 4 warning, 6 info, 7 debug."""
    return next(number for least, number in PRIORITIES if level >= least)


def is_journal(stream: TextIO, environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether systemd connected `stream` to the journal: JOURNAL_STREAM names its device and inode
    (systemd.exec(5))."""
    try:
        status = os.fstat(stream.fileno())
    except (OSError, ValueError):  # closed, or not a file
        return False
    return environment.get(JOURNAL_STREAM) == f"{status.st_dev}:{status.st_ino}"


def with_priority(text: str, level: int, stream: TextIO) -> str:
    """Return `text` with the prefix ``<N>`` before each line if `stream` is the journal's, else unchanged."""
    if not is_journal(stream):
        return text
    return "\n".join(f"<{priority(level)}>{line}" for line in text.splitlines())


class ServiceFormatter(logging.Formatter):
    """``SUBJECT: message``, with the journal's priority where `stream` is the journal's."""

    def __init__(self, subject: str, stream: TextIO) -> None:
        super().__init__()
        self._subject = subject
        self._stream = stream

    def format(self, record: logging.LogRecord) -> str:
        message = super().format(record)
        text = f"{self._subject}: {message}" if self._subject else message
        return with_priority(text, record.levelno, self._stream)


class LogLine(msgspec.Struct, frozen=True):
    """A line for the log. level: of `logging`."""

    level: int
    text: str


class RepeatedProblem:
    """A problem that may end and begin again at any rate, with at most two log lines a minute; pure.

    The first line is the problem itself. After each minute follows one line: the number of further events, or
    the end of the problem when there were none.
    """

    EVERY_US = 60_000_000

    def __init__(self, event: str, over: str) -> None:
        """event: what is counted (``foreign frames``); over: the text of the end."""
        self._event, self._over = event, over
        self._events = 0
        self._due_us: int | None = None

    def update(self, now_us: int, problem: str, events: int) -> LogLine | None:
        """Return the line that is due. problem: empty when there is none; events: since the start."""
        if self._due_us is None:
            if not problem:
                return None
            line = LogLine(logging.ERROR, problem)
        elif now_us < self._due_us:
            return None
        elif events > self._events:
            line = LogLine(logging.ERROR, f"{events - self._events} more {self._event} in the last minute")
        elif problem:
            return None
        else:
            self._due_us = None
            return LogLine(logging.INFO, f"{self._over}: {events} {self._event}")
        self._events, self._due_us = events, now_us + self.EVERY_US
        return line


class LineLimit:
    """A limit on log lines of one kind: MOST a minute, then one line with the number of the others; pure."""

    MOST = 10
    EVERY_US = 60_000_000

    def __init__(self, event: str) -> None:
        """event: what a line reports, in the plural (``changes of the bus``)."""
        self._event = event
        self._end_us: int | None = None
        self._logged = 0
        self._further = 0
        self._last: LogLine | None = None

    def update(self, now_us: int, lines: Sequence[LogLine] = ()) -> list[LogLine]:
        """Return the lines that are due; call it without lines too, for the number of those held back."""
        due: list[LogLine] = []
        if self._end_us is not None and now_us >= self._end_us:
            if self._last is not None:
                text = f"{self._further} more {self._event} in the last minute, the last: {self._last.text}"
                due.append(LogLine(self._last.level, text))
            self._end_us, self._logged, self._further, self._last = None, 0, 0, None
        for line in lines:
            if self._end_us is None:
                self._end_us = now_us + self.EVERY_US
            if self._logged < self.MOST:
                self._logged += 1
                due.append(line)
            else:
                self._further, self._last = self._further + 1, line
        return due


@contextmanager
def logging_to_stderr(subject: str = "") -> Iterator[None]:
    """Write the log of this process to standard error, from INFO on, until the context ends.

    subject: precedes each line (the fingertip's name); empty for none.
    """
    logger = logging.getLogger(ROOT)
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(ServiceFormatter(subject, sys.stderr))
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


def write_tracebacks_with_priority() -> None:
    """Write the traceback of an unhandled exception, of the process or of a thread, as critical lines.

    The journal then shows a crash with ``journalctl --priority err``. Outside of the journal the text is
    Python's own.
    """
    sys.excepthook = _write_traceback
    threading.excepthook = _write_thread_traceback


def _write_traceback(
    kind: type[BaseException], error: BaseException | None, trace: TracebackType | None, heading: str = ""
) -> None:
    if sys.stderr is None:  # closed before the start
        return
    text = heading + "".join(traceback.format_exception(kind, error, trace)).rstrip("\n")
    sys.stderr.write(with_priority(text, logging.CRITICAL, sys.stderr) + "\n")
    sys.stderr.flush()


def _write_thread_traceback(failure: threading.ExceptHookArgs) -> None:
    if failure.exc_type is SystemExit:
        return
    name = failure.thread.name if failure.thread else "unknown"
    _write_traceback(
        failure.exc_type, failure.exc_value, failure.exc_traceback, f"Exception in thread {name}:\n"
    )
