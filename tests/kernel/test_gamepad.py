"""The LeRobot plug-in's reader of gamepads on the kernel's joystick API (joydev)."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
from tests.lerobot_plugin import plugin_modules

from kernel_guest.gamepad import AXIS, BUTTON_A, BUTTON_B, KEY, RIGHT_X, X, Y, gamepad

pytestmark = pytest.mark.vm

DEVICE = Path("/dev/input/js0")
FLAT = 128
HALF = (1 << 29) // (32767 - 2 * FLAT) * (16384 - FLAT) >> 14
"""Value for a stick at 16384, by joydev_correct of the kernel's joydev.c."""


def test_sticks_and_buttons_have_the_numbers_of_the_defaults(wait_until) -> None:
    """Axes 0, 1 and 3 are the sticks of roll, pitch and yaw; button 0 is A. Triggers rest at -1."""
    with plugin_modules() as module, gamepad() as pad:
        wait_until(DEVICE.exists)
        with closing(module("joystick").Joystick(DEVICE)) as joystick:
            state = joystick.poll()
            assert [state.axes[number] for number in range(8)] == [0, 0, -1, 0, 0, -1, 0, 0]
            assert not state.pressed
            pad.send(AXIS, {X: 32767, Y: 16384, RIGHT_X: -32768})
            pad.send(KEY, {BUTTON_A: 1, BUTTON_B: 1})
            wait_until(lambda: joystick.poll().pressed == {0, 1})
            assert (state.axes[0], state.axes[3]) == (1.0, -1.0)
            assert state.axes[1] * 32767 == pytest.approx(HALF)
            pad.send(KEY, {BUTTON_B: 0})
            wait_until(lambda: joystick.poll().pressed == {0})
            pad.unplug()
            with pytest.raises(module("control_socket").PalpateHandError, match=r"gone \(No such device\)"):
                wait_until(lambda: joystick.poll() is None)
