"""A bus that goes and comes back: opened again with back-off, sent to without ever waiting.

Two ways to lose it. *Bus-off*: the controller took itself off; the descriptor stays good and the driver says
when it restarts. *Down*: the interface or the hub is gone; the bus is closed and opened anew.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum

from palpate_edge.can_bus.bus import Bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.transmit_queue import EMCY_IDS, TransmitQueue
from palpate_edge.common.errors import BusError, BusOffError

FIRST_RETRY_US, LONGEST_RETRY_US = 100_000, 2_000_000  # between two attempts to open it
FIRST_RESEND_US, LONGEST_RESEND_US = 500, 10_000  # between two attempts to send into a full queue

Stamped = tuple[int, CanFrame]


class BusState(Enum):
    UP = "up"
    BUS_OFF = "bus-off"
    DOWN = "down"


@dataclass(frozen=True, slots=True)
class BusStateChange:
    """The link is in another state than before; reason: why, empty when it is up."""

    state: BusState
    reason: str
    after_bus_off: bool


class ReconnectingBus:
    """Owns the `Bus` that `open_one` gives. Times are arguments; `receive` gives Unix stamps, as `Bus` does.

    retries: refused attempts to send; restarts: how often it came back.
    """

    def __init__(self, open_one: Callable[[], Bus]) -> None:
        """Raises BusError: what cannot be opened at the start will not come by waiting."""
        self.state = BusState.UP
        self.retries = 0
        self.restarts = 0
        self._open_one = open_one
        self._bus: Bus | None = open_one()
        self._openings = 1
        self._queue = TransmitQueue()
        self._changes: list[BusStateChange] = []
        self._early_frames: list[Stamped] = []
        self._was_bus_off = False
        self._restarts_seen = 0
        self._retry_us = FIRST_RETRY_US
        self._retry_at_us = 0
        self._resend_us = FIRST_RESEND_US
        self._resend_at_us: int | None = None
        self.sent = self.received = 0

    @property
    def dropped(self) -> int:
        """PDOs that a full queue cost."""
        return self._queue.dropped

    @property
    def error_passive(self) -> bool:
        return self._bus is not None and self._bus.error_passive

    def descriptor(self) -> tuple[int, int] | None:
        """(file descriptor, how often it was opened): polls readable when `receive` has something.

        None while down. The number of a descriptor may come again, so it is told with its opening.
        """
        return None if self._bus is None else (self._bus.fileno(), self._openings)

    def accept(self, can_ids: Sequence[int]) -> None:
        """Another receive filter; one that is opened later has it from `open_one`."""
        if self._bus is not None:
            with suppress(BusError):  # it is gone: `receive` will tell
                self._bus.accept(can_ids)

    def changes(self) -> list[BusStateChange]:
        """What has changed since the last call."""
        changes, self._changes = self._changes, []
        return changes

    def receive(self, now_us: int) -> list[Stamped]:
        """What has come; a failure changes the state, it never raises."""
        if self._bus is None:
            return []
        frames, self._early_frames = self._early_frames, []
        try:
            frames += self._bus.receive(0)
        except BusOffError as error:
            self._enter(BusState.BUS_OFF, str(error))
        except BusError as error:
            self._go_down(now_us, str(error))
            return frames
        self.received += len(frames)
        if self.state is BusState.BUS_OFF and (frames or self._bus.counters.restarts > self._restarts_seen):
            self._come_up()
        return frames

    def send(self, now_us: int, frames: Sequence[CanFrame]) -> None:
        """Send these behind what waits; while there is no bus only emergencies wait for it."""
        if self.state is BusState.UP and not self._queue:
            frames = frames[self._offer(now_us, frames) :]
        if self.state is not BusState.UP:
            frames = [frame for frame in frames if frame.can_id in EMCY_IDS]
        try:
            self._queue.put(now_us, frames)
        except BusError as error:
            self._go_down(now_us, str(error))
        if self._queue and (self._resend_at_us is None or now_us >= self._resend_at_us):
            self._flush(now_us)

    def poll(self, now_us: int) -> None:
        """What is due: opening the bus again, sending what waits."""
        if self.state is BusState.DOWN and now_us >= self._retry_at_us:
            self._reopen(now_us)
        elif self._resend_at_us is not None and now_us >= self._resend_at_us:
            self._flush(now_us)

    @property
    def due_us(self) -> int | None:
        """When `poll` has something to do."""
        return self._retry_at_us if self.state is BusState.DOWN else self._resend_at_us

    def close(self) -> None:
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def _flush(self, now_us: int) -> None:
        self._resend_at_us = None
        if self.state is BusState.UP:
            self._queue.sent(self._offer(now_us, self._queue.fresh(now_us)))

    def _offer(self, now_us: int, frames: Sequence[CanFrame]) -> int:
        """How many of the frames the bus took at once; the others are due a little later."""
        if self._bus is None or not frames:
            return 0
        try:
            taken = self._bus.try_send(frames)
        except BusError as error:
            self._go_down(now_us, str(error))
            return 0
        self.sent += taken
        if taken:
            self._resend_us = FIRST_RESEND_US
        if taken < len(frames):
            self.retries += 1
            self._resend_at_us = now_us + self._resend_us
            self._resend_us = min(2 * self._resend_us, LONGEST_RESEND_US)
        return taken

    def _reopen(self, now_us: int) -> None:
        """Open it and look whether it carries anything: a socket on a link that is down opens as well."""
        bus = None
        try:
            bus = self._open_one()
            self._openings += 1
            self._early_frames = bus.receive(0)
        except BusOffError as error:
            self._bus = bus
            self._enter(BusState.BUS_OFF, str(error))
            return
        except BusError:
            if bus is not None:
                bus.close()
            self._retry_us = min(2 * self._retry_us, LONGEST_RETRY_US)
            self._retry_at_us = now_us + self._retry_us
            return
        self._bus = bus
        self._come_up()

    def _come_up(self) -> None:
        self.restarts += 1
        self._retry_us = FIRST_RETRY_US
        self._enter(BusState.UP, "")
        self._was_bus_off = False
        self._resend_at_us = 0  # the emergencies that wait

    def _go_down(self, now_us: int, reason: str) -> None:
        self.close()
        self._retry_at_us = now_us + self._retry_us
        self._enter(BusState.DOWN, reason)

    def _enter(self, state: BusState, reason: str) -> None:
        if state is self.state:
            return
        self.state = state
        if state is BusState.BUS_OFF:
            assert self._bus is not None
            self._was_bus_off = True
            self._restarts_seen = self._bus.counters.restarts
        self._changes.append(BusStateChange(state, reason, self._was_bus_off))
        if state is not BusState.UP:
            self._resend_at_us = None
            self._queue.keep_emergencies()
