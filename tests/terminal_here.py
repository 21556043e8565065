"""A view of this process on a pseudo-terminal: the function under test runs in a thread."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from tests.terminal_process import PseudoTerminal


class TerminalHere(PseudoTerminal):
    """The terminal that is this process's standard input and output. failure: of the function."""

    patience_s = 30.0

    def __init__(self, columns: int, rows: int) -> None:
        super().__init__(columns, rows)
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

    def finish(self) -> None:
        """Wait for the end of the function; the terminal must be as it was."""
        assert self._thread is not None
        self.until(lambda _: not self._thread.is_alive(), "does not end")
        self._read(0.0)
        self._check()
        assert self.settings_now() == self.settings
        assert self.screen.modes == {"25", "7"}  # cursor and wrap; no alternate screen

    def close(self) -> None:
        for file in self.files:
            file.close()
        super().close()

    def _check(self) -> None:
        assert self.failure is None, self.failure


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
