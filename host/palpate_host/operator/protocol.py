"""The protocol of the control socket: JSON objects, one a line, in both directions. Pure.

The key ``command`` of a request is a command's name (command.py), ``status`` or ``stream``. Every request has
one response, in order; after `Stream` each tick's status follows until the client closes the connection.
"""

from __future__ import annotations

import msgspec

from palpate_edge.common.config_file import json_fault
from palpate_host.common.command import (
    Accept,
    Accepted,
    Command,
    CommandError,
    Grasp,
    Move,
    Recover,
    Release,
    Reorient,
    Rotate,
    Stop,
)
from palpate_host.common.status import HostStatus

LONGEST_REQUEST = 4096
"""Most bytes of a request's line."""


class Status(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="command", tag="status"):
    """A request for the status of the last tick."""


class Stream(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="command", tag="stream"):
    """A request for the status of every tick from now on."""


Request = Command | Status | Stream


class Answer(msgspec.Struct, frozen=True, omit_defaults=True):
    """The response to one request. error: why it was refused, or empty. status: of the last tick.

    accepted, config: to `Accept`, what was accepted, and the hand.toml of the host.
    """

    error: str = ""
    status: HostStatus | None = None
    accepted: Accepted | None = None
    config: str = ""


_requests = msgspec.json.Decoder(
    Grasp | Rotate | Move | Reorient | Release | Stop | Recover | Accept | Status | Stream
)
_answers = msgspec.json.Decoder(Answer)
_encoder = msgspec.json.Encoder()


def decode_request(line: bytes) -> Request:
    """Parse a line. Raises CommandError, in one line, for anything but a request."""
    try:
        request: Request = _requests.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise CommandError(f"not a request ({json_fault(line, Request)}): see docs/using.md") from None
    return request


def encode(message: Request | Answer) -> bytes:
    """Return the message as one line of JSON."""
    return _encoder.encode(message) + b"\n"


def decode_answer(line: bytes) -> Answer:
    """Parse a line. Raises CommandError for anything but a response, as from a host of another version."""
    try:
        answer: Answer = _answers.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        reason = json_fault(line, Answer)
        raise CommandError(
            f"not a host's response ({reason}): use the same palpate version on both sides"
        ) from None
    return answer


class Lines:
    """A stream of bytes split into lines of bounded length."""

    def __init__(self, longest: int) -> None:
        self._incomplete, self._longest = b"", longest

    def receive(self, data: bytes) -> list[bytes]:
        """Return the lines completed by `data`. Raises CommandError when one is too long."""
        *lines, self._incomplete = (self._incomplete + data).split(b"\n")
        if len(self._incomplete) > self._longest or any(len(line) > self._longest for line in lines):
            raise CommandError(
                f"a line of more than {self._longest} bytes: send one JSON object a line (docs/using.md)"
            )
        return lines
