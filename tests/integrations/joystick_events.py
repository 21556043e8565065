"""Bytes of the kernel's joystick API: struct js_event of linux/joystick.h."""

from __future__ import annotations

import struct

LEFT_X, LEFT_Y, RIGHT_X = 0, 1, 3
INITIAL_STATE = bytes.fromhex(
    "a0bb0d00 0000 8100  a0bb0d00 0000 8101"  # buttons 0 and 1 are up
    "a0bb0d00 0000 8200  a0bb0d00 0000 8201  a0bb0d00 0180 8202  a0bb0d00 0000 8203"  # trigger 2 is at -32767
)
"""The events that a gamepad of the driver xpad sends when it is opened."""


def axis(number: int, value: int) -> bytes:
    """Return the event of an axis; value: -32767 to 32767."""
    return struct.pack("<IhBB", 900_000, value, 2, number)


def button(number: int, is_down: bool) -> bytes:
    """Return the event of a button."""
    return struct.pack("<IhBB", 900_000, is_down, 1, number)
