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
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import TextIO

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
