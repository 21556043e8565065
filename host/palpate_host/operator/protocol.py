"""What goes over the control socket: JSON objects, one a line, in both directions. Pure.

A request is a command (command.py) or a question, told apart by its key ``command``. Every request has one
answer, in their order; after `Stream` a status follows each tick until the client closes.
"""

from __future__ import annotations

import msgspec

from palpate_host.common.command import Command, CommandError, Grasp, Recover, Release, Rotate, Stop
from palpate_host.common.status import HostStatus

LONGEST_REQUEST = 4096
"""Bytes; a longer line is no request of this protocol."""


class Status(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="command", tag="status"):
    """Ask for the status of the last tick."""


class Stream(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="command", tag="stream"):
    """Ask for the status of every tick from now on."""


Request = Command | Status | Stream


class Answer(msgspec.Struct, frozen=True, omit_defaults=True):
    """To one request. error: why it was refused, empty when it was not. status: of the last tick."""

    error: str = ""
    status: HostStatus | None = None


_requests = msgspec.json.Decoder(Grasp | Rotate | Release | Stop | Recover | Status | Stream)
_answers = msgspec.json.Decoder(Answer)
_encoder = msgspec.json.Encoder()


def decode_request(line: bytes) -> Request:
    """CommandError, in one line, for anything but a request."""
    try:
        request: Request = _requests.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as exc:
        reason = " ".join(str(exc).split())
        raise CommandError(f"not a request ({reason}): see docs/using.md") from exc
    return request


def encode(message: Request | Answer) -> bytes:
    """One line."""
    return _encoder.encode(message) + b"\n"


def decode_answer(line: bytes) -> Answer:
    """CommandError when the other side is of another version."""
    try:
        answer: Answer = _answers.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as exc:
        reason = " ".join(str(exc).split())
        raise CommandError(f"the host's answer is not understood ({reason}): use one version") from exc
    return answer


class Lines:
    """Cuts a stream of bytes into lines of bounded length."""

    def __init__(self, longest: int) -> None:
        self._rest, self._longest = b"", longest

    def receive(self, data: bytes) -> list[bytes]:
        """The lines completed by `data`. CommandError when one is too long."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > self._longest or any(len(line) > self._longest for line in lines):
            raise CommandError(f"a line of more than {self._longest} bytes: see docs/using.md")
        return lines
