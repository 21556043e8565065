"""Homing of the drives at start-up, one after another. Pure: the time is an argument.

A drive that has kept its zero since its last homing reports it (statusword bit 12 in homing mode) and is not
moved. Nothing is tried again: a drive that reports an error, faults or takes too long is a fault of the hand.
"""

from __future__ import annotations

from collections.abc import Sequence

from palpate_host.config.hand_config import HomingConfig
from palpate_host.drives.drive import Drive, HomingState


class HomingRun:
    """The homing of all drives; call `step` once a tick in the mode HOME."""

    def __init__(self, config: HomingConfig | None, drives: Sequence[Drive]) -> None:
        self._config = config
        self._drives = drives
        self._homed = [config is None] * len(drives)
        self._since_us: int | None = None
        self._was_enabled = False
        self.problem = ""

    def booted(self, node_id: int) -> None:
        """Home the drive again: it has booted, so it may have lost power and its zero."""
        if self._config is not None:
            for i, drive in enumerate(self._drives):
                if drive.node_id == node_id:
                    self._homed[i] = False
        self._since_us = None
        self.problem = ""

    @property
    def turn(self) -> int | None:
        """The index of the drive whose turn it is, None when all are homed."""
        return self._homed.index(False) if False in self._homed else None

    @property
    def waiting(self) -> str:
        """The name of the drive whose turn it is, empty when all are homed."""
        return "" if self.turn is None else self._drives[self.turn].name

    def step(self, now_us: int) -> None:
        """Check the drive whose turn it is; a failure is described in `problem`."""
        turn = self.turn
        if turn is None or self._config is None:
            return
        drive = self._drives[turn]
        if self._since_us is None:
            self._since_us, self._was_enabled = now_us, False
        is_enabled = drive.is_enabled
        if is_enabled and drive.homing is HomingState.ATTAINED:
            self._homed[turn] = True
            self._since_us = None
        elif drive.homing is HomingState.ERROR:
            self.problem = (
                f"{drive.name}: homing error (method {self._config.method}): check its switch and its path"
            )
        elif self._was_enabled and not is_enabled:
            self.problem = f"{drive.name}: {drive.state_name} while homing"
        elif now_us - self._since_us > self._config.timeout_s * 1e6:
            self.problem = f"{drive.name}: not homed within homing.timeout_s = {self._config.timeout_s:g} s"
        self._was_enabled = self._was_enabled or is_enabled
