"""The status as JSON lines for a live view; writing never blocks the loop."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import msgspec

from palpate_edge.common.errors import ConfigError
from palpate_host.common.status import HostStatus


class StatusStream:
    """Writes status lines to a file, a named pipe or a listening Unix stream socket.

    A slow reader loses lines, counted in `lines_lost`; when the reader closes, the stream ends.
    """

    def __init__(self, target: Path) -> None:
        """Raises ConfigError when `target` cannot be opened; a pipe or socket needs a reader first."""
        self._encoder = msgspec.json.Encoder()
        self._unsent = b""
        self.lines_lost = 0
        self._socket: socket.socket | None = None
        self._fd: int | None = None
        try:
            if target.is_socket():
                self._socket = _connect(target)
                self._fd = self._socket.fileno()
            else:
                self._fd = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NONBLOCK, 0o600)
        except OSError as exc:
            raise ConfigError(
                f"status stream {target}: cannot be opened ({exc.strerror}):"
                " start its reader first or name a file"
            ) from exc

    def write(self, status: HostStatus) -> None:
        """Send one line, or count it as lost while the reader has not taken the last one."""
        if self._fd is None:
            return
        if self._unsent:
            self._send(b"")
        if self._unsent:
            self.lines_lost += 1
            return
        self._send(self._encoder.encode(status) + b"\n")

    def close(self) -> None:
        """Close the stream; a second call does nothing."""
        if self._socket is not None:
            self._socket.close()
        elif self._fd is not None:
            os.close(self._fd)
        self._fd = self._socket = None

    def _send(self, line: bytes) -> None:
        assert self._fd is not None
        data = self._unsent + line
        try:
            written = os.write(self._fd, data)
        except BlockingIOError:
            written = 0
        except OSError:
            # The reader has closed: the stream ends, the hand continues.
            self.close()
            written = len(data)
        self._unsent = data[written:]


def _connect(target: Path) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        connection.connect(str(target))
    except OSError:
        connection.close()
        raise
    connection.setblocking(False)
    return connection
