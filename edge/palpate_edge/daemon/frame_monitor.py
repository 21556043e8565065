"""Supervision of the frames: they come in time, show the beads, and are not dropped; pure."""

from __future__ import annotations

from collections import deque

from palpate_edge.common.contact import MIN_BEADS_SHARE, Contact

RATE_WINDOW_US = 1_000_000
FIRST_FRAME_US = 3_000_000  # what a camera may take to start
BEADS_LOST_AFTER_US = 500_000
OVERRUN_SHARE = 0.2  # of the frames of the last second were dropped


class FrameMonitor:
    """Counts frames and detects a stalled camera, lost beads and overruns.

    timeout_us: the camera counts as stalled after this time without a frame.
    frames, refused: since the start.
    """

    def __init__(self, timeout_us: int, now_us: int) -> None:
        self.frames = 0
        self.refused = 0
        self.last_us: int | None = None
        self.last_contact: Contact | None = None
        self._timeout_us = timeout_us
        self._started_us = now_us
        self._recent: deque[tuple[int, int]] = deque()  # (when published, dropped until then)
        self._few_beads_since_us: int | None = None

    def frame_estimated(self, now_us: int, contact: Contact, dropped: int) -> None:
        """Take note of an estimated frame. dropped: frames, since the start."""
        self.frames += 1
        self.refused += not contact.valid
        self.last_us, self.last_contact = now_us, contact
        self._recent.append((now_us, dropped))
        self._forget(now_us)
        few = not contact.valid and contact.beads_found < MIN_BEADS_SHARE * contact.beads_expected
        self._few_beads_since_us = (self._few_beads_since_us or now_us) if few else None

    def is_stalled(self, now_us: int) -> bool:
        """Return whether no frame came within the time limit."""
        return now_us >= self.stalls_at_us

    @property
    def stalls_at_us(self) -> int:
        """The time at which the camera counts as stalled unless a frame comes before."""
        if self.last_us is None:
            return self._started_us + max(FIRST_FRAME_US, self._timeout_us)
        return self.last_us + self._timeout_us

    def beads_are_lost(self, now_us: int) -> bool:
        """Return whether frames have shown too few beads for `BEADS_LOST_AFTER_US`."""
        since_us = self._few_beads_since_us
        return since_us is not None and now_us - since_us >= BEADS_LOST_AFTER_US

    def fps(self, now_us: int) -> float:
        """Return the number of frames in the last second."""
        self._forget(now_us)
        return 1e6 * len(self._recent) / RATE_WINDOW_US

    def overruns(self) -> bool:
        """Return whether more than `OVERRUN_SHARE` of the last second's frames were dropped."""
        if len(self._recent) < 2:
            return False
        dropped = self._recent[-1][1] - self._recent[0][1]
        return dropped > OVERRUN_SHARE * (dropped + len(self._recent) - 1)

    def _forget(self, now_us: int) -> None:
        while self._recent and self._recent[0][0] <= now_us - RATE_WINDOW_US:
            self._recent.popleft()
