"""A connection to a host's control socket: one JSON object a line, in both directions."""

from __future__ import annotations

import json
import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

RECEIVE_BYTES = 1 << 16
LONGEST_RESPONSE = 1 << 20

HostState = dict[str, Any]
"""The host's status of one tick, as JSON."""


class PalpateHandError(RuntimeError):
    """The host refused a request, does not respond, or the hand cannot be used; the text has the reason."""


def default_control_socket() -> Path:
    """Return the path at which `palpate-host run` listens by default."""
    named = os.environ.get("PALPATE_CONTROL")
    if named:
        return Path(named)
    service = Path("/run/palpate-host")
    for folder in (str(service) if service.is_dir() else None, os.environ.get("XDG_RUNTIME_DIR")):
        if folder:
            return Path(folder) / "palpate-host.sock"
    return Path(tempfile.gettempdir()) / f"palpate-host-{os.getuid()}.sock"


class HostConnection:
    """One connection to the control socket."""

    def __init__(self, path: Path, timeout_s: float) -> None:
        """Connect. Raises PalpateHandError when no host listens on `path`, or this user may not connect."""
        self._path, self._received = path, b""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(timeout_s)
        try:
            self._socket.connect(str(path))
        except OSError as error:
            self._socket.close()
            raise PalpateHandError(
                f"no hand is running on {path} ({error.strerror or error}): start one with"
                " palpate-host run --config hand.toml --start command"
            ) from error

    def ask(self, command: str, **arguments: Any) -> HostState:
        """Send a command and return the host's last status.

        Raises PalpateHandError with the host's reason when it refuses.
        """
        request = json.dumps({"command": command, **arguments})
        with self._reported():
            self._socket.sendall(request.encode() + b"\n")
        return status_of(self.line())

    def line(self) -> bytes:
        """Wait for the next line. Raises PalpateHandError when none comes."""
        with self._reported():
            while b"\n" not in self._received:
                data = self._socket.recv(RECEIVE_BYTES)
                if not data or len(self._received) > LONGEST_RESPONSE:
                    raise PalpateHandError(f"the host on {self._path} has closed the connection: see its log")
                self._received += data
        line, _, self._received = self._received.partition(b"\n")
        return line

    def interrupt(self) -> None:
        """End a `line` that another thread waits for."""
        with suppress(OSError):  # the host has ended
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Disconnect; a second call does nothing."""
        self._socket.close()

    @contextmanager
    def _reported(self) -> Iterator[None]:
        """Raise errors of the socket as PalpateHandError."""
        try:
            yield
        except TimeoutError as error:
            raise PalpateHandError(f"the host on {self._path} does not respond: see its log") from error
        except OSError as error:
            raise PalpateHandError(
                f"the host on {self._path} has ended ({error.strerror}): see its log"
            ) from error


def status_of(line: bytes) -> HostState:
    """Return the status in a response. Raises PalpateHandError with the host's reason for a refusal."""
    response = json.loads(line)
    if response.get("error"):
        raise PalpateHandError(response["error"])
    status = response.get("status")
    if status is None:
        raise PalpateHandError("the host has not ticked yet: try again")
    return dict(status)
