"""Subscriber to the host's status of every tick over its control socket, in a thread of its own.

The host never waits for a reader: a slow one misses ticks. If no host is running, the connection is retried.
"""

from __future__ import annotations

import threading
from collections import deque
from pathlib import Path
from types import TracebackType

from palpate_host.common.command import CommandError
from palpate_host.common.status import HostStatus
from palpate_host.operator.client import OperatorClient

RETRY_S = 0.2
MAX_WAITING = 10_000
"""Ticks that wait for `take`; beyond this the oldest are dropped."""


class StatusFollower:
    """Subscribes at once; a context manager. failure: why no host is connected, or empty."""

    def __init__(self, path: Path) -> None:
        """Start the thread. path: of the control socket."""
        self.failure = ""
        self._path = path
        self._waiting: deque[HostStatus] = deque(maxlen=MAX_WAITING)
        self._ended, self._has_news = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="status", daemon=True)
        self._thread.start()

    def take(self, timeout_s: float = 0.0) -> list[HostStatus]:
        """Return the ticks since the last call; when there is none, wait `timeout_s` for one.

        Returns early when the connection ends.
        """
        if timeout_s and not self._waiting:
            self._has_news.wait(timeout_s)
        self._has_news.clear()
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def close(self) -> None:
        """End the subscription. The daemon thread may still wait for a host that does not respond."""
        self._ended.set()

    def __enter__(self) -> StatusFollower:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                with OperatorClient(self._path) as client:
                    self.failure = ""
                    for status in client.stream():
                        self._waiting.append(status)
                        self._has_news.set()
                        if self._ended.is_set():
                            return
            except CommandError as exc:
                self.failure = str(exc)
                self._has_news.set()
            self._ended.wait(RETRY_S)
