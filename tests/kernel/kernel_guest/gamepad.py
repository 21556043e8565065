"""A gamepad of the kernel's uinput with the axes and buttons of the driver xpad (Xbox 360 pads)."""

from __future__ import annotations

import fcntl
import os
import struct
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

# linux/uinput.h and linux/input-event-codes.h
SET_EVENT, SET_KEY, SET_AXIS = 0x40045564, 0x40045565, 0x40045567
SETUP, SETUP_AXIS, CREATE, DESTROY = 0x405C5503, 0x401C5504, 0x5501, 0x5502
SYNC, KEY, AXIS = 0, 1, 3
X, Y, LEFT_TRIGGER, RIGHT_X, RIGHT_Y, RIGHT_TRIGGER, HAT_X, HAT_Y = 0, 1, 2, 3, 4, 5, 0x10, 0x11
BUTTON_A, BUTTON_B = 0x130, 0x131
BUTTONS = (BUTTON_A, BUTTON_B, 0x133, 0x134, 0x136, 0x137, 0x13A, 0x13B, 0x13C, 0x13D, 0x13E)
STICK, TRIGGER, HAT = (-32768, 32767, 16, 128), (0, 255, 0, 0), (-1, 1, 0, 0)
AXES = dict.fromkeys((X, Y, RIGHT_X, RIGHT_Y), STICK) | {
    **dict.fromkeys((LEFT_TRIGGER, RIGHT_TRIGGER), TRIGGER),
    **dict.fromkeys((HAT_X, HAT_Y), HAT),
}
"""Code -> minimum, maximum, fuzz and flat, as xpad.c sets them."""

IDENTITY = struct.Struct("HHHH80sI")
AXIS_SETUP = struct.Struct("Hxx6i")
EVENT = struct.Struct("llHHi")
USB = 3


class Gamepad:
    """A connected gamepad."""

    def __init__(self, device: int) -> None:
        self._device = device

    def send(self, kind: int, values: Mapping[int, int]) -> None:
        """Send one report: kind is KEY or AXIS; values: code -> value."""
        for code, value in values.items():
            os.write(self._device, EVENT.pack(0, 0, kind, code, value))
        os.write(self._device, EVENT.pack(0, 0, SYNC, 0, 0))

    def unplug(self) -> None:
        """Remove the gamepad from the kernel."""
        fcntl.ioctl(self._device, DESTROY)


@contextmanager
def gamepad() -> Iterator[Gamepad]:
    """Plug in a gamepad at rest."""
    subprocess.run(["modprobe", "--all", "uinput", "joydev"], check=True)
    device = os.open("/dev/uinput", os.O_WRONLY)
    try:
        for kind in (KEY, AXIS):
            fcntl.ioctl(device, SET_EVENT, kind)
        for button in BUTTONS:
            fcntl.ioctl(device, SET_KEY, button)
        for axis, (low, high, fuzz, flat) in AXES.items():
            fcntl.ioctl(device, SET_AXIS, axis)
            fcntl.ioctl(device, SETUP_AXIS, AXIS_SETUP.pack(axis, 0, low, high, fuzz, flat, 0))
        fcntl.ioctl(device, SETUP, IDENTITY.pack(USB, 0x045E, 0x028E, 0x0114, b"gamepad", 0))
        fcntl.ioctl(device, CREATE)
        yield Gamepad(device)
    finally:
        os.close(device)
