"""A client's connection to the hub: connect, send, receive, request. Used by the plug-in and the commands."""

from __future__ import annotations

import select
import socket
import time
from pathlib import Path

import msgspec

from palpate_bus.hub import protocol
from palpate_bus.hub.control import Refused, Reply, Request, reply_decoder
from palpate_bus.hub.protocol import Hello, Kind
from palpate_edge.common.config_file import json_fault
from palpate_edge.common.errors import BusError

ANSWER_TIMEOUT_S = 5.0  # a hub responds within 1 ms; a loaded machine may take longer
RECEIVE_BYTES = 64 * 1024


class HubGoneError(BusError):
    """No hub listens on the socket, or the hub has closed the connection."""


class HubSilentError(HubGoneError):
    """The hub does not reply."""


def connect(path: Path) -> socket.socket:
    """Return a non-blocking socket to the hub. Raises HubGoneError with the command that starts a hub."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        connection.connect(str(path))
    except OSError as error:
        connection.close()
        raise HubGoneError(
            f"no CAN bus at {path} ({error.strerror or error}): start the local hub "
            f'(palpate-host bus hub --socket {path}) or set bus.interface = "socketcan"'
        ) from error
    connection.setblocking(False)
    return connection


def receive(connection: socket.socket, path: Path) -> bytes:
    """Return the received bytes, b"" for none. Raises HubGoneError when the hub has closed the connection."""
    try:
        data = connection.recv(RECEIVE_BYTES)
    except BlockingIOError:
        return b""
    except OSError:  # reset by a killed hub
        data = b""
    if not data:
        raise gone(path)
    return data


def send(connection: socket.socket, path: Path, data: bytes) -> None:
    """Send all of `data`.

    Raises HubGoneError when the hub has closed the connection or reads nothing for ANSWER_TIMEOUT_S.
    """
    try:
        while data:
            try:
                data = data[connection.send(data) :]
            except BlockingIOError:
                if not _wait_writable(connection.fileno()):
                    raise HubGoneError(
                        f"the CAN hub at {path} reads nothing for {ANSWER_TIMEOUT_S:.0f} s: restart it"
                    ) from None
    except OSError as error:
        raise gone(path) from error


def gone(path: Path) -> HubGoneError:
    """Return the error for a hub that has closed the connection."""
    return HubGoneError(
        f"the CAN hub at {path} has stopped: start it with: palpate-host bus hub --socket {path}"
    )


def silent(path: Path) -> HubSilentError:
    """Return the error for a hub that does not reply within ANSWER_TIMEOUT_S."""
    return HubSilentError(f"the CAN hub at {path} does not reply within {ANSWER_TIMEOUT_S:.0f} s: restart it")


def rejected(path: Path, payload: bytes) -> HubGoneError:
    """Return the error for a REJECT message."""
    return HubGoneError(f"the CAN hub at {path} rejected the connection: {payload.decode(errors='replace')}")


def wait_readable(descriptor: int, timeout_s: float | None) -> bool:
    """Wait until there is something to read; return False after `timeout_s`. None waits without limit."""
    timeout_ms = None if timeout_s is None else max(timeout_s, 0.0) * 1000
    poller = select.poll()
    poller.register(descriptor, select.POLLIN)
    return bool(poller.poll(timeout_ms))


def _wait_writable(descriptor: int) -> bool:
    poller = select.poll()
    poller.register(descriptor, select.POLLOUT)
    return bool(poller.poll(ANSWER_TIMEOUT_S * 1000))


def ask(path: Path, request: Request) -> Reply:
    """Send one request to the hub and return its reply.

    Raises HubGoneError when there is no hub or no reply, BusError when the hub refuses the request.
    """
    with connect(path) as connection:
        hello = Hello(name="control", bitrate=0, receive_own=False, control_only=True)
        connection.sendall(
            protocol.hello_message(hello) + protocol.message(Kind.REQUEST, msgspec.json.encode(request))
        )
        splitter = protocol.Splitter()
        deadline_s = time.monotonic() + ANSWER_TIMEOUT_S
        while wait_readable(connection.fileno(), deadline_s - time.monotonic()):
            for kind, payload in splitter.feed(receive(connection, path)):
                if kind is Kind.REJECT:
                    raise rejected(path, payload)
                if kind is Kind.REPLY:
                    return _checked(_decoded(path, payload))
    raise silent(path)


def _decoded(path: Path, payload: bytes) -> Reply:
    try:
        return reply_decoder.decode(payload)
    except msgspec.MsgspecError:
        fault = json_fault(payload, Reply)
        raise BusError(f"the CAN hub at {path} is of another version ({fault}): restart it") from None


def _checked(reply: Reply) -> Reply:
    if isinstance(reply, Refused):
        raise BusError(reply.reason)
    return reply
