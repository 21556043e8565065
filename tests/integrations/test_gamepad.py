"""The gamepad of the LeRobot plug-in at the kernel's border: bytes of struct js_event through a FIFO."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, BinaryIO

import pytest
from tests.integrations.joystick_events import INITIAL_STATE, LEFT_X, LEFT_Y, RIGHT_X, axis, button


@pytest.fixture
def device(tmp_path: Path, plugin) -> Iterator[tuple[Any, BinaryIO]]:
    """The gamepad as the plug-in opens it, and the kernel's end."""
    os.mkfifo(tmp_path / "js0")
    with (
        closing(plugin("joystick").Joystick(tmp_path / "js0")) as joystick,
        (tmp_path / "js0").open("wb", buffering=0) as kernel,
    ):
        yield joystick, kernel


def test_the_initial_state_is_at_rest_and_changes_follow(device) -> None:
    joystick, kernel = device
    kernel.write(INITIAL_STATE)
    state = joystick.poll()
    assert [state.deflection(number, 0.1) for number in (LEFT_X, LEFT_Y, RIGHT_X)] == [0.0, 0.0, 0.0]
    assert state.axes[2] == -1.0 and not state.pressed
    kernel.write(axis(LEFT_X, 32767) + axis(LEFT_Y, -32768) + axis(RIGHT_X, 18022) + button(1, True))
    state = joystick.poll()
    assert [state.deflection(number, 0.1) for number in (LEFT_X, LEFT_Y)] == [1.0, -1.0]
    assert state.deflection(RIGHT_X, 0.1) == pytest.approx(0.5, abs=1e-4)  # 0.55 from a dead zone of 0.1
    assert state.pressed == {1}
    kernel.write(axis(LEFT_X, 3276) + button(1, False))
    state = joystick.poll()
    assert state.deflection(LEFT_X, 0.1) == 0.0 and not state.pressed
    assert joystick.poll() is state, "without an event the state stays"


def test_events_in_pieces_and_thousands_at_once_are_read(device) -> None:
    joystick, kernel = device
    event = axis(LEFT_X, -32767)
    kernel.write(event[:5])
    assert joystick.poll().axes == {}
    kernel.write(event[5:] + b"".join(axis(LEFT_Y, value) for value in range(5000)))
    state = joystick.poll()
    assert state.axes == {LEFT_X: -1.0, LEFT_Y: pytest.approx(4999 / 32767)}


def test_an_unplugged_and_a_missing_gamepad_are_errors_with_the_next_step(plugin, device, tmp_path) -> None:
    joystick, kernel = device
    error = plugin("control_socket").PalpateHandError
    kernel.write(axis(LEFT_X, 32767))
    kernel.close()
    with pytest.raises(error, match=r"js0 is gone \(end of file\): connect it and start again"):
        joystick.poll()
    with pytest.raises(error, match=r"no gamepad at .*js7 \(No such file or directory\): connect one"):
        plugin("joystick").Joystick(tmp_path / "js7")


def test_a_stick_turns_at_its_share_of_the_speed_within_the_limits(plugin) -> None:
    driven = plugin("driven_orientation").DrivenOrientation(speed_deg_s=10.0, limit_deg=2.5)
    for _ in range(4):
        rpy_deg = driven.advance((1.0, -0.5, 0.0), 0.05, is_back=False)
    assert rpy_deg == pytest.approx((2.0, -1.0, 0.0))
    assert driven.advance((0.0, 0.0, 9.0), 60.0, is_back=False) == pytest.approx((2.0, -1.0, 1.0))
    assert driven.advance((1.0, 0.0, 0.0), 0.1, is_back=False) == pytest.approx((2.5, -1.0, 1.0))
    assert driven.advance((0.0, 0.0, 0.0), 0.1, is_back=True) == pytest.approx((1.5, 0.0, 0.0))
