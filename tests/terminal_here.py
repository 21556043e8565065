"""A view of this process on a pseudo-terminal: the function under test runs in a thread."""

from __future__ import annotations

import fcntl
import os
import select
import struct
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from tests.terminal_process import DrawnScreen

PATIENCE_S = 30.0


class TerminalHere:
    """The terminal that is this process's standard input and output. failure: of the function."""

    def __init__(self, columns: int, rows: int) -> None:
        self._ours, self._theirs = os.openpty()
        self.screen = DrawnScreen(columns, rows)
        self._set_size(columns, rows)
        self.settings = self.settings_now()
        self.failure: Exception | None = None
        self._thread: threading.Thread | None = None
        self.files = [os.fdopen(os.dup(self._theirs), mode) for mode in ("r", "w")]

    def start(self, function: Callable[[], Any]) -> None:
        def run() -> None:
            try:
                function()
            except Exception as error:  # noqa: BLE001 (the test's thread reports it)
                self.failure = error

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    def resize(self, columns: int, rows: int) -> None:
        self._read(0.0)
        self.screen.resize(columns, rows)
        self._set_size(columns, rows)

    def press(self, keys: str) -> None:
        os.write(self._ours, keys.encode())

    def until(self, condition: Callable[[DrawnScreen], Any], what: str) -> None:
        """Wait until a condition of the screen holds."""
        end_s = time.monotonic() + PATIENCE_S
        while not condition(self.screen):
            assert self.failure is None, self.failure
            assert time.monotonic() < end_s, f"{what}:\n{self.screen.text}"
            self._read(0.05)

    def finish(self) -> None:
        """Wait for the end of the function; the terminal must be as it was."""
        assert self._thread is not None
        self.until(lambda _: not self._thread.is_alive(), "does not end")
        self._read(0.0)
        assert self.failure is None, self.failure
        assert self.settings_now() == self.settings
        assert self.screen.modes == {"25", "7"}  # cursor and wrap; no alternate screen

    def settings_now(self) -> list[Any]:
        return termios.tcgetattr(self._theirs)

    def close(self) -> None:
        for file in self.files:
            file.close()
        os.close(self._ours)
        os.close(self._theirs)

    def _read(self, timeout_s: float) -> None:
        while select.select([self._ours], [], [], timeout_s)[0]:
            self.screen.take(os.read(self._ours, 1 << 16).decode(errors="ignore"))
            timeout_s = 0.0

    def _set_size(self, columns: int, rows: int) -> None:
        fcntl.ioctl(self._theirs, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))


@contextmanager
def terminal_here(columns: int = 80, rows: int = 24) -> Iterator[TerminalHere]:
    """Replace standard input and output by a terminal of this size."""
    terminal = TerminalHere(columns, rows)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stdin", terminal.files[0])
        patch.setattr(sys, "stdout", terminal.files[1])
        patch.setenv("TERM", "xterm-256color")
        patch.setenv("LC_ALL", "C.UTF-8")
        try:
            yield terminal
        finally:
            terminal.close()
