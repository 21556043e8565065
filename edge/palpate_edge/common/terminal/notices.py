"""Log lines of a process whose terminal shows a view: they would break it, so they wait for its end."""

from __future__ import annotations

import logging
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

from palpate_edge.common.logs import ROOT, ServiceFormatter

MOST_LINES = 100


class Notices(logging.Handler):
    """Keeps the last 100 lines of a log. newest: the line that was not yet taken, or empty."""

    def __init__(self, subject: str) -> None:
        super().__init__()
        self.setFormatter(ServiceFormatter(subject, sys.stderr))
        self.lines: deque[str] = deque(maxlen=MOST_LINES)
        self.newest = ""

    def emit(self, record: logging.LogRecord) -> None:
        self.add(self.format(record))

    def add(self, line: str) -> None:
        """Keep a line."""
        self.lines.append(line)
        self.newest = line

    def take(self) -> str:
        """Return the newest line once."""
        line, self.newest = self.newest, ""
        return line


@contextmanager
def notices_for_later(subject: str) -> Iterator[Notices]:
    """Keep the log of this process, from INFO on; write it to standard error at the end of the context.

    subject: precedes each line (the fingertip's name).
    """
    logger, notices = logging.getLogger(ROOT), Notices(subject)
    level = logger.level
    logger.addHandler(notices)
    logger.setLevel(logging.INFO)
    try:
        yield notices
    finally:
        logger.removeHandler(notices)
        logger.setLevel(level)
        for line in notices.lines:
            print(line, file=sys.stderr)
