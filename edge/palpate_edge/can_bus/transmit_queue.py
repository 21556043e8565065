"""Frames that wait while the controller's transmit queue is full: bounded, and what waits longest goes first.

A contact is worth nothing once the next is there; an EMCY or an SDO answer is said once. So PDOs are given
up, oldest first, and the others never.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError

PDO_IDS = range(0x180, 0x580)  # predefined connection set (CiA 301, 7.3.3)
EMCY_IDS = range(0x081, 0x100)
MAX_PDOS = 48  # 16 contacts
MAX_OTHERS = 256  # an SDO block is 127 frames
MAX_PDO_AGE_US = 100_000


class TransmitQueue:
    """dropped: PDOs given up since the start."""

    def __init__(self) -> None:
        self.dropped = 0
        self._waiting: deque[tuple[int, CanFrame]] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, now_us: int, frames: Iterable[CanFrame]) -> None:
        """Raises BusError when nothing but frames that may not be dropped fills it: the bus is dead."""
        self._waiting.extend((now_us, frame) for frame in frames)
        pdos = sum(frame.can_id in PDO_IDS for _, frame in self._waiting)
        if len(self._waiting) - pdos > MAX_OTHERS:
            raise BusError(
                f"{MAX_OTHERS} frames wait for a bus that takes none: check cabling, termination and bit rate"
            )
        if pdos > MAX_PDOS:
            self._drop_oldest_pdos(pdos - MAX_PDOS)

    def fresh(self, now_us: int) -> list[CanFrame]:
        """What is to be sent, in order; PDOs that are too old by now are given up."""
        kept = [
            one for one in self._waiting if one[1].can_id not in PDO_IDS or now_us - one[0] <= MAX_PDO_AGE_US
        ]
        if len(kept) < len(self._waiting):
            self.dropped += len(self._waiting) - len(kept)
            self._waiting = deque(kept)
        return [frame for _, frame in kept]

    def sent(self, count: int) -> None:
        """The first ones are on their way."""
        for _ in range(count):
            self._waiting.popleft()

    def keep_emergencies(self) -> None:
        """The bus is gone: what others wait for they ask again, what the node has to report stays."""
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
