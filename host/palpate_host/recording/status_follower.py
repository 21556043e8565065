"""Subscriber to the host's status of every tick over its control socket, in a thread of its own.

The host never waits for a reader: a slow one misses ticks. If no host is running, the connection is retried.
"""

from __future__ import annotations

import threading
from collections import deque
from contextlib import closing
from pathlib import Path
from types import TracebackType

from palpate_host.common.status import HostStatus
from palpate_host.recording.tick_stream import RETRY_S, TickStream

MAX_WAITING = 10_000
"""Ticks that wait for `take`; beyond this the oldest are dropped."""


class StatusFollower:
    """Subscribes at once; a context manager."""

    def __init__(self, path: Path) -> None:
        """Start the thread. path: of the control socket."""
        self._stream = TickStream(path)
        self._waiting: deque[HostStatus] = deque(maxlen=MAX_WAITING)
        self._ended, self._has_news = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="status", daemon=True)
        self._thread.start()

    @property
    def failure(self) -> str:
        """Why no host is connected, or empty."""
        return self._stream.failure

    def take(self, timeout_s: float = 0.0) -> list[HostStatus]:
        """Return the ticks since the last call; when there is none, wait `timeout_s` for one.

        Returns early when the connection ends.
        """
        if timeout_s and not self._waiting:
            self._has_news.wait(timeout_s)
        self._has_news.clear()
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def close(self) -> None:
        """End the subscription."""
        self._ended.set()
        self._thread.join()

    def __enter__(self) -> StatusFollower:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _run(self) -> None:
        with closing(self._stream):
            while not self._ended.is_set():
                status = self._stream.next(RETRY_S)
                if status is not None:
                    self._waiting.append(status)
                if status is not None or self.failure:
                    self._has_news.set()
