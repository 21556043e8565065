"""The serial dialogue with Marlin, and with Klipper's same subset: bytes and time in, bytes and replies out.

A line is sent as ``N<number> <command>*<checksum>``, the checksum being the exclusive or of all bytes before
the asterisk. The firmware answers ``ok`` when it has taken the line; M400 when all motion has ended. After a
damaged line it sends ``Resend: <number>`` and an ``ok`` that belongs to the resend. While a command takes
long, Marlin sends ``echo:busy: processing`` every two seconds. Klipper accepts number and checksum
and ignores both.
"""

from __future__ import annotations

import re
from functools import reduce
from operator import xor

from palpate_edge.common.errors import RigError

EMERGENCY_STOP = b"M112\n"  # without number: Marlin's emergency parser acts on it ahead of all other lines
RECOVERABLE = ("line number", "checksum")  # errors that a Resend follows
POWER_ON_S = 15.0  # a board that restarts when its port is opened answers within this time
MOST_RESENDS = 10  # of one line
LONGEST_LINE = 1000

_RESEND = re.compile(r"(?:resend:?|rs)\s*N?(\d+)", re.IGNORECASE)
_POSITION = re.compile(r"([XYZ]):\s*(-?\d+(?:\.\d+)?)")


def numbered(number: int, command: str) -> bytes:
    """Return a command as a line with number and checksum."""
    line = f"N{number} {command}".encode("ascii")
    return line + b"*%d\n" % reduce(xor, line)


def position_of(replies: list[str]) -> tuple[float, float, float]:
    """Return X, Y, Z in mm of the replies to M114. Raises RigError when they hold none."""
    for reply in replies:
        found = dict(reversed(_POSITION.findall(reply)))  # of doublets ("Count X:") the first counts
        if len(found) == 3:
            return float(found["X"]), float(found["Y"]), float(found["Z"])
    raise RigError("the printer did not report its position (M114): is it Marlin or Klipper?")


class MarlinLink:
    """One printer; at most one line is under way. is_ready: the printer owes no reply."""

    def __init__(self, silence_s: float) -> None:
        self.is_ready = True
        self.resends = 0
        self._silence_us = round(1e6 * silence_s)
        self._number = 0
        self._line = b""
        self._is_first = True
        self._skipped_oks = self._resends_of_line = 0
        self._heard_us = 0
        self._received = b""
        self._replies: list[str] = []

    def open(self, now_us: int) -> bytes:
        """Return the first bytes: the line counter starts at 0."""
        self._number = -1
        return self.send(now_us, "M110 N0")

    def send(self, now_us: int, command: str) -> bytes:
        """Return the bytes of a command; the printer must be ready."""
        assert self.is_ready
        self._number += 1
        self._line = numbered(self._number, command)
        self._replies, self._resends_of_line = [], 0
        self.is_ready, self._heard_us = False, now_us
        return self._line

    def receive(self, now_us: int, data: bytes) -> bytes:
        """Take the printer's bytes; return bytes to send. Raises RigError when the printer stopped."""
        if data:
            self._heard_us = now_us
        *lines, self._received = (self._received + data).split(b"\n")
        self._received = self._received[-LONGEST_LINE:]
        return b"".join(self._receive_line(line.decode("utf-8", "replace").strip()) for line in lines)

    def take_replies(self) -> list[str]:
        """Return what the printer sent before the last ``ok``."""
        replies, self._replies = self._replies, []
        return replies

    def check(self, now_us: int) -> None:
        """Raises RigError when the printer owes a reply and is silent."""
        limit_us = round(1e6 * POWER_ON_S) if self._is_first else self._silence_us
        if not self.is_ready and now_us - self._heard_us > limit_us:
            raise RigError(
                f"the printer is silent for {limit_us / 1e6:g} s after {self._command}: check power, cable, "
                "printer.port and printer.baud"
            )

    @property
    def _command(self) -> str:
        return self._line.decode("ascii").partition(" ")[2].partition("*")[0]

    def _receive_line(self, line: str) -> bytes:
        lower = line.lower()
        resend = _RESEND.match(line)
        if resend:
            return self._resend(int(resend[1]))
        if lower == "start" and not self._is_first:
            raise RigError("the printer restarted, its position is lost: home it and start again")
        if lower.startswith("!!") or (
            lower.startswith("error") and not any(text in lower for text in RECOVERABLE)
        ):
            raise RigError(f"the printer refuses {self._command}: {line}")
        if lower.startswith("echo:home") and lower.endswith("first"):
            raise RigError("the printer is not homed: home it, or add G28 to printer.start in rig.toml")
        if lower == "ok" or lower.startswith("ok "):
            self._acknowledge()
        elif line and not lower.startswith("echo:busy"):
            self._replies.append(line)
        return b""

    def _acknowledge(self) -> None:
        if self._skipped_oks:
            self._skipped_oks -= 1
            return
        self.is_ready, self._is_first = True, False

    def _resend(self, number: int) -> bytes:
        self.resends += 1
        self._resends_of_line += 1
        is_other = number != self._number and not self._is_first  # M110 sets the number, damaged or not
        if is_other or self._resends_of_line > MOST_RESENDS:
            raise RigError(
                f"the printer asks for line {number} again, line {self._number} is under way: check "
                "the cable, or set printer.baud lower"
            )
        self._skipped_oks += 1
        return self._line
