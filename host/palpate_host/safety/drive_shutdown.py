"""How the drives lose their power in FAULT and STOP: quick stop first, then off."""

from __future__ import annotations

from palpate_host.common.joint_command import DriveGoal

QUICK_STOP_LIMIT_US = 500_000
POWER_OFF_US = 50_000  # for the last commands to reach the drives


class PowerDown:
    """One way down; a hand that recovers has a new one for the next."""

    def __init__(self) -> None:
        self._off_us: int | None = None

    @property
    def is_off(self) -> bool:
        """Every drive is told to be off."""
        return self._off_us is not None

    def is_over(self, now_us: int) -> bool:
        """They have been told for long enough to have heard it."""
        return self._off_us is not None and now_us - self._off_us >= POWER_OFF_US

    def goal(self, now_us: int, stopped_us: int, any_powered: bool) -> DriveGoal:
        """Quick stop until no drive has power, at most 500 ms from `stopped_us` on; then off for good."""
        if self._off_us is None:
            if any_powered and now_us - stopped_us < QUICK_STOP_LIMIT_US:
                return DriveGoal.QUICK_STOP
            self._off_us = now_us
        return DriveGoal.OFF
