"""How much counters have grown within the last window; pure.

Since the start says little after months: one loss would be told for ever, and a thousand would vanish among
all the frames that were not lost.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

WINDOW_US = 60_000_000


class SlidingWindow:
    """Looks at counters now and then, and remembers those looks that are at most a window old."""

    def __init__(self) -> None:
        self._looks: deque[tuple[int, Sequence[int]]] = deque()

    def growth(self, now_us: int, counts: Sequence[int]) -> tuple[int, ...]:
        """By how much each is above the oldest look; nothing at the first one."""
        while self._looks and not 0 <= now_us - self._looks[0][0] <= WINDOW_US:
            self._looks.popleft()
        self._looks.append((now_us, counts))
        return tuple(max(0, now - then) for now, then in zip(counts, self._looks[0][1], strict=True))


class DroppedFrames:
    """The share of the last window's frames that was dropped.

    What was dropped while everything was loaded does not count, nor what was while the first frame was worked
    on: a source tells of the latter with its second frame.
    """

    def __init__(self) -> None:
        self._window = SlidingWindow()

    def share(self, now_us: int, frames: int, dropped: int) -> float:
        """0 to 1. frames: that were estimated; both since the start."""
        if frames < 2:
            return 0.0
        frames, dropped = self._window.growth(now_us, (frames, dropped))
        return dropped / max(1, frames + dropped)
