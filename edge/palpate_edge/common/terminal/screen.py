"""The terminal of this process, with a live view on its alternate screen."""

from __future__ import annotations

import os
import select
import sys
import termios
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from palpate_edge.common.errors import ConfigError
from palpate_edge.common.terminal.keys import Keys
from palpate_edge.common.terminal.lines import BLANK, Cell, Line, Palette, cells, palette_of, redrawn

CLEAR = "\x1b[2J"
ENTER = f"\x1b[?1049h\x1b[?25l\x1b[?7l{CLEAR}"  # alternate screen, no cursor, no wrap (xterm's sequences)
LEAVE = "\x1b[0m\x1b[?7h\x1b[?25h\x1b[?1049l"
LONGEST_READ = 256
QUIT = "q"

View = Callable[[int, int, Palette], list[Line]]
"""Returns the lines of a screen of this many columns and rows."""


class Screen:
    """The alternate screen; `draw` sends only cells that have changed since the last call."""

    def __init__(self, keyboard: int, display: int, palette: Palette) -> None:
        self._keyboard, self._display, self._palette = keyboard, display, palette
        self._keys = Keys()
        self._size = os.terminal_size((0, 0))
        self._shown: list[list[Cell]] = []

    def draw(self, view: View) -> None:
        """Show a view at the terminal's present size."""
        size = os.get_terminal_size(self._display)
        lines = view(*size, self._palette)[: size.lines]
        rows = [cells(line, size.columns, self._palette) for line in lines]
        blank = [BLANK] * size.columns
        rows += [blank] * (size.lines - len(rows))
        is_resized = size != self._size
        former = [blank] * size.lines if is_resized else self._shown
        text = (CLEAR if is_resized else "") + redrawn(rows, former)
        self._size, self._shown = size, rows
        _write(self._display, text)

    def keys(self, timeout_s: float) -> str:
        """Return the keys pressed, after at most `timeout_s`; `QUIT` when the terminal has closed."""
        if not select.select([self._keyboard], [], [], timeout_s)[0]:
            return ""
        try:
            data = os.read(self._keyboard, LONGEST_READ)
        except OSError:
            data = b""
        return self._keys.of(data) if data else QUIT


@contextmanager
def alternate_screen() -> Iterator[Screen]:
    """Yield the screen of standard input and output; restore the terminal at the end.

    Keys are read one by one, without echo; Ctrl-C is SIGINT as before, Ctrl-S and Ctrl-Z do nothing. Raises
    ConfigError when standard input or output is no terminal, or one without a movable cursor.
    """
    keyboard, display = sys.stdin.fileno(), sys.stdout.fileno()
    if not (os.isatty(keyboard) and os.isatty(display)) or os.environ.get("TERM", "dumb") == "dumb":
        raise ConfigError("--terminal needs a terminal, and TERM set to its kind (over ssh: ssh -t)")
    former = termios.tcgetattr(keyboard)
    present = termios.tcgetattr(keyboard)
    present[0] &= ~termios.IXON
    present[3] &= ~(termios.ICANON | termios.ECHO)
    present[6][termios.VSUSP] = b"\0"
    sys.stdout.flush()
    try:
        termios.tcsetattr(keyboard, termios.TCSANOW, present)
        _write(display, ENTER)
        yield Screen(keyboard, display, palette_of(os.environ))
    finally:
        _write(display, LEAVE)
        termios.tcsetattr(keyboard, termios.TCSANOW, former)


def _write(display: int, text: str) -> None:
    data = text.encode()
    while data:
        data = data[os.write(display, data) :]
