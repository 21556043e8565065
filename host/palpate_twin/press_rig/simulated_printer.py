"""A printer with Marlin at its serial line: bytes and time in, bytes and the head's position out."""

from __future__ import annotations

import re
from collections import deque
from functools import reduce
from operator import xor

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_twin.press_rig.axes import Play, StraightMove

PLAY_MM = 0.05
BUSY_US = 2_000_000  # period of Marlin's keepalive
_WORD = re.compile(r"([A-Z])(-?\d*\.?\d+)")


class SimulatedPrinter:
    """One printer. moving_us: time in motion so far. is_silent: it takes nothing and answers nothing, as
    without power; `damage_next` damages the next line on its way, as noise on the cable does."""

    def __init__(self, start_mm: Array, play_mm: float = PLAY_MM) -> None:
        self.moving_us = 0
        self.is_silent = False
        self.is_halted = False
        self.damage_next = False
        self.lines: list[str] = []
        self._target_mm = start_mm.astype(np.float64)
        self._move = StraightMove.plan(0, self._target_mm, self._target_mm, 1.0)
        self._play = Play(play_mm, self._target_mm)
        self._speed_mm_s = 10.0
        self._last_number = 0
        self._received = b""
        self._waiting: deque[str] = deque()  # commands whose turn has not come
        self._answer = bytearray(b"start\necho:Marlin 2.1.2\n")
        self._busy_from_us = 0

    def receive(self, data: bytes) -> None:
        """Take bytes of the host."""
        if self.is_silent:
            return
        *lines, self._received = (self._received + data).split(b"\n")
        for line in lines:
            if line.strip() == b"M112":
                self.is_halted = True
                self._waiting.clear()
                self._answer += b"Error:Printer halted. kill() called!\n"
            elif not self.is_halted:
                self._take_line(line)

    def advance(self, now_us: int) -> bytes:
        """Do what is due; return bytes for the host."""
        if self.is_silent:
            return b""
        while self._waiting and (self._waiting[0] != "M400" or now_us >= self._move.end_us):
            command = self._waiting.popleft()
            if command != "M400":
                self._execute(now_us, command)
            self._answer += b"ok\n"
            self._busy_from_us = now_us
        if self._waiting and now_us - self._busy_from_us >= BUSY_US:
            self._busy_from_us = now_us
            self._answer += b"echo:busy: processing\n"
        answer, self._answer = bytes(self._answer), bytearray()
        return answer

    def position_mm(self, now_us: int) -> Array:
        """Return where the head stands (3,); times must not decrease."""
        return self._play.follow(self._move.at_mm(now_us))

    def _take_line(self, line: bytes) -> None:
        if self.damage_next:
            self.damage_next = False
            line = line[:3] + b"?" + line[4:]
        body, star, checksum = line.partition(b"*")
        numbered = re.match(rb"N(\d+) ?(.*)", body)
        if numbered is None:
            self._waiting.append(body.decode("ascii").strip())
            return
        number, command = int(numbered[1]), numbered[2].decode("ascii", "replace")
        if not star or int(checksum) != reduce(xor, body):
            self._request_again("checksum mismatch")
        elif command.startswith("M110"):
            self._last_number = number
            self._waiting.append(command)
        elif number != self._last_number + 1:
            self._request_again("Line Number is not Last Line Number+1")
        else:
            self._last_number = number
            self._waiting.append(command)

    def _request_again(self, reason: str) -> None:
        self._answer += (
            f"Error:{reason}, Last Line: {self._last_number}\nResend: {self._last_number + 1}\nok\n".encode()
        )

    def _execute(self, now_us: int, command: str) -> None:
        self.lines.append(command)
        words = dict(_WORD.findall(command))
        if command.startswith("G1 "):
            self._speed_mm_s = float(words.get("F", 60 * self._speed_mm_s)) / 60
            target = [float(words.get(axis, at)) for axis, at in zip("XYZ", self._target_mm, strict=True)]
            start_us = max(now_us, self._move.end_us)
            self._move = StraightMove.plan(start_us, self._target_mm, np.array(target), self._speed_mm_s)
            self._target_mm = np.array(target)
            self.moving_us += self._move.end_us - start_us
        elif command == "M114":
            x, y, z = self._target_mm.tolist()
            self._answer += f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f} E:0.00 Count X:0 Y:0 Z:0\n".encode()
        elif command.split(maxsplit=1)[0] not in {"G21", "G90", "G28", "M110", "M115"}:
            self._answer += f'echo:Unknown command: "{command}"\n'.encode()
