"""Frames that wait while the controller's transmit queue is full: bounded, the oldest are sent first.

A PDO is superseded by the next one, whereas an EMCY or an SDO response is sent only once. PDOs are therefore
dropped when too many wait, oldest first; other frames never.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact_quantities import CONTACT_TPDOS
from palpate_edge.common.errors import BusError

PDO_IDS = range(0x180, 0x580)  # predefined connection set (CiA 301, 7.3.3)
EMCY_IDS = range(0x081, 0x100)
MAX_PDOS = 16 * len(CONTACT_TPDOS)  # 16 contacts
MAX_OTHERS = 256  # an SDO block is 127 frames
MAX_PDO_AGE_US = 100_000


class TransmitQueue:
    """A queue with a bound for PDOs and one for other frames. dropped: PDOs, since the start."""

    def __init__(self) -> None:
        self.dropped = 0
        self._waiting: deque[tuple[int, CanFrame]] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, now_us: int, frames: Iterable[CanFrame]) -> None:
        """Append frames; drop the oldest PDOs above `MAX_PDOS`.

        Raises BusError when more than `MAX_OTHERS` frames wait that must not be dropped: the bus is dead.
        """
        self._waiting.extend((now_us, frame) for frame in frames)
        pdos = sum(frame.can_id in PDO_IDS for _, frame in self._waiting)
        if len(self._waiting) - pdos > MAX_OTHERS:
            raise BusError(
                f"{MAX_OTHERS} frames wait and the bus accepts none: check cabling, termination and bit rate"
            )
        if pdos > MAX_PDOS:
            self._drop_oldest_pdos(pdos - MAX_PDOS)

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

    def _drop_oldest_pdos(self, count: int) -> None:
        kept: deque[tuple[int, CanFrame]] = deque()
        for since_us, frame in self._waiting:
            if count and frame.can_id in PDO_IDS:
                count -= 1
                self.dropped += 1
            else:
                kept.append((since_us, frame))
        self._waiting = kept
