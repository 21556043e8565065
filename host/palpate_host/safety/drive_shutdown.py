"""The shutdown of the drives in FAULT and STOP: quick stop first, then off. Pure."""

from __future__ import annotations

from palpate_host.common.joint_command import DriveGoal

QUICK_STOP_LIMIT_US = 500_000
OFF_SETTLING_US = 50_000  # for the last commands to reach the drives


class DriveShutdown:
    """One shutdown; after `Recover` the next one is a new object."""

    def __init__(self) -> None:
        self._off_us: int | None = None

    @property
    def is_off(self) -> bool:
        """True once every drive is commanded off."""
        return self._off_us is not None

    def is_finished(self, now_us: int) -> bool:
        """Return whether the drives have been commanded off for 50 ms, which every drive has received."""
        return self._off_us is not None and now_us - self._off_us >= OFF_SETTLING_US

    def goal(self, now_us: int, stopped_us: int, any_powered: bool) -> DriveGoal:
        """Return QUICK_STOP until no drive has power, at most 500 ms after `stopped_us`; from then on OFF."""
        if self._off_us is None:
            if any_powered and now_us - stopped_us < QUICK_STOP_LIMIT_US:
                return DriveGoal.QUICK_STOP
            self._off_us = now_us
        return DriveGoal.OFF
