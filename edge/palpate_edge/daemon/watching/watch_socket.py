"""The daemon's end of the watch socket: a Unix socket of packets in the run directory, of mode 0600.

Its peers must be this user or root. Nothing waits for a watcher: one that does not read misses packets.
"""

from __future__ import annotations

import os
import selectors
import socket
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec

from palpate_edge.common.errors import ConfigError, PalpateError, reason_of
from palpate_edge.common.local_sockets.unix_socket import peer_of, remove_if_stale
from palpate_edge.daemon.watching.watch_messages import (
    LONGEST_PACKET,
    WatchAnswer,
    WatchedFingertip,
    WatchedFrame,
    WatchedHealth,
    WatchMessage,
    WatchRequest,
)

MOST_WATCHERS = 8
LONGEST_REQUEST = 1024
_requests = msgspec.json.Decoder(WatchRequest)

Execute = Callable[[WatchRequest], str]
"""Carries out a request and returns the answer's text; raises PalpateError to refuse it."""


class _Watcher:
    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.wants_pictures = False


class WatchSocket:
    """The listening socket and its watchers; `fileno` polls readable when `serve` has something to do."""

    def __init__(self, path: Path, fingertip: WatchedFingertip, execute: Execute) -> None:
        """Listen on `path`. Raises ConfigError when the path cannot be used, or another daemon listens."""
        self._path, self._hello, self._execute = path, msgspec.json.encode(fingertip), execute
        self._watchers: dict[int, _Watcher] = {}
        self._health: WatchedHealth | None = None
        self._selector = selectors.EpollSelector()
        self._listener = _listen(path)
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._inode = path.lstat().st_ino

    def fileno(self) -> int:
        return self._selector.fileno()

    @property
    def is_watched(self) -> bool:
        """True while a watcher wants pictures."""
        return any(watcher.wants_pictures for watcher in self._watchers.values())

    def serve(self) -> None:
        """Accept watchers and answer their requests."""
        for key, _ in self._selector.select(0):
            if key.fileobj is self._listener:
                self._accept()
            elif key.fd in self._watchers:
                self._read(key.fd, self._watchers[key.fd])

    def send(self, message: WatchedFrame | WatchedHealth) -> None:
        """Send to all watchers, a frame to those who want pictures."""
        if isinstance(message, WatchedHealth):
            self._health = message
        if not self._watchers:
            return
        packet = msgspec.json.encode(message)
        for fd, watcher in list(self._watchers.items()):
            if watcher.wants_pictures or not isinstance(message, WatchedFrame):
                self._send(fd, packet)

    def close(self) -> None:
        """Close all connections and remove the socket, unless another daemon's has replaced it."""
        for fd in list(self._watchers):
            self._drop(fd)
        self._selector.close()
        self._listener.close()
        with suppress(FileNotFoundError):
            if self._path.lstat().st_ino == self._inode:
                self._path.unlink()

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return
        if len(self._watchers) >= MOST_WATCHERS or peer_of(connection).uid not in (0, os.geteuid()):
            connection.close()
            return
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, LONGEST_PACKET)
        fd = connection.fileno()
        self._watchers[fd] = _Watcher(connection)
        self._selector.register(connection, selectors.EVENT_READ)
        self._send(fd, self._hello)
        if self._health is not None:
            self._send(fd, msgspec.json.encode(self._health))

    def _read(self, fd: int, watcher: _Watcher) -> None:
        try:
            packet = watcher.connection.recv(LONGEST_REQUEST)
        except BlockingIOError:
            return
        except OSError:
            packet = b""
        try:
            request = _requests.decode(packet)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):  # also the end: an empty packet
            self._drop(fd)
            return
        self._send(fd, msgspec.json.encode(self._answer(watcher, request)))

    def _answer(self, watcher: _Watcher, request: WatchRequest) -> WatchAnswer:
        if request.command in ("pictures", "no_pictures"):
            watcher.wants_pictures = request.command == "pictures"
            return WatchAnswer(request.number)
        try:
            return WatchAnswer(request.number, self._execute(request))
        except PalpateError as error:
            return WatchAnswer(request.number, refused=str(error))

    def _send(self, fd: int, packet: bytes) -> None:
        watcher = self._watchers.get(fd)
        if watcher is None:
            return
        try:
            watcher.connection.send(packet, socket.MSG_NOSIGNAL)
        except BlockingIOError:  # it does not read
            return
        except OSError:
            self._drop(fd)

    def _drop(self, fd: int) -> None:
        watcher = self._watchers.pop(fd, None)
        if watcher is not None:
            self._selector.unregister(watcher.connection)
            watcher.connection.close()


def decode_message(packet: bytes) -> WatchMessage | None:
    """Return a daemon's message; None for that of another version."""
    try:
        message: WatchMessage = _messages.decode(packet)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    return message


_messages = msgspec.json.Decoder(WatchedFingertip | WatchedFrame | WatchedHealth | WatchAnswer)


def _listen(path: Path) -> socket.socket:
    """Return a listening socket that its owner alone may connect to."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        _remove_stale(path)
        os.fchmod(listener.fileno(), 0o600)  # the mode of the file that `bind` makes
        listener.bind(str(path))
        listener.setblocking(False)
        listener.listen(MOST_WATCHERS)
    except OSError as error:
        listener.close()
        raise ConfigError(
            f"watch socket {path}: {reason_of(error)}; set health to a short path of this user"
        ) from None
    except ConfigError:
        listener.close()
        raise
    return listener


def _remove_stale(path: Path) -> None:
    """Remove a socket on which no daemon listens. Raises ConfigError, or OSError."""
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise ConfigError(f"watch socket {path}: exists and is no socket: remove it")
    except FileNotFoundError:
        return
    if not remove_if_stale(path, socket.SOCK_SEQPACKET):
        raise ConfigError(f"watch socket {path}: another daemon of this name runs: give it another name")
