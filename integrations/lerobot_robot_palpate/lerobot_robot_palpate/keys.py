"""The teleoperator ``palpate_keys``: held keys turn the object.

| keys | turn |
|---|---|
| w, s | pitch + and - |
| a, d | roll - and + |
| q, e | yaw + and - |
| 0 | back to the orientation at the start |
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from typing import Any

from lerobot.teleoperators.keyboard import KeyboardTeleop
from lerobot.utils.decorators import check_if_not_connected

from lerobot_robot_palpate.configs import PalpateKeysConfig
from lerobot_robot_palpate.control_socket import PalpateHandError
from lerobot_robot_palpate.driven_orientation import DrivenOrientation
from lerobot_robot_palpate.hand import ORIENTATION
from lerobot_robot_palpate.object_teleoperator import ObjectTeleoperator

TURNS = {"d": (0, 1), "a": (0, -1), "w": (1, 1), "s": (1, -1), "q": (2, 1), "e": (2, -1)}
"""Key -> element of roll, pitch, yaw, and its sign."""
BACK = "0"


class KeyedOrientation:
    """The orientation that held keys have reached. Pure."""

    def __init__(self, speed_deg_s: float, limit_deg: float) -> None:
        self._driven = DrivenOrientation(speed_deg_s, limit_deg)

    def advance(self, held: Collection[Any], elapsed_s: float) -> tuple[float, float, float]:
        """Return roll, pitch and yaw after `held` keys were down for `elapsed_s`."""
        shares = [0.0, 0.0, 0.0]
        for key, (element, sign) in TURNS.items():
            if key in held:
                shares[element] += sign
        return self._driven.advance(shares, elapsed_s, is_back=BACK in held)


class PalpateKeys(ObjectTeleoperator, KeyboardTeleop):
    """Keyboard of an X11 session, Windows or macOS, as LeRobot's own keyboard teleoperator reads it."""

    config_class = PalpateKeysConfig
    name = "palpate_keys"

    def __init__(self, config: PalpateKeysConfig, now_s: Callable[[], float] = time.monotonic) -> None:
        super().__init__(config)
        self._orientation = KeyedOrientation(config.speed_deg_s, config.limit_deg)
        self._now_s, self._last_s = now_s, now_s()

    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002 - LeRobot's signature
        """Start to read the keyboard. Raises PalpateHandError where no window system provides its keys."""
        super().connect()
        if not self.is_connected:
            raise PalpateHandError(
                "no keyboard: palpate_keys needs an X11 session, Windows or macOS;"
                " without one, use --teleop.type=palpate_turns"
            )

    @check_if_not_connected
    def get_action(self) -> dict[str, float]:
        """Return the object's orientation after the keys held since the last call."""
        self._drain_pressed_keys()
        held = {key for key, is_pressed in self.current_pressed.items() if is_pressed}
        now_s = self._now_s()
        rpy_deg = self._orientation.advance(held, now_s - self._last_s)
        self._last_s = now_s
        return dict(zip(ORIENTATION, rpy_deg, strict=True))
