"""A client of the control socket: requests with their responses, and the stream of statuses."""

from __future__ import annotations

import contextlib
import select
import socket
from collections.abc import Iterator
from pathlib import Path

from palpate_host.common.command import Accept, CommandError
from palpate_host.common.status import HostStatus
from palpate_host.operator.protocol import Answer, Lines, Request, Stream, decode_answer, encode

LONGEST_ANSWER = 1 << 20
DEFAULT_TIMEOUT_S = 5.0


class NoHostError(CommandError):
    """No host responds on the control socket."""

    exit_status = 9


class OperatorClient:
    """One connection to a host; a context manager."""

    def __init__(self, path: Path, timeout_s: float = DEFAULT_TIMEOUT_S) -> None:
        """Connect to `path`. Raises NoHostError when no host listens there, or this user may not connect."""
        self._path = path
        self._lines = Lines(LONGEST_ANSWER)
        self._waiting: list[bytes] = []
        self._connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._connection.settimeout(timeout_s)
        try:
            self._connection.connect(str(path))
        except OSError as exc:
            self._connection.close()
            raise NoHostError(
                f"no hand is running; start one: palpate-host run --config hand.toml, or give its --socket"
                f" (control socket {path}: {exc.strerror or exc})"
            ) from exc

    def ask(self, request: Request) -> HostStatus | None:
        """Send a request and return the status in the response; CommandError with the host's reason when it
        refuses."""
        return self._answer_to(request).status

    def accept(self, node_id: int) -> Answer:
        """Send `Accept` and return the response, with what was accepted; CommandError as `ask`."""
        return self._answer_to(Accept(node_id))

    def _answer_to(self, request: Request) -> Answer:
        with contextlib.suppress(BrokenPipeError):  # the host may refuse the connection before the request
            self._connection.sendall(encode(request))
        return self._checked(self._next())

    def stream(self) -> Iterator[HostStatus]:
        """Yield every tick's status until the connection is closed; it then serves no other request."""
        self.ask(Stream())
        while True:
            status = self._checked(self._next()).status
            if status is not None:
                yield status

    def poll(self, timeout_s: float) -> HostStatus | None:
        """Return the next status after a request `Stream`; None when none comes in `timeout_s`.

        Raises NoHostError when the connection ends.
        """
        if not self._waiting:
            poller = select.poll()
            poller.register(self._connection, select.POLLIN)
            if not poller.poll(1000 * timeout_s):
                return None
        return self._checked(self._next()).status

    def close(self) -> None:
        self._connection.close()

    def __enter__(self) -> OperatorClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _next(self) -> Answer:
        while not self._waiting:
            try:
                data = self._connection.recv(1 << 16)
            except TimeoutError as exc:
                raise NoHostError(
                    f"the host on {self._path} does not respond: see its log, or restart it"
                ) from exc
            except OSError as exc:
                raise NoHostError(
                    f"the host on {self._path} has ended ({exc.strerror or exc}): see its log"
                ) from exc
            if not data:
                raise NoHostError(f"the host on {self._path} has closed the connection: see its log")
            self._waiting = self._lines.receive(data)
        return decode_answer(self._waiting.pop(0))

    @staticmethod
    def _checked(answer: Answer) -> Answer:
        if answer.error:
            raise CommandError(answer.error)
        return answer
