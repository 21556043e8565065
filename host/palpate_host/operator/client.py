"""A client of the control socket: asks, waits for the answer, and follows the stream."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from pathlib import Path

from palpate_host.common.command import CommandError
from palpate_host.common.status import HostStatus
from palpate_host.operator.protocol import Answer, Lines, Request, Stream, decode_answer, encode

LONGEST_ANSWER = 1 << 20
DEFAULT_TIMEOUT_S = 5.0


class NoHostError(CommandError):
    """No host answers on the control socket."""

    exit_status = 9


class OperatorClient:
    """One connection; a context manager."""

    def __init__(self, path: Path, timeout_s: float = DEFAULT_TIMEOUT_S) -> None:
        """NoHostError when nobody listens at `path`, or this user may not connect."""
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
                f"no host on {path} ({exc.strerror or exc}): start palpate-host run, or give its --socket"
            ) from exc

    def ask(self, request: Request) -> HostStatus | None:
        """The status with which the host accepts; CommandError with its reason when it refuses."""
        with contextlib.suppress(BrokenPipeError):  # a refusal may have been said before the request
            self._connection.sendall(encode(request))
        return self._checked(self._next())

    def stream(self) -> Iterator[HostStatus]:
        """Every tick's status until the connection is closed; this connection answers nothing else then."""
        self.ask(Stream())
        while True:
            status = self._checked(self._next())
            if status is not None:
                yield status

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
                raise NoHostError(f"the host on {self._path} does not answer: is it stopped?") from exc
            except OSError as exc:
                raise NoHostError(f"the host on {self._path} left ({exc.strerror or exc})") from exc
            if not data:
                raise NoHostError(f"the host on {self._path} has closed the connection: see its log")
            self._waiting = self._lines.receive(data)
        return decode_answer(self._waiting.pop(0))

    @staticmethod
    def _checked(answer: Answer) -> HostStatus | None:
        if answer.error:
            raise CommandError(answer.error)
        return answer.status
