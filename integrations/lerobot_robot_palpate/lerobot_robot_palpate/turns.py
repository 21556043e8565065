"""The teleoperator ``palpate_turns``: a programme of turns, for demonstrations without a person."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from lerobot_robot_palpate.configs import PalpateTurnsConfig
from lerobot_robot_palpate.hand import ORIENTATION
from lerobot_robot_palpate.object_teleoperator import ObjectTeleoperator


def programme_deg(
    targets_deg: Sequence[Sequence[float]], speed_deg_s: float, pause_s: float, elapsed_s: float
) -> tuple[float, float, float]:
    """Return roll, pitch and yaw `elapsed_s` after the start at 0, 0, 0.

    The largest of the three differences to the next target is covered at `speed_deg_s`; after the last
    target the programme repeats from there.
    """
    begin = np.zeros(3)
    while True:
        round_s = 0.0
        for target in map(np.asarray, targets_deg):
            ramp_s = float(np.abs(target - begin).max()) / speed_deg_s
            if elapsed_s < ramp_s + pause_s:
                share = 1.0 if ramp_s == 0.0 else min(1.0, elapsed_s / ramp_s)
                roll, pitch, yaw = begin + share * (target - begin)
                return float(roll), float(pitch), float(yaw)
            elapsed_s -= ramp_s + pause_s
            round_s += ramp_s + pause_s
            begin = target
        if round_s == 0.0:
            roll, pitch, yaw = begin
            return float(roll), float(pitch), float(yaw)


class PalpateTurns(ObjectTeleoperator):
    """Sends the targets of its configuration one after the other, from the first action on."""

    config_class = PalpateTurnsConfig
    name = "palpate_turns"

    def __init__(self, config: PalpateTurnsConfig, now_s: Callable[[], float] = time.monotonic) -> None:
        super().__init__(config)
        if config.speed_deg_s <= 0.0 or any(len(target) != 3 for target in config.targets_deg):
            raise ValueError("palpate_turns: targets_deg are triples of degrees, speed_deg_s is above 0")
        self.config = config
        self._now_s, self._is_connected = now_s, False
        self._begin_s: float | None = None

    @property
    def is_connected(self) -> bool:
        return self._is_connected

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002 - LeRobot's signature
        self._is_connected, self._begin_s = True, None

    @check_if_not_connected
    def get_action(self) -> dict[str, float]:
        """Return the orientation of the programme at this time."""
        now_s = self._now_s()
        if self._begin_s is None:
            self._begin_s = now_s
        config = self.config
        rpy_deg = programme_deg(config.targets_deg, config.speed_deg_s, config.pause_s, now_s - self._begin_s)
        return dict(zip(ORIENTATION, rpy_deg, strict=True))

    def disconnect(self) -> None:
        self._is_connected = False
