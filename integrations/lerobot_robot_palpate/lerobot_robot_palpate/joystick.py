"""Axes and buttons of a gamepad by the kernel's joystick API: /dev/input/js0, one struct js_event an event.

The kernel first sends the state of each axis and button, marked as initial, then each change (Linux,
Documentation/input/joydev/joystick-api.rst).
"""

from __future__ import annotations

import os
import struct
from pathlib import Path

from lerobot_robot_palpate.control_socket import PalpateHandError

EVENT = struct.Struct("=IhBB")
"""time (ms), value, type, number."""
BUTTON, AXIS, INITIAL = 0x01, 0x02, 0x80
FULL = 32767
READ_EVENTS = 64


class JoystickState:
    """Deflections and pressed buttons after a stream of events. Pure."""

    def __init__(self) -> None:
        self.axes: dict[int, float] = {}
        self.pressed: set[int] = set()
        self._rest = b""

    def receive(self, data: bytes) -> None:
        """Take bytes of the device; an incomplete event waits for its rest."""
        data = self._rest + data
        whole = len(data) - len(data) % EVENT.size
        self._rest = data[whole:]
        for _, value, kind, number in EVENT.iter_unpack(data[:whole]):
            if kind & ~INITIAL == AXIS:
                self.axes[number] = max(-1.0, value / FULL)
            elif kind & ~INITIAL == BUTTON and value:
                self.pressed.add(number)
            elif kind & ~INITIAL == BUTTON:
                self.pressed.discard(number)

    def deflection(self, axis: int, dead_zone: float) -> float:
        """Return -1 to 1; 0 within the dead zone, from whose edge the deflection counts."""
        value = self.axes.get(axis, 0.0)
        share = max(0.0, abs(value) - dead_zone) / (1.0 - dead_zone)
        return share if value >= 0.0 else -share


class Joystick:
    """An open device."""

    def __init__(self, path: Path) -> None:
        """Open the device. Raises PalpateHandError when there is none, or this user may not read it."""
        self.state, self._path = JoystickState(), path
        try:
            self._device = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            raise PalpateHandError(
                f"no gamepad at {path} ({error.strerror}): connect one, load the kernel module joydev, or"
                " give --teleop.device; the user has to be in the group input"
            ) from error

    def poll(self) -> JoystickState:
        """Return the state after all events so far. Raises PalpateHandError when the gamepad is gone."""
        reason = "end of file"
        try:
            while data := os.read(self._device, READ_EVENTS * EVENT.size):
                self.state.receive(data)
        except BlockingIOError:
            return self.state
        except OSError as error:  # ENODEV: unplugged
            reason = str(error.strerror)
        raise PalpateHandError(f"the gamepad at {self._path} is gone ({reason}): connect it and start again")

    def close(self) -> None:
        """Close the device."""
        os.close(self._device)
