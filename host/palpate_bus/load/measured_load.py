"""Measured bus load: bits on the wire in the last second, and counts for each identifier since the start."""

from __future__ import annotations

from collections import deque

WINDOW_US = 1_000_000
_BIN_US = 100_000


class BusLoad:
    """Counts frames and their bits, which are bit times of the nominal rate; a frame counts at the time at
    which it won arbitration."""

    def __init__(self) -> None:
        self.frames = 0
        self.bits = 0.0
        self.by_id: dict[int, tuple[int, float]] = {}  # identifier -> (frames, bits)
        self._bins: deque[tuple[int, float]] = deque()  # (bin number, bits), oldest first

    def count(self, won_at_us: int, can_id: int, bits: float) -> None:
        """Add one frame."""
        self.frames += 1
        self.bits += bits
        frames_of_id, bits_of_id = self.by_id.get(can_id, (0, 0.0))
        self.by_id[can_id] = (frames_of_id + 1, bits_of_id + bits)
        number = won_at_us // _BIN_US
        if self._bins and self._bins[-1][0] == number:
            self._bins[-1] = (number, self._bins[-1][1] + bits)
        else:
            self._bins.append((number, bits))
        self._forget(won_at_us)

    def window_bits(self, now_us: int) -> float:
        """Return the bits of the frames that won arbitration in the second before `now_us`, to 0.1 s."""
        self._forget(now_us)
        return sum(bits for _, bits in self._bins)

    def _forget(self, now_us: int) -> None:
        oldest = (now_us - WINDOW_US) // _BIN_US
        while self._bins and self._bins[0][0] <= oldest:
            self._bins.popleft()
