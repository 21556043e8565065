"""The reader's side of `palpate-host run --status SOCKET`: a Unix socket to which the host connects.

The host never waits for a reader (status_stream.py); a host that starts again connects again.
"""

from __future__ import annotations

import socket
from pathlib import Path
from types import TracebackType

import msgspec

from palpate_edge.errors import ConfigError
from palpate_host.status import HostStatus

CHUNK_BYTES = 1 << 18
MAX_LINE_BYTES = 1 << 20


class StatusListener:
    """Every status of the host that is connected; garbled lines are counted in `garbled` and left out."""

    def __init__(self, path: Path) -> None:
        """ConfigError when no socket can be made at `path`; one that nobody listens at is replaced."""
        self.garbled = 0
        self._path = path
        self._decoder = msgspec.json.Decoder(HostStatus)
        self._rest = b""
        self._host: socket.socket | None = None
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.setblocking(False)
        try:
            if path.is_socket():
                _refuse_if_used(path)
                path.unlink()
            self._listener.bind(str(path))
            self._listener.listen(1)
        except OSError as exc:
            self._listener.close()
            raise ConfigError(
                f"status socket {path}: cannot be made ({exc.strerror or exc}): name another with --status"
            ) from exc

    def __enter__(self) -> StatusListener:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Also takes the socket's file away."""
        self._leave()
        self._listener.close()
        self._path.unlink(missing_ok=True)

    def take(self) -> list[HostStatus]:
        """What has come since the last call, without waiting. A second host waits for the first to leave."""
        found: list[HostStatus] = []
        while self._host is not None or self._accept():
            assert self._host is not None
            try:
                data = self._host.recv(CHUNK_BYTES)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                self._leave()
                continue
            *lines, self._rest = (self._rest + data).split(b"\n")
            found += [status for line in lines if (status := self._decoded(line)) is not None]
            if len(self._rest) > MAX_LINE_BYTES:
                self.garbled += 1
                self._rest = b""
        return found

    def _accept(self) -> bool:
        try:
            self._host, _ = self._listener.accept()
        except BlockingIOError:
            return False
        self._host.setblocking(False)
        return True

    def _leave(self) -> None:
        if self._host is not None:
            self._host.close()
        self._host, self._rest = None, b""

    def _decoded(self, line: bytes) -> HostStatus | None:
        try:
            return self._decoder.decode(line)
        except msgspec.MsgspecError:
            self.garbled += 1
            return None


def _refuse_if_used(path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            return
    raise OSError(None, "another process listens there")
