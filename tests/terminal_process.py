"""A program on a pseudo-terminal, and the screen that it draws there."""

from __future__ import annotations

import fcntl
import os
import re
import select
import struct
import subprocess
import termios
import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 60.0
SEQUENCE = re.compile(r"\x1b\[([?]?)([0-9;]*)([A-Za-z])")


class DrawnScreen:
    """Rows of text from what a program writes.

    Obeys the sequences of ECMA-48 and xterm that the views use, and fails at any other, at a character
    beyond the last column, and at a control character.
    """

    def __init__(self, columns: int, rows: int) -> None:
        self.modes: set[str] = set()
        self.main_text = ""
        self._pending = ""
        self.resize(columns, rows)

    def resize(self, columns: int, rows: int) -> None:
        self.columns, self.rows = columns, [""] * rows
        self._at = [0, 0]

    @property
    def text(self) -> str:
        return "\n".join(self.rows)

    def take(self, text: str) -> None:
        text, self._pending = self._pending + text, ""
        place = 0
        while place < len(text):
            if text[place] != "\x1b":
                self._put(text[place])
                place += 1
                continue
            match = SEQUENCE.match(text, place)
            if match is None:
                assert len(text) - place < 32, repr(text[place:])
                self._pending = text[place:]
                return
            self._obey(*match.groups())
            place = match.end()

    def _put(self, character: str) -> None:
        if "1049" not in self.modes:
            self.main_text += character
            return
        row, column = self._at
        assert character.isprintable() and column < self.columns, (character, row, column)
        line = self.rows[row].ljust(column)
        self.rows[row] = line[:column] + character + line[column + 1 :]
        self._at[1] += 1

    def _obey(self, private: str, numbers: str, final: str) -> None:
        row, column = self._at
        if private:
            assert final in "hl"
            (self.modes.add if final == "h" else self.modes.discard)(numbers)
        elif final == "H":
            self._at = [int(part) - 1 for part in numbers.split(";")]
        elif final == "K":
            self.rows[row] = self.rows[row][:column]
        elif final == "J":
            self.rows = [""] * len(self.rows)
        else:
            assert final == "m", (numbers, final)


class PseudoTerminal:
    """A pseudo-terminal of some size, its screen, and its settings at the beginning."""

    patience_s = PATIENCE_S

    def __init__(self, columns: int, rows: int) -> None:
        self._ours, self._theirs = os.openpty()
        self.screen = DrawnScreen(columns, rows)
        self._set_size(columns, rows)
        self.settings = self.settings_now()

    def resize(self, columns: int, rows: int) -> None:
        """Change the terminal's size. Call `until` afterwards: what was on its way is dropped."""
        self._read(0.0)
        self.screen.resize(columns, rows)
        self._set_size(columns, rows)

    def press(self, keys: str) -> None:
        os.write(self._ours, keys.encode())

    def until(self, condition: Callable[[DrawnScreen], Any], what: str) -> None:
        """Wait until a condition of the screen holds."""
        end_s = time.monotonic() + self.patience_s
        while not condition(self.screen):
            self._check()
            assert time.monotonic() < end_s, f"{what}:\n{self.screen.main_text}\n{self.screen.text}"
            self._read(0.05)

    def settings_now(self) -> list[Any]:
        return termios.tcgetattr(self._theirs)

    def close(self) -> None:
        os.close(self._ours)
        os.close(self._theirs)

    def _check(self) -> None:
        """Fail where nothing more will be drawn."""

    def _read(self, timeout_s: float) -> None:
        while select.select([self._ours], [], [], timeout_s)[0]:
            self.screen.take(os.read(self._ours, 1 << 16).decode(errors="ignore"))
            timeout_s = 0.0

    def _set_size(self, columns: int, rows: int) -> None:
        fcntl.ioctl(self._theirs, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))


class TerminalProcess(PseudoTerminal):
    """A command whose standard input, output and error are a terminal of this size."""

    def __init__(self, command: list[str], columns: int, rows: int, **environment: str) -> None:
        super().__init__(columns, rows)
        self.process = subprocess.Popen(
            ["setsid", "--ctty", *command],
            stdin=self._theirs,
            stdout=self._theirs,
            stderr=self._theirs,
            env={**os.environ, "TERM": "xterm-256color", "LC_ALL": "C.UTF-8", **environment},
        )

    def finish(self) -> int:
        """Read until the process has ended; return its exit status."""
        self.until(lambda _: self.process.poll() is not None, "does not end")
        self._read(0.0)
        return self.process.returncode

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        super().close()
