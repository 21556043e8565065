"""The teleoperator ``palpate_gamepad``: sticks turn the object, each at a rate up to `speed_deg_s`.

| default | turn |
|---|---|
| left stick, right and left (axis 0) | roll + and - |
| left stick, away and towards (axis 1, reversed) | pitch + and - |
| right stick, left and right (axis 3, reversed) | yaw + and - |
| button 0, held | back to the orientation at the start |
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from lerobot_robot_palpate.configs import PalpateGamepadConfig
from lerobot_robot_palpate.driven_orientation import DrivenOrientation
from lerobot_robot_palpate.hand import ORIENTATION
from lerobot_robot_palpate.joystick import Joystick
from lerobot_robot_palpate.object_teleoperator import ObjectTeleoperator


class PalpateGamepad(ObjectTeleoperator):
    """A gamepad of Linux."""

    config_class = PalpateGamepadConfig
    name = "palpate_gamepad"

    def __init__(self, config: PalpateGamepadConfig, now_s: Callable[[], float] = time.monotonic) -> None:
        super().__init__(config)
        if len(config.axes) != 3 or len(config.signs) != 3 or not 0.0 <= config.dead_zone < 1.0:
            raise ValueError("palpate_gamepad: axes and signs are three numbers, dead_zone is below 1")
        self.config = config
        self._orientation = DrivenOrientation(config.speed_deg_s, config.limit_deg)
        self._now_s, self._last_s = now_s, now_s()
        self._joystick: Joystick | None = None

    @property
    def is_connected(self) -> bool:
        return self._joystick is not None

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002 - LeRobot's signature
        """Open the gamepad. Raises PalpateHandError when there is none."""
        self._joystick = Joystick(Path(self.config.device))
        self._last_s = self._now_s()

    @check_if_not_connected
    def get_action(self) -> dict[str, float]:
        """Return the object's orientation after the sticks' deflections since the last call."""
        assert self._joystick is not None
        state, config = self._joystick.poll(), self.config
        shares = [
            sign * state.deflection(axis, config.dead_zone)
            for axis, sign in zip(config.axes, config.signs, strict=True)
        ]
        now_s = self._now_s()
        is_back = config.back_button in state.pressed
        rpy_deg = self._orientation.advance(shares, now_s - self._last_s, is_back=is_back)
        self._last_s = now_s
        return dict(zip(ORIENTATION, rpy_deg, strict=True))

    def disconnect(self) -> None:
        if self._joystick is not None:
            self._joystick.close()
            self._joystick = None
