"""The hub's socket server: one thread, a Unix stream socket and its clients.

The hub's behaviour is in hub_core.py.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import selectors
import socket
from collections.abc import Iterator
from pathlib import Path

from palpate_bus.hub import protocol
from palpate_bus.hub.control import Statistics
from palpate_bus.hub.hub_client import Client
from palpate_bus.hub.hub_core import HubCore
from palpate_bus.hub.protocol import GarbledStreamError, Kind
from palpate_bus.logs.candump import LogRecord, LogWriter
from palpate_edge.common.errors import BusError
from palpate_edge.common.local_clock import LocalClock
from palpate_edge.common.local_sockets.unix_socket import peer_of

RECEIVE_BYTES = 64 * 1024
LOG_FLUSH_US = 500_000

# Shortest interval between two steps of the wire: frames in between share one wake-up and one system call. It
# adds at most this much latency; time stamps are those of the wire and are not affected.
QUANTUM_US = 200


class Hub:
    """A running hub. `run` serves until `stop`; `close` removes the socket file.

    log: when set, all transmitted frames are written to it; `close` closes it. clock: the wire's clock, which
    must not follow steps of the system clock: the wire would stop or transmit faster. data_bitrate: bit/s of
    the data phase of CAN FD frames, None for a classic bus.

    Raises BusError when another hub listens on the socket or the socket cannot be created.
    """

    def __init__(
        self,
        path: Path,
        bitrate: int,
        txqueuelen: int,
        clock: LocalClock | None = None,
        data_bitrate: int | None = None,
    ) -> None:
        self._clock = clock or LocalClock()
        self.core = HubCore(bitrate, txqueuelen, self._clock.now_us(), data_bitrate)
        self.path = path
        self.log: LogWriter | None = None
        self._log_flushed_us = 0
        self._stopping = False
        self._clients: dict[socket.socket, Client] = {}
        self._congested: set[socket.socket] = set()
        self._listener = _listen(path)
        self._inode = path.stat().st_ino
        # select() instead of epoll: its timeout is in microseconds, epoll's is rounded up to 1 ms.
        self._selector = selectors.SelectSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        # A signal handler (or another thread) that calls `stop` wakes the selector through this pair.
        self._wake_in, self._wake_out = socket.socketpair()
        self._wake_in.setblocking(False)
        self._wake_out.setblocking(False)
        self._selector.register(self._wake_in, selectors.EVENT_READ)

    def run(self) -> None:
        """Serve clients until `stop` is called."""
        while not self._stopping:
            now_us = self._clock.now_us()
            for delivery in self.core.advance(now_us):
                if self.log is not None:
                    self.log.write(LogRecord(delivery.won_at_us, delivery.frame))
            self._flush_log(now_us)
            self._write_clients()
            for key, events in self._selector.select(self._timeout_s()):
                self._serve(key.fileobj, events)

    def stop(self) -> None:
        """Make `run` return; may be called from a signal handler."""
        self._stopping = True
        with contextlib.suppress(BlockingIOError):
            self._wake_out.send(b"x")

    @property
    def wake_descriptor(self) -> int:
        """The descriptor for signal.set_wakeup_fd, so that a signal just before the wait ends the wait."""
        return self._wake_out.fileno()

    def statistics(self) -> Statistics:
        """Return all counters."""
        return self.core.statistics(self._clock.now_us())

    def close(self) -> None:
        """Disconnect every client and remove the socket file if it is still this hub's."""
        for connection in list(self._clients):
            self._disconnect(connection)
        self._selector.close()
        for end in (self._listener, self._wake_in, self._wake_out):
            end.close()
        with contextlib.suppress(FileNotFoundError):
            if self.path.stat().st_ino == self._inode:
                self.path.unlink()
        if self.log is not None:
            self.log.close()

    def _timeout_s(self) -> float | None:
        now_us = self._clock.now_us()
        due_us = self.core.next_due_us(now_us)
        if due_us is None:
            return LOG_FLUSH_US / 1e6 if self.log is not None else None
        return max(due_us - now_us, QUANTUM_US) / 1e6

    def _serve(self, end: object, events: int) -> None:
        if end is self._listener:
            self._accept()
        elif end is self._wake_in:
            self._wake_in.recv(RECEIVE_BYTES)
        elif isinstance(end, socket.socket) and end in self._clients and events & selectors.EVENT_READ:
            self._read(end)

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except (BlockingIOError, ConnectionAbortedError):  # closed before it was accepted
            return
        connection.setblocking(False)
        self._clients[connection] = Client(process=peer_of(connection).pid)
        self._selector.register(connection, selectors.EVENT_READ)

    def _read(self, connection: socket.socket) -> None:
        client = self._clients[connection]
        try:
            data = connection.recv(RECEIVE_BYTES)
        except BlockingIOError:
            return
        except OSError:  # reset by a killed client
            data = b""
        if not data:
            self._disconnect(connection)
            return
        try:
            self.core.receive(client, data, self._clock.now_us())
        except GarbledStreamError as error:
            client.output += protocol.message(Kind.REJECT, str(error).encode())
            self._write(connection, client)
            if connection in self._clients:
                self._disconnect(connection)

    def _write_clients(self) -> None:
        for connection, client in list(self._clients.items()):
            if client.output:
                self._write(connection, client)

    def _write(self, connection: socket.socket, client: Client) -> None:
        try:
            sent = connection.send(client.output)
            del client.output[:sent]
        except BlockingIOError:
            pass
        except OSError:  # closed; `_read` takes the last received bytes and then disconnects
            client.output.clear()
        self._watch_writable(connection, bool(client.output))

    def _watch_writable(self, connection: socket.socket, congested: bool) -> None:
        if congested != (connection in self._congested):
            events = selectors.EVENT_READ | (selectors.EVENT_WRITE if congested else 0)
            self._selector.modify(connection, events)
            self._congested ^= {connection}

    def _disconnect(self, connection: socket.socket) -> None:
        self.core.disconnect(self._clients.pop(connection))
        self._congested.discard(connection)
        self._selector.unregister(connection)
        connection.close()

    def _flush_log(self, now_us: int) -> None:
        if self.log is not None and now_us - self._log_flushed_us >= LOG_FLUSH_US:
            self.log.flush()
            self._log_flushed_us = now_us


def _listen(path: Path) -> socket.socket:
    """Return a listening socket at `path`, mode 0600; replace the file that a killed hub left behind."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        with _directory_lock(path.parent):
            if path.exists():
                _remove_stale(path)
            mask = os.umask(0o177)
            try:
                listener.bind(str(path))
            finally:
                os.umask(mask)
        listener.listen(64)
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        raise BusError(
            f"hub socket {path}: {error.strerror or error}: give another path with --socket"
        ) from error
    except BusError:
        listener.close()
        raise
    return listener


def _remove_stale(path: Path) -> None:
    if not path.is_socket():
        raise BusError(
            f"hub socket {path}: the file exists and is not a socket: give another path with --socket"
        )
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
            return
    raise BusError(
        f"hub socket {path}: a hub already listens there: use or stop it, or give another path with --socket"
    )


@contextlib.contextmanager
def _directory_lock(directory: Path) -> Iterator[None]:
    """Lock the directory, so that two starting hubs do not remove each other's new socket as stale."""
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
