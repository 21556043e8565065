"""The HTTP server of a console: static files, a stream of events, commands.

It listens on 127.0.0.1 only. Each request must name this machine's loopback as its host, so that a name that
another site points to 127.0.0.1 is refused, and must not come from a page of another origin. Everyone on this
machine may look; a command needs the token. The library's own server suffices: a few clients, each with a
thread that waits for events.
"""

from __future__ import annotations

import hmac
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import msgspec

from palpate_edge.common.errors import ConfigError, PalpateError, reason_of
from palpate_edge.web.broadcast import Broadcast, Event

LOOPBACK = "127.0.0.1"
HOST_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})
MOST_LISTENERS = 16
LONGEST_BODY = 4096
BEAT_S = 0.4
"""A stream without events has a beat after this time, so that the page sees a dead connection."""
STUCK_S = 10.0
"""A client that does not read for so long is disconnected."""
TYPES = {".html": "text/html; charset=utf-8", ".js": "text/javascript", ".css": "text/css"}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}

RunCommand = Callable[[bytes], str]
"""Carries out a command, a JSON object, and returns what happened; raises PalpateError to refuse it."""


class ConsoleServer:
    """Serves `pages` and `broadcast`; commands go to `run_command`. port: 0 for any that is free."""

    def __init__(
        self,
        port: int,
        token: str,
        pages: Mapping[str, Path],
        broadcast: Broadcast,
        run_command: RunCommand,
    ) -> None:
        """pages: path of the URL -> file. Raises ConfigError when the port is in use."""
        files = {path: (TYPES[file.suffix], file.read_bytes()) for path, file in pages.items()}

        class BoundHandler(_Handler):
            console = _Console(token, files, broadcast, run_command)

        try:
            self._server = _Server((LOOPBACK, port), BoundHandler)
        except OSError as error:
            raise ConfigError(f"port {port} of {LOOPBACK}: {reason_of(error)}: give another --port") from None
        self.port: int = self._server.server_address[1]

    @contextmanager
    def serving(self) -> Iterator[None]:
        """Serve in threads until the end of the block."""
        thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True
        )
        thread.start()
        try:
            yield
        finally:
            self._server.shutdown()
            self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a client that has left; its thread ends."""


class _Console:
    """Data that the handlers of one server share."""

    def __init__(
        self,
        token: str,
        files: Mapping[str, tuple[str, bytes]],
        broadcast: Broadcast,
        run_command: RunCommand,
    ) -> None:
        self.token, self.files, self.broadcast, self.run_command = token, files, broadcast, run_command


class _RefusedError(Exception):
    """A request that is refused with a status and a text."""

    def __init__(self, status: HTTPStatus, text: str) -> None:
        super().__init__(text)
        self.status = status


class _Handler(BaseHTTPRequestHandler):
    console: _Console
    server_version, sys_version = "palpate", ""
    timeout = STUCK_S

    def do_GET(self) -> None:
        """Send a file or the stream of events."""
        try:
            self._check_sender()
            if self.path == "/events":
                self._send_events()
                return
            kind, data = self._file()
        except _RefusedError as refusal:
            self._send_json(refusal.status, {"refused": str(refusal)})
            return
        self._send(HTTPStatus.OK, kind, data)

    def do_POST(self) -> None:
        """Carry out a command."""
        try:
            self._check_sender()
            self._check_token()
            text = self.console.run_command(self._body())
        except _RefusedError as refusal:
            self._send_json(refusal.status, {"refused": str(refusal)})
        except PalpateError as refusal:
            self._send_json(HTTPStatus.CONFLICT, {"refused": str(refusal)})
        else:
            self._send_json(HTTPStatus.OK, {"text": text})

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: a console's own requests are no news."""

    def _check_sender(self) -> None:
        """Refuse a host that is not loopback, and a page of another origin."""
        host = self.headers.get("Host", "")
        if len(self.headers.get_all("Host", [])) != 1 or host_name(host) not in HOST_NAMES:
            raise _RefusedError(HTTPStatus.FORBIDDEN, f"host {host!r} is not loopback: use ssh -L")
        origin = self.headers.get("Origin")
        if origin is not None and origin != f"http://{host}":
            raise _RefusedError(HTTPStatus.FORBIDDEN, f"origin {origin} may not use this console")
        is_navigation = self.path == "/" and self.headers.get("Sec-Fetch-Dest") == "document"
        if self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin") and not is_navigation:
            raise _RefusedError(HTTPStatus.FORBIDDEN, "a page of another site may not use this console")

    def _check_token(self) -> None:
        """Refuse a command without the token."""
        kind, _, token = self.headers.get("Authorization", "").partition(" ")
        given = token.encode("utf-8", "surrogateescape")
        if kind != "Bearer" or not hmac.compare_digest(given, self.console.token.encode()):
            text = "watching only: commands need the address with the token that the console's program prints"
            raise _RefusedError(HTTPStatus.UNAUTHORIZED, text)

    def _body(self) -> bytes:
        if self.path != "/command":
            raise _RefusedError(HTTPStatus.NOT_FOUND, f"nothing at {self.path}")
        if self.headers.get("Content-Type", "") != "application/json":
            raise _RefusedError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "send application/json")
        length = self.headers.get("Content-Length", "")
        if not length.isascii() or not length.isdigit() or int(length) > LONGEST_BODY:
            raise _RefusedError(HTTPStatus.BAD_REQUEST, f"send at most {LONGEST_BODY} bytes")
        return self.rfile.read(int(length))

    def _file(self) -> tuple[str, bytes]:
        try:
            return self.console.files[self.path.partition("?")[0]]
        except KeyError:
            raise _RefusedError(HTTPStatus.NOT_FOUND, f"nothing at {self.path}") from None

    def _send_events(self) -> None:
        broadcast = self.console.broadcast
        if broadcast.listeners >= MOST_LISTENERS:
            text = f"{MOST_LISTENERS} pages are open already: close one"
            raise _RefusedError(HTTPStatus.SERVICE_UNAVAILABLE, text)
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._send_head(HTTPStatus.OK, "text/event-stream", None)
        self.wfile.write(b"retry: 500\n\n")
        with broadcast.listen() as listener, suppress(OSError):  # the client has left, or does not read
            while True:
                events = listener.next(BEAT_S) or [("beat", b"{}")]
                self.wfile.write(b"".join(map(_as_text, events)))

    def _send_json(self, status: HTTPStatus, value: Mapping[str, str]) -> None:
        self._send(status, "application/json", msgspec.json.encode(value))

    def _send(self, status: HTTPStatus, kind: str, data: bytes) -> None:
        self._send_head(status, kind, len(data))
        self.wfile.write(data)

    def _send_head(self, status: HTTPStatus, kind: str, length: int | None) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        if length is not None:
            self.send_header("Content-Length", str(length))
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.end_headers()


def _as_text(event: Event) -> bytes:
    """Return an event in the format of a stream of server-sent events."""
    kind, data = event
    return b"event: %b\ndata: %b\n\n" % (kind.encode(), data)


def host_name(host: str) -> str:
    """Return the name in a Host header, without its port, in lower case."""
    name, colon, port = host.rpartition(":")
    return (name if colon and port.isdigit() else host).lower()
