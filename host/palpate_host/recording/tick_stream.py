"""The host's status of every tick over its control socket, read in the caller's thread.

For a reader that must not lose time between two threads; one that may stall for more than 0.4 s, as on a
disk, uses `StatusFollower`, which keeps what comes meanwhile.
"""

from __future__ import annotations

import time
from pathlib import Path

from palpate_host.common.command import CommandError
from palpate_host.common.status import HostStatus
from palpate_host.operator.client import OperatorClient
from palpate_host.operator.protocol import Stream

RETRY_S = 0.2
"""Time between two attempts to connect."""

RESPONSE_S = 1.0
"""Longest wait for a host that accepts the connection and does not respond."""


class TickStream:
    """A subscription that connects again after a failure. failure: why no host is connected, or empty."""

    def __init__(self, path: Path) -> None:
        """path: of the control socket."""
        self.failure = ""
        self._path = path
        self._client: OperatorClient | None = None

    def next(self, timeout_s: float) -> HostStatus | None:
        """Return the next tick; None when none comes in `timeout_s`, or the connection fails."""
        try:
            if self._client is None:
                self._client = OperatorClient(self._path, RESPONSE_S)
                self._client.ask(Stream())
                self.failure = ""
            return self._client.poll(timeout_s)
        except CommandError as exc:
            self.close()
            if self.failure:  # a further attempt
                time.sleep(min(timeout_s, RETRY_S))
            self.failure = str(exc)
            return None

    def close(self) -> None:
        """End the subscription."""
        if self._client is not None:
            self._client.close()
            self._client = None
