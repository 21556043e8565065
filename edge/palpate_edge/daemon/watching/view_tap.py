"""Pictures for the console: some of the frames, while somebody watches, into a ring in shared memory.

The capture thread offers each frame after its contact was handed over; without watchers that costs one
comparison. The bus loop takes what is to be sent.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import CaptureError
from palpate_edge.common.frame import Frame
from palpate_edge.common.local_clock import LocalClock, monotonic_us
from palpate_edge.daemon.watching.watch_messages import WatchedFrame, beads_shown
from palpate_edge.estimation.frame_estimator import BeadsInView

MOST_PICTURES_S = 10
PERIOD_US = 1_000_000 // MOST_PICTURES_S
EARLY_US = 10_000  # so that a camera of 30 frames/s gives each third frame, also when one comes early
OWNER_ONLY = 0o600

_log = logging.getLogger("palpate.console")


class PictureRate:
    """Chooses at most `MOST_PICTURES_S` frames a second, evenly."""

    def __init__(self) -> None:
        self._due_us = 0

    def takes(self, at_us: int) -> bool:
        """Return whether the frame exposed at this time is one of them."""
        late_us = at_us + EARLY_US - self._due_us
        if -PERIOD_US <= late_us < 0:
            return False
        self._due_us = (self._due_us if 0 <= late_us < PERIOD_US else at_us) + PERIOD_US
        return True


class ViewTap:
    """Writes at most `MOST_PICTURES_S` frames a second to a ring at `path`, which exists while needed.

    is_watched: set by the bus loop. beads: returns the beads of the frame that was estimated last.
    """

    def __init__(self, path: Path, clock: LocalClock, beads: Callable[[], BeadsInView | None]) -> None:
        self.is_watched = False
        self.path, self._clock, self._beads = path, clock, beads
        self._ring: RingWriter | None = None
        self._shape: tuple[int, ...] = ()
        self._rate = PictureRate()
        self._frame: WatchedFrame | None = None

    def offer(self, frame: Frame, contact: Contact) -> bool:
        """Return whether the bus loop has something to send; called by the capture thread, never waits."""
        if not self.is_watched:
            self.close()
            return False
        if not self._rate.takes(frame.exposed_at_us):
            return False
        if frame.image.shape != self._shape:
            self._open_ring(frame.image.shape)
        if self._ring is None:
            return False
        age_us = self._clock.now_us() - frame.exposed_at_us
        self._ring.write(frame.image, frame.sequence, monotonic_us() - age_us)
        beads = self._beads()
        self._frame = WatchedFrame(contact, age_us / 1000, None if beads is None else beads_shown(beads))
        return True

    def take(self) -> WatchedFrame | None:
        """Return the newest frame, once."""
        frame, self._frame = self._frame, None
        return frame

    def close(self) -> None:
        """Remove the ring."""
        ring, self._ring, self._shape = self._ring, None, ()
        if ring is not None:
            ring.close()

    def _open_ring(self, shape: tuple[int, ...]) -> None:
        """Make the ring; where that fails, no picture is shown until the watchers have left."""
        self.close()
        self._shape = shape
        channels = shape[2] if len(shape) == 3 else 1
        try:
            form = RingFormat(shape[1], shape[0], channels)
            self._ring = RingWriter(self.path, form, mode=OWNER_ONLY)
        except CaptureError as error:
            _log.warning("no pictures for the console: %s", error)
