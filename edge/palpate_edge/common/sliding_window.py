"""Growth of counters over the last minute; pure.

After months the totals since the start hide what happens now.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

WINDOW_US = 60_000_000


class SlidingWindow:
    """Samples of counters, kept for a minute."""

    def __init__(self) -> None:
        self._samples: deque[tuple[int, Sequence[int]]] = deque()

    def growth(self, now_us: int, counts: Sequence[int]) -> tuple[int, ...]:
        """Add a sample; return the growth of each counter since the window's oldest sample, at least 0."""
        while self._samples and not 0 <= now_us - self._samples[0][0] <= WINDOW_US:
            self._samples.popleft()
        self._samples.append((now_us, counts))
        return tuple(max(0, now - then) for now, then in zip(counts, self._samples[0][1], strict=True))


class DroppedFrames:
    """The share of the last minute's frames that were dropped.

    Frames dropped before the second estimated frame do not count: start-up and the first frame take long,
    and a source reports the frames that it dropped meanwhile with its second frame.
    """

    def __init__(self) -> None:
        self._window = SlidingWindow()

    def share(self, now_us: int, frames: int, dropped: int) -> float:
        """Return the share, 0 to 1. frames: estimated; both counters since the start."""
        if frames < 2:
            return 0.0
        frames, dropped = self._window.growth(now_us, (frames, dropped))
        return dropped / max(1, frames + dropped)
