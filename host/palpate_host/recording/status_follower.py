"""The host's status of every tick, followed over its control socket by a thread of its own.

The host leaves ticks out for a reader that is slow and never waits for it. A host that is not there yet, or
has ended, is asked for again.
"""

from __future__ import annotations

import threading
from collections import deque
from pathlib import Path
from types import TracebackType

from palpate_host.common.command import CommandError
from palpate_host.common.status import HostStatus
from palpate_host.operator.client import OperatorClient

ASK_AGAIN_S = 0.2
MOST_WAITING = 10_000
"""Ticks that `take` may leave waiting; beyond it the oldest are lost."""


class StatusFollower:
    """Begins at once; a context manager. failure: why there is no host at the moment, or empty."""

    def __init__(self, path: Path) -> None:
        """path: the control socket."""
        self.failure = ""
        self._path = path
        self._waiting: deque[HostStatus] = deque(maxlen=MOST_WAITING)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="status", daemon=True)
        self._thread.start()

    def take(self) -> list[HostStatus]:
        """What has come since the last call, without waiting."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def close(self) -> None:
        """Ask for no more. The thread is a daemon: it may still wait for a host that is silent."""
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
                        if self._ended.is_set():
                            return
            except CommandError as exc:
                self.failure = str(exc)
            self._ended.wait(ASK_AGAIN_S)
