"""The host's newest status, without waiting for a tick: a thread reads the stream of all ticks."""

from __future__ import annotations

import threading
from pathlib import Path

from lerobot_robot_palpate.control_socket import HostConnection, HostState, PalpateHandError, status_of


class StatusReader:
    """A connection that is sent the status of every tick. Only the newest one is kept."""

    def __init__(self, path: Path, timeout_s: float) -> None:
        """Connect. Raises PalpateHandError as HostConnection does."""
        self._connection = HostConnection(path, timeout_s)
        self._changed = threading.Condition()
        self._line, self._count, self._error = b"", 0, ""
        self._passed_count, self._passed_us = 0, 0
        try:
            self._connection.ask("stream")
        except BaseException:
            self._connection.close()
            raise
        self._thread = threading.Thread(target=self._read, name="statuses", daemon=True)
        self._thread.start()

    def newest(self) -> HostState:
        """Return the status of the last tick; wait for it at the start and after `pass_by`.

        Raises PalpateHandError when the host has ended, or is silent for `timeout_s`.
        """
        with self._changed:
            while True:
                if self._error:
                    raise PalpateHandError(self._error)
                if self._count > self._passed_count:
                    status = status_of(self._line)
                    if status["time_us"] != self._passed_us:
                        return status
                self._changed.wait()

    def pass_by(self, response: HostState) -> None:
        """Skip the statuses up to the one in a command's response, which is that before the command.

        The stream may or may not have reached that tick.
        """
        with self._changed:
            self._passed_count, self._passed_us = self._count, response["time_us"]

    def close(self) -> None:
        """Disconnect."""
        self._connection.interrupt()
        self._thread.join()
        self._connection.close()

    def _read(self) -> None:
        line, error = b"", ""
        while not error:
            try:
                line = self._connection.line()
            except PalpateHandError as end:
                error = str(end)
            with self._changed:
                self._line, self._count, self._error = line, self._count + 1, error
                self._changed.notify_all()
