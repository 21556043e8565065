"""Recognition of a program's own frames on a bus that it has reopened; pure.

A frame that waits in the kernel or in the hub while its socket is closed is still transmitted. The next
socket of the same program then receives it: to this socket it is a frame of another sender.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

from palpate_edge.can_bus.can_frame import CanFrame

REMEMBERED = 1024  # frames: as many as a long transmit queue (ip link set can0 txqueuelen 1000) may hold
SENT_WITHIN_US = 5_000_000  # before the bus was lost
EXPECTED_FOR_US = 2_000_000  # after the bus was reopened


class OwnFrames:
    """Frames sent before the bus was reopened. Each is expected once, for EXPECTED_FOR_US."""

    def __init__(self) -> None:
        self._sent: deque[tuple[int, CanFrame]] = deque(maxlen=REMEMBERED)
        self._expected: Counter[CanFrame] = Counter()
        self._expected_until_us = 0

    def sent(self, now_us: int, frames: Iterable[CanFrame]) -> None:
        """Remember frames that the bus has accepted."""
        self._sent.extend((now_us, frame) for frame in frames)

    def lost(self, now_us: int) -> None:
        """Expect the recent frames back: their socket is closed."""
        self._expected.update(frame for at_us, frame in self._sent if now_us - at_us <= SENT_WITHIN_US)
        self._sent.clear()

    def reopened(self, now_us: int) -> None:
        """Begin the time in which the frames may arrive."""
        self._expected_until_us = now_us + EXPECTED_FOR_US

    def is_echo(self, now_us: int, frame: CanFrame) -> bool:
        """Return whether a received frame is one of this program's; it is then expected once less."""
        if not self._expected:
            return False
        if now_us > self._expected_until_us:
            self._expected.clear()
            return False
        if not self._expected[frame]:
            return False
        self._expected[frame] -= 1
        return True
