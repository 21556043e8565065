"""The host's end of the control socket: requests in, responses out, without blocking the control loop.

A Unix stream socket of mode 0660 whose peers must be root, the host's own user or a member of the host's
group. A client that does not read misses statuses of its stream; one that floods the host is disconnected.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path

from palpate_edge.common.errors import ConfigError, PalpateError
from palpate_edge.common.local_sockets.unix_socket import peer_of, remove_if_stale
from palpate_host.common.command import Accepted, Command, CommandError
from palpate_host.common.status import HostStatus
from palpate_host.operator.protocol import (
    LONGEST_REQUEST,
    Answer,
    Lines,
    Status,
    Stream,
    decode_request,
    encode,
)

SERVICE_DIRECTORY = Path("/run/palpate-host")
MOST_CLIENTS = 16
MOST_UNSENT = 1 << 18
"""Bytes that a client may leave unread; beyond them it is disconnected."""
RECEIVE_BYTES = 4096
_SO_PEERGROUPS = 59  # asm-generic/socket.h; not in Python's socket module
_GROUPS_BYTES = 1024  # the most that Python asks for: 256 groups of the peer

Execute = Callable[[Command], Accepted | None]


def default_control_socket() -> Path:
    """Return the default path of the control socket.

    $PALPATE_CONTROL; else palpate-host.sock in $RUNTIME_DIRECTORY, in the service's directory while the
    service runs, or in $XDG_RUNTIME_DIR; else a name with the user's number in the directory for temporary
    files, which all users share.
    """
    named = os.environ.get("PALPATE_CONTROL")
    if named:
        return Path(named)
    service = str(SERVICE_DIRECTORY) if SERVICE_DIRECTORY.is_dir() else None
    for folder in (os.environ.get("RUNTIME_DIRECTORY"), service, os.environ.get("XDG_RUNTIME_DIR")):
        if folder:
            return Path(folder) / "palpate-host.sock"
    return Path(tempfile.gettempdir()) / f"palpate-host-{os.getuid()}.sock"


class _Client:
    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.lines = Lines(LONGEST_REQUEST)
        self.unsent = b""
        self.streams = False


class OperatorSocket:
    """The listening socket and its clients; call `serve` once a tick."""

    def __init__(self, path: Path, config: Path | None = None) -> None:
        """Listen on `path`. Raises ConfigError when another host listens there, or the path cannot be
        used. config: the host's hand.toml, for clients that change it."""
        self._path = path
        self._config = "" if config is None else str(config.absolute())
        self._clients: dict[int, _Client] = {}
        self._selector = selectors.DefaultSelector()
        self._listener = _listen(path)
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._own = os.stat(path).st_ino  # noqa: PTH116 - of the socket itself, not of a link's target

    def serve(self, execute: Execute, status: HostStatus | None) -> None:
        """Respond to the requests that have come, and send `status` to the clients that stream.

        execute: carries out a command; the text of its CommandError is the response.
        """
        for key, _ in self._selector.select(0):
            if key.fileobj is self._listener:
                self._accept()
            elif key.fd in self._clients:
                self._read(key.fd, self._clients[key.fd], execute, status)
        line = b""
        for fd, client in list(self._clients.items()):
            if client.streams and status is not None and not client.unsent:
                line = line or encode(Answer(status=status))
                client.unsent = line
            self._flush(fd, client)

    def close(self) -> None:
        """Close every connection and remove the socket, unless another host's has replaced it."""
        for fd in list(self._clients):
            self._drop(fd)
        self._selector.close()
        self._listener.close()
        with contextlib.suppress(FileNotFoundError):
            if self._path.stat().st_ino == self._own:
                self._path.unlink()

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return
        connection.setblocking(False)
        error = "" if may_command(connection) else _not_allowed()
        if len(self._clients) >= MOST_CLIENTS:
            error = f"{MOST_CLIENTS} clients are connected already: close one"
        if error:
            with contextlib.suppress(OSError):
                connection.send(encode(Answer(error)))
            connection.close()
            return
        self._clients[connection.fileno()] = _Client(connection)
        self._selector.register(connection, selectors.EVENT_READ)

    def _read(self, fd: int, client: _Client, execute: Execute, status: HostStatus | None) -> None:
        try:
            data = client.connection.recv(RECEIVE_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(fd)
            return
        try:
            lines = client.lines.receive(data)
        except CommandError as exc:
            client.unsent += encode(Answer(str(exc)))
            self._flush(fd, client)
            self._drop(fd)
            return
        for line in lines:
            client.unsent += encode(self._answer(client, line, execute, status))
            if len(client.unsent) > MOST_UNSENT:
                self._drop(fd)
                return

    def _answer(self, client: _Client, line: bytes, execute: Execute, status: HostStatus | None) -> Answer:
        accepted = None
        try:
            request = decode_request(line)
            if isinstance(request, Stream):
                client.streams = True
            elif not isinstance(request, Status):
                accepted = execute(request)
        except PalpateError as exc:
            return Answer(str(exc))
        return Answer(status=status, accepted=accepted, config="" if accepted is None else self._config)

    def _flush(self, fd: int, client: _Client) -> None:
        if not client.unsent:
            return
        try:
            sent = client.connection.send(client.unsent)
        except BlockingIOError:
            return
        except OSError:
            self._drop(fd)
            return
        client.unsent = client.unsent[sent:]

    def _drop(self, fd: int) -> None:
        client = self._clients.pop(fd, None)
        if client is not None:
            self._selector.unregister(client.connection)
            client.connection.close()


def may_command(connection: socket.socket) -> bool:
    """Return whether the peer is root, this user, or in this process's group.

    The kernel provides the peer's groups. A look-up of its user would fail in the service, where every user
    but root and the service's own appears as 65534 (PrivateUsers= of systemd.exec).
    """
    peer = peer_of(connection)
    if peer.uid in (0, os.getuid()) or peer.gid == os.getgid():
        return True
    try:
        groups = connection.getsockopt(socket.SOL_SOCKET, _SO_PEERGROUPS, _GROUPS_BYTES)
    except OSError:  # ERANGE: the peer has more groups
        return False
    return os.getgid() in memoryview(groups).cast("I")


def _not_allowed() -> str:
    return (
        "only root, the host's user and its group may command the hand: use sudo -u palpate palpate-host ..."
    )


def _listen(path: Path) -> socket.socket:
    _remove_stale(path)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    former = os.umask(0o117)
    try:
        listener.bind(str(path))
    except OSError as exc:
        listener.close()
        raise ConfigError(
            f"control socket {path}: {exc.strerror or exc}: give another path with --socket"
        ) from exc
    finally:
        os.umask(former)
    listener.setblocking(False)
    listener.listen(MOST_CLIENTS)
    return listener


def _remove_stale(path: Path) -> None:
    """Remove a socket on which no host listens, as a killed host leaves it."""
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise ConfigError(
                f"control socket {path}: exists and is no socket: give another path with --socket"
            )
    except FileNotFoundError:
        return
    try:
        is_free = remove_if_stale(path, socket.SOCK_STREAM)
    except OSError as exc:
        raise ConfigError(
            f"control socket {path}: {exc.strerror or exc}: give another path with --socket"
        ) from exc
    if not is_free:
        raise ConfigError(
            f"control socket {path}: a host is running there: stop it, or give another path with --socket"
        )
