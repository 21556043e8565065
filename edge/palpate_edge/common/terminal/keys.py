"""Keys from the bytes of a terminal. Pure."""

from __future__ import annotations

ESCAPE = "\x1b"


class Keys:
    """Takes bytes as they arrive; drops the sequences of cursor and function keys (ECMA-48: CSI, SS3).

    A lone Escape, and the Escape before a key that Alt precedes, are dropped too; the key itself is kept.
    """

    def __init__(self) -> None:
        self._before = ""

    def of(self, data: bytes) -> str:
        """Return the keys, one character each."""
        keys = ""
        for key in data.decode("ascii", "ignore"):
            if self._before == ESCAPE and key in "[O":
                self._before = key
            elif self._before == "[" and " " <= key <= "?":
                pass  # parameters
            elif self._before in ("[", "O") or key == ESCAPE:
                self._before = key if key == ESCAPE else ""
            else:
                self._before = ""
                keys += key
        return keys
