"""The state of a node id that another node uses as well: when contacts return and the error ends; pure.

A foreign frame with an identifier of this node keeps the node silent for QUIET_US. The error lasts until none
has arrived for OVER_US, so that a stranger causes at most one EMCY in that time, and the node returns at most
once in QUIET_US.
"""

from __future__ import annotations

QUIET_US = 700_000  # without a foreign frame, until the node returns to its former state
OVER_US = 10_000_000  # without a foreign frame, until the error is over


class IdConflict:
    """Foreign frames with an identifier of this node.

    frames: since the start. can_id: of the last one. is_active: the error is not over; is_silent: the node is
    kept out of OPERATIONAL.
    """

    def __init__(self) -> None:
        self.frames = 0
        self.can_id = 0
        self.is_active = self.is_silent = False
        self._last_us = 0

    def seen(self, now_us: int, can_id: int) -> None:
        """Note a foreign frame."""
        self.frames += 1
        self.can_id = can_id
        self.is_active = self.is_silent = True
        self._last_us = now_us

    def poll(self, now_us: int) -> None:
        """End the silence and the error when their time has passed."""
        self.is_silent = self.is_silent and now_us < self._last_us + QUIET_US
        self.is_active = self.is_active and now_us < self._last_us + OVER_US

    def end(self) -> None:
        """End both at once: this node has another id."""
        self.is_active = self.is_silent = False

    @property
    def due_us(self) -> int | None:
        """The time of the next `poll` that has work; None when nothing is due."""
        if self.is_silent:
            return self._last_us + QUIET_US
        return self._last_us + OVER_US if self.is_active else None
