"""Frames that wait while the controller's transmit queue is full: bounded, the oldest are sent first.

A PDO is superseded by the next one: PDOs are dropped when too many wait, oldest first. Other frames have a
bound of their own. A client repeats a request whose response is missing, and a heartbeat follows the last
one; an EMCY is sent only once, and is dropped last.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact_quantities import CONTACT_TPDOS

PDO_IDS = range(0x180, 0x580)  # predefined connection set (CiA 301, 7.3.3)
EMCY_IDS = range(0x081, 0x100)
MAX_PDOS = 16 * len(CONTACT_TPDOS)  # 16 contacts
MAX_OTHERS = 256  # an SDO block is 127 frames
MAX_PDO_AGE_US = 100_000


class TransmitQueue:
    """A queue with a bound for PDOs and one for other frames. dropped, others_dropped: since the start."""

    def __init__(self) -> None:
        self.dropped = 0
        self.others_dropped = 0
        self._waiting: deque[tuple[int, CanFrame]] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, now_us: int, frames: Iterable[CanFrame]) -> None:
        """Append frames; drop the oldest PDOs above `MAX_PDOS` and the oldest others above `MAX_OTHERS`."""
        self._waiting.extend((now_us, frame) for frame in frames)
        pdos = sum(frame.can_id in PDO_IDS for _, frame in self._waiting)
        others = len(self._waiting) - pdos
        if pdos > MAX_PDOS:
            self.dropped += self._drop_oldest(pdos - MAX_PDOS, lambda can_id: can_id in PDO_IDS)
        if others > MAX_OTHERS:
            excess = others - MAX_OTHERS
            dropped = self._drop_oldest(
                excess, lambda can_id: can_id not in PDO_IDS and can_id not in EMCY_IDS
            )
            dropped += self._drop_oldest(excess - dropped, lambda can_id: can_id in EMCY_IDS)
            self.others_dropped += dropped

    def fresh(self, now_us: int) -> list[CanFrame]:
        """Return the frames to send, in order; drop PDOs older than `MAX_PDO_AGE_US`."""
        kept = [
            one for one in self._waiting if one[1].can_id not in PDO_IDS or now_us - one[0] <= MAX_PDO_AGE_US
        ]
        if len(kept) < len(self._waiting):
            self.dropped += len(self._waiting) - len(kept)
            self._waiting = deque(kept)
        return [frame for _, frame in kept]

    def sent(self, count: int) -> None:
        """Remove the first `count` frames: they were sent."""
        for _ in range(count):
            self._waiting.popleft()

    def keep_emergencies(self) -> None:
        """Remove all frames but EMCYs: the bus is lost; clients repeat their requests, the node its PDOs."""
        self.dropped += sum(frame.can_id in PDO_IDS for _, frame in self._waiting)
        self._waiting = deque(one for one in self._waiting if one[1].can_id in EMCY_IDS)

    def _drop_oldest(self, count: int, is_droppable: Callable[[int], bool]) -> int:
        """Drop up to `count` frames with such an identifier; return how many were dropped."""
        kept: deque[tuple[int, CanFrame]] = deque()
        for since_us, frame in self._waiting:
            if count and is_droppable(frame.can_id):
                count -= 1
            else:
                kept.append((since_us, frame))
        dropped = len(self._waiting) - len(kept)
        self._waiting = kept
        return dropped
