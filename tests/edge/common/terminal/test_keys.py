"""Keys among the bytes of a terminal."""

from __future__ import annotations

import pytest

from palpate_edge.common.terminal.keys import Keys


@pytest.mark.parametrize(
    ("data", "pressed"),
    [
        (b"rq", "rq"),
        (b"\x1b[A\x1b[1;5Cs", "s"),  # cursor keys of xterm
        (b"\x1bOP\x1b[15~ ", " "),  # F1, F5
        (b"\x1bs", "s"),  # Alt-s, or Escape and s: a stop must not be lost
        (b"\x1b\x1b[Bs", "s"),
        ("é\xff".encode() + b"\xffs", "s"),
    ],
)
def test_sequences_are_no_keys(data, pressed):
    assert Keys().of(data) == pressed
    keys = Keys()
    assert "".join(keys.of(data[place : place + 1]) for place in range(len(data))) == pressed
