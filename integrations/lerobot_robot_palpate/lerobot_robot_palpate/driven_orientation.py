"""The orientation to which rates of roll, pitch and yaw have led: shared by keys and gamepad. Pure."""

from __future__ import annotations

from collections.abc import Sequence

LONGEST_STEP_S = 0.1
"""Time that one call counts at most, so that a pause of the caller is no jump."""


class DrivenOrientation:
    """Roll, pitch and yaw, each turned at a rate of at most `speed_deg_s` and within `limit_deg`."""

    def __init__(self, speed_deg_s: float, limit_deg: float) -> None:
        self._speed_deg_s, self._limit_deg = speed_deg_s, limit_deg
        self.rpy_deg = (0.0, 0.0, 0.0)

    def advance(
        self, shares: Sequence[float], elapsed_s: float, *, is_back: bool
    ) -> tuple[float, float, float]:
        """Return roll, pitch and yaw after `elapsed_s`.

        shares: of the speed, -1 to 1, for each. is_back: turn towards the orientation at the start as well.
        """
        step_deg = self._speed_deg_s * min(elapsed_s, LONGEST_STEP_S)
        rpy = list(self.rpy_deg)
        if is_back:
            rpy = [value - max(-step_deg, min(step_deg, value)) for value in rpy]
        rpy = [
            value + max(-1.0, min(1.0, share)) * step_deg for value, share in zip(rpy, shares, strict=True)
        ]
        roll, pitch, yaw = (max(-self._limit_deg, min(self._limit_deg, value)) for value in rpy)
        self.rpy_deg = (roll, pitch, yaw)
        return self.rpy_deg
